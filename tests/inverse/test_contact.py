"""Gradients through contact, friction and what is driven, against differences of order 8 of whole runs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from inverse_runs import add_miss, along, difference, random_directions, sliding_cube

from yasps import Scene
from yasps.bodies import Ground, HalfSpace, Joints, MovingObstacle, SoftBody
from yasps.contact import ContactTable
from yasps.inverse import PRECISE, Energy, InitialVelocity, MotionOf, PerStep, Tied, Trajectory
from yasps.meshes import TriangleMesh, box
from yasps.simulation import Simulation
from yasps.stepping import BACKWARD_EULER, BDF2

GOAL = (0.3, 0.1, 0.2)
TILTED = box((0.1, 0.1, 0.1), (1, 1, 1)).rotated((0.3, 1.0, 0.2), 0.1).translated((0.013, 0.021, 0.061))
SETTINGS = replace(PRECISE, relative_force_tolerance=1e-11)


def check(trajectory: Trajectory, objective: Any, parameters: list[Any], *, tolerance: float = 1e-6) -> None:
    """Every parameter by itself, along a random direction; the contact sets of all runs are as large as that of the one
    in the middle, so nothing came or went."""
    found = trajectory.gradient(objective, parameters)
    size = max(abs(along(found, random_directions(trajectory, [one]))) for one in parameters)
    for one in parameters:
        directions = random_directions(trajectory, [one])
        wanted, same = difference(trajectory, objective, directions, 1e-5)
        assert same, f"contacts changed in the runs for {one!r}"
        # What differences are known to is a share of the objective, and not of a slope that is small beside others.
        assert along(found, directions) == pytest.approx(wanted, rel=tolerance, abs=1e-11 * size / 1e-5), one
    assert found.warnings == []


def test_a_cube_that_lands_and_slides() -> None:
    """All kinds of parameters at once: materials, contact, friction, gravity, the start."""
    simulation, cube = sliding_cube()
    miss, trajectory = add_miss(cube, GOAL), Trajectory(simulation, 9)
    assert simulation.contact is not None
    laws = simulation.contact.parts.laws
    friction = Tied(laws["friction"], laws["kinetic_friction"])
    matrix, translation = cube.targets
    parameters = [friction, laws["stiffness"], simulation.gravity, cube.mass, translation, InitialVelocity(cube)]
    found = trajectory.gradient(miss, parameters)
    directions = random_directions(trajectory, parameters)
    directions[translation] *= 0.01
    wanted, same = difference(trajectory, miss, directions, 2e-4)
    assert same
    assert along(found, directions) == pytest.approx(wanted, rel=1e-7)
    assert max(report.contacts for report in trajectory.reports) == 2
    assert abs(found[friction].sum()) > 1e-3  # it slides
    trajectory.run()
    forces, term = simulation.contact_forces().on_vertices("both"), simulation.forces_by_term()
    trajectory.gradient(miss, friction)  # afterwards all is as at the end of the run
    np.testing.assert_array_equal(simulation.contact_forces().on_vertices("both"), forces)
    for path, of_targets in simulation.forces_by_term().items():
        for target, force in of_targets.items():
            np.testing.assert_array_equal(force, term[path][target])
    assert found.warnings == []
    assert matrix not in found
    forwards = trajectory.sensitivities(cube.position, parameters)[0]
    slopes = 2 * (cube.positions() - GOAL).ravel()
    backwards = np.concatenate([found[one].ravel() for one in parameters])
    np.testing.assert_allclose(slopes @ forwards, backwards, rtol=1e-9, atol=1e-13)


@pytest.mark.nightly
@pytest.mark.parametrize("integrator", [BACKWARD_EULER, BDF2])
@pytest.mark.parametrize("lagging", ["once", "converged"])
def test_fifty_steps_of_an_affine_body(integrator: Any, lagging: str) -> None:
    simulation, cube = sliding_cube(integrator=integrator, lagging=lagging)
    miss, trajectory = add_miss(cube, GOAL), Trajectory(simulation, 50)
    assert simulation.contact is not None
    laws = simulation.contact.parts.laws
    parameters = [Tied(laws["friction"], laws["kinetic_friction"]), laws["stiffness"], simulation.gravity]
    check(trajectory, [Energy(miss), Energy(miss, [3], 0.5)], [*parameters, InitialVelocity(cube), cube.mass])


@pytest.mark.nightly
@pytest.mark.parametrize("on", ["half-space", "triangles"])
def test_fifty_steps_of_a_soft_body(on: str) -> None:
    scene = Scene("soft", threads=1, deterministic=True)
    cube = SoftBody(scene, "cube", TILTED, youngs_modulus=2e5)
    floor = HalfSpace(scene, "ground") if on == "half-space" else Ground(scene, "ground", size=2.0)
    simulation = Simulation(
        scene,
        [cube, floor],
        contacts=ContactTable(0.3),
        activation_distance=1e-2,
        time_step=0.005,
        settings=SETTINGS,
        eps_v=0.02,
    )
    simulation.set_velocity(cube, (0.4, 0.1, -0.1))
    assert simulation.contact is not None
    laws = simulation.contact.parts.laws
    parameters = [Tied(laws["friction"], laws["kinetic_friction"]), cube.mu, cube.mass, cube.position]
    parameters += [cube.vertices["rest_position"], cube.tets["rest_edges_inverse"], InitialVelocity(cube, each=True)]
    check(Trajectory(simulation, 50), add_miss(cube, GOAL), parameters)


@pytest.mark.nightly
def test_obstacles_pins_and_schedules() -> None:
    """A soft cube hangs from a pin that moves, and from a spring, and a lift takes it up; frames kept in two ways."""
    scene, steps, step = Scene("lift", threads=1, deterministic=True), 12, 0.005
    cube = SoftBody(scene, "cube", TILTED.translated((0.0, 0.0, 0.009)), youngs_modulus=2e5)
    plate = TriangleMesh(
        np.array([[-0.2, -0.2, 0.0], [0.25, -0.2, 0.0], [0.25, 0.22, 0.0], [-0.2, 0.22, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    frames = np.arange(steps + 1)[:, None, None]
    lift = MovingObstacle(scene, "lift", plate, motion=plate.vertices + frames * [1e-3, 3e-3, 2.75e-3])
    simulation = Simulation(
        scene,
        [cube, lift],
        contacts=ContactTable(0.4),
        activation_distance=1e-2,
        time_step=step,
        settings=SETTINGS,
        eps_v=0.02,
    )
    pin = simulation.pin(cube, [7], motion=cube.rest[[7]] + frames * [0.0, 2e-3, 1e-3])
    springs = simulation.pin(cube, [0], 50.0)
    place = PerStep(springs.primitive["place"], cube.rest[0] + frames[:-1, 0] * [0.0, 1e-3, 0.0])
    miss = add_miss(cube, GOAL)
    trajectory = Trajectory(simulation, steps, schedules=[place])
    parameters = [MotionOf(lift), MotionOf(pin), place, cube.mu, springs.primitive["stiffness"]]
    found = trajectory.gradient(miss, parameters)
    some = Trajectory(simulation, steps, schedules=[place], keep="checkpoints")
    some.start = trajectory.start
    again = some.gradient(miss, parameters)
    for name in found:
        np.testing.assert_array_equal(again[name], found[name])
    for one in parameters:
        directions = random_directions(trajectory, [one])
        if isinstance(one, MotionOf):  # where the run starts is no part of it
            directions[one] *= 0.05
            directions[one][0] = 0.0
            assert not found[one][0].any()
        wanted, same = difference(trajectory, miss, directions)
        assert same
        assert along(found, directions) == pytest.approx(wanted, rel=1e-6)
    forwards = some.sensitivities(cube.position, parameters)[0]
    slopes = 2 * (cube.positions() - GOAL).ravel()
    backwards = np.concatenate([found[one].ravel() for one in parameters])
    np.testing.assert_allclose(slopes @ forwards, backwards, rtol=1e-8, atol=1e-10)


@pytest.mark.nightly
def test_joints() -> None:
    """Two cubes, one on a hinge to the world and to the other, which a motor turns."""
    scene = Scene("hinge", threads=1, deterministic=True)
    shape = box((0.1, 0.1, 0.1), (1, 1, 1))
    first = SoftBody(scene, "first", shape, youngs_modulus=2e5)
    second = SoftBody(scene, "second", shape.translated((0.15, 0.0, 0.0)), youngs_modulus=2e5)
    joints = Joints(scene, [first, second])
    joints.point(None, first, (-0.05, 0.0, 0.0), 1e3)
    hinge = joints.hinge(first, second, (0.075, 0.0, 0.0), (0.0, 1.0, 0.0), 1e3)
    hinge.drive(0.5, 0.2)
    simulation = Simulation(scene, [first, second], contact=False, time_step=0.01, settings=SETTINGS)
    simulation.attach(joints)
    turns = joints.mesh.turns
    parameters = [turns["aim"], turns["drive"], joints.mesh.links["stiffness"], second.mass]
    check(Trajectory(simulation, 20), add_miss(second, GOAL), parameters)
