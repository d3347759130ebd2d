"""A square mat whose ends turn in opposite directions, until it folds and meets itself (the paper, E.1 and table 2).

The mat is a sheet of rubber, 1 mm thick. The rows of vertices at its two ends turn about its long axis; nothing else
acts, not even gravity. By half a turn of one end against the other its rims have come to the axis, and the mat meets
itself; from then on it rolls up into a rope. The paper turns each end at 5 rad/s for 2000 steps; this scene turns
faster, so that 200 steps show all of that.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps.bodies import Body, Cloth
from yasps.meshes import cloth_grid
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

SIDE, THICKNESS = 0.2, 1e-3  # m
YOUNGS_MODULUS, POISSON_RATIO, DENSITY = 1e6, 0.45, 1000.0  # Pa, none, kg/m^3: soft rubber
REACH = 0.3  # activation distance in sides of a cell
TOLERANCE = 1e-2  # m/s, of Newton's method; the ends move at 2 m/s
MEETS_ITSELF = 4.0  # rad: after this turn of one end against the other it has, at any resolution
OFF_AXIS = 0.02  # how far its centre may be from where it was, in sides: nothing pushes it aside

PROGRAM = SceneProgram("mat_twist", __doc__, frames=200, time_step=0.001, size=2500, size_means="vertices of the mat")
PROGRAM.add_argument("--speed", type=float, default=20.0, help="of each end [rad/s] (20)")


def ends(mat: Body) -> dict[float, NDArray[np.int64]]:
    """The vertices at either end, by the sign of their turn."""
    along = mat.rest[:, 0]
    return {-1.0: np.flatnonzero(along == along.min()), 1.0: np.flatnonzero(along == along.max())}


def turned(points: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Points [n, 3] after a turn about the x axis [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]]))


def build(options: Options) -> Simulation:
    """The mat in the plane z = 0, its middle at the origin, its ends at x = -SIDE / 2 and SIDE / 2."""
    scene = PROGRAM.scene(options)
    cells = max(round(options.size**0.5) - 1, 2)
    mat = Cloth(
        scene,
        "mat",
        cloth_grid((SIDE, SIDE), (cells, cells)),
        area_density=DENSITY * THICKNESS,
        stretch=0.5 * YOUNGS_MODULUS * THICKNESS,
        shear=0.25 * YOUNGS_MODULUS * THICKNESS / (1 + POISSON_RATIO),
        bending=YOUNGS_MODULUS * THICKNESS**3 / (12 * (1 - POISSON_RATIO**2)),
    )
    simulation = Simulation(
        scene,
        [mat],
        time_step=options.dt,
        gravity=(0.0, 0.0, 0.0),
        activation_distance=REACH * SIDE / cells,
        settings=NewtonSettings(velocity_tolerance=TOLERANCE, max_iterations=500),
    )
    for sign, vertices in ends(mat).items():
        places, speed = mat.rest[vertices], sign * options.speed
        simulation.pin(mat, vertices, motion=lambda time, places=places, speed=speed: turned(places, speed * time))
    return simulation


def check(simulation: Simulation, options: Options) -> str:
    """The ends are where they were turned to, the mat is on its axis, and it meets itself if it was turned far."""
    (mat,) = simulation.moving
    x, turn = mat.positions(), 2 * options.speed * simulation.time
    for sign, vertices in ends(mat).items():
        off = np.abs(x[vertices] - turned(mat.rest[vertices], sign * 0.5 * turn)).max()
        if off > 1e-9 * SIDE:
            raise CheckFailedError(f"an end is {off:.2g} m from where it was turned to")
    aside = float(np.linalg.norm(x.mean(axis=0)))
    if aside > OFF_AXIS * SIDE:
        raise CheckFailedError(f"the centre of the mat has moved by {1e3 * aside:.1f} mm, though nothing pushes it")
    gaps = simulation.contact_forces().normal.gap
    if abs(turn) >= MEETS_ITSELF and not len(gaps):
        raise CheckFailedError(f"the mat does not meet itself after a turn of {turn:.2f} rad")
    met = f"{len(gaps)} pairs touch, {1e3 * gaps.min():.2g} mm apart or more" if len(gaps) else "it has not met itself"
    return f"after {simulation.time:.3f} s one end has turned by {turn:.2f} rad against the other: {met}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run mat_twist`."""
    return PROGRAM.run(arguments, build, check, view_direction=(0.4, -1.0, 0.5), speed=0.05)


if __name__ == "__main__":
    sys.exit(main())
