"""Tetrahedral meshes from and to files, through meshio."""

import io
import logging
import os
import subprocess
import sys
import tempfile
import threading
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, cast

import meshio
import numpy as np
import numpy.typing as npt

from yasps.meshes.mesh_reader import OUT_OF_MEMORY
from yasps.meshes.tetrahedral_mesh import (
    Float64Array,
    Int32Array,
    MeshError,
    TetrahedralMesh,
    drop_unused_vertices,
    flip_inverted_tets,
)

logger = logging.getLogger(__name__)

# Cells that fill a volume; a mesh that mixes them with tetrahedra would have holes without them.
OTHER_VOLUME_CELLS = ("hexahedron", "wedge", "pyramid", "polyhedron", "VTK_LAGRANGE", "tetra")

# What reading may take: so much, and so much more for each byte of the file.
_MEMORY = (2**30, 200)
_SECONDS = (60, 1e-5)

# While a mesh is written, what is printed goes elsewhere, for all threads.
_one_writer = threading.Lock()


def read_tetrahedral_mesh(path: str | Path, *, flip_inverted: bool = False) -> TetrahedralMesh:
    """Read the tetrahedra of a mesh file, in any format that meshio reads (.msh, .vtk, .vtu, .mesh, .inp, .xdmf, ...).

    Lengths are taken as they are in the file. Blocks of tetrahedra are joined; points, lines and triangles, which mesh
    generators write next to the tetrahedra, are skipped. Vertices that no tetrahedron uses are dropped, and a line
    about it goes to the log.

    Args:
        path: the file.
        flip_inverted: turn inverted tetrahedra (negative volume) the right way round, and log how many. For files
            from programs with the other orientation convention. Flat tetrahedra are refused all the same.

    Raises:
        MeshError: the file is missing or unreadable, has no tetrahedra, has higher-order tetrahedra or other volume
            cells, claims to hold more than it does, or its mesh breaks a rule of `TetrahedralMesh`; the message names
            the file.
    """
    file = Path(path)
    if not file.is_file():
        kind = "is a folder" if file.is_dir() else "does not exist"
        raise MeshError(f"Cannot read a mesh from '{file}': it {kind}. The working folder is '{Path.cwd()}'.")
    return _tetrahedral_mesh(_read_arrays(file), file, flip_inverted)


def write_mesh(path: str | Path, mesh: TetrahedralMesh) -> None:
    """Write a mesh in the format that the file's ending names (.msh, .vtk, .vtu, .mesh, ...).

    Raises:
        MeshError: the folder is missing, or meshio cannot write the format.
    """
    file = Path(path)
    if not file.parent.is_dir():
        raise MeshError(f"Cannot write a mesh to '{file}': the folder '{file.parent}' does not exist. Create it first.")
    printed = io.StringIO()
    try:
        with _one_writer, redirect_stdout(printed), redirect_stderr(printed):
            meshio.write(file, meshio.Mesh(mesh.vertices, [("tetra", mesh.tets)]))
    except (Exception, SystemExit) as error:  # its writers let every kind through
        told = "" if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
        raise _failure(f"Cannot write a mesh to '{file}'", [*printed.getvalue().splitlines(), told]) from error


def _read_arrays(file: Path) -> dict[str, npt.NDArray[Any]]:
    """What `mesh_reader` finds in the file."""
    size = file.stat().st_size
    memory, seconds = (int(first + each * size) for first, each in (_MEMORY, _SECONDS))
    with tempfile.TemporaryDirectory(prefix="yasps-mesh-") as folder:
        arrays = Path(folder) / "arrays.npz"
        reader = Path(__file__).with_name("mesh_reader.py")
        command = [sys.executable, "-P", str(reader), str(file.absolute()), str(arrays), str(memory), str(seconds)]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False, errors="replace"
            )
            if done.returncode == 0:
                with np.load(arrays, allow_pickle=False) as found:
                    return dict(found)
        except (OSError, ValueError) as error:
            raise _failure(f"Cannot read a mesh from '{file}'", [f"{type(error).__name__}: {error}"]) from error
    reasons = [*done.stdout.splitlines(), *done.stderr.splitlines()]
    if done.returncode == OUT_OF_MEMORY:
        reasons = [f"its {size} bytes claim to hold more than fits into {memory / 1e9:.1f} GB of memory"]
    elif done.returncode < 0:
        reasons = [f"its reader did not end well (signal {-done.returncode}), within at most {seconds} s"]
    raise _failure(f"Cannot read a mesh from '{file}'", reasons)


def _tetrahedral_mesh(contents: dict[str, npt.NDArray[Any]], file: Path, flip_inverted: bool) -> TetrahedralMesh:
    blocks = [array for name, array in contents.items() if name.startswith("cells/")]
    found = _cell_counts(contents)
    others = {kind: n for kind, n in found.items() if kind != "tetra" and kind.startswith(OTHER_VOLUME_CELLS)}
    if others:
        raise MeshError(
            f"'{file}' has volume cells that are not linear tetrahedra ({_listed(others)}). Every element must be a "
            "tetrahedron with four vertices: export the mesh at order 1 and with tetrahedra only."
        )
    if not any(len(block) for block in blocks):
        raise MeshError(
            f"'{file}' has no tetrahedra; it has {_listed(found)}. A surface must be filled with tetrahedra first, "
            "for example with pytetwild (pip install pytetwild), TetGen or Gmsh."
        )
    vertices = contents["points"]
    try:
        if any(block.dtype.kind not in "iu" for block in blocks):
            raise MeshError(f"Its vertex indices are numbers of type {blocks[0].dtype}, not integers.")
        if any(block.ndim != 2 or block.shape[1] != 4 for block in blocks):
            raise MeshError("Its tetrahedra have another number of vertices than four.")
        tets = np.concatenate(blocks).astype(np.int64)
        return _cleaned(vertices, tets, file, flip_inverted)
    except MeshError as error:
        raise MeshError(f"The mesh in '{file}' cannot be used. {error}") from error


def _cleaned(vertices: Float64Array, tets: npt.NDArray[np.int64], file: Path, flip_inverted: bool) -> TetrahedralMesh:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or tets.min() < 0 or tets.max() >= len(vertices):
        # Not fit for cleaning: the constructor says what is wrong.
        return TetrahedralMesh(vertices, cast(Int32Array, tets))
    kept, renumbered = drop_unused_vertices(vertices, tets)
    if flip_inverted and np.isfinite(kept).all():
        renumbered, flipped = flip_inverted_tets(kept, renumbered)
        if flipped:
            logger.warning("%s: turned %d of %d inverted tetrahedra the right way round", file, flipped, len(tets))
    mesh = TetrahedralMesh(kept, renumbered.astype(np.int32))
    if len(kept) < len(vertices):
        unused = len(vertices) - len(kept)
        logger.info("%s: dropped %d of %d vertices, in no tetrahedron", file, unused, len(vertices))
    return mesh


def _cell_counts(contents: dict[str, npt.NDArray[Any]]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for kind, count in zip(contents["types"].tolist(), contents["counts"].tolist(), strict=True):
        counts[kind] = counts.get(kind, 0) + count
    return counts


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in counts.items()) or "no cells at all"


def _failure(what_failed: str, reasons: list[str]) -> MeshError:
    told = "; ".join(dict.fromkeys(filter(None, map(str.strip, reasons)))) or "no reason was given"
    endings = ", ".join(sorted(ending for ending in meshio.extension_to_filetypes if ending))
    return MeshError(
        f"{what_failed} ({told}). Is the file whole, and of the format that its ending says? Known endings: {endings}."
    )
