"""The fixed part of every device program: the files of runtime/cuda, each with what it includes."""

from __future__ import annotations

import re
from importlib.resources import files

from yasps.runtime.toolchain import Source

_INCLUDE = re.compile(r'^#include "([^"]+)"\n', re.MULTILINE)
_PRAGMA_ONCE = re.compile(r"^#pragma once\n", re.MULTILINE)


def runtime_sources() -> list[Source]:
    """All files of device code, by their names without ending. Headers are inlined: a text says all it means."""
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
        return _INCLUDE.sub(included, _PRAGMA_ONCE.sub("", _text(name)))

    return _INCLUDE.sub(included, text)


def _text(name: str) -> str:
    return files("yasps.runtime").joinpath("cuda", name).read_text(encoding="utf-8")
