"""Equilibria under growing loads, against closed forms; loads that are too large a step, and too large altogether."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from yasps import Attribute, NotConvergedError, Scene, SceneError, materials
from yasps.stepping import NewtonSettings, quasi_static

STIFFNESS, HALF_SPAN, HEIGHT = 1e3, 1.0, 0.2  # N/m, m, m
SETTINGS = NewtonSettings(velocity_tolerance=None, relative_force_tolerance=1e-10, solver="direct")


def truss(load: float) -> tuple[Scene, Attribute, Attribute]:
    """Two bars from supports to an apex that a dead load pushes down (von Mises' truss), and the load."""
    scene = Scene("truss", threads=1)
    apex = scene.add_mesh("m").add_primitive("apex", 1)
    x = apex.add_attribute("x", 3, 1, value=[0.0, 0.0, HEIGHT])
    length = np.hypot(HALF_SPAN, HEIGHT)
    stretches = [(x - np.array([side * HALF_SPAN, 0.0, 0.0])).norm() - length for side in (-1, 1)]
    elastic = sum(0.5 * STIFFNESS * stretch**2 for stretch in stretches)
    steady = 0.5 * STIFFNESS * x[1] ** 2  # out of the plane of the bars
    push = apex.add_constant("push", 1, 1)
    scene.add_energy(apex.add_attribute("elastic", computed_attribute=elastic + steady), projection="abs")
    scene.add_energy(apex.add_attribute("pushed", computed_attribute=load * push * x[2]))
    scene.add_minimize_target(x)
    return scene, x, push


def force_at(height: float) -> float:
    """That holds the apex at a height."""
    now, rest = np.hypot(HALF_SPAN, height), np.hypot(HALF_SPAN, HEIGHT)
    return float(2 * STIFFNESS * (rest / now - 1) * height)


LIMIT = max(force_at(height) for height in np.linspace(0.0, HEIGHT, 2001))


def test_a_shallow_truss_follows_its_path_and_snaps() -> None:
    scene, x, push = truss(1.5 * LIMIT)
    heights: list[float] = []
    found = quasi_static(
        scene, [x], push.update_value, settings=SETTINGS, after_step=lambda _: heights.append(float(x.value[2]))
    )
    loads = np.array([one.load for one in found])
    assert loads[0] == 0.0
    assert loads[-1] == 1.0
    assert (np.diff(loads) > 0).all()
    np.testing.assert_allclose([force_at(height) for height in heights], 1.5 * LIMIT * loads, atol=1e-8 * LIMIT)
    over = np.array(heights) > 0
    np.testing.assert_array_equal(over, loads < 1 / 1.5)  # it snaps when its limit is passed, and not before
    assert 2 < over.sum() < len(over)


def test_a_step_that_is_too_large_is_halved(caplog: pytest.LogCaptureFixture) -> None:
    """Few iterations are allowed, so that only small load steps succeed."""
    few = NewtonSettings(velocity_tolerance=None, relative_force_tolerance=1e-10, solver="direct", max_iterations=4)
    scene, x, push = truss(0.9 * LIMIT)
    with caplog.at_level(logging.INFO, "yasps"):
        found = quasi_static(scene, [x], push.update_value, settings=few, first=1.0)
    assert len(found) > 3
    said = [record.getMessage() for record in caplog.records if "load step" in record.getMessage()]
    assert "load step to 1 failed; the next one is 0.5" in said[0]
    assert force_at(float(x.value[2])) == pytest.approx(0.9 * LIMIT, rel=1e-9)


def test_a_load_that_nothing_bears_is_named_and_the_last_equilibrium_kept() -> None:
    """A spring with the energy k (1 - exp(-s^2 / 2)) bears k exp(-1/2) at s = 1 and no more."""
    scene = Scene("weak", threads=1)
    point = scene.add_mesh("m").add_primitive("point", 1)
    x = point.add_attribute("x", 3, 1)
    push = point.add_constant("push", 3, 1)
    scene.add_energy(point.add_attribute("bond", computed_attribute=100.0 * (1 - (-0.5 * x.dot(x)).exp())))
    scene.add_energy(point.add_attribute("pull", computed_attribute=materials.dead_load(x, push)))
    scene.add_minimize_target(x)
    strength = 100.0 * np.exp(-0.5)
    few = NewtonSettings(velocity_tolerance=None, relative_force_tolerance=1e-10, solver="direct", max_iterations=60)

    def set_load(share: float) -> None:
        push.update_value([2 * strength * share, 0.0, 0.0])

    with pytest.raises(NotConvergedError, match=r"no equilibrium under 0\.5.* of the load: .* The last one is under"):
        quasi_static(scene, [x], set_load, settings=few, smallest=1e-3)
    held, s = push.value[0], x.value[0]
    assert 0.49 < held / (2 * strength) <= 0.5
    assert held == pytest.approx(100.0 * s * np.exp(-0.5 * s * s), rel=1e-8)


def test_steps_that_cannot_be() -> None:
    scene, x, push = truss(LIMIT)
    with pytest.raises(SceneError, match="the first load step is at most 1"):
        quasi_static(scene, [x], push.update_value, first=2.0)
    with pytest.raises(SceneError, match="smallest"):
        quasi_static(scene, [x], push.update_value, smallest=0.0)
