"""Meshes of finite elements other than linear tetrahedra, from cells of meshio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from yasps.frontend.language.arrays import real_numbers, vertices_and_elements
from yasps.meshes.element_kinds import KINDS, TET_SIDES, TRIANGLE_SIDES, ElementKind
from yasps.meshes.shapes import TriangleMesh, grid_of_cells
from yasps.meshes.tetrahedral_mesh import Float64Array, Int32Array, MeshError, TetrahedralMesh


@dataclass(frozen=True)
class GaussPoints:
    """All Gauss points of a mesh, element by element: each one instance of an energy."""

    nodes: Int32Array
    """Of each point's element, [points, n]."""
    gradients: Float64Array
    """Of the shape functions at rest, [points, n, 3] in 1/m; for surfaces [points, n, 2], in plane coordinates."""
    volumes: Float64Array
    """What each stands for at rest [m^3], [points]; of surfaces areas [m^2]."""


@dataclass(frozen=True, eq=False, repr=False)
class ElementMesh:
    """A mesh of one kind of finite element.

    kind: of meshio: "tetra", "tetra10", "hexahedron", "triangle" or "triangle6"; nodes of a cell in the order of meshio
    (`mesh.cells_dict["tetra10"]`). vertices: all nodes, [n, 3]; cells: node numbers, [m, nodes of the kind].

    Raises MeshError for other kinds, unused nodes, and elements that are flat or inside out at a Gauss point;
    DataError, ShapeMismatchError.
    """

    kind: str
    vertices: Float64Array
    cells: Int32Array

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise MeshError(f"Elements are of the kinds {', '.join(KINDS)}, got {self.kind!r}.")
        x, cells = vertices_and_elements(self.vertices, self.cells, self._kind.nodes, ("vertices", "cells"))
        unused = np.flatnonzero(np.bincount(cells.ravel(), minlength=len(x)) == 0)
        if len(unused):
            raise MeshError(
                f"{len(unused)} of {len(x)} nodes belong to no element; the first is node {unused[0]}. It would have "
                "no mass: leave it out and number the others anew (numpy.unique(cells, return_inverse=True))."
            )
        x, cells = np.array(x), cells.astype(np.int32)
        x.flags.writeable = cells.flags.writeable = False
        object.__setattr__(self, "vertices", x)
        object.__setattr__(self, "cells", cells)
        self.points()

    def __repr__(self) -> str:
        return f"ElementMesh({len(self.cells)} cells {self.kind!r}, {len(self.vertices)} nodes)"

    @property
    def _kind(self) -> ElementKind:
        return KINDS[self.kind]

    def points(self, warp: ArrayLike = (1.0, 0.0, 0.0)) -> GaussPoints:
        """The Gauss points. warp: direction of the first plane coordinate of surfaces, projected into them.

        Raises MeshError for elements that are flat or inside out at one of them, DataError.
        """
        kind = self._kind
        slopes = kind.slopes(kind.points)
        by_local = np.einsum("mnc,qnd->mqcd", self.vertices[self.cells], slopes)  # 3 x d
        if kind.dimension == 2:
            by_local = _in_plane(by_local, real_numbers(warp, "warp"))
        size = np.linalg.det(by_local)
        wrong = np.flatnonzero(~(size > 0).all(axis=1))
        if wrong.size:
            raise MeshError(
                f"Cell {wrong[0]} ({self.kind}) is flat or inside out at rest ({wrong.size} cells are). Nodes stand in "
                "the order of meshio; exchange two corners, and the nodes between, of cells of the other convention."
            )
        gradients = np.einsum("qnd,mqde->mqne", slopes, np.linalg.inv(by_local))
        points = len(kind.points)
        return GaussPoints(
            np.repeat(self.cells, points, axis=0),
            gradients.reshape(-1, kind.nodes, kind.dimension),
            (size * kind.weights).reshape(-1),
        )

    def volumes(self) -> Float64Array:
        """Of each element [m^3], [m]; of surfaces areas [m^2]."""
        return np.asarray(self.points().volumes.reshape(len(self.cells), -1).sum(axis=1))

    def vertex_masses(self, density: float) -> Float64Array:
        """Lumped masses [kg], [n]: the diagonal of the consistent mass matrix of elements with straight sides, scaled
        to each element's mass (Hinton, Rock and Zienkiewicz 1976), so all are positive.

        density: kg/m^3, of surfaces kg/m^2. Raises MeshError for what is no positive number.
        """
        if not (np.isfinite(density) and density > 0):
            raise MeshError(f"The density is {density}, but a mass per volume must be a positive number.")
        masses = density * self.volumes()[:, None] * self._kind.masses
        return np.bincount(self.cells.ravel(), masses.ravel(), len(self.vertices)).astype(np.float64)

    def surface_triangles(self) -> Int32Array:
        """Triangles [k, 3] of all nodes of the surface, counter-clockwise seen from outside: four of a quadratic face,
        two of a quadrilateral, cut from its lowest node number, so that neighbours cut alike.

        What touches them pulls at the nodes themselves. Raises MeshError where more than two elements share a face.
        """
        kind = self._kind
        if kind.dimension == 2:
            return np.asarray(self.cells[:, np.array(kind.split[0])].reshape(-1, 3), np.int32)
        corners = np.stack([self.cells[:, face] for face in kind.faces], axis=1)
        flat = np.sort(corners.reshape(-1, corners.shape[2]), axis=1)
        _, inverse, counts = np.unique(flat, axis=0, return_inverse=True, return_counts=True)
        if counts.max() > 2:
            raise MeshError("More than two elements share a face: elements overlap or appear twice.")
        outside = (counts[inverse.reshape(-1)] == 1).reshape(len(self.cells), -1)
        if not kind.split:
            return _cut_quadrilaterals(corners[outside])
        triangles = np.stack([self.cells[:, np.array(split)] for split in kind.split], axis=1)
        return np.asarray(triangles[outside].reshape(-1, 3), np.int32)


