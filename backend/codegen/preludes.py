"""The fixed texts that generated files begin with."""

from __future__ import annotations

from pathlib import Path

from yasps.runtime.core import sink

_BACKEND = Path(__file__).parents[1]
PRELUDES = {
    "runtime/core/sink.h": sink.TEXT,
    **{
        f"backend/{path.relative_to(_BACKEND).as_posix()}": path.read_text(encoding="utf-8")
        for path in sorted(_BACKEND.glob("*/preludes/*.*h"))
    },
}
"""By their paths in the repository."""


def without_preludes(text: str) -> str:
    """A generated text with a comment in place of each prelude."""
    for path, prelude in PRELUDES.items():
        text = text.replace(prelude, f"// {path} stands here\n")
    return text
