"""The fixed part of every device program: the .cu files of the runtime, each with what it includes."""

from __future__ import annotations

import re
from pathlib import Path

from yasps.runtime.build.toolchain import RUNTIME, Source

_INCLUDE = re.compile(r'^#include "([^"]+)"\n', re.MULTILINE)


def runtime_sources() -> list[Source]:
    """All files of device code, by their names without ending. Headers are inlined: a text says all it means.

    Lines are numbered as in the files, so that what compilers and compute-sanitizer say can be looked up there.
    """
    paths = sorted((path for path in RUNTIME.rglob("*.cu") if path.parent.name != "host"), key=lambda path: path.stem)
    return [Source(path.stem, with_includes(_text(path))) for path in paths]


def with_includes(text: str) -> str:
    """The text with the files of the runtime that it includes, each once."""
    seen: set[str] = set()

    def included(match: re.Match[str]) -> str:
        name = match.group(1)
        if name in seen:
            return ""
        seen.add(name)
        return _INCLUDE.sub(included, _text(RUNTIME / name))

    return _INCLUDE.sub(included, text)


def _text(path: Path) -> str:
    """A file that says of its lines which they are."""
    lines = [f'#line 1 "{path.name}"']
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        lines.append("" if line == "#pragma once" else line)
        if line.startswith("#include"):
            lines.append(f'#line {number + 1} "{path.name}"')
    return "\n".join(lines) + "\n"
