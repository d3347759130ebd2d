"""A row of dominoes: the first is pushed, the last falls.

The dominoes are affine bodies; friction with the ground keeps their feet in place while they tip.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from yasps import Scene
from yasps.bodies import AffineBody, HalfSpace
from yasps.contact import ContactTable
from yasps.meshes import box
from yasps.output import FrameRecorder
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

THICKNESS, WIDTH, HEIGHT = 0.02, 0.05, 0.1  # m
SPACING = 0.05  # m, from one to the next
DISTANCE = 5e-4  # m, of activation
PUSH = 4.0  # rad/s, of the first domino at the start


def dominoes(count: int = 12, scene: Scene | None = None) -> Simulation:
    """The row along x on the ground at z = 0; the first one has been pushed."""
    scene = scene or Scene("dominoes")
    shape = box((THICKNESS, WIDTH, HEIGHT), (1, 1, 1))
    row = [
        AffineBody(scene, f"domino_{k}", shape.translated((k * SPACING, 0.0, 0.5 * HEIGHT + 0.98 * DISTANCE)))
        for k in range(count)
    ]
    contacts = ContactTable(friction=0.2)
    for domino in row:
        contacts.set(domino.name, "ground", friction=0.6)
    simulation = Simulation(
        scene,
        [*row, HalfSpace(scene, "ground")],
        time_step=0.005,
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run dominoes`; 1 if one of them still stands."""
    parser = argparse.ArgumentParser(prog="yasps run dominoes", description=__doc__)
    parser.add_argument("--dominoes", type=int, default=12, help="how many (default 12)")
    parser.add_argument("--frames", type=int, default=240, help="time steps of 0.005 s (default 240)")
    parser.add_argument("--output", type=Path, default=Path("output/dominoes"), help="folder for files")
    parser.add_argument("--no-pictures", action="store_true", help="no picture and no animation")
    options = parser.parse_args(arguments)
    simulation = dominoes(options.dominoes)
    with FrameRecorder(simulation, options.output, "dominoes", pictures=not options.no_pictures) as files:
        simulation.run(options.frames, files)
    fallen = sum(angle > 45.0 for angle in tilts(simulation))
    print(f"after {simulation.time:.2f} s {fallen} of {options.dominoes} dominoes have fallen")
    return 0 if fallen == options.dominoes else 1


if __name__ == "__main__":
    sys.exit(main())
