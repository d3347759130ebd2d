"""The fixed part of every device program: the files of runtime/cuda, each with what it includes."""

from __future__ import annotations

import re
from importlib.resources import files

from yasps.runtime.toolchain import Source

_INCLUDE = re.compile(r'^#include "([^"]+)"\n', re.MULTILINE)


def runtime_sources() -> list[Source]:
    """All files of device code, by their names without ending. Headers are inlined: a text says all it means.

    Lines are numbered as in the files, so that what compilers and compute-sanitizer say can be looked up there.
    """
    folder = files("yasps.runtime").joinpath("cuda")
    names = sorted(item.name for item in folder.iterdir() if item.name.endswith(".cu"))
    return [Source(name.removesuffix(".cu"), with_includes(_text(name))) for name in names]


def with_includes(text: str) -> str:
    """The text with the files of runtime/cuda that it includes, each once."""
    seen: set[str] = set()

    def included(match: re.Match[str]) -> str:
        name = match.group(1)
        if name in seen:
            return ""
        seen.add(name)
        return _INCLUDE.sub(included, _text(name))

    return _INCLUDE.sub(included, text)


def _text(name: str) -> str:
    """A file that says of its lines which they are."""
    lines = [f'#line 1 "{name}"']
    text = files("yasps.runtime").joinpath("cuda", name).read_text(encoding="utf-8")
    for number, line in enumerate(text.splitlines(), 1):
        lines.append("" if line == "#pragma once" else line)
        if line.startswith("#include"):
            lines.append(f'#line {number + 1} "{name}"')
    return "\n".join(lines) + "\n"
