"""No momentum from nowhere: two bodies collide in free space, and their common centre of mass moves straight on."""

from __future__ import annotations

import numpy as np
import pytest
from scene_shapes import block

from yasps import Scene
from yasps.bodies import AffineBody, SoftBody
from yasps.contact import ContactTable
from yasps.simulation import Simulation
from yasps.stepping import BACKWARD_EULER, BDF2, Integrator, NewtonSettings

DT = 0.01  # s
SIZE = 0.1  # m


def colliding_pair(first: str, second: str, friction: float, integrator: Integrator) -> Simulation:
    """Two cubes, askew, that meet corner and face first while both move on."""
    scene = Scene("pair", threads=1)
    kinds = {"soft": (SoftBody, 1e5), "affine": (AffineBody, 1e7)}
    cube = block((SIZE,) * 3).translated((0.0, 0.0, -0.5 * SIZE))
    bodies = []
    for number, (kind, x) in enumerate(((first, -0.0905), (second, 0.0905))):
        make, modulus = kinds[kind]
        shape = cube.rotated((0.3, 1.0, 0.7), 0.6 + 1.3 * number).translated((x, 0.013 * number, 0.02 * number))
        bodies.append(make(scene, f"body_{number}", shape, youngs_modulus=modulus))
    return Simulation(
        scene,
        bodies,
        time_step=DT,
        gravity=(0.0, 0.0, 0.0),
        activation_distance=1e-3,
        contacts=ContactTable(friction=friction),
        velocities={bodies[0]: (1.5, 0.2, 0.1), bodies[1]: (-0.5, 0.2, 0.1)},
        integrator=integrator,
        settings=NewtonSettings(velocity_tolerance=1e-5, solver="direct"),
    )


def run(first: str, second: str, friction: float, steps: int, integrator: Integrator = BACKWARD_EULER) -> None:
    simulation = colliding_pair(first, second, friction, integrator)
    mass = np.concatenate([body.mass.value for body in simulation.bodies])

    def centre() -> np.ndarray:
        return np.asarray(mass @ np.concatenate([body.positions() for body in simulation.bodies]) / mass.sum())

    start, speed = centre(), simulation.stepper.momentum() / mass.sum()
    before = simulation.velocity_of(simulation.bodies[0]).mean(axis=0)
    touched = False
    for step in range(1, steps + 1):
        touched |= simulation.step().contacts > 0
        way = centre() - start
        assert np.abs(way - step * DT * speed).max() < 1e-10 * np.linalg.norm(speed) * step * DT
    assert touched
    after = simulation.velocity_of(simulation.bodies[0]).mean(axis=0)
    assert np.linalg.norm(after - before) > 0.1  # they did collide


def test_the_centre_of_mass_of_two_affine_cubes_moves_straight() -> None:
    run("affine", "affine", 0.3, 8)
    run("affine", "affine", 0.3, 8, BDF2)


@pytest.mark.nightly
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize(("first", "second"), [("affine", "affine"), ("soft", "soft"), ("soft", "affine")])
def test_the_centre_of_mass_moves_straight(first: str, second: str, friction: float) -> None:
    run(first, second, friction, 25)
    run(first, second, friction, 25, BDF2)