def _in_plane(by_local: Float64Array, warp: Float64Array) -> Float64Array:
    """Derivatives of the plane's own two coordinates, 2 x 2, from those of points in space, 3 x 2."""
    normal = np.cross(by_local[..., 0], by_local[..., 1])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    along = warp - (normal @ warp)[..., None] * normal
    size = np.linalg.norm(along, axis=-1, keepdims=True)
    if not (size > 1e-6 * np.linalg.norm(warp)).all():
        raise MeshError(f"warp {tuple(warp.tolist())} is normal to an element: choose another direction.")
    along = along / size
    axes = np.stack([along, np.cross(normal, along)], axis=-2)
    return np.asarray(axes @ by_local)


def _cut_quadrilaterals(quads: Int32Array) -> Int32Array:
    """Two triangles of each, from its lowest node number."""
    first = quads.argmin(axis=1)
    turned = np.take_along_axis(quads, (first[:, None] + np.arange(4)) % 4, axis=1)
    return turned[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def quadratic(mesh: TetrahedralMesh | TriangleMesh) -> ElementMesh:
    """The same mesh with nodes in the middles of all sides: "tetra10" of tetrahedra, "triangle6" of triangles."""
    solid = isinstance(mesh, TetrahedralMesh)
    cells = np.asarray(mesh.tets if isinstance(mesh, TetrahedralMesh) else mesh.triangles)
    sides = np.sort(cells[:, np.array(TET_SIDES if solid else TRIANGLE_SIDES)], axis=2)
    ends, inverse = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    middles = len(mesh.vertices) + inverse.reshape(len(cells), -1)
    vertices = np.concatenate([mesh.vertices, mesh.vertices[ends].mean(axis=1)])
    return ElementMesh("tetra10" if solid else "triangle6", vertices, np.hstack([cells, middles]).astype(np.int32))


def hex_box(
    size: tuple[float, float, float] = (1.0, 1.0, 1.0), divisions: tuple[int, int, int] = (8, 8, 8)
) -> ElementMesh:
    """A box of hexahedra, its middle at the origin. size [m]; divisions: cells along x, y, z. Raises MeshError."""
    vertices, corner = grid_of_cells(size, divisions)
    order = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
    return ElementMesh("hexahedron", vertices, np.stack([corner[one] for one in order], axis=1).astype(np.int32))
