"""Directions around what is in the way: fewer iterations, the same end."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import NotFiniteError, Scene
from yasps.bodies import Ground, SoftBody
from yasps.meshes import box
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings, detour
from yasps.stepping.newton import Minimization


def thrown_cubes() -> Simulation:
    """Two soft cubes, askew, thrown at the ground and at each other."""
    scene = Scene("thrown")
    shape = box((0.1, 0.1, 0.1), (3, 3, 3))
    low = SoftBody(scene, "low", shape.rotated((1.0, 1.0, 0.0), 0.2).translated((0.0, 0.0, 0.075)), youngs_modulus=2e4)
    high = SoftBody(
        scene, "high", shape.rotated((1.0, 0.3, 0.2), 0.4).translated((0.02, 0.01, 0.22)), youngs_modulus=2e4
    )
    velocities = {low: (0.0, 0.0, -2.0), high: (0.0, 0.0, -5.0)}
    settings = NewtonSettings(velocity_tolerance=1e-4, linear_tolerance=1e-10)
    return Simulation(scene, [low, high, Ground(scene)], velocities=velocities, settings=settings)


@pytest.mark.slow
def test_detours_save_iterations_and_end_at_the_same_place(monkeypatch: pytest.MonkeyPatch) -> None:
    iterations, ends, detours = {}, {}, {}
    for most in (0, 2):
        monkeypatch.setattr(detour, "DETOURS", most)
        simulation = thrown_cubes()
        contact = simulation.contact
        assert contact is not None
        reports = [simulation.step() for _ in range(3)]
        iterations[most] = sum(report.iterations for report in reports)
        detours[most] = sum(report.detours for report in reports)
        ends[most] = contact.positions()
        assert not contact.geometry.has_intersections(ends[most])
        assert simulation.scene.everything.ahead.num_instances == 0
    assert detours[0] == 0
    assert detours[2] > 0
    assert iterations[2] < 0.8 * iterations[0]
    # Each of three steps ends up to 1e-4 m/s, 1e-6 m, from its minimum.
    np.testing.assert_allclose(ends[2], ends[0], atol=3e-6)


def test_what_a_cut_step_left_over_saves_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    reports, ends = [], []
    for _ in range(2):
        simulation = thrown_cubes()
        assert simulation.contact is not None
        reports.append(simulation.step())
        ends.append(simulation.contact.positions())
        monkeypatch.setattr(Minimization, "left_by", lambda *_: None)
    used, plain = reports
    assert min(used.step_lengths) < 1.0
    assert used.iterations == plain.iterations
    assert used.cg_iterations < plain.cg_iterations
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-9)


def test_springs_are_gone_after_a_solve_that_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = thrown_cubes()
    simulation.rescue = 0

    def fails(*arguments: object, **names: object) -> None:
        assert simulation.scene.everything.ahead.num_instances > 0
        raise NotFiniteError("of the test")

    monkeypatch.setattr(detour, "solve_newton_system", fails)
    with pytest.raises(NotFiniteError, match="of the test"):
        simulation.run(4)
    assert simulation.scene.everything.ahead.num_instances == 0
    monkeypatch.undo()
    simulation.step()
