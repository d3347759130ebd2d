"""A house of seven cards, two levels high, that friction alone holds up.

The cards are affine bodies. Two that lean against each other push their feet apart with at most the tangent of their
angle times the load, which is less than the friction there. Their upper edges meet along a line, as real cards do.
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
from yasps.meshes import TetrahedralMesh, box
from yasps.output import FrameRecorder
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

LENGTH, WIDTH, THICKNESS = 0.1, 0.06, 0.003  # m, of a card
ANGLE = np.radians(22.0)  # of a leaning card, from the vertical
DISTANCE = 5e-4  # m, of activation
GAP = 0.98 * DISTANCE  # between cards at the start: near where they come to rest
FRICTION = 0.5
SLIP_SPEED = 1e-5  # m/s: friction that holds lets things creep slower than this


def leaning_pair(x: float, z: float) -> list[TetrahedralMesh]:
    """Two cards that lean against each other, `GAP` apart at x, their feet at height z."""
    card = box((THICKNESS, WIDTH, LENGTH), (1, 1, 1))
    cards = []
    for side in (-1.0, 1.0):
        tilted = card.rotated((0.0, 1.0, 0.0), -side * ANGLE)
        inner = (tilted.vertices[:, 0] * side).min()
        cards.append(tilted.translated((x + side * (0.5 * GAP) - side * inner, 0.0, z - tilted.vertices[:, 2].min())))
    return cards


def cards_of_house() -> list[TetrahedralMesh]:
    """Two pairs on the ground, a card that lies on both, and a pair on it."""
    low = GAP
    first = leaning_pair(0.0, low)
    half_span = 0.5 * np.ptp(np.concatenate([card.vertices for card in first])[:, 0]) + THICKNESS
    top = np.concatenate([card.vertices for card in first])[:, 2].max()
    flat = box((2 * half_span + 0.35 * LENGTH, 1.1 * WIDTH, THICKNESS), (1, 1, 1))
    flat = flat.translated((0.0, 0.0, top + GAP + 0.5 * THICKNESS))
    above = leaning_pair(0.0, top + 2 * GAP + THICKNESS)
    return [*leaning_pair(-half_span, low), *leaning_pair(half_span, low), flat, *above]


def card_house(friction: float = FRICTION, scene: Scene | None = None) -> Simulation:
    """The house on the ground at z = 0."""
    scene = scene or Scene("card_house")
    cards = [
        AffineBody(scene, f"card_{number}", shape, density=1000.0, youngs_modulus=1e8)
        for number, shape in enumerate(cards_of_house())
    ]
    return Simulation(
        scene,
        [*cards, HalfSpace(scene, "ground")],
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=friction),
        eps_v=SLIP_SPEED,
        settings=NewtonSettings(
            velocity_tolerance=0.1 * SLIP_SPEED, relative_force_tolerance=1e-3, solver="direct", max_iterations=500
        ),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run card_house`."""
    parser = argparse.ArgumentParser(prog="yasps run card_house", description=__doc__)
    parser.add_argument("--friction", type=float, default=FRICTION, help="coefficient everywhere (default 0.5)")
    parser.add_argument("--frames", type=int, default=100, help="time steps of 0.01 s (default 100)")
    parser.add_argument("--output", type=Path, default=Path("output/card_house"), help="folder for files")
    parser.add_argument("--no-pictures", action="store_true", help="no picture and no animation")
    options = parser.parse_args(arguments)
    simulation = card_house(options.friction)
    cards = simulation.moving
    before = max(card.positions()[:, 2].max() for card in cards)
    with FrameRecorder(simulation, options.output, "card_house", pictures=not options.no_pictures) as files:
        simulation.run(options.frames, files)
    after = max(card.positions()[:, 2].max() for card in cards)
    print(f"after {simulation.time:.2f} s the house is {1e3 * after:.2f} mm high; it was {1e3 * before:.2f} mm")
    return 0


if __name__ == "__main__":
    sys.exit(main())
