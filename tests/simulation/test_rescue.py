"""A time step that fails is tried again in halves; if these fail, too, nothing has happened."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from yasps import NotConvergedError, Scene, SceneError
from yasps.bodies import AffineBody, HalfSpace, MovingObstacle, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, box
from yasps.simulation import Simulation
from yasps.stepping import NewtonReport

CUBE = box((0.1, 0.1, 0.1), (1, 1, 1))
DT = 0.01


def falling_cube() -> tuple[Simulation, SoftBody]:
    scene = Scene("cube", threads=1)
    soft = SoftBody(scene, "soft", CUBE.translated((0.0, 0.0, 1.0)))
    return Simulation(scene, [soft], time_step=DT, contact=False), soft


def fail_above(simulation: Simulation, longest: float) -> list[float]:
    """Lets every step that is longer than this fail after it has moved everything; returns the steps that are tried."""
    tried: list[float] = []
    stepper = simulation.stepper
    minimize = stepper.minimize

    def failing(fixed: object = None) -> NewtonReport:
        tried.append(stepper.time_step)
        report = minimize(fixed)  # type: ignore[arg-type]
        if stepper.time_step > longest * (1 + 1e-9):
            raise NotConvergedError("not today")
        return report

    stepper.minimize = failing  # type: ignore[method-assign]
    return tried


def test_halves_and_quarters_are_tried(caplog: pytest.LogCaptureFixture) -> None:
    simulation, soft = falling_cube()
    simulation.step()
    start, velocity = soft.positions(), simulation.velocity_of(soft)
    compiled = simulation.scene.compile()
    tried = fail_above(simulation, DT / 4)
    with caplog.at_level(logging.WARNING, "yasps"):
        report = simulation.step()
    assert simulation.scene.compile() is compiled
    assert tried == [DT, DT / 2, DT / 4, DT / 4, DT / 2, DT / 4, DT / 4]
    assert report.substeps == 4
    assert report.iterations >= 4
    assert len(caplog.records) == 3
    assert "t = 0.01 s did not work out; it is tried in two of 0.005 s: not today" in caplog.records[0].getMessage()
    assert (simulation.frame, simulation.time) == (2, pytest.approx(2 * DT, rel=1e-14))
    # Backward Euler with the smaller step: v and x are those of four quarters.
    v, fall, quarter = velocity[0, 2], 0.0, DT / 4
    for _ in range(4):
        v -= 9.8 * quarter
        fall += v * quarter
    np.testing.assert_allclose(soft.positions() - start, np.tile([0.0, 0.0, fall], (8, 1)), atol=1e-10)
    np.testing.assert_allclose(simulation.velocity_of(soft)[:, 2], v, atol=1e-7)
    # And the next step is a whole one again.
    assert simulation.time_step.value[0] == simulation.stepper.time_step == DT
    simulation.stepper.minimize = type(simulation.stepper).minimize.__get__(simulation.stepper)  # type: ignore[method-assign]
    assert simulation.step().substeps == 1


def test_forces_that_are_read_are_those_of_the_last_part() -> None:
    """Inertia and friction depend on the time step: what is read after a rescued step balances, and so it does when the
    next step has got another one."""
    scene = Scene("sliding", threads=1)
    cube = AffineBody(scene, "cube", CUBE.translated((0.0, 0.0, 0.05 + 0.9936e-3)))
    contacts = ContactTable(0.5)
    simulation = Simulation(
        scene, [cube, HalfSpace(scene, "ground")], activation_distance=1e-3, contacts=contacts, time_step=DT
    )
    simulation.run(2)
    simulation.set_velocity(cube, (4e-3, 0.0, 0.0))  # sticks at the end of each half
    fail_above(simulation, DT / 2)
    report = simulation.step()
    assert report.substeps == 2
    for _ in range(2):
        terms = simulation.forces_by_term().values()
        left = sum(term["cube.body.translation"] for term in terms)
        assert np.linalg.norm(left) <= 1.001 * report.residual_force + 1e-12
        forces = simulation.contact_forces()
        rubbing = simulation.forces_by_term()["everything.half_space_friction.potential"]["cube.body.translation"]
        np.testing.assert_allclose(forces.on_bodies("friction")[0], rubbing[0], rtol=1e-9, atol=1e-12)
        assert not forces.friction.slides.any()
        simulation.time_step.update_value(DT / 10)
    assert simulation.time_step.value[0] == DT / 10


def test_after_all_failed_everything_is_as_before() -> None:
    simulation, soft = falling_cube()
    simulation.run(2)
    before, velocity, targets = soft.positions(), simulation.velocity_of(soft), simulation.stepper.target_velocities
    tried = fail_above(simulation, DT / 16)
    with pytest.raises(NotConvergedError, match="not today") as caught:
        simulation.step()
    assert tried == [DT, DT / 2, DT / 4, DT / 8]
    np.testing.assert_array_equal(soft.positions(), before)
    np.testing.assert_array_equal(simulation.velocity_of(soft), velocity)
    np.testing.assert_array_equal(simulation.stepper.target_velocities, targets)
    assert simulation.time_step.value[0] == simulation.stepper.time_step == DT
    assert (simulation.frame, simulation.time) == (2, 2 * DT)
    assert "failed; the state before it is in" in caught.value.__notes__[0]
    simulation.rescue = 0
    tried.clear()
    with pytest.raises(NotConvergedError):
        simulation.step()
    assert tried == [DT]


def test_a_second_half_that_fails_takes_the_first_back() -> None:
    simulation, _ = falling_cube()
    simulation.run(2)
    before, velocities = simulation.state(), [v.copy() for v in simulation.stepper.target_velocities]
    stepper, minimize = simulation.stepper, simulation.stepper.minimize

    def failing(fixed: object = None) -> NewtonReport:
        if stepper.time_step == DT or stepper.time > 2.4 * DT:
            raise NotConvergedError("late")
        return minimize(fixed)  # type: ignore[arg-type]

    stepper.minimize = failing  # type: ignore[method-assign]
    with pytest.raises(NotConvergedError, match="late"):
        simulation.step()
    after = simulation.state()
    assert before.keys() == after.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value)
    np.testing.assert_array_equal(stepper.target_velocities, velocities)  # of the next step's first guess


def test_halves_of_a_driven_step_go_half_the_way() -> None:
    """A function of time is asked at the end of each part; what was said for the whole step is cut in two."""
    scene = Scene("parts", threads=1)
    soft = SoftBody(scene, "soft", CUBE.translated((0.0, 0.0, 1.0)))
    plate = TriangleMesh(CUBE.vertices, CUBE.surface_triangles())
    asked: list[float] = []

    def motion(time: float) -> np.ndarray:
        asked.append(time)
        return plate.vertices + np.array([time, 0.0, 0.0])

    first = MovingObstacle(scene, "first", plate, motion=motion)
    second = MovingObstacle(scene, "second", plate)
    table = [plate.vertices + np.array([0.0, x, 0.0]) for x in (0.0, 0.1, 0.3)]
    third = MovingObstacle(scene, "third", plate, motion=np.array(table))
    simulation = Simulation(scene, [soft, first, second, third], time_step=DT, contact=False)
    simulation.step()
    second.move_to(plate.vertices + np.array([0.0, 0.0, -0.2]))
    tried = fail_above(simulation, DT / 2)
    ways: list[tuple[float, float]] = []
    minimize = simulation.stepper.minimize

    def noting(fixed: object = None) -> NewtonReport:
        ways.append((second.positions()[0, 2] - plate.vertices[0, 2], third.positions()[0, 1] - plate.vertices[0, 1]))
        return minimize(fixed)  # type: ignore[arg-type]

    simulation.stepper.minimize = noting  # type: ignore[method-assign]
    assert simulation.step().substeps == 2
    assert tried == [DT, DT / 2, DT / 2]
    np.testing.assert_allclose(asked, [DT, 2 * DT, 1.5 * DT, 2 * DT], rtol=1e-14)
    np.testing.assert_allclose(ways, [(-0.2, 0.3), (-0.1, 0.2), (-0.2, 0.3)], rtol=1e-12)
    np.testing.assert_allclose(simulation.velocity_of(second), np.tile([0, 0, -20.0], (8, 1)), rtol=1e-9)
    with pytest.raises(SceneError, match="first is fixed already"):
        simulation.pin(first, [0])
