"""Files with the state of a simulation: named arrays of numbers."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from yasps import SceneError
from yasps.meshes.tetrahedral_mesh import Float64Array


def write_state(state: Mapping[str, Float64Array], name: str) -> Path:
    """Writes a state to a new file of this name, in a folder of its own among those for temporary files."""
    file = Path(tempfile.mkdtemp(prefix="yasps-")) / f"{name}.npz"
    np.savez(file, allow_pickle=False, **state)
    return file


def read_state(file: str | Path, like: Mapping[str, Float64Array]) -> dict[str, Float64Array]:
    """The state in a file, which has the names and shapes of another. Raises SceneError for any other file."""
    try:
        with np.load(file, allow_pickle=False) as stored:
            state = {name: np.asarray(stored[name]) for name in stored.files}
    except (OSError, ValueError, AttributeError, TypeError, zipfile.BadZipFile) as problem:
        raise SceneError(f"{file} holds no state of a simulation: {problem}") from problem
    if {name: value.shape for name, value in like.items()} != {name: value.shape for name, value in state.items()}:
        differing = sorted(set(like) ^ set(state)) or [n for n in like if like[n].shape != state[n].shape]
        raise SceneError(f"{file} is the state of another scene: {differing[0]} differs")
    return state
