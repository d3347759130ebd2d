"""Results files of made-up motions, without a simulation: bodies as far as output sees them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from yasps.meshes import box
from yasps.output import FrameRecorder

DT = 0.02
CUBE = box((1.0, 1.0, 1.0), (1, 1, 1))
NO_FACES, NO_EDGES, NO_POINTS = np.empty((0, 3), np.int32), np.empty((0, 2), np.int32), np.empty(0, np.int32)


@dataclass(eq=False)
class Solid:
    """A body of tetrahedra."""

    name: str
    x: Any
    triangles: Any
    cells: Any
    edges: Any = field(default_factory=lambda: NO_EDGES)
    points: Any = field(default_factory=lambda: NO_POINTS)
    radius: float = 0.0
    stands_still: bool = False
    is_fixed: bool = False

    def positions(self) -> Any:
        return self.x

    def radii(self) -> Any:
        return np.full(len(self.x), self.radius)


class Sheet(Solid):
    """One of triangles, with a rim."""


class Rod(Solid):
    """One of edges."""


class Wall(Solid):
    """One that stands still."""


class Floor(Solid):
    """A half-space."""

    def __init__(self, name: str, normal: Any = (0.0, 0.0, 1.0), point: Any = (0.0, 0.0, 0.0)) -> None:
        super().__init__(name, np.empty((0, 3)), NO_FACES, {}, stands_still=True, is_fixed=True)
        self.plane = SimpleNamespace(normal=normal, point=point)
        self.shape = SimpleNamespace(vertices=np.array([[0, 0, 0], [10.0, 0, 0], [10, 10, 0], [0, 10, 0]]))


def cube(name: str, middle: Any) -> Solid:
    shape = CUBE.translated(middle)
    return Solid(name, shape.vertices, shape.surface_triangles(), {"tetra": shape.tets})


def sheet(name: str, middle: Any, side: float = 2.0, cells: int = 4) -> Sheet:
    steps = np.linspace(-0.5 * side, 0.5 * side, cells + 1)
    x = np.array([[a, b, 0.0] for a in steps for b in steps]) + middle
    corner = np.array([(cells + 1) * i + j for i in range(cells) for j in range(cells)])[:, None]
    halves = np.array([[0, cells + 1, 1], [1, cells + 1, cells + 2]])
    triangles = np.concatenate([corner + half for half in halves]).astype(np.int32)
    return Sheet(name, x, triangles, {"triangle": triangles})


def rod(name: str, points: Any, radius: float) -> Rod:
    edges = np.array([[i, i + 1] for i in range(len(points) - 1)], np.int32)
    return Rod(name, np.array(points, float), NO_FACES, {"line": edges}, edges=edges, radius=radius)


def wall(name: str, middle: Any) -> Wall:
    shape = CUBE.translated(middle)
    faces = shape.surface_triangles()
    return Wall(name, shape.vertices, faces, {"triangle": faces}, stands_still=True, is_fixed=True)


class Motion:
    """What a recorder sees of a simulation: bodies that move by themselves, each with its velocity [m/s]."""

    def __init__(self, *bodies: Solid, velocities: dict[str, Any] | None = None) -> None:
        self.bodies = list(bodies)
        self.time = 0.0
        self.contact = "some"
        self.velocities = velocities or {}

    def velocity_of(self, body: Solid) -> Any:
        return np.broadcast_to(np.asarray(self.velocities.get(body.name, (0.0, 0.0, 0.0)), float), body.x.shape)

    def contact_forces(self) -> Any:
        forces = [np.tile([0.0, 0.0, 1.0 + k], (len(body.x), 1)) for k, body in enumerate(self.bodies)]
        return SimpleNamespace(on_vertices=lambda: np.concatenate(forces))

    def step(self) -> None:
        self.time += DT
        for body in self.bodies:
            body.x = body.x + DT * self.velocity_of(body)


def everything() -> Motion:
    """A cube, a sheet, a rod, a wall, a floor and a slope; the first three move."""
    return Motion(
        cube("cube", (0.0, 0.0, 2.0)),
        sheet("sheet", (2.5, 0.0, 1.0)),
        rod("rod", [[-3.0, 0.1 * i, 0.6 + 0.05 * i] for i in range(12)], 0.12),
        wall("wall", (0.0, 3.0, 0.5)),
        Floor("floor"),
        Floor("slope", normal=(0.0, -0.6, 0.8), point=(0.0, 4.0, 0.0)),
        velocities={"cube": (1.0, 0.0, -2.0), "sheet": (0.0, 0.0, -1.0), "rod": (0.0, 1.0, 0.0)},
    )


def record(motion: Motion, folder: Path, frames: int, name: str = "motion", **options: Any) -> Path:
    """Records so many frames and gives the file."""
    with FrameRecorder(motion, folder, name, **({"pictures": False} | options)) as recorder:
        for frame in range(frames):
            if frame:
                motion.step()
            recorder.record(motion)
    return recorder.file
