"""What the line search promises: no way through an obstacle, straight or curved, and pairs of where it ends."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from yasps import Attribute, NotConvergedError, Scene, concat_rows
from yasps.contact import BarrierContact
from yasps.stepping import NewtonSettings, minimize

PLATE = np.array([[-0.02, -0.02, 0.0], [0.02, -0.02, 0.0], [0.0, 0.03, 0.0]])
"""A small triangle that moves."""


def wall(inner: float, outer: float, angle: float) -> np.ndarray:
    """Two triangles that stand on the plane of a turn, from one radius to another; corners [4, 3]."""
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    up = np.array([0.0, 0.0, 0.2])
    return np.array([inner * along - up, outer * along - up, outer * along + up, inner * along + up])


def turning_plate(walls: list[np.ndarray], goal: float) -> tuple[Scene, BarrierContact, Attribute]:
    """A plate at radius 1 whose angle a spring pulls to `goal`: Newton's step is the whole way there."""
    scene = Scene("turn")
    mesh = scene.add_mesh("mesh")
    lever = mesh.add_primitive("lever", 1)
    angle = lever.add_attribute("angle", 1, 1)
    moving = mesh.add_primitive("moving", 3)
    a = moving.add_attribute(
        "angle", through=moving.add_connectivity("of_lever", lever, np.zeros(3, int), 1), source=angle
    )
    rest = moving.add_constant("rest", 3, 1, value=PLATE + np.array([1.0, 0.0, 0.0]))
    turned = concat_rows([a.cos() * rest[0] - a.sin() * rest[1], a.sin() * rest[0] + a.cos() * rest[1], rest[2]])
    moving.add_attribute("position", computed_attribute=turned)
    fixed = mesh.add_primitive("fixed", 4 * len(walls))
    fixed.add_constant("position", 3, 1, value=np.concatenate(walls))
    points = mesh.add_primitive_union("points", [moving, fixed])
    points.add_attribute("position")
    corners = np.array([[0, 1, 2], [0, 2, 3]])
    triangles = np.concatenate([[[0, 1, 2]], *(3 + 4 * k + corners for k in range(len(walls)))])
    pull = 5.0 * (angle - goal) * (angle - goal)
    scene.add_energy(lever.add_attribute("spring", computed_attribute=pull))
    scene.add_minimize_target(angle)
    contact = BarrierContact(
        mesh,
        points,
        triangles,
        activation_distance=0.01,
        barrier="paper",
        stiffness=1e8,
        fixed=np.arange(points.num_instances) >= 3,
    )
    return scene, contact, angle


def test_a_curved_way_does_not_jump_over_a_wall() -> None:
    """The straight way to the opposite side leads through the middle, where a wall shortens it to 0.7. The vertices are
    then not on that way but on their circle, behind another wall that only the turn meets."""
    middle, beside = wall(0.4, 0.5, np.pi), wall(0.3, 1.5, np.pi / 3)
    scene, contact, angle = turning_plate([middle, beside], np.pi)
    start = contact.positions()
    opposite = start.copy()
    opposite[:3, :2] *= -1
    bound, _ = contact.free_step(start, opposite)
    assert 0.6 < bound < 0.8
    behind = np.pi * bound
    assert behind > np.pi / 3 + 0.2
    minimize(scene, [], 1.0, contact=contact, settings=NewtonSettings(velocity_tolerance=1e-6))
    assert 0.9 < float(angle.value[0]) < np.pi / 3  # it came to the wall and no further
    assert len(contact.active) > 0


def test_without_the_wall_it_arrives() -> None:
    scene, contact, angle = turning_plate([wall(0.3, 1.5, -np.pi / 2)], 2.5)
    minimize(scene, [], 1.0, contact=contact, settings=NewtonSettings(velocity_tolerance=1e-6))
    assert float(angle.value[0]) == pytest.approx(2.5, abs=1e-5)


