"""Reads a mesh file by meshio, in a process of its own: `python -P mesh_reader.py FILE ARRAYS BYTES SECONDS`.

meshio's parsers believe what a file says of itself: they ask for the memory it claims to need, and some wait for ever
for numbers that it claims to have. Here they have limits. This file imports nothing of yasps, to start fast.

ARRAYS, an `.npz` file, gets `points`, and of each block of cells its type in `types`, its length in `counts`, and where
it is of tetrahedra its indices as `cells/N`.
"""

import resource
import sys
from pathlib import Path
from typing import Any

import meshio
import numpy as np

OUT_OF_MEMORY = 3
"""Exit status of a reader whose memory did not suffice."""


def save_arrays(file: Path, arrays: Path) -> None:
    """Reads the mesh and writes its arrays. Raises whatever meshio raises, which may be anything."""
    mesh = meshio.read(file)
    found: dict[str, Any] = {
        "points": np.asarray(mesh.points, dtype=np.float64),
        "types": np.array([block.type for block in mesh.cells], dtype=np.str_),
        "counts": np.array([len(block.data) for block in mesh.cells], dtype=np.int64),
    }
    for k, block in enumerate(mesh.cells):
        if block.type == "tetra":
            found[f"cells/{k}"] = np.asarray(block.data)
    np.savez(arrays, **found)


def main(file: str, arrays: str, most_bytes: str, most_seconds: str) -> int:
    """Reads within the limits; what went wrong is on stderr, and the exit status is not 0 then."""
    resource.setrlimit(resource.RLIMIT_AS, (int(most_bytes),) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a reader that is stopped leaves nothing behind
    resource.setrlimit(resource.RLIMIT_CPU, (int(most_seconds),) * 2)
    try:
        save_arrays(Path(file), Path(arrays))
    except MemoryError:
        return OUT_OF_MEMORY
    except Exception as error:  # noqa: BLE001 - parsers let every kind through when a file is not what its ending says
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
