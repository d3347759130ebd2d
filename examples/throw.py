"""The velocity with which a cube must be thrown to land in the middle of a box without a lid.

The objective is how far the cube is from the middle, over the ground, at the end; `fit` finds the velocity by the exact
gradient through all steps: flight over the wall, landing, and sliding with friction. What runs afterwards, with
pictures, is that throw.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps.bodies import AffineBody, HalfSpace, Obstacle
from yasps.contact import ContactTable
from yasps.inverse import PRECISE, InitialVelocity, Squares, Trajectory, fit, scaled
from yasps.meshes import TriangleMesh, box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

SIDE, HEIGHT = 0.1, 0.3  # m, of the cube and of its middle at the start
MIDDLE = (0.8, 0.2)  # m, of the box on the floor
INSIDE, WALL, RIM = 0.3, 0.02, 0.06  # m: the box is square inside; thickness and height of its walls
FRICTION, REACH, EPS_V = 0.3, 5e-3, 0.02  # -, m, m/s
GUESS = (1.4, 0.3, 2.0)  # m/s: it comes down in the box, but not in the middle
LOWEST, HIGHEST = (0.0, -2.0, 0.0), (3.0, 2.0, 3.0)  # m/s
NEAR = 2e-3  # m

PROGRAM = SceneProgram("throw", __doc__, frames=60, time_step=0.01, size=60, size_means="steps until it must be there")


def walls() -> TriangleMesh:
    """Four walls round a place of the floor, their lower faces below it."""
    outside, low = 0.5 * (INSIDE + WALL), 0.5 * RIM - 0.01
    sides = [
        box((WALL, INSIDE + 2 * WALL, RIM), (1, 1, 1)).translated((-outside, 0.0, low)),
        box((WALL, INSIDE + 2 * WALL, RIM), (1, 1, 1)).translated((outside, 0.0, low)),
        box((INSIDE, WALL, RIM), (1, 1, 1)).translated((0.0, -outside, low)),
        box((INSIDE, WALL, RIM), (1, 1, 1)).translated((0.0, outside, low)),
    ]
    starts = np.cumsum([0, *(len(side.vertices) for side in sides)])
    vertices = np.concatenate([side.vertices for side in sides]) + np.array([*MIDDLE, 0.0])
    triangles = [side.surface_triangles() + start for side, start in zip(sides, starts, strict=False)]
    return TriangleMesh(vertices, np.concatenate(triangles).astype(np.int32))


def build(options: Options) -> Simulation:
    """The cube with the velocity that was found, before it flies."""
    scene = PROGRAM.scene(options)
    shape = box((SIDE, SIDE, SIDE), (1, 1, 1)).translated((0.0, 0.0, HEIGHT))
    cube = AffineBody(scene, "cube", shape)
    simulation = Simulation(
        scene,
        [cube, Obstacle(scene, "box", walls()), HalfSpace(scene, "floor", size=4.0)],
        time_step=options.dt,
        contacts=ContactTable(FRICTION),
        activation_distance=REACH,
        eps_v=EPS_V,
        settings=PRECISE,
    )
    simulation.set_velocity(cube, GUESS)
    middle = cube.body.add_constant("middle", 2, 1, value=MIDDLE)
    over_ground = cube.body["translation"].block(0, 0, 2, 1)
    away = cube.body.add_attribute("away", computed_attribute=over_ground - middle)
    trajectory, velocity = Trajectory(simulation, options.size), InitialVelocity(cube)
    bounds = {velocity: (LOWEST, HIGHEST)}
    fit(trajectory, Squares(away), velocity, bounds=bounds, transforms={velocity: scaled(0.5)}, max_iterations=40)
    trajectory.restart()
    return simulation


def check(simulation: Simulation, options: Options) -> str:
    """The cube is in the middle of the box when it must be."""
    (cube,) = simulation.moving
    away = float(np.linalg.norm(cube.mesh.body["away"].value))
    if simulation.frame != options.size:
        return f"{away:.3g} m to go"
    if away > NEAR:
        raise CheckFailedError(f"the cube is {away:.3g} m from the middle of the box after {simulation.time:.2f} s")
    return f"after {simulation.time:.2f} s the cube is within {away:.1g} m of the middle of the box"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run throw`."""
    return PROGRAM.run(arguments, build, check, view_direction=(0.3, -1.0, 0.3))


if __name__ == "__main__":
    sys.exit(main())
