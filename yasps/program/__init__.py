"""Scenes as programs: one set of flags, what a run says and leaves behind, and a check of its end."""

from yasps.program.options import Options
from yasps.program.scene_program import CheckFailedError, SceneProgram

__all__ = ["CheckFailedError", "Options", "SceneProgram"]
