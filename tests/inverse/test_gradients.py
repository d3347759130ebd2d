"""Gradients through runs without contact: closed forms, recurrences by complex step, differences, and memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from inverse_runs import SETTINGS, add_miss, along, chain, difference, random_directions

from yasps import SceneError, materials
from yasps.inverse import Energy, FrameView, FromOutside, InitialValue, InitialVelocity, Squares, Trajectory
from yasps.stepping import BACKWARD_EULER, BDF2, Integrator

STEPS, STEP = 6, 0.05
GOAL = (0.3, -0.2, 0.1)


def test_projectiles() -> None:
    """Backward Euler: x_n = x_0 + n h v_0 + h^2 g n (n + 1) / 2. The miss is |x_n - goal|^2."""
    simulation, body = chain(0.0)
    miss, trajectory = add_miss(body, GOAL), Trajectory(simulation, STEPS)
    velocity = InitialVelocity(body, each=True)
    found = trajectory.gradient(miss, [velocity, body.position, simulation.gravity, body.mass])
    n, v, g = STEPS, trajectory.value(velocity), simulation.gravity.value
    way = body.rest + n * STEP * v + STEP**2 * n * (n + 1) / 2 * g - GOAL
    assert found.value == pytest.approx((way**2).sum(), rel=1e-10)
    np.testing.assert_allclose(found[velocity], 2 * n * STEP * way, rtol=1e-10)
    np.testing.assert_allclose(found[body.position][..., 0], 2 * way, rtol=1e-10)
    np.testing.assert_allclose(found[simulation.gravity].ravel(), STEP**2 * n * (n + 1) * way.sum(axis=0), rtol=1e-10)
    assert np.abs(found["chain.vertices.mass"]).max() < 1e-10  # all that is heavy falls alike
    assert found.warnings == []


def recurrence(integrator: Integrator, numbers: Any) -> Any:
    """Where a chain of springs of length 0 from the origin is in the end: M (x - X - h V) / h^2 + K x - M g = 0."""
    x, v, stiffness, mass, gravity = numbers
    joined = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    past: list[Any] = []
    for _ in range(STEPS):
        known = len(past) > 0 and len(integrator.weights) > 1
        weights, h = (integrator.weights, integrator.share * STEP) if known else ((1.0,), STEP)
        moments = [(x, v), *past[-1:]][: len(weights)]
        from_x, from_v = (sum(w * moment[k] for w, moment in zip(weights, moments, strict=True)) for k in (0, 1))
        past.append((x, v))
        inertia = np.diag(mass / h**2)
        x = np.linalg.solve(inertia + stiffness * joined, inertia @ (from_x + h * from_v) + np.outer(mass, gravity))
        v = (x - from_x) / h
    return x


@pytest.mark.parametrize("integrator", [BACKWARD_EULER, BDF2])
def test_masses_on_springs(integrator: Integrator) -> None:
    """By complex step of the recurrence, which is exact."""
    simulation, body = chain(7.0, integrator=integrator)
    miss, trajectory = add_miss(body, GOAL), Trajectory(simulation, STEPS)
    velocity = InitialVelocity(body, each=True)
    found = trajectory.gradient(miss, [body.position, velocity, body.stiffness, body.mass, simulation.gravity])
    start = [body.rest, trajectory.value(velocity), np.array([7.0]), body.mass.value, simulation.gravity.value]
    for name, numbers in zip(found, start, strict=True):
        slopes = []
        for k in range(numbers.size):
            moved = [one.astype(complex) for one in start]
            moved[list(found).index(name)].flat[k] += 1e-30j
            slopes.append(((recurrence(integrator, moved) - GOAL) ** 2).sum().imag / 1e-30)
        np.testing.assert_allclose(found[name].ravel(), slopes, rtol=1e-10, atol=1e-12)


def test_objectives_of_several_frames() -> None:
    """Energies of all frames, squares, and a function that reads velocities, together; with what was kept in part the
    same to the last bit."""
    simulation, body = chain(5.0, integrator=BDF2)
    miss = add_miss(body, GOAL)
    wind = body.vertices.add_constant("wind", 3, 1, value=np.ones((3, 3)))
    load = materials.dead_load(body.position, wind)
    body.add_energy(body.vertices.add_attribute("blown", computed_attribute=load))

    def slow(frame: FrameView) -> Any:
        v, x = frame.velocities[body], body.positions()
        return 0.5 * (v**2).sum() + x[0, 0] ** 3, {
            body: v,
            body.position: 3 * x**2 * np.eye(3)[[0]] * [[1.0], [0], [0]],
        }

    objective = [Energy(miss, "all", 0.5), Squares(body.position, [2, -2]), slow]
    trajectory = Trajectory(simulation, STEPS)
    parameters = [body.stiffness, body.mass, wind, body.anchor, body.position, InitialVelocity(body, each=True)]
    found = trajectory.gradient(objective, parameters)
    assert found.value == trajectory.objective(objective)
    directions = random_directions(trajectory, parameters)
    assert along(found, directions) == pytest.approx(difference(trajectory, objective, directions, 1e-3)[0], rel=1e-9)
    some = Trajectory(simulation, STEPS, keep="checkpoints")
    some.start = trajectory.start
    again = some.gradient(objective, parameters)
    assert again.value == found.value
    for name in found:
        np.testing.assert_array_equal(again[name], found[name])
    assert InitialValue(body.position).name in found


def test_a_run_is_taken_again_when_numbers_change() -> None:
    simulation, body = chain(5.0)
    miss, trajectory = add_miss(body, GOAL), Trajectory(simulation, STEPS)
    first = trajectory.gradient(miss, body.stiffness)
    body.stiffness.update_value(6.0)
    second = trajectory.gradient(miss, body.stiffness)
    assert second.value != first.value
    body.stiffness.update_value(5.0)
    assert trajectory.gradient(miss, body.stiffness)[body.stiffness] == first[body.stiffness]
    assert simulation.frame == STEPS


def test_a_run_that_was_stopped_early_is_said() -> None:
    """The forces that were left bound what gradients are wrong by."""
    simulation, body = chain(5.0)
    trajectory = Trajectory(simulation, 2)
    miss = add_miss(body, GOAL)
    assert trajectory.gradient(miss, body.stiffness).warnings == []
    simulation.stepper.settings = type(SETTINGS)(velocity_tolerance=1e3, linear_tolerance=0.5)
    trajectory.run()
    (warning,) = trajectory.gradient(miss, body.stiffness).warnings
    assert "settings=PRECISE" in warning


def test_forwards_as_backwards() -> None:
    """Sensitivities by one sweep forwards are the gradients of all numbers; a Gauss-Newton product is J^T J d."""
    simulation, body = chain(5.0, integrator=BDF2)
    trajectory = Trajectory(simulation, STEPS)
    parameters = [body.stiffness, body.mass, body.position, InitialVelocity(body)]
    forwards = trajectory.sensitivities(body.position, parameters, [3, -1])
    assert forwards.shape == (2, 9, 1 + 3 + 9 + 3)
    for row, frame in enumerate((3, STEPS)):
        for number in range(9):

            def one(view: FrameView, number: int = number) -> Any:
                return 0.0, {body.position: np.eye(9)[number]}

            found = trajectory.gradient(FromOutside(one, [frame]), parameters)
            backwards = np.concatenate([found[name].ravel() for name in found])
            np.testing.assert_allclose(forwards[row, number], backwards, rtol=1e-10, atol=1e-13)
    squares = [Squares(body.position, [3], 0.5), Squares(body.position, weight=2.0)]
    direction = random_directions(trajectory, parameters)
    product = trajectory.gauss_newton_product(squares, direction)
    d = np.concatenate([one.ravel() for one in direction.values()])
    wanted = 0.5 * forwards[0].T @ (forwards[0] @ d) + 2.0 * forwards[1].T @ (forwards[1] @ d)
    np.testing.assert_allclose(np.concatenate([one.ravel() for one in product.values()]), wanted, rtol=1e-10)
    with pytest.raises(SceneError, match="Squares"):
        trajectory.gauss_newton_product([FromOutside(one)], direction)  # type: ignore[list-item]
