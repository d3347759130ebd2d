"""Files of named arrays that are there wholly or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps import SceneError

Arrays = Mapping[str, NDArray[Any]]


class DamagedStateError(SceneError):
    """A file that is no state of a simulation or fit, or no longer a whole one."""


def write_arrays(file: Path, arrays: Arrays) -> None:
    """Writes an .npz file; whoever looks, also after a crash or a power cut, sees the whole file or the one before.

    Raises SceneError if the system does not let it; the file before is still there then.
    """
    unfinished = file.with_name(f".{file.name}.unfinished")
    try:
        with unfinished.open("wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays)
            stream.flush()
            os.fsync(stream.fileno())
        unfinished.replace(file)
        _sync_folder(file.parent)
    except OSError as problem:
        raise SceneError(f"the state can't be written to {file}: {problem}") from problem
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """A new name is safe when its folder is."""
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def read_arrays(file: Path, of: str = "simulation") -> dict[str, NDArray[Any]]:
    """All arrays of such a file. Raises DamagedStateError, which says what it should be a state `of`."""
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return {name: np.asarray(stored[name]) for name in stored.files}
    except Exception as problem:  # damage shows anywhere: in zip, its methods and flags, zlib, the header of an array
        told = str(problem) or type(problem).__name__
        raise DamagedStateError(f"{file} holds no state of a {of}: {told}") from problem
