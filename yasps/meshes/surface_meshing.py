"""Tetrahedra inside a closed triangle surface, by fTetWild (the extra `tetwild`)."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np

from yasps.frontend.language.arrays import vertices_and_elements
from yasps.meshes.shapes import TriangleMesh
from yasps.meshes.tetrahedral_mesh import (
    Float64Array,
    Int32Array,
    MeshError,
    TetrahedralMesh,
    drop_unused_vertices,
    flip_inverted_tets,
)

ENVELOPE = 1e-3
"""How far the new surface may lie from the given one, in diagonals of the box around it (fTetWild's default)."""

LEFTOVER = Path("__tracked_surface.stl")
"""What fTetWild leaves in the working folder."""


def tetrahedralize(surface: TriangleMesh, edge_length: float | None = None) -> TetrahedralMesh:
    """Tetrahedra that fill a closed surface, whose own surface is a new one: within 1/1000 of the diagonal of the box
    around it, with other vertices. Another call may give another mesh: keep the result (`write_mesh`) where runs shall
    be repeated.

    surface: closed and facing outwards, vertices [n, 3] in m. edge_length [m]: what edges have about; default 1/20 of
    that diagonal. Hu et al. 2020, "Fast tetrahedral meshing in the wild".

    Raises ShapeMismatchError for wrong shapes, DataError for wrong numbers and indices, MeshError for a surface that is
    open or faces inwards, and where pytetwild is missing or fails.
    """
    vertices, triangles = vertices_and_elements(surface.vertices, surface.triangles, 3, ("vertices", "triangles"))
    _check_closed(vertices, triangles)
    diagonal = float(np.linalg.norm(np.ptp(vertices[triangles.reshape(-1)], axis=0)))
    if edge_length is None:
        edge_length = diagonal / 20
    if not (isinstance(edge_length, float | int | np.floating) and 0 < edge_length < np.inf):
        raise MeshError(f"edge_length is {edge_length!r}, but it is a positive number of metres.")
    try:
        pytetwild = importlib.import_module("pytetwild")
    except ImportError as error:
        raise MeshError(
            "Meshing the inside of a surface needs pytetwild: pip install 'yasps[tetwild]'. Or give a tetrahedral mesh."
        ) from error
    try:
        # Copies, because it takes no arrays that are read-only.
        points, tets = pytetwild.tetrahedralize(
            vertices.copy(), triangles.copy(), edge_length_abs=float(edge_length), epsilon=ENVELOPE, quiet=True
        )
    except (RuntimeError, ValueError) as error:
        raise MeshError(f"pytetwild could not mesh the surface: {error}") from error
    finally:
        LEFTOVER.unlink(missing_ok=True)
    if len(tets) == 0:
        raise MeshError("pytetwild found no inside: does the surface cross itself?")
    tets, _ = flip_inverted_tets(points, tets)
    points, tets = drop_unused_vertices(points, tets)
    return TetrahedralMesh(points, tets.astype(np.int32))


def tetrahedra_of(shape: TetrahedralMesh | TriangleMesh) -> TetrahedralMesh:
    """The mesh itself, or the inside of a closed surface. Raises MeshError for no mesh, and what `tetrahedralize`
    raises."""
    if not isinstance(shape, TetrahedralMesh | TriangleMesh):
        raise MeshError(f"a body is made of a TetrahedralMesh or a closed TriangleMesh, got {shape!r}")
    return tetrahedralize(shape) if isinstance(shape, TriangleMesh) else shape


def _check_closed(vertices: Float64Array, triangles: Int32Array) -> None:
    """Raises MeshError unless every edge is used once in each direction, and the volume inside is positive."""
    if len(triangles) == 0:
        raise MeshError("The surface has no triangles.")
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    forward, backward = (edges @ np.array(weights) for weights in ([len(vertices), 1], [1, len(vertices)]))
    numbers, counts = np.unique(forward, return_counts=True)
    alone = np.setdiff1d(forward, backward)
    if len(alone) or counts.max() > 1:
        edge = alone[0] if len(alone) else numbers[counts > 1][0]
        reason = "borders one triangle only" if len(alone) else "is used twice in one direction"
        raise MeshError(
            f"The surface is not closed: the edge of vertices {edge // len(vertices)} and {edge % len(vertices)} "
            f"{reason}. Close its holes, merge vertices that lie on each other, and let all triangles face outwards."
        )
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    if not volume > 0:
        raise MeshError(
            f"The surface encloses a volume of {volume:.3g} m^3: its triangles face inwards. Swap two vertices of each."
        )
