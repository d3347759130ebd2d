"""A block slides to a stop, and its coefficient of friction follows from where that is.

The distance is given; found is the coefficient with which the block slides as far, by Gauss-Newton steps with exact
derivatives through the whole slide: contact, friction, and the standstill at its end. Then the block slides once more,
with what was found. The textbook's answer is v^2 / (2 g d); steps of backward Euler stop v dt / 2 earlier.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps.bodies import AffineBody, HalfSpace
from yasps.contact import ContactTable
from yasps.inverse import PRECISE, Squares, Tied, Trajectory, Transform, fit
from yasps.meshes import box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

SIDE = 0.1  # m, of the block
SPEED = 1.0  # m/s, at the start
ACTIVATION = 2e-3  # m
GUESS = 0.6  # coefficient of friction to begin with
SETTLES = 10
"""Steps in which the block comes to rest where contact carries it."""
WITHIN, JITTERED, TEXTBOOK = 1e-4, 1e-2, 1e-2
"""How near the block must come to the given distance, also with another start (`--seed`), and the coefficient to that
of the textbook, relative."""
RECIPROCAL = Transform(lambda mu: 1 / mu, lambda y: 1 / y, lambda y: -1 / y**2)
"""The optimiser sees 1 / mu, to which the distance is nearly proportional."""

PROGRAM = SceneProgram("slide_to_stop", __doc__, frames=40, time_step=0.01)
PROGRAM.add_argument("--distance", type=float, default=0.12, help="how far the block shall slide, in metres (0.12)")


def slide(options: Options, friction: float, rest: Sequence[NDArray[np.float64]] = ()) -> Simulation:
    """The block on the ground at z = 0: in motion along x from where it rests, or about to come to rest. rest: values
    of its targets."""
    scene = PROGRAM.scene(options)
    start = (0.0, 0.0, 0.5 * SIDE + 0.98 * ACTIVATION)
    block = AffineBody(scene, "block", box((SIDE, SIDE, SIDE), (1, 1, 1)).translated(start))
    for target, value in zip(block.targets, rest, strict=False):
        target.update_value(value)
    simulation = Simulation(
        scene,
        [block, HalfSpace(scene, "ground")],
        time_step=options.dt,
        activation_distance=ACTIVATION,
        contacts=ContactTable(friction=friction),
        settings=PRECISE,
    )
    simulation.set_velocity(block, (SPEED if rest else 0.0, 0.0, 0.0))
    return simulation


def at_rest(options: Options) -> list[NDArray[np.float64]]:
    """Values of the block's targets where contact carries it."""
    simulation = slide(options, GUESS)
    for _ in range(SETTLES):
        simulation.step()
    return [target.value for target in simulation.moving[0].targets]


class SlideToStop:
    """Finds the coefficient, and slides with it. before, after: how far the block slid with the guess, and slides with
    what was found [m]."""

    def __init__(self) -> None:
        self.friction = GUESS
        self.before = self.after = np.nan

    def build(self, options: Options) -> Simulation:
        """The block, with the coefficient that was found."""
        rest = at_rest(options)
        simulation = slide(options, GUESS, rest)
        block = simulation.moving[0]
        way = block.vertices.add_constant("start", 3, 1, value=block.positions())
        short = block.vertices.add_attribute(
            "short", computed_attribute=((block.position - way)[0] - options.distance) / options.distance
        )
        trajectory = Trajectory(simulation, options.frames)
        assert simulation.contact is not None
        laws = simulation.contact.parts.laws
        friction = Tied(laws["friction"], laws["kinetic_friction"])
        trajectory.run()
        self.before = options.distance * (1 + float(short.value.mean()))
        found = fit(
            trajectory,
            Squares(short),
            friction,
            method="trust-ncg",
            transforms={friction: RECIPROCAL},
            max_iterations=10,
            options={"gtol": 1e-8},
        )
        self.friction = float(found[friction].max())
        return slide(options, self.friction, rest)

    def check(self, simulation: Simulation, options: Options) -> str:
        """The block has stopped where it was to stop, by a coefficient near that of the textbook."""
        (block,) = simulation.moving
        way = block.positions().mean(axis=0) - block.rest.mean(axis=0)
        self.after = float(way[0])
        speed = float(np.abs(simulation.velocity_of(block)).max())
        if speed > 1e-3 * SPEED:
            raise CheckFailedError(f"the block still slides at {speed:.3g} m/s after {simulation.time:.2f} s")
        if abs(self.after - options.distance) > (JITTERED if options.seed else WITHIN) * options.distance:
            raise CheckFailedError(f"the block slid {self.after:.6f} m and not {options.distance} m")
        textbook = SPEED**2 / (2 * 9.8 * (options.distance + 0.5 * SPEED * options.dt))
        if abs(self.friction - textbook) > TEXTBOOK * textbook:
            raise CheckFailedError(f"the coefficient is {self.friction:.5f}, but {textbook:.5f} by the textbook")
        return (
            f"with a coefficient of {GUESS} the block slid {self.before:.4f} m, with {self.friction:.5f} it slides"
            f" {self.after:.6f} m of {options.distance} m; by the textbook it is {textbook:.5f}"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run slide_to_stop`; 1 if the block stops elsewhere."""
    program = SlideToStop()
    return PROGRAM.run(arguments, program.build, program.check)


if __name__ == "__main__":
    sys.exit(main())
