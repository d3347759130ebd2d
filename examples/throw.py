"""The velocity with which a cube must be thrown to land in a marked place, over a floor on which it bounces and slides.

The objective is how far its middle is from the place at the end; `fit` finds the velocity by the exact gradient through
all steps: flight, landing and friction. What runs afterwards, with pictures, is that throw.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps.bodies import AffineBody, HalfSpace
from yasps.contact import ContactTable
from yasps.inverse import PRECISE, InitialVelocity, Squares, Trajectory, fit, scaled
from yasps.meshes import box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

SIDE, HEIGHT = 0.1, 0.2  # m, of the cube and of its middle at the start
FRICTION, REACH, EPS_V = 0.3, 5e-3, 0.02  # -, m, m/s
GUESS = (2.0, 0.0, -0.5)  # m/s
PLACE = (2.0, 0.4)  # m/s, along the floor on the way there from below the start, on average
LOWEST, HIGHEST = (-10.0, -10.0, -2.0), (10.0, 10.0, 0.0)  # m/s: not upwards, so that it lands on the way
NEAR = 2e-3  # m

PROGRAM = SceneProgram("throw", __doc__, frames=40, time_step=0.01, size=40, size_means="steps until it must be there")


def build(options: Options) -> Simulation:
    """The cube with the velocity that was found, before it flies."""
    scene = PROGRAM.scene(options)
    shape = box((SIDE, SIDE, SIDE), (1, 1, 1)).translated((0.0, 0.0, HEIGHT))
    cube = AffineBody(scene, "cube", shape)
    simulation = Simulation(
        scene,
        [cube, HalfSpace(scene, "floor", size=4.0)],
        time_step=options.dt,
        contacts=ContactTable(FRICTION),
        activation_distance=REACH,
        eps_v=EPS_V,
        settings=PRECISE,
    )
    simulation.set_velocity(cube, GUESS)
    seconds = options.dt * options.size
    place = cube.body.add_constant("place", 3, 1, value=[PLACE[0] * seconds, PLACE[1] * seconds, 0.5 * SIDE + REACH])
    away = cube.body.add_attribute("away", computed_attribute=cube.body["translation"] - place)
    trajectory, velocity = Trajectory(simulation, options.size), InitialVelocity(cube)
    bounds = {velocity: (LOWEST, HIGHEST)}
    fit(trajectory, Squares(away), velocity, bounds=bounds, transforms={velocity: scaled(0.5)}, max_iterations=40)
    trajectory.restart()
    return simulation


def check(simulation: Simulation, options: Options) -> str:
    """The cube is in its place when it must be."""
    (cube,) = simulation.moving
    away = float(np.linalg.norm(cube.mesh.body["away"].value))
    if simulation.frame != options.size:
        return f"{away:.3g} m to go"
    if away > NEAR:
        raise CheckFailedError(f"the cube is {away:.3g} m from its place after {simulation.time:.2f} s")
    return f"after {simulation.time:.2f} s the cube is within {away:.1g} m of its place"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run throw`."""
    return PROGRAM.run(arguments, build, check, view_direction=(0.3, -1.0, 0.3))


if __name__ == "__main__":
    sys.exit(main())
