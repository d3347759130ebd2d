"""Friction in time steps: a cube that slides on a half-space, in one lagging pass and in as many as it takes."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from yasps import NotConvergedError, Scene, SceneError
from yasps.bodies import AffineBody, HalfSpace
from yasps.contact import ContactTable
from yasps.meshes import box
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

FRICTION, GRAVITY, TIME_STEP, REACH = 0.5, 9.8, 0.01, 1e-3


def sliding_cube(**options: object) -> tuple[Simulation, AffineBody]:
    """A cube of 1 kg at 1 m/s, where the ground just begins to push."""
    scene = Scene("sliding", threads=1)
    shape = box((0.1, 0.1, 0.1), (1, 1, 1)).translated((0.0, 0.0, 0.05 + 0.9936 * REACH))
    cube = AffineBody(scene, "cube", shape)
    chosen = {"contacts": ContactTable(FRICTION), "activation_distance": REACH, "time_step": TIME_STEP}
    simulation = Simulation(scene, [cube, HalfSpace(scene, "ground")], **(chosen | options))  # type: ignore[arg-type]
    simulation.set_velocity(cube, (1.0, 0.0, 0.0))
    return simulation, cube


@pytest.mark.parametrize("lagging", ["once", "converged"])
def test_a_cube_slides_to_rest(lagging: str) -> None:
    """It loses mu g dt of its speed in each step, and stays where it then is."""
    simulation, cube = sliding_cube(lagging=lagging)
    speeds, passes = [], []
    for _ in range(22):
        report = simulation.step()
        assert report.lag_converged is (True if lagging == "converged" else None)
        passes.append(report.lagging_passes)
        speeds.append(simulation.velocity_of(cube).mean(axis=0)[0])
    assert (max(passes[:4]) > 1) == (lagging == "converged")  # later on the load is the same
    lost = -np.diff(speeds)[4:14]
    bound = 0.002 if lagging == "converged" else 0.05  # normal forces are those of the step before
    np.testing.assert_allclose(lost, FRICTION * GRAVITY * TIME_STEP, rtol=bound)
    assert 1.0 - 21 * FRICTION * GRAVITY * TIME_STEP < 0
    assert abs(speeds[-1]) < 1e-3  # eps_v


def test_forces_balance_in_every_step() -> None:
    """Speed alone does not see it: what is about to slide is nearly as stiff as what sticks."""
    simulation, _ = sliding_cube()
    assert max(simulation.step().relative_residual_force for _ in range(22)) <= 1e-3


def test_the_potential_of_friction_is_no_energy_of_the_motion() -> None:
    """What friction takes is gone: with its potential, which grows with the slip, the energy would be higher."""
    simulation, cube = sliding_cube()
    before = simulation.energy()
    for _ in range(4):
        simulation.step()
        assert simulation.energy() < before
        before = simulation.energy()
    energies = simulation.report().energies
    assert energies["friction"] > 0.02  # some of mu m g v dt: normal forces are just beginning
    assert before == pytest.approx(sum(energies.values()) - energies["friction"], rel=1e-14)
    speed = simulation.velocity_of(cube)[:, 0].mean()
    assert energies["kinetic"] == pytest.approx(0.5 * cube.mass.value.sum() * speed**2, rel=1e-3)


def test_friction_that_does_not_settle_is_said(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("yasps.stepping.time_stepper.LAGGING_PASSES", 1)
    simulation, _ = sliding_cube(lagging="converged", settings=NewtonSettings(velocity_tolerance=1e-9))
    with caplog.at_level(logging.WARNING, "yasps"):
        report = simulation.step()
    assert report.lag_converged is False
    assert report.lagging_passes == 2
    assert "not settled after 2 lagging passes" in caplog.text


def test_forces_say_when_friction_has_settled() -> None:
    settings = NewtonSettings(velocity_tolerance=None, relative_force_tolerance=1e-9, solver="direct")
    simulation, cube = sliding_cube(lagging="converged", settings=settings)
    for _ in range(3):
        report = simulation.step()
        assert report.lag_converged
        contact = simulation.contact
        assert contact is not None
        contact.lag()  # at the end of the step: what it holds already
        left = np.linalg.norm(np.concatenate(simulation.scene.gradient()))
        assert left < 1e-7 * report.largest_force
    assert simulation.velocity_of(cube)[0, 0] < 0.9


def test_a_velocity_tolerance_that_blurs_sticking_is_announced(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "yasps"):
        simulation, _ = sliding_cube()
        assert simulation.stepper.settings.velocity_tolerance == 1e-4
        assert not caplog.text
        sliding_cube(settings=NewtonSettings(velocity_tolerance=2e-4))
        assert "more than a tenth of eps_v" in caplog.text
        caplog.clear()
        sliding_cube(settings=NewtonSettings(velocity_tolerance=2e-4), eps_v=2e-3)
        sliding_cube(settings=NewtonSettings(velocity_tolerance=2e-4), contacts=ContactTable(0.0))
        assert not caplog.text


def test_wrong_settings_of_friction_are_refused() -> None:
    with pytest.raises(SceneError, match="lagging is one of 'once', 'converged'"):
        sliding_cube(lagging="twice")
    with pytest.raises(SceneError, match="eps_v must be positive"):
        sliding_cube(eps_v=0.0)


def test_a_step_that_fails_leaves_the_lag_of_the_one_before() -> None:
    simulation, _ = sliding_cube(lagging="converged")
    simulation.step()
    contact = simulation.contact
    assert contact is not None
    before = contact.save()
    energies = simulation.scene.energy_values()
    simulation.stepper.settings = NewtonSettings(velocity_tolerance=1e-12, max_iterations=1)
    with pytest.raises(NotConvergedError):
        simulation.step()
    after = contact.save()
    assert after.lag is before.lag
    np.testing.assert_array_equal(after.accepted, before.accepted)
    for path, values in simulation.scene.energy_values().items():
        if "inertia" not in path:  # that of the step that failed
            np.testing.assert_array_equal(values, energies[path])
