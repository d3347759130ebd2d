"""Tetrahedral meshes from and to files, through meshio."""

import contextlib
import io
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import meshio
import numpy as np
import numpy.typing as npt

from yasps.frontend.tetrahedral_mesh import (
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
            cells, or its mesh breaks a rule of `TetrahedralMesh`; the message names the file.
    """
    file = Path(path)
    if not file.is_file():
        kind = "is a folder" if file.is_dir() else "does not exist"
        raise MeshError(f"Cannot read a mesh from '{file}': it {kind}. The working folder is '{Path.cwd()}'.")
    with _meshio_errors_as_mesh_errors(f"Cannot read a mesh from '{file}'"):
        contents = meshio.read(file)
    return _tetrahedral_mesh(contents, file, flip_inverted)


def write_mesh(path: str | Path, mesh: TetrahedralMesh) -> None:
    """Write a mesh in the format that the file's ending names (.msh, .vtk, .vtu, .mesh, ...).

    Raises:
        MeshError: the folder is missing, or meshio cannot write the format.
    """
    file = Path(path)
    if not file.parent.is_dir():
        raise MeshError(f"Cannot write a mesh to '{file}': the folder '{file.parent}' does not exist. Create it first.")
    with _meshio_errors_as_mesh_errors(f"Cannot write a mesh to '{file}'"):
        meshio.write(file, meshio.Mesh(mesh.vertices, [("tetra", mesh.tets)]))


def _tetrahedral_mesh(contents: meshio.Mesh, file: Path, flip_inverted: bool) -> TetrahedralMesh:
    blocks = [block.data for block in contents.cells if block.type == "tetra"]
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
    vertices = np.asarray(contents.points, dtype=np.float64)
    tets = np.concatenate(blocks).astype(np.int64)
    try:
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


def _cell_counts(contents: meshio.Mesh) -> dict[str, int]:
    counts: dict[str, int] = {}
    for block in contents.cells:
        counts[block.type] = counts.get(block.type, 0) + len(block.data)
    return counts


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in counts.items()) or "no cells at all"


@contextlib.contextmanager
def _meshio_errors_as_mesh_errors(what_failed: str) -> Iterator[None]:
    """Keep meshio silent, and raise one MeshError for whatever it does: it prints, it calls sys.exit, and its parsers
    let every kind of error through when a file is not what its ending says."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            yield
    except (Exception, SystemExit) as error:
        said = [line.strip() for line in printed.getvalue().splitlines()]
        told = str(error) if not isinstance(error, SystemExit) else ""
        reasons = dict.fromkeys(filter(None, [*said, told and f"{type(error).__name__}: {told}"]))
        endings = ", ".join(sorted(ending for ending in meshio.extension_to_filetypes if ending))
        raise MeshError(
            f"{what_failed} ({'; '.join(reasons) or type(error).__name__}). Is the file whole, and of the format that "
            f"its ending says? Known endings: {endings}."
        ) from error
