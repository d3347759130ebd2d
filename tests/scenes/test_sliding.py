"""Blocks that slide and blocks that stick: on a level plane, and on a slope of 26.565 degrees, where friction of 0.5
just holds.

The oracle is backward Euler's own sliding block (closed_forms.py), so what is left is contact's error and not the time
step's. The velocity tolerance is a tenth of eps_v throughout.
"""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import creep_speed, pressure_over_stiffness, relative_gap, speeds
from scene_shapes import SLOPE, block, lower_areas, point_areas, slope_directions, slope_mesh

from yasps import Scene
from yasps.bodies import AffineBody, HalfSpace, Obstacle, SoftBody
from yasps.contact import ContactTable
from yasps.simulation import Simulation
from yasps.stepping import BACKWARD_EULER, BDF2, Integrator, NewtonSettings

GRAVITY = 9.8  # m/s^2
EPS_V = 1e-3  # m/s
DISTANCE = 1e-3  # m, of activation
DENSITY = 1000.0  # kg/m^3
WEIGHT = DENSITY * GRAVITY  # N, of a cubic metre
MODULUS = {"affine": 1e7, "soft": 1e9}  # Pa
DOWN, NORMAL = slope_directions(SLOPE)[1], slope_directions(SLOPE)[0]


def on_plane(
    kind: str,
    plane: str,
    friction: float,
    angle: float = 0.0,
    *,
    dt: float = 0.01,
    eps_v: float = EPS_V,
    integrator: Integrator = BACKWARD_EULER,
) -> tuple[Simulation, AffineBody | SoftBody]:
    """A unit cube that lies on a plane of that slope, at the gap at which the barrier bears its weight."""
    normal, _ = slope_directions(angle)
    shape = block((1.0, 1.0, 1.0))
    # Over a plane of two large triangles only one side of the pair counts: half the weights, twice the pressure.
    area = point_areas(shape)[lower_areas(shape) > 0].sum() * (1.0 if plane == "half-space" else 0.5)
    gap = DISTANCE * relative_gap(WEIGHT * np.cos(angle) / area, 0.1 * MODULUS[kind])
    shape = shape.rotated((0.0, 1.0, 0.0), angle).translated(gap * normal)
    scene = Scene("sliding", threads=1)
    make = SoftBody if kind == "soft" else AffineBody
    body = make(scene, "block", shape, density=DENSITY, youngs_modulus=MODULUS[kind])
    if plane == "half-space":
        ground: HalfSpace | Obstacle = HalfSpace(scene, "plane", normal=tuple(normal))
    else:
        ground = Obstacle(scene, "plane", slope_mesh(angle))
    simulation = Simulation(
        scene,
        [body, ground],
        time_step=dt,
        gravity=(0.0, 0.0, -GRAVITY),
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=friction),
        eps_v=eps_v,
        integrator=integrator,
        settings=NewtonSettings(velocity_tolerance=0.1 * eps_v, force_tolerance=1e-6 * WEIGHT, solver="direct"),
    )
    simulation.rescue = 0
    # First it settles straight onto the plane.
    simulation.gravity.update_value(-GRAVITY * np.cos(angle) * normal)
    for _ in range(10):
        simulation.step()
    simulation.gravity.update_value([0.0, 0.0, -GRAVITY])
    return simulation, body


def centre(body: AffineBody | SoftBody) -> np.ndarray:
    mass = body.mass.value
    return np.asarray(mass @ body.positions() / mass.sum())


def mean_velocity(simulation: Simulation, body: AffineBody | SoftBody) -> np.ndarray:
    mass = body.mass.value
    return np.asarray(mass @ simulation.velocity_of(body) / mass.sum())


def test_the_closed_forms() -> None:
    assert sum(speeds(1.0, 0.0, 4.9, 0.01, steps=100)) * 0.01 == pytest.approx(1 / (2 * 4.9), rel=0.06)
    assert pressure_over_stiffness(relative_gap(3e3, 1e5)) == pytest.approx(0.03, rel=1e-12)
    assert speeds(0.0, 4.9, 5.0, 0.01, steps=500, slip_speed=1e-3)[-1] == pytest.approx(creep_speed(4.9, 5.0, 1e-3))


