"""A house of cards that friction alone holds up.

The cards are affine bodies. Two that lean against each other push their feet apart with at most the tangent of their
angle times the load, which is less than the friction there. Their upper edges meet along a line, as real cards do. On
each level but the top one lies a card that is long enough for all pairs below it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps.bodies import AffineBody, HalfSpace
from yasps.contact import ContactTable
from yasps.meshes import TetrahedralMesh, box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

LENGTH, WIDTH, THICKNESS = 0.1, 0.06, 0.003  # m, of a card
ANGLE = np.radians(22.0)  # of a leaning card, from the vertical
DISTANCE = 5e-4  # m, of activation
GAP = 0.98 * DISTANCE  # between cards at the start: near where they come to rest
SLIP_SPEED = 1e-5  # m/s: friction that holds lets things creep slower than this
SETTLING = 1e-3  # m: how far a card may move until it rests

PROGRAM = SceneProgram("card_house", __doc__, frames=100, time_step=0.01, size=2, size_means="levels of the house")
PROGRAM.add_argument("--friction", type=float, default=0.5, help="coefficient everywhere (0.5)")


def leaning_pair(x: float, z: float) -> list[TetrahedralMesh]:
    """Two cards that lean against each other, `GAP` apart at x, their feet at height z."""
    card = box((THICKNESS, WIDTH, LENGTH), (1, 1, 1))
    cards = []
    for side in (-1.0, 1.0):
        tilted = card.rotated((0.0, 1.0, 0.0), -side * ANGLE)
        inner = (tilted.vertices[:, 0] * side).min()
        cards.append(tilted.translated((x + side * (0.5 * GAP) - side * inner, 0.0, z - tilted.vertices[:, 2].min())))
    return cards


def cards_of_house(levels: int) -> list[TetrahedralMesh]:
    """As many pairs on the ground as there are levels, a card that lies on all of them, one pair fewer on it, ..."""
    corners = np.concatenate([card.vertices for card in leaning_pair(0.0, 0.0)])
    span, height = np.ptp(corners[:, 0]) + 2 * THICKNESS, corners[:, 2].max()
    cards, foot = [], GAP
    for pairs in range(levels, 0, -1):
        for number in range(pairs):
            cards += leaning_pair((number - 0.5 * (pairs - 1)) * span, foot)
        if pairs > 1:
            flat = box(((pairs - 1) * span + 0.35 * LENGTH, 1.1 * WIDTH, THICKNESS), (1, 1, 1))
            cards.append(flat.translated((0.0, 0.0, foot + height + GAP + 0.5 * THICKNESS)))
        foot += height + 2 * GAP + THICKNESS
    return cards


def build(options: Options) -> Simulation:
    """The house on the ground at z = 0."""
    scene = PROGRAM.scene(options)
    cards = [
        AffineBody(scene, f"card_{number}", shape, density=1000.0, youngs_modulus=1e8)
        for number, shape in enumerate(cards_of_house(options.size))
    ]
    return Simulation(
        scene,
        [*cards, HalfSpace(scene, "ground")],
        time_step=options.dt,
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=options.friction),
        eps_v=SLIP_SPEED,
        settings=NewtonSettings(
            velocity_tolerance=0.1 * SLIP_SPEED, relative_force_tolerance=1e-3, solver="direct", max_iterations=500
        ),
    )


def check(simulation: Simulation, options: Options) -> str:
    """Every card is where it was built."""
    moved = {card.name: float(np.abs(card.positions() - card.rest).max()) for card in simulation.moving}
    most = max(moved, key=lambda name: moved[name])
    if moved[most] > SETTLING:
        raise CheckFailedError(
            f"{most} has moved by {1e3 * moved[most]:.1f} mm after {simulation.time:.2f} s with a coefficient of"
            f" friction of {options.friction}: the house does not stand"
        )
    return f"after {simulation.time:.2f} s the house stands: no card has moved by more than {1e3 * moved[most]:.3f} mm"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run card_house`."""
    return PROGRAM.run(arguments, build, check)


if __name__ == "__main__":
    sys.exit(main())
