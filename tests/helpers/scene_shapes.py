"""Shapes of the scenes in tests/scenes: blocks of several meshes, slopes, and things that move as they are told."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from yasps.meshes import TetrahedralMesh, TriangleMesh, box, ground

Floats = NDArray[np.float64]
SLOPE = float(np.arctan(0.5))
"""26.565 degrees: friction of 0.5 just holds."""


def block(
    size: tuple[float, float, float], divisions: tuple[int, int, int] = (1, 1, 1), *, seed: int | None = None
) -> TetrahedralMesh:
    """A block that stands on z = 0. seed: moves the columns of vertices inside about, by up to a quarter of a cell."""
    shape = box(size, divisions).translated((0.0, 0.0, 0.5 * size[2]))
    if seed is None:
        return shape
    points = shape.vertices.copy()
    cell = np.array(size[:2]) / divisions[:2]
    inside = (np.abs(points[:, :2]) < 0.5 * np.array(size[:2]) - 0.5 * cell).all(axis=1)
    # All layers alike: a load on the upper face then goes straight down.
    layers = inside.reshape(-1, divisions[2] + 1)
    moves = np.random.default_rng(seed).uniform(-0.25, 0.25, (len(layers), 1, 2)) * cell
    points[:, :2] += (layers[:, :, None] * moves).reshape(-1, 2)
    shaken = TetrahedralMesh(points, shape.tets)
    assert (shaken.volumes() > 0).all()
    return shaken


def outside(shape: TetrahedralMesh) -> TriangleMesh:
    """The surface of a body as an obstacle's shape."""
    return TriangleMesh(shape.vertices, shape.surface_triangles())


def tilted(shape: TriangleMesh, angle: float) -> TriangleMesh:
    """Turned about the y axis: what faced up faces down the slope, +x."""
    turn = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
    return TriangleMesh(shape.vertices @ turn.T, shape.triangles)


def slope_directions(angle: float) -> tuple[Floats, Floats]:
    """Normal of a slope and the way down on it."""
    return np.array([np.sin(angle), 0.0, np.cos(angle)]), np.array([np.cos(angle), 0.0, -np.sin(angle)])


def slope_mesh(angle: float, size: float = 8.0, divisions: int = 1) -> TriangleMesh:
    """A square through the origin with that slope."""
    return tilted(ground((size, size), 0.0, (divisions, divisions)), angle)


def disc(radius: float, corners: int = 24) -> TriangleMesh:
    """A level disc at z = 0, a fan of triangles that faces up."""
    angles = 2 * np.pi * np.arange(corners) / corners
    rim = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(corners)])
    first = np.arange(1, corners + 1)
    triangles = np.column_stack([np.zeros(corners, int), first, np.roll(first, -1)])
    return TriangleMesh(np.vstack([np.zeros(3), rim]), triangles.astype(np.int32))


def turned(points: ArrayLike, angle: float) -> Floats:
    """Points turned about the z axis."""
    return np.asarray(points, float) @ Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix().T


def joined(shapes: list[TriangleMesh]) -> TriangleMesh:
    """Several surfaces as one."""
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])[:-1]
    return TriangleMesh(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.triangles + start for shape, start in zip(shapes, starts, strict=True)]).astype(np.int32),
    )


def point_areas(shape: TetrahedralMesh) -> Floats:
    """A third of the areas of all adjacent surface triangles [m^2], [n]: what contact weighs a vertex with."""
    return _shares(shape, shape.surface_triangles())


def lower_areas(shape: TetrahedralMesh) -> Floats:
    """The same of the triangles that face down: what a pressure from below acts on."""
    triangles = shape.surface_triangles()
    normals = _normals(shape, triangles)
    return _shares(shape, triangles[normals[:, 2] < -0.5 * np.linalg.norm(normals, axis=1)])


def _normals(shape: TetrahedralMesh, triangles: NDArray[np.int32]) -> Floats:
    corners = shape.vertices[triangles]
    return np.asarray(0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def _shares(shape: TetrahedralMesh, triangles: NDArray[np.int32]) -> Floats:
    areas = np.zeros(len(shape.vertices))
    np.add.at(areas, triangles.ravel(), np.repeat(np.linalg.norm(_normals(shape, triangles), axis=1) / 3, 3))
    return areas
