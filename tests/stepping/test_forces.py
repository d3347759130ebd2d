"""Newton's method that stops by forces: down to rounding, in newtons for every kind of target, never silently short."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yasps import Attribute, DataError, NotConvergedError, Scene, SceneError
from yasps.bodies import AffineBody, Ground, SoftBody
from yasps.meshes import box
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings, minimize

DIRECT = NewtonSettings(
    velocity_tolerance=None, force_tolerance=1e-9, solver="direct", linear_tolerance=1e-14, max_iterations=60
)


def resting(settings: NewtonSettings) -> tuple[Simulation, float]:
    """A soft cube near the ground and its weight [N]."""
    scene = Scene("rest", threads=1)
    cube = SoftBody(scene, "cube", box((0.1, 0.1, 0.1), (2, 2, 2)).translated((0.0, 0.0, 0.0504)), youngs_modulus=5e4)
    return (
        Simulation(scene, [cube, Ground(scene)], activation_distance=1e-3, settings=settings),
        9.8 * float(cube.mass.value.sum()),
    )


def left(simulation: Simulation) -> float:
    """The largest force that is left on a vertex, by the scene's own gradient."""
    (gradient,) = simulation.scene.gradient()
    return float(np.linalg.norm(gradient.reshape(-1, 3), axis=1).max())


def test_forces_fall_to_rounding_and_are_those_of_the_accepted_state() -> None:
    simulation, weight = resting(DIRECT)
    simulation.stepper.settings = replace(DIRECT, force_tolerance=1e-9 * weight)
    for _ in range(8):
        report = simulation.step()
        assert report.residual_force <= 1e-9 * weight
        assert left(simulation) == pytest.approx(report.residual_force, abs=1e-12 * weight)
    assert report.contacts > 0
    assert report.relative_residual_force == report.residual_force / report.largest_force
    largest = max(
        np.linalg.norm(one.reshape(-1, 3), axis=1).max() for one in simulation.scene.compile().gradients().values()
    )
    assert report.largest_force == pytest.approx(largest)


def test_the_default_reports_what_it_leaves() -> None:
    simulation, weight = resting(NewtonSettings(velocity_tolerance=1e-2))
    report = simulation.run(4)[-1]
    assert report.contacts > 0
    assert report.residual_force == pytest.approx(left(simulation), rel=1e-6)
    assert 1e-9 * weight < report.residual_force < weight


def test_a_relative_tolerance_is_one_of_the_largest_force_of_an_energy() -> None:
    simulation, _ = resting(replace(DIRECT, force_tolerance=None, relative_force_tolerance=1e-7))
    report = simulation.run(4)[-1]
    assert 0 < report.relative_residual_force <= 1e-7


def test_where_nothing_acts_a_relative_tolerance_holds() -> None:
    """All forces are rounding then, and what is left of them is no small share of any."""
    scene = Scene("flight", threads=1)
    cube = SoftBody(scene, "cube", box((0.1, 0.1, 0.1), (1, 1, 1)))
    settings = replace(DIRECT, force_tolerance=None, relative_force_tolerance=1e-7)
    simulation = Simulation(scene, [cube], contact=False, gravity=(0.0, 0.0, 0.0), settings=settings)
    simulation.set_velocity(cube, (0.0, 0.0, 5.0))
    reports = simulation.run(5)
    assert max(report.relative_residual_force for report in reports) > 1e-3
    assert max(report.residual_force for report in reports) < 1e-9


def test_all_tolerances_must_hold() -> None:
    simulation, _ = resting(replace(DIRECT, velocity_tolerance=1e-9, force_tolerance=1e9))
    report = simulation.run(3)[-1]
    assert report.largest_velocity < 1e-9
    simulation, _ = resting(replace(DIRECT, velocity_tolerance=1e3, force_tolerance=1e-6))
    report = simulation.run(3)[-1]
    assert report.residual_force <= 1e-6


def test_forces_that_rounding_forbids_are_an_error_that_says_what_is_left() -> None:
    simulation, _ = resting(replace(DIRECT, force_tolerance=1e-30, max_iterations=30))
    with pytest.raises(NotConvergedError, match=r"largest force left is .* N on cube\.vertices\.position, instance \d"):
        simulation.stepper.step()


def test_where_the_energy_is_all_rounding_the_slope_decides() -> None:
    """Newton's method on s^2 sqrt(1 + x^2 / s^2) jumps from x to -x^3 / s^2, away from 0 beyond s. An energy of 1e6 J
    beside it hides that, but not the slope, which changes its sign and grows."""
    scene = Scene("offset", threads=1)
    points = scene.add_mesh("m").add_primitive("points", 1)
    size = 1e-8
    x = points.add_attribute("x", 3, 1, value=[[2.0 * size, 0.0, 0.0]])
    bowl = size**2 * (1.0 + x.dot(x) / size**2).sqrt()
    scene.add_energy(points.add_attribute("bowl", computed_attribute=1e6 + bowl))
    scene.add_minimize_target(x)
    report = minimize(scene, [x], 1.0, settings=replace(DIRECT, force_tolerance=1e-20))
    assert min(report.step_lengths) < 1.0
    assert report.iterations < 10
    assert np.abs(x.value).max() <= 1e-19


