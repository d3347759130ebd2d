"""Beads on springs find their rest below a hook: JOIN, UNION, two energies and a Newton loop of one's own.

Every bead is a free point, the hook is a constant one; a union makes them one primitive, so that each spring sees its
two ends without knowing what they are. At rest spring i carries all beads below it, so the answer is known.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, NotConvergedError, Scene
from yasps.program import Options, SceneProgram

GRAVITY = 9.8  # m/s^2
MASS = 0.1  # kg, of a bead
STIFFNESS = 50.0  # N/m, of a spring
LENGTH = 0.2  # m, of a spring at rest
TOLERANCE = 1e-9  # m, of the Newton step
MAX_ITERATIONS = 200

PROGRAM = SceneProgram("hanging_chain", __doc__, frames=None, size=5, size_means="beads")


def build(options: Options) -> tuple[Scene, Attribute]:
    """The scene, and the beads' positions: the only thing that moves. Starts as a slanted line of stretched springs,
    or, with a seed, as a crooked one."""
    scene, beads = PROGRAM.scene(options), options.size
    hook = scene.add_mesh("wall").add_primitive("hook", num_instances=1)
    hook.add_constant("position", rows=3, cols=1)
    bead = scene.add_mesh("beads").add_primitive("bead", num_instances=beads)
    start = np.arange(1, beads + 1)[:, None] * 2 * LENGTH * np.array([0.6, 0.0, -0.8])
    if options.seed:
        start += np.random.default_rng(options.seed).uniform(-0.1 * LENGTH, 0.1 * LENGTH, start.shape)
    position = bead.add_attribute("position", rows=3, cols=1, value=start)

    chain = scene.add_mesh("chain")
    points = chain.add_primitive_union("points", [hook, bead])
    points.add_attribute("position")
    springs = chain.add_primitive("springs", num_instances=beads)
    pairs = [[i, i + 1] for i in range(beads)]  # point 0 is the hook
    ends = springs.add_connectivity("ends", points, pairs, 2)
    x = springs.add_attribute("positions", through=ends, source=points["position"])

    stretch = (x.row(1) - x.row(0)).norm() - LENGTH
    elastic = 0.5 * STIFFNESS * stretch * stretch
    scene.add_energy(springs.add_attribute("elastic", computed_attribute=elastic))
    scene.add_energy(bead.add_attribute("weight", computed_attribute=MASS * GRAVITY * position[2]))
    scene.add_minimize_target(position)
    return scene, position


def minimize(scene: Scene, position: Attribute) -> int:
    """Newton's method with step halving; returns how many steps it took. Raises NotConvergedError."""
    for iteration in range(1, MAX_ITERATIONS + 1):
        (uphill,) = scene.minimize_energy(tolerance=1e-14)  # x of H x = g; the Newton step is -x
        before, energy = position.value, scene.total_energy()
        step = 1.0
        position.update_value(before - uphill)
        if np.abs(uphill).max() < TOLERANCE:
            return iteration
        while scene.total_energy() > energy:
            step /= 2
            if step < 1e-12:
                position.update_value(before)
                raise NotConvergedError(f"no step along the Newton direction lowers the energy {energy} J")
            position.update_value(before - step * uphill)
    raise NotConvergedError(f"no rest within {MAX_ITERATIONS} Newton steps")


def rest_positions(beads: int) -> NDArray[np.float64]:
    """Where the beads hang, [n, 3]: straight down, spring i stretched by the weight of the n - i beads below it."""
    below = np.arange(beads, 0, -1)
    depth = np.cumsum(LENGTH + below * MASS * GRAVITY / STIFFNESS)
    return np.stack([np.zeros(beads), np.zeros(beads), -depth], axis=1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run hanging_chain`; 1 if the beads do not hang where they must."""
    options = PROGRAM.options(arguments)
    scene, position = build(options)
    iterations = minimize(scene, position)
    found = position.value.reshape(-1, 3)
    error = float(np.abs(found - rest_positions(options.size)).max())
    print(f"at rest after {iterations} Newton iterations, energy {scene.total_energy():.6f} J")
    print(f"lowest bead at z = {found[-1, 2]:.6f} m; largest error of all beads {error:.1e} m")
    if error < 1e-6 * LENGTH * options.size:
        return 0
    print("the beads are not where they must hang", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
