"""Files with the state of a simulation: named arrays of numbers."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from yasps import SceneError
from yasps.meshes.tetrahedral_mesh import Float64Array

PAST = "past/"
"""How names of what a state has of the step before it begin: a state may be without."""


def write_state(state: Mapping[str, Float64Array], name: str) -> Path:
    """Writes a state to a new file of this name, in a folder of its own among those for temporary files."""
    file = Path(tempfile.mkdtemp(prefix="yasps-")) / f"{name}.npz"
    np.savez(file, allow_pickle=False, **state)
    return file


def read_state(file: str | Path, like: Mapping[str, Float64Array]) -> dict[str, Float64Array]:
    """The state in a file, which has the names and shapes of another, but for the step before it. Raises SceneError for
    any other file."""
    try:
        with np.load(file, allow_pickle=False) as stored:
            state = {name: np.asarray(stored[name]) for name in stored.files}
    except (OSError, ValueError, AttributeError, TypeError, zipfile.BadZipFile) as problem:
        raise SceneError(f"{file} holds no state of a simulation: {problem}") from problem
    here, there = ({name: x.shape for name, x in one.items() if not name.startswith(PAST)} for one in (like, state))
    if here != there:
        differing = sorted(set(here) ^ set(there)) or [name for name in here if here[name] != there[name]]
        raise SceneError(f"{file} is the state of another scene: {differing[0]} differs")
    return state