def plate_over_ground(height: float, goal: float) -> tuple[Scene, BarrierContact, Attribute]:
    """A plate that is pulled to the height `goal`, with a Newton step that is a tenth of what it should be."""
    scene = Scene("stiffened")
    mesh = scene.add_mesh("mesh")
    moving = mesh.add_primitive("moving", 3)
    x = moving.add_attribute("position", 3, 1, value=PLATE + np.array([0.0, 0.0, height]))
    goals = moving.add_constant("goal", 3, 1, value=PLATE + np.array([0.0, 0.0, goal]))
    offset = x - goals
    scene.add_energy(moving.add_attribute("bowl", computed_attribute=0.5 * offset.dot(offset)))
    scene.add_energy(moving.add_attribute("hill", computed_attribute=-0.45 * offset.dot(offset)))
    still = mesh.add_primitive("still", 3)
    still.add_constant("position", 3, 1, value=50 * PLATE)
    points = mesh.add_primitive_union("points", [moving, still])
    points.add_attribute("position")
    contact = BarrierContact(
        mesh,
        points,
        [[0, 1, 2], [3, 4, 5]],
        activation_distance=0.1,
        barrier="paper",
        stiffness=1e8,
        fixed=np.arange(6) >= 3,
    )
    scene.add_minimize_target(x)
    return scene, contact, x


@pytest.mark.parametrize("longest", [1.0, 8.5])
def test_pairs_are_those_of_where_a_failed_longer_step_leaves(longest: float) -> None:
    """The longer step would end in the barrier's reach, where the energy is higher: the shorter one is taken, and
    nothing is close there."""
    scene, contact, x = plate_over_ground(0.5, 0.0)
    settings = NewtonSettings(velocity_tolerance=1e-9, longest_step=longest, max_iterations=1)
    with pytest.raises(NotConvergedError, match="no convergence in 1 Newton"):
        minimize(scene, [], 1.0, contact=contact, settings=settings)
    np.testing.assert_allclose(x.value.reshape(-1, 3)[:, 2], 0.45)
    assert len(contact.active) == 0
    assert all(pairs.primitive.num_instances == 0 for pairs in contact.primitives.values())
    assert scene.total_energy() == pytest.approx(3 * 0.05 * 0.45**2)


def test_a_longer_step_that_ends_near_the_ground_brings_its_pairs() -> None:
    """Pairs and energy are those of the last place, whether a step was made longer, shorter or left."""
    scene, contact, _ = plate_over_ground(0.5, 0.05)
    settings = NewtonSettings(velocity_tolerance=1e-5, longest_step=8.0)
    report = minimize(scene, [], 1.0, contact=contact, settings=settings)
    assert len(contact.active) > 0
    expected = contact.geometry.active_set(contact.positions())
    for name, pairs in expected.kinds().items():
        assert pairs.vertices.tolist() == contact.active.kinds()[name].vertices.tolist()
        assert contact.primitives[name].primitive.num_instances == len(pairs)
    assert report.energy == pytest.approx(scene.total_energy(), rel=1e-9)
    assert report.contacts == len(expected)


def overshooting() -> tuple[Scene, Attribute]:
    """sqrt(1 + x^2) from x = 2: Newton's step is 2 + 2^3 and ends farther away than it began."""
    scene = Scene("overshooting")
    points = scene.add_mesh("m").add_primitive("points", 1)
    x = points.add_attribute("x", 3, 1, value=[2.0, 0.0, 0.0])
    scene.add_energy(points.add_attribute("cone", computed_attribute=(1 + x.dot(x)).sqrt()))
    scene.add_minimize_target(x)
    return scene, x


def test_a_step_that_raises_the_energy_is_halved() -> None:
    scene, x = overshooting()
    energies = [scene.total_energy()]
    settings = NewtonSettings(velocity_tolerance=1e-8, linear_tolerance=1e-26, longest_step=1.0, max_iterations=1)
    for _ in range(30):
        try:
            report = minimize(scene, [x], 1.0, settings=settings)
        except NotConvergedError:
            energies.append(scene.total_energy())
            continue
        break
    else:
        pytest.fail("it does not converge")
    assert report.largest_velocity < 1e-8
    assert all(after <= before * (1 + 1e-14) for before, after in pairwise(energies))
    np.testing.assert_allclose(x.value, 0.0, atol=1e-8)


def test_where_no_step_is_short_enough_everything_stays() -> None:
    scene, x = overshooting()
    before, energy = x.value, scene.total_energy()
    with pytest.raises(NotConvergedError, match="no step along the Newton direction lowers the energy"):
        minimize(scene, [x], 1.0, settings=NewtonSettings(shortest_step=0.9))
    np.testing.assert_array_equal(x.value, before)
    assert scene.total_energy() == energy
