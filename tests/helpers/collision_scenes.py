"""Small surfaces that are close to each other, and the barrier potential of their close pairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yasps.contact import ActiveSet

Floats = NDArray[np.float64]
Mesh = tuple[Floats, NDArray[np.int32]]

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
ONE = np.array([[0, 1, 2]], np.int32)


def sheet(cells: int, height: float = 0.0) -> Mesh:
    """Unit square in the plane z = height, split into cells x cells x 2 triangles."""
    x, y = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    a, b, c, d = corner, corner + cells + 1, corner + 1, corner + cells + 2
    triangles = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
    return points, triangles.astype(np.int32)


def box() -> Mesh:
    points = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    return points, np.array(faces, np.int32)


def union(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    faces = [triangles + int(start) for (_, triangles), start in zip(meshes, starts, strict=False)]
    return np.concatenate([points for points, _ in meshes]), np.concatenate(faces).astype(np.int32)


def move(mesh: Mesh, shift: tuple[float, float, float], turn: float = 0.0, noise: float = 0.0) -> Mesh:
    """Turn about the z axis, shake by `noise` and shift."""
    points, faces = mesh
    c, s = np.cos(turn), np.sin(turn)
    shaken = points + noise * np.random.default_rng(5).standard_normal(points.shape)
    return shaken @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + np.array(shift), faces


def renumbered(mesh: Mesh, seed: int) -> Mesh:
    """The same surface with its vertices in another order, and its triangles too, each from another corner on."""
    rng = np.random.default_rng(seed)
    points, faces = mesh
    new_id = rng.permutation(len(points))
    moved = np.empty_like(points)
    moved[new_id] = points
    turned = np.array([np.roll(face, rng.integers(3)) for face in new_id[faces]], np.int32)
    return moved, rng.permutation(turned)


# (scene, activation distance): aligned sheets and boxes give exactly parallel edges, small turns and shaking
# mollified pairs of every kind, large turns plain ones.
SCENES: dict[str, tuple[Mesh, float]] = {
    "aligned sheets": (union(sheet(3), move(sheet(3), (0.1, 0.05, 0.05))), 0.2),
    "shifted past each other": (union(sheet(2), move(sheet(2), (1.03, 1.04, 0.02))), 0.1),
    "nearly parallel": (union(sheet(3), move(sheet(3), (0.02, 0.01, 0.06), turn=0.004, noise=0.003)), 0.2),
    "shaken": (union(sheet(4), move(sheet(4), (0.07, 0.02, 0.12), turn=0.02, noise=0.01)), 0.2),
    "turned": (union(sheet(4), move(sheet(4), (0.1, -0.2, 0.07), turn=0.6, noise=0.01)), 0.15),
    "edges crossing at 0.015": (union(sheet(1), move(sheet(1), (1.003, 0.008, 0.03), turn=np.pi + 0.015)), 0.1),
    "edges crossing at 0.03": (union(sheet(1), move(sheet(1), (1.003, 0.012, 0.04), turn=np.pi + 0.03)), 0.1),
    "edges crossing at 0.001": (union(sheet(1), move(sheet(1), (1.003, 4e-4, 0.07), turn=np.pi + 0.001)), 0.1),
    "box corner to corner": (union(box(), move(box(), (1.02, 1.03, 1.01))), 0.1),
    "box edge along edge": (union(box(), move(box(), (1.02, 1.03, 0.3))), 0.1),
    "box edge across edge": (union(box(), move(box(), (1.02, 0.4, 0.3), turn=0.001)), 0.1),
}


def squared(x: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Sum of squares without conjugation, so that complex steps differentiate it."""
    return np.asarray(np.sum(x * x, axis=-1))


def distances(kind: str, x: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Squared distance of each pair; x [n, arity, 3] in the order of the ActiveSet's rows."""
    p = x.swapaxes(0, 1)
    if kind in ("point_point", "mollified_point_point"):
        return squared(p[1] - p[0])
    if kind in ("point_edge", "mollified_point_edge"):
        return squared(np.cross(p[1] - p[0], p[2] - p[1])) / squared(p[2] - p[1])
    if kind == "point_triangle":
        normal, arm = np.cross(p[2] - p[1], p[3] - p[1]), p[0] - p[1]
    else:
        normal, arm = np.cross(p[1] - p[0], p[3] - p[2]), p[2] - p[0]
    return squared(np.sum(normal * arm, axis=-1, keepdims=True)) / squared(normal)


EDGES_OF_KIND = {
    "mollified_edge_edge": (0, 1, 2, 3),
    "mollified_point_edge": (0, 3, 1, 2),
    "mollified_point_point": (0, 2, 1, 3),
}


def potential(active: ActiveSet, x: NDArray[np.complex128], rest: Floats, dhat: float) -> complex:
    """IPC barrier potential of unit stiffness with the barrier of eq. 8 of the yasps paper.

    rest: [n, 3], for its mollifiers.
    """
    at_rest = rest.astype(np.complex128)
    total = 0j
    for kind, pairs in active.kinds().items():
        points = x[pairs.vertices]
        d = distances(kind, points)
        energy = (d - dhat**2) ** 2 * np.log(d / dhat**2) ** 2
        if kind in EDGES_OF_KIND:
            a0, a1, b0, b1 = EDGES_OF_KIND[kind]
            cross = squared(np.cross(points[:, a1] - points[:, a0], points[:, b1] - points[:, b0]))
            still = at_rest[pairs.vertices]
            threshold = 1e-3 * squared(still[:, a1] - still[:, a0]) * squared(still[:, b1] - still[:, b0])
            ratio = cross / threshold
            energy = energy * ratio * (2 - ratio)
        total += complex(np.sum(pairs.weight * energy))
    return total