def lever(settings: NewtonSettings, arms: dict[Attribute, float] | None = None, arm: float = 2.0) -> float:
    """A bar of 2 m that a spring of 3 N m turns to 0.2 rad; the residual of its only iteration [N]."""
    scene = Scene("lever", threads=1)
    bar = scene.add_mesh("m").add_primitive("bar", 1)
    angle = bar.add_attribute("angle", 1, 1, value=0.3)
    scene.add_energy(bar.add_attribute("spring", computed_attribute=3.0 * ((angle - 0.2).cos() * -1)))
    scene.add_minimize_target(angle)
    arms = {angle: arm} if arms is None else arms
    return minimize(scene, [], 1.0, settings=settings, arms=arms).residual_force


def test_torques_are_forces_over_the_arm() -> None:
    once = NewtonSettings(velocity_tolerance=1.0, solver="direct")
    assert lever(once, {}) == pytest.approx(2.0 * lever(once), rel=1e-12)
    with pytest.raises(SceneError, match=r"arms: 'nothing' is no minimisation target"):
        lever(once, {"nothing": 1.0})  # type: ignore[dict-item]
    with pytest.raises(SceneError, match=r"the arm of m\.bar\.angle must be positive"):
        lever(once, arm=0.0)


def test_the_arm_of_an_affine_body_is_its_farthest_vertex() -> None:
    scene = Scene("stiff", threads=1)
    body = AffineBody(scene, "stiff", box((0.1, 0.2, 0.2), (1, 1, 1)))
    (matrix, _) = body.targets
    assert body.arms == {matrix: pytest.approx(0.15)}
    simulation = Simulation(scene, [body], contact=False)
    assert simulation.stepper.arms == body.arms


def test_what_no_tolerance_can_be() -> None:
    with pytest.raises(DataError, match="needs a tolerance"):
        NewtonSettings(velocity_tolerance=None)
    for name, wrong, words in (
        ("force_tolerance", 0.0, "force_tolerance .* must be positive, .* got 0.0 N"),
        ("velocity_tolerance", float("nan"), "velocity_tolerance .* must be positive, .* m/s"),
        ("velocity_tolerance", "slow", "velocity_tolerance .* needs real numbers"),
        ("relative_force_tolerance", float("inf"), "relative_force_tolerance .* must be positive"),
        ("max_iterations", 0, "max_iterations must be a positive integer, got 0"),
        ("max_iterations", 1.5, "max_iterations must be a positive integer, got 1.5"),
        ("longest_step", 0.5, "longest_step is 1 or more Newton steps, got 0.5"),
        ("shortest_step", 2.0, "shortest_step is a share of the Newton step, got 2.0"),
    ):
        with pytest.raises(DataError, match=words):
            NewtonSettings(**{name: wrong})  # type: ignore[arg-type]


def test_the_centre_of_mass_of_a_colliding_pair_moves_straight() -> None:
    """Nothing but contact and elasticity acts, so momentum stays to what is left of the forces."""
    scene = Scene("pair", threads=1)
    shape = box((0.1, 0.1, 0.1), (2, 2, 2))
    first = SoftBody(scene, "first", shape.rotated((0.3, 1.0, 0.2), 0.4), youngs_modulus=2e4)
    second = SoftBody(scene, "second", shape.translated((0.03, 0.02, 0.14)), youngs_modulus=5e4, density=500.0)
    simulation = Simulation(
        scene,
        [first, second],
        gravity=(0.0, 0.0, 0.0),
        activation_distance=1e-3,
        barrier="paper",
        settings=replace(DIRECT, force_tolerance=1e-11),
        velocities={first: (0.2, 0.1, 1.0), second: (0.1, -0.1, -1.5)},
    )
    mass = np.concatenate([first.mass.value, second.mass.value])

    def centre() -> np.ndarray:
        return mass @ np.concatenate([first.positions(), second.positions()]) / mass.sum()

    start = centre()
    velocity = simulation.stepper.momentum() / mass.sum()
    spread, most = 0.0, 0
    for step in range(1, 8):
        most = max(most, simulation.step().contacts)
        straight = start + velocity * simulation.time
        spread = max(spread, float(np.abs(centre() - straight).max()) / simulation.time)
        assert step * 0.01 == pytest.approx(simulation.time)
    assert most > 10
    assert np.abs(simulation.velocity_of(first).mean(axis=0) - [0.2, 0.1, 1.0]).max() > 0.3  # they did collide
    assert spread < 1e-10 * np.linalg.norm(velocity)
