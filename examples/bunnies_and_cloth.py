"""What the scenes of the paper's sections 9.1 to 9.3 share: shapes, and what must hold at their ends."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from yasps.meshes import TetrahedralMesh, rabbit, read_tetrahedral_mesh, signed_volumes
from yasps.output import OBSTACLE_GREY, PALETTE
from yasps.program import CheckFailedError

DIAGONAL = 1.0  # m, of the box around a bunny
CLOTH = "cloth_0"
GRAVITY = 9.8  # m/s^2
VIEW = (0.3, -1.0, 1.4)  # from the scene towards the camera


class Thing(Protocol):
    """A body of the kit, or one made by hand."""

    name: str
    cells: Mapping[str, NDArray[np.int32]]
    rest: NDArray[np.float64]

    def positions(self) -> NDArray[np.float64]:
        """[n, 3]."""


def number_of(text: str) -> int:
    """A number of bodies, of a flag. Raises argparse.ArgumentTypeError."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"it is a number of bodies, 0 or more, got {text!r}")
    return int(text)


def bunny_shape(size: int, mesh: Path | None) -> TetrahedralMesh:
    """The bunny, its middle at the origin: of a file with y up, or the rabbit, as fine as a cloth of `size` cells."""
    if mesh is not None:
        shape = read_tetrahedral_mesh(mesh).rotated((1.0, 0.0, 0.0), 0.5 * np.pi)
    else:
        shape = rabbit(max(1500, round(1.9 * size**2)))
    low, high = shape.bounds
    return shape.translated(-0.5 * (low + high)).scaled(DIAGONAL / float(np.linalg.norm(high - low)))


def place_of_bunny(number: int) -> tuple[float, float, float]:
    """Of the middle of one of many bunnies [m]: two beside each other, the next two above them."""
    return 0.4 * (-1) ** (number + number // 2), 0.0, 0.8 + 0.9 * (number // 2)


def colors_of(bunnies: int) -> dict[str, str]:
    """Light blue and dark pink in turn, and the cloth."""
    return {f"bunny_{number}": PALETTE[number % 2] for number in range(bunnies)} | {CLOTH: OBSTACLE_GREY}


def cloth_corners(cells: int) -> list[int]:
    """The corners of a square `cloth_grid` of so many cells along each side."""
    return [0, cells, cells * (cells + 1), (cells + 1) ** 2 - 1]


def check_end(things: Sequence[Thing], masses: Mapping[str, NDArray[np.float64]], motion: float) -> str:
    """What must hold of these scenes at any time; motion: the kinetic energy [J]. Raises CheckFailedError.

    The corners of the cloth are where they were, nothing has gone through it, no tetrahedron that is free is inside
    out, and nothing moves faster than by falling.
    """
    by_name = {thing.name: thing for thing in things}
    cloth = by_name[CLOTH]
    corners = cloth_corners(round(len(cloth.rest) ** 0.5) - 1)
    if not np.array_equal(cloth.positions()[corners], cloth.rest[corners]):
        raise CheckFailedError(f"the corners of {CLOTH} have moved")
    worst, fallen = np.inf, 0.0
    for thing in things:
        x, rest = thing.positions(), thing.rest
        fallen += GRAVITY * float(masses[thing.name] @ (rest - x)[:, 2])
        if (tets := thing.cells.get("tetra")) is not None:
            shares = signed_volumes(x, tets) / signed_volumes(rest, tets)
            worst = min(worst, float(shares.min()))
            if worst <= 0:
                raise CheckFailedError(f"tetrahedron {int(shares.argmin())} of {thing.name} is inside out")
        if thing is not cloth and not lies_above(_inside(thing), cloth.positions(), cloth.cells["triangle"]):
            raise CheckFailedError(f"{thing.name} is no longer above {CLOTH}")
    if motion > fallen + 1e-6 * abs(fallen):
        raise CheckFailedError(f"the motion has {motion:.6g} J, but only {fallen:.6g} J came from falling")
    lowest = float((cloth.positions() - cloth.rest)[:, 2].min())
    return (
        f"bodies above the cloth: {len(things) - 1}; it hangs {-lowest:.2f} m deep from its corners;"
        f" {motion:.3g} J of {fallen:.3g} J from falling are left as motion, and the flattest tetrahedron has"
        f" {worst:.2f} of its volume"
    )


def lies_above(point: NDArray[np.float64], vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> bool:
    """Whether a point [3] is above a sheet, however that is folded: of all triangles that its vertical line meets, as
    many more face up than down below it, and as many above it, as if the sheet were flat."""
    a, b, c = (vertices[triangles[:, k]] - point for k in range(3))
    sides = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))]
    met = np.all([side > 0 for side in sides], axis=0) | np.all([side < 0 for side in sides], axis=0)
    weights = np.stack(sides, axis=1)[met]
    heights = (weights * np.stack([a[met, 2], b[met, 2], c[met, 2]], axis=1)).sum(axis=1) / weights.sum(axis=1)
    return int(np.sign(weights[heights < 0, 0]).sum()) == 1 and int(np.sign(weights[heights > 0, 0]).sum()) == 0


def _inside(thing: Thing) -> NDArray[np.float64]:
    """A point of a thing, near the middle of its vertices, on no edge."""
    ids = next(iter(thing.cells.values()))
    x = thing.positions()[ids]
    middles = x.mean(axis=1)
    nearest = int(np.linalg.norm((middles - middles.mean(axis=0))[:, :2], axis=1).argmin())
    weights = np.array([0.23, 0.31, 0.46, 0.0][: ids.shape[1]])
    return np.asarray(weights @ x[nearest])
