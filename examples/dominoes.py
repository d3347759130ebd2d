"""A row of dominoes: the first is pushed, the last falls.

The dominoes are affine bodies; friction with the ground keeps their feet in place while they tip.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps.bodies import AffineBody, HalfSpace
from yasps.contact import ContactTable
from yasps.meshes import box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

THICKNESS, WIDTH, HEIGHT = 0.02, 0.05, 0.1  # m
SPACING = 0.05  # m, from one to the next
DISTANCE = 5e-4  # m, of activation
PUSH = 4.0  # rad/s, of the first domino at the start
FALLEN = 45.0  # degrees from upright

PROGRAM = SceneProgram("dominoes", __doc__, frames=240, time_step=0.005, size=12, size_means="dominoes")


def build(options: Options) -> Simulation:
    """The row along x on the ground at z = 0; the first one has been pushed."""
    scene = PROGRAM.scene(options)
    shape = box((THICKNESS, WIDTH, HEIGHT), (1, 1, 1))
    row = [
        AffineBody(scene, f"domino_{k}", shape.translated((k * SPACING, 0.0, 0.5 * HEIGHT + 0.98 * DISTANCE)))
        for k in range(options.size)
    ]
    contacts = ContactTable(friction=0.2)
    for domino in row:
        contacts.set(domino.name, "ground", friction=0.6)
    simulation = Simulation(
        scene,
        [*row, HalfSpace(scene, "ground")],
        time_step=options.dt,
        activation_distance=DISTANCE,
        contacts=contacts,
        settings=NewtonSettings(
            velocity_tolerance=1e-4, relative_force_tolerance=1e-3, solver="direct", max_iterations=500
        ),
    )
    # It turns about its lower front edge.
    simulation.set_velocity(row[0], (0.5 * PUSH * HEIGHT, 0.0, -0.5 * PUSH * THICKNESS), angular=(0.0, PUSH, 0.0))
    return simulation


def tilts(simulation: Simulation) -> list[float]:
    """Angle of each domino from upright [degrees]."""
    angles = []
    for domino in simulation.moving:
        matrix = domino.targets[0].value.reshape(3, 3)
        upright = matrix @ np.array([0.0, 0.0, 1.0])
        angles.append(float(np.degrees(np.arctan2(np.hypot(upright[0], upright[1]), upright[2]))))
    return angles


def check(simulation: Simulation, options: Options) -> str:
    """All of them have fallen."""
    fallen = sum(angle > FALLEN for angle in tilts(simulation))
    if fallen < options.size:
        raise CheckFailedError(
            f"after {simulation.time:.2f} s only {fallen} of {options.size} dominoes have fallen; give it more --frames"
        )
    return f"after {simulation.time:.2f} s all {options.size} dominoes have fallen"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run dominoes`."""
    return PROGRAM.run(arguments, build, check)


if __name__ == "__main__":
    sys.exit(main())
