"""Lines of the user's Python, for messages and for the IR."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).parents[2]


@dataclass(frozen=True)
class Location:
    """A line of the user's Python."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@cache
def _is_ours(file: str) -> bool:
    """Is the file in a folder of the package? Examples are not ours: they are users."""
    place = Path(file)
    return place.is_relative_to(_PACKAGE) and not place.is_relative_to(_PACKAGE / "examples")


def user_location() -> Location:
    """The innermost line outside yasps on the call stack; examples count as users."""
    frame = sys._getframe(1)
    while frame.f_back is not None and _is_ours(frame.f_code.co_filename):
        frame = frame.f_back
    return Location(frame.f_code.co_filename, frame.f_lineno)
