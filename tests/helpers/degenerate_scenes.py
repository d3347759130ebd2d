"""Contacts in which everything is degenerate at once: corners, edges and faces on each other, exactly aligned; spikes,
wedges, cracks, cliffs and stacks. Each is a list of bodies and one of obstacles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from yasps.meshes import TetrahedralMesh, TriangleMesh, box, ground
from yasps.meshes.tetrahedral_mesh import Vector

SIZE = 0.1  # m, of a cube
GAP = 6e-4  # m, between surfaces at first; the activation distance is 1e-3
FALL = (0.0, 0.0, -0.3)  # m/s: five gaps in one step
LEVEL = ground((2.0, 2.0))

Things = tuple[list[TetrahedralMesh], list[TriangleMesh]]
"""Bodies and obstacles."""


def cube() -> TetrahedralMesh:
    """Its lowest point at the origin's height."""
    return box((SIZE,) * 3, (1, 1, 1)).translated((0.0, 0.0, SIZE / 2))


def on_edge() -> TetrahedralMesh:
    """A cube that stands on an edge along x."""
    return resting(cube().rotated((1.0, 0.0, 0.0), np.pi / 4))


def on_corner() -> TetrahedralMesh:
    """A cube that stands on a corner, its diagonal upright."""
    return resting(cube().rotated((1.0, -1.0, 0.0), np.arctan(np.sqrt(2.0))))


def resting(shape: TetrahedralMesh) -> TetrahedralMesh:
    """The shape moved so that its lowest vertex is at the origin."""
    return shape.translated(-shape.vertices[np.argmin(shape.vertices[:, 2])])


def spike(up: bool = False) -> TetrahedralMesh:
    """A thin tetrahedron, its tip at the origin and the rest above it, or below."""
    angles = 2 * np.pi * np.arange(3) / 3
    corners = np.column_stack([0.02 * np.cos(angles), 0.02 * np.sin(angles), np.full(3, SIZE)])
    shape = TetrahedralMesh(np.vstack([np.zeros(3), corners]), np.array([[1, 2, 3, 0]])[:, [0, 2, 1, 3]])
    return shape.rotated((1.0, 0.0, 0.0), np.pi) if up else shape


def wedge() -> TetrahedralMesh:
    """A prism, its sharp edge along y through the origin and 20 degrees wide."""
    half = SIZE * np.tan(np.radians(10.0))
    section = np.array([[0.0, 0.0], [half, SIZE], [-half, SIZE]])
    points = np.array([[x, y, z] for y in (-SIZE / 2, SIZE / 2) for x, z in section])
    tets = np.array([[0, 1, 2, 5], [0, 1, 5, 4], [0, 4, 5, 3]])
    volumes = np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]])
    tets[volumes < 0] = tets[volumes < 0][:, [0, 2, 1, 3]]
    return TetrahedralMesh(points, tets)


def surface(shape: TetrahedralMesh, offset: Vector = (0.0, 0.0, 0.0)) -> TriangleMesh:
    """A body's surface as an obstacle."""
    return TriangleMesh(shape.translated(offset).vertices, shape.surface_triangles())


def at(shape: TetrahedralMesh, *offset: float) -> TetrahedralMesh:
    return shape.translated(np.asarray(offset))


def block(x: float, z: float = 0.0) -> TriangleMesh:
    """A fixed cube below z, its left face at x."""
    return surface(cube(), (x + SIZE / 2, 0.0, z - SIZE))


def groove(angle: float) -> TriangleMesh:
    """Two planes that meet in an edge along y, `angle` from the vertical."""
    x, z = np.sin(angle), np.cos(angle)
    points = np.array([[0, -1, 0], [0, 1, 0], [x, -1, z], [x, 1, z], [-x, -1, z], [-x, 1, z]])
    return TriangleMesh(points, np.array([[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]], np.int32))


def in_groove() -> Things:
    """A wedge of 20 degrees in a groove of 24, evenly off both planes."""
    return [at(wedge(), 0.0, 0.0, GAP / np.sin(np.radians(12.0)))], [groove(np.radians(12.0))]


def in_crack() -> Things:
    """A cube between two walls, as near to both as to the ground."""
    return [at(cube(), 0.0, 0.0, GAP)], [block(-1.5 * SIZE - GAP, 0.11), block(0.5 * SIZE + GAP, 0.11), LEVEL]


def bed_of_spikes() -> Things:
    places = [(x, y) for x in (-0.03, 0.03) for y in (-0.03, 0.03)]
    return [at(cube(), 0.0, 0.0, GAP)], [surface(spike(up=True), (x, y, 0.0)) for x, y in places]


SCENES: dict[str, Callable[[], Things]] = {
    "corner on corner": lambda: ([at(on_corner(), 0.0, 0.0, GAP)], [surface(spike(up=True))]),
    "corner on edge": lambda: ([at(on_corner(), 0.0, 0.0, GAP)], [surface(on_edge(), (0.0, 0.0, -SIZE * 2**0.5))]),
    "corner on face": lambda: ([at(on_corner(), 0.1, 0.3, GAP)], [LEVEL]),
    "corner on a vertex of the ground": lambda: ([at(on_corner(), 0.0, 0.0, GAP)], [ground((2.0, 2.0), 0.0, (2, 2))]),
    "edge across edge": lambda: (
        [at(on_edge().rotated((0.0, 0.0, 1.0), np.pi / 2), 0.0, 0.0, GAP)],
        [surface(on_edge(), (0.0, 0.0, -SIZE * 2**0.5))],
    ),
    "edge along edge": lambda: ([at(on_edge(), 0.0, 0.0, GAP)], [surface(on_edge(), (0.0, 0.0, -SIZE * 2**0.5))]),
    "edge on face": lambda: ([at(on_edge(), 0.1, 0.3, GAP)], [LEVEL]),
    "edge along the diagonal of the ground": lambda: (
        [at(on_edge().rotated((0.0, 0.0, 1.0), np.pi / 4), 0.0, 0.0, GAP)],
        [LEVEL],
    ),
    "face on the same face": lambda: ([at(cube(), 0.0, 0.0, GAP)], [block(-SIZE / 2)]),
    "face on half a face": lambda: ([at(cube(), 0.0, 0.0, GAP)], [block(-0.02)]),
    "cliff": lambda: ([at(cube(), 0.0, 0.0, GAP)], [block(0.0)]),
    "crack": in_crack,
    "spike on spike": lambda: ([at(spike(), 0.0, 0.0, GAP)], [surface(spike(up=True))]),
    "spike on face": lambda: ([at(spike(), 0.0, 0.0, GAP)], [LEVEL]),
    "bed of spikes": bed_of_spikes,
    "wedge in a groove": in_groove,
    "stack": lambda: ([at(cube(), 0.0, 0.0, (SIZE + GAP) * k + GAP) for k in range(3)], [LEVEL]),
}