def slide(kind: str, plane: str, dt: float) -> None:
    """Distance until it stops within 1 % of Coulomb's law in backward Euler; within 0.1 % of the smoothed law."""
    friction, start = 0.3, 1.0
    simulation, body = on_plane(kind, plane, friction, dt=dt)
    simulation.set_velocity(body, (start, 0.0, 0.0))
    before = centre(body)
    steps = int(1.1 * start / (friction * GRAVITY * dt))
    for _ in range(steps):
        simulation.step()
    way = float((centre(body) - before)[0])
    coulomb = dt * sum(speeds(start, 0.0, friction * GRAVITY, dt, steps=steps))
    smoothed = dt * sum(speeds(start, 0.0, friction * GRAVITY, dt, steps=steps, slip_speed=EPS_V))
    assert way == pytest.approx(coulomb, rel=1e-2)
    assert way == pytest.approx(smoothed, rel=1e-3)
    assert float(np.abs(mean_velocity(simulation, body)).max()) < EPS_V


def test_sliding_distance_is_backward_eulers_own() -> None:
    slide("affine", "half-space", 0.01)


@pytest.mark.nightly
@pytest.mark.parametrize("dt", [0.01, 0.0025])
@pytest.mark.parametrize("plane", ["half-space", "mesh"])
@pytest.mark.parametrize("kind", ["affine", "soft"])
def test_sliding_distance(kind: str, plane: str, dt: float) -> None:
    slide(kind, plane, dt)


def slips(kind: str, plane: str, steps: int) -> None:
    """At 0.49 it gains g (sin - mu cos) dt a step, once it is faster than eps_v."""
    simulation, body = on_plane(kind, plane, 0.49, SLOPE)
    found = []
    for _ in range(steps):
        simulation.step()
        found.append(float(mean_velocity(simulation, body) @ DOWN))
    half = steps // 2
    assert found[half] > 2 * EPS_V
    rate = (found[-1] - found[half]) / ((steps - 1 - half) * 0.01)
    assert rate == pytest.approx(GRAVITY * (np.sin(SLOPE) - 0.49 * np.cos(SLOPE)), rel=1e-3)


def sticks(kind: str, plane: str, steps: int, integrator: Integrator = BACKWARD_EULER) -> None:
    """At 0.51 it creeps, at the speed at which the smoothed law bears the pull, below eps_v."""
    simulation, body = on_plane(kind, plane, 0.51, SLOPE, integrator=integrator)
    found = []
    for _ in range(steps):
        simulation.step()
        found.append(float(mean_velocity(simulation, body) @ DOWN))
    assert max(found[steps // 2 :]) < EPS_V  # at first the block leans
    creep = creep_speed(np.sin(SLOPE), 0.51 * np.cos(SLOPE), EPS_V)
    assert found[-1] == pytest.approx(creep, rel=1e-3)
    assert abs(float(mean_velocity(simulation, body) @ NORMAL)) < 1e-3 * EPS_V


def test_the_slope_slips_at_49_and_sticks_at_51() -> None:
    slips("affine", "half-space", 20)
    sticks("affine", "half-space", 20)


def test_bdf2_slides_by_its_own_recurrence_and_creeps_at_the_same_speed() -> None:
    """v' = V - 2/3 dt mu g with V = (4 v - v_before) / 3; slips and their length are those of BDF2's velocity."""
    friction, dt = 0.3, 0.01
    simulation, body = on_plane("affine", "half-space", friction, dt=dt, integrator=BDF2)
    simulation.set_velocity(body, (1.0, 0.0, 0.0))
    simulation.step()  # of backward Euler
    before, v = 1.0, 1.0 - dt * friction * GRAVITY
    assert float(mean_velocity(simulation, body)[0]) == pytest.approx(v, rel=1e-3)
    for _ in range(10):
        simulation.step()
        before, v = v, (4 * v - before) / 3 - 2 / 3 * dt * friction * GRAVITY
        assert float(mean_velocity(simulation, body)[0]) == pytest.approx(v, rel=1e-3)
    sticks("affine", "half-space", 32, BDF2)  # it takes longer than backward Euler to come to rest


@pytest.mark.nightly
@pytest.mark.parametrize("plane", ["half-space", "mesh"])
@pytest.mark.parametrize("kind", ["affine", "soft"])
def test_slope(kind: str, plane: str) -> None:
    slips(kind, plane, 100)
    sticks(kind, plane, 100)
