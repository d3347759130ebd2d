"""A soft rabbit and a stiff one fall on each other and on the ground.

The soft rabbit is stable Neo-Hookean, each vertex free; the stiff one is an affine body (9 + 3 unknowns). Contact is
IPC's barrier with friction, written once over the union of all vertices. After every step it is checked that nothing
intersects.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from yasps import SOLVERS, WHEN_TO_PROJECT, Scene
from yasps.bodies import AffineBody, Ground, SoftBody
from yasps.contact import ContactTable, narrowest_gap
from yasps.meshes import TetrahedralMesh, rabbit, read_tetrahedral_mesh
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

HEIGHT = 0.2  # m, of a rabbit

PROGRAM = SceneProgram(
    "two_bunnies",
    __doc__,
    frames=100,
    time_step=0.01,
    size=5000,
    size_means="vertices of each rabbit, about; at least 1500",
    mesh_means="a tetrahedral mesh in any format meshio reads, instead of the rabbit",
)
PROGRAM.add_argument("--friction", type=float, default=0.3, help="coefficient everywhere (0.3)")
PROGRAM.add_argument("--solver", choices=SOLVERS, default="pcg", help="of the linear systems (pcg)")
PROGRAM.add_argument("--projection", choices=WHEN_TO_PROJECT, default="always", help="of Hessians (always)")


def two_bunnies(shape: TetrahedralMesh, scene: Scene, time_step: float = 0.01, friction: float = 0.0) -> Simulation:
    """A soft copy of the shape, made 0.2 m high, a stiff one above it, and the ground at z = 0."""
    shape = shape.centered((0.0, 0.0, 0.0)).scaled(HEIGHT / np.ptp(shape.vertices[:, 2]))
    height = np.ptp(shape.vertices[:, 2])
    low = shape.translated((0.0, 0.0, 0.5 * height + 0.1 * HEIGHT))
    high = shape.rotated((0.0, 0.0, 1.0), 0.9).translated((0.15 * HEIGHT, 0.1 * HEIGHT, 1.5 * height + 0.25 * HEIGHT))
    soft = SoftBody(scene, "soft", low, youngs_modulus=2e4, poisson_ratio=0.4)
    stiff = AffineBody(scene, "stiff", high, youngs_modulus=1e7)
    # Surfaces repel when they are nearer than 1/200 of the size, or less where the rabbit itself is narrower.
    distance = float(np.clip(0.8 * narrowest_gap(low, 5e-3 * HEIGHT), 1e-3 * HEIGHT, 5e-3 * HEIGHT))
    bodies = [soft, stiff, Ground(scene, size=10 * HEIGHT)]
    return Simulation(
        scene,
        bodies,
        time_step=time_step,
        activation_distance=distance,
        barrier="paper",
        contacts=ContactTable(friction=friction),
    )


def build(options: Options) -> Simulation:
    """Two rabbits, or two of what is in the file."""
    shape = read_tetrahedral_mesh(options.mesh) if options.mesh else rabbit(options.size)
    simulation = two_bunnies(shape, PROGRAM.scene(options), options.dt, options.friction)
    stepper = simulation.stepper
    stepper.settings = replace(stepper.settings, solver=options.solver, projection=options.projection)
    return simulation


def check(simulation: Simulation, options: Options) -> str:
    """Nothing has gained energy, nor is anything below the ground."""
    lowest = min(float(body.positions()[:, 2].min()) for body in simulation.moving)
    if lowest < 0:
        raise CheckFailedError(f"after {simulation.time:.2f} s a rabbit is {-1e3 * lowest:.3g} mm below the ground")
    before = build(options).energy()  # at rest the rabbits' elastic energy is not zero
    lost = before - simulation.energy()
    if lost < -1e-6 * abs(before):
        raise CheckFailedError(f"after {simulation.time:.2f} s there are {-lost:.3g} J more than at the start")
    return f"after {simulation.time:.2f} s the rabbits have lost {lost:.3g} J; nothing intersects"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run two_bunnies`."""
    return PROGRAM.run(arguments, build, check)


if __name__ == "__main__":
    sys.exit(main())
