"""Velocities and positions of backward Euler against its recurrences, which for simple systems are solved by hand."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Attribute, Scene, materials
from yasps.stepping import MovingPart, NewtonSettings, TimeStepper

DT = 0.02
GRAVITY = np.array([0.5, -1.0, -9.8])
TIGHT = NewtonSettings(velocity_tolerance=1e-9, linear_tolerance=1e-26)
MASSES = {"light": np.array([0.5, 2.0, 1.5]), "heavy": np.array([40.0, 70.0])}


def two_parts(*, stiffness: float, weight: bool) -> tuple[Scene, list[MovingPart], list[Attribute]]:
    """Points of two primitives with inertia; each is pulled to its place by a spring, or none."""
    scene = Scene("points")
    mesh = scene.add_mesh("m")
    parts, targets = [], []
    strength = mesh.add_constant("strength", 1, 1, value=stiffness)
    for k, (name, masses) in enumerate(MASSES.items()):
        points = mesh.add_primitive(name, len(masses))
        start = np.arange(3.0 * len(masses)).reshape(-1, 3) + 10 * k
        x = points.add_attribute("x", 3, 1, value=start)
        home = points.add_constant("home", 3, 1, value=start)
        mass = points.add_constant("mass", 1, 1, value=masses)
        predicted = points.add_constant("predicted", 3, 1, value=start)
        pull = GRAVITY if weight else np.zeros(3)
        energy = materials.gravity(x, mass, tuple(pull)) + 0.5 * strength * (x - home).dot(x - home)
        scene.add_energy(points.add_attribute("outer", computed_attribute=energy))
        inertia = materials.inertia(x, predicted, mass, DT)
        scene.add_energy(points.add_attribute("inertia", computed_attribute=inertia))
        parts.append(MovingPart(x, predicted, mass))
        targets.append(x)
    scene.add_minimize_target(targets)
    return scene, parts, targets


@pytest.mark.parametrize("with_guess", [False, True])
def test_free_fall(with_guess: bool) -> None:
    """v_n = n dt a and x_n = x_0 + n (n + 1) / 2 dt^2 a, for every mass."""
    scene, parts, targets = two_parts(stiffness=0.0, weight=True)
    accelerations = dict.fromkeys(targets, GRAVITY) if with_guess else None
    stepper = TimeStepper(scene, parts, DT, accelerations=accelerations, settings=TIGHT)
    start = [target.value.reshape(-1, 3) for target in targets]
    everything = sum(float(masses.sum()) for masses in MASSES.values())
    for n in range(1, 5):
        report = stepper.step()
        if with_guess:
            assert report.iterations == 1  # it is the solution
        for velocity, target, first in zip(stepper.velocities, targets, start, strict=True):
            np.testing.assert_allclose(velocity, np.tile(n * DT * GRAVITY, (len(velocity), 1)), rtol=1e-9)
            fallen = target.value.reshape(-1, 3) - first
            np.testing.assert_allclose(fallen, np.tile(n * (n + 1) / 2 * DT**2 * GRAVITY, (len(fallen), 1)), rtol=1e-7)
        assert stepper.time == pytest.approx(n * DT)
        np.testing.assert_allclose(stepper.momentum(), everything * n * DT * GRAVITY, rtol=1e-9)
        speed = n * DT * np.linalg.norm(GRAVITY)
        assert stepper.kinetic_energy() == pytest.approx(0.5 * everything * speed**2, rel=1e-9)


def test_a_spring_follows_the_recurrence() -> None:
    """(m / dt^2 + k) u_{n+1} = m / dt^2 (u_n + dt v_n), v_{n+1} = (u_{n+1} - u_n) / dt, for every point by itself."""
    stiffness = 300.0
    scene, parts, targets = two_parts(stiffness=stiffness, weight=False)
    home = [target.value.reshape(-1, 3) for target in targets]
    rng = np.random.default_rng(0)
    away = [0.1 * rng.standard_normal(place.shape) for place in home]
    for target, place, u in zip(targets, home, away, strict=True):
        target.update_value(place + u)
    stepper = TimeStepper(scene, parts, DT, settings=TIGHT)
    speed = [np.zeros_like(u) for u in away]
    energies = []
    for _ in range(6):
        stepper.step()
        for k, masses in enumerate(MASSES.values()):
            heavy = (masses / DT**2)[:, None]
            new = heavy / (heavy + stiffness) * (away[k] + DT * speed[k])
            speed[k], away[k] = (new - away[k]) / DT, new
            np.testing.assert_allclose(targets[k].value.reshape(-1, 3) - home[k], away[k], atol=1e-9)
            np.testing.assert_allclose(stepper.velocities[k], speed[k], atol=1e-7)
        energies.append(stepper.kinetic_energy())
        by_hand = sum(
            0.5 * float(masses @ (v**2).sum(axis=1)) for masses, v in zip(MASSES.values(), speed, strict=True)
        )
        assert energies[-1] == pytest.approx(by_hand, rel=1e-6)


def test_velocities_that_are_given_are_kept_where_nothing_pulls() -> None:
    scene, parts, targets = two_parts(stiffness=0.0, weight=False)
    stepper = TimeStepper(scene, parts, DT, settings=TIGHT)
    given = [np.random.default_rng(k).standard_normal(v.shape) for k, v in enumerate(stepper.velocities)]
    stepper.velocities = [v.copy() for v in given]
    start = [target.value.reshape(-1, 3) for target in targets]
    for n in range(1, 4):
        stepper.step()
        for k, target in enumerate(targets):
            np.testing.assert_allclose(stepper.velocities[k], given[k], atol=1e-9)
            np.testing.assert_allclose(target.value.reshape(-1, 3), start[k] + n * DT * given[k], atol=1e-9)
