"""Errors that show when results are asked for, and what all errors are."""

from __future__ import annotations

import numpy as np
import pytest
from refusals import World, make_world

from yasps import (
    ConnectivityError,
    DataError,
    LineageError,
    NameTakenError,
    NotConvergedError,
    NotFiniteError,
    Scene,
    SceneError,
    ShapeMismatchError,
    YaspsError,
)


@pytest.fixture
def world() -> World:
    """A fresh one for each test."""
    return make_world()


def test_every_error_is_a_yasps_error_and_a_standard_one() -> None:
    for wrong_input in (NameTakenError, LineageError, ShapeMismatchError, DataError, ConnectivityError, SceneError):
        assert issubclass(wrong_input, YaspsError)
        assert issubclass(wrong_input, ValueError)
    for wrong_numbers in (NotFiniteError, NotConvergedError):
        assert issubclass(wrong_numbers, YaspsError)
        assert issubclass(wrong_numbers, ArithmeticError)


def test_result_without_targets() -> None:
    scene = Scene("s")
    x = scene.add_attribute("x", 1, 1)
    scene.add_energy(x * x)
    with pytest.raises(SceneError, match="no minimisation target yet"):
        scene.minimize_energy()
    with pytest.raises(SceneError, match="no minimisation target yet"):
        scene.gradient()


# -- what only shows in numbers: these compile ---------------------------------------------------------------


def test_stale_sizes_are_told_at_the_next_result(world: World) -> None:
    position = world.pairs.add_attribute("positions", through=world.pair2point, source=world.all_points["x"])
    apart = position.row(0) - position.row(1)
    world.scene.add_energy(world.pairs["weight"] * apart.dot(apart))
    good = world.scene.total_energy()
    world.pair2point.update_value([[0, 5], [1, 7], [2, 6]])
    for result in (world.scene.total_energy, world.scene.gradient, world.scene.minimize_energy):
        with pytest.raises(
            DataError, match=r"all\.pairs has 3 instances, but all\.pairs\.weight has numbers for 2.*update"
        ):
            result()
    world.pairs["weight"].update_value([1.0, 2.0, 0.0])
    world.pairs["offset"].update_value(np.zeros(6))
    assert world.scene.total_energy() == pytest.approx(good, rel=1e-14)
    world.pairs["weight"].update_value([1.0])
    with pytest.raises(
        ConnectivityError, match=r"all\.pairs has 1 instances, but all\.pairs\.pair2point has rows for 3"
    ):
        world.scene.total_energy()


def test_a_dynamic_target_that_shrank_is_an_error_not_a_memory_fault() -> None:
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    drops = mesh.add_primitive("drops", 4, is_dynamic=True)
    height = drops.add_attribute("height", 1, 1, value=[1.0, 2.0, 3.0, 4.0])
    walls = mesh.add_primitive("walls", 2)
    wall2drop = walls.add_connectivity("wall2drop", drops, [0, 3], 1)
    joined = walls.add_attribute("height", through=wall2drop, source=height)
    scene.add_energy(joined * joined)
    scene.add_energy(height * height)
    scene.add_minimize_target(height)
    doubled = joined * 2.0
    np.testing.assert_array_equal(doubled.compute().value, [2.0, 8.0])
    assert scene.total_energy() == 17.0 + 30.0
    height.update_value([5.0, 6.0])
    for result in (scene.total_energy, scene.gradient, scene.minimize_energy, doubled.compute, scene.energy_values):
        with pytest.raises(
            ConnectivityError, match=r"m\.walls\.wall2drop: index 3 .* m\.drops has 2 instances.*shrunk"
        ):
            result()
    wall2drop.update_value([0, 1])
    np.testing.assert_array_equal(doubled.compute().value, [10.0, 12.0])
    np.testing.assert_array_equal(np.concatenate(scene.gradient()), [20.0, 24.0])
    np.testing.assert_allclose(scene.minimize_energy(1e-20)[0], [5.0, 6.0])
    drops.update(height=[])
    with pytest.raises(ConnectivityError, match="0 instances, so none is valid"):
        scene.total_energy()


def test_stale_numbers_on_a_union_are_told() -> None:
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    fixed, moving = mesh.add_primitive("fixed", 2), mesh.add_primitive("moving", 1, is_dynamic=True)
    for member in (fixed, moving):
        member.add_attribute("a", 1, 1, value=np.ones(member.num_instances))
    union = mesh.add_primitive_union("union", [fixed, moving])
    union.add_attribute("a")
    weight = union.add_attribute("weight", 1, 1, value=[1.0, 2.0, 3.0])
    itself = union.add_connectivity("itself", fixed, [0, 1, 0], 1)
    product = weight * union["a"] * union.add_attribute("b", through=itself, source=fixed["a"])
    np.testing.assert_array_equal(product.compute().value, [1.0, 2.0, 3.0])
    moving["a"].update_value([5.0, 7.0])
    with pytest.raises(ConnectivityError, match=r"m\.union has 4 instances, but m\.union\.itself has rows for 3"):
        product.compute()
    itself.update_value([0, 1, 0, 1])
    with pytest.raises(DataError, match=r"m\.union has 4 instances, but m\.union\.weight has numbers for 3"):
        product.compute()
    weight.update_value([1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(product.compute().value, [1.0, 2.0, 15.0, 28.0])


def test_derivatives_that_are_not_finite_name_energy_and_instance() -> None:
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("points", 3)
    x = points.add_attribute("x", 1, 1, value=[1.0, 0.0, 2.0])
    scene.add_energy(points.add_attribute("barrier", computed_attribute=-x.log()))
    scene.add_minimize_target(x)
    with pytest.raises(NotFiniteError, match=r"m\.points\.barrier .* instance 1"):
        scene.minimize_energy()
    assert scene.total_energy() == np.inf
    x.update_value([1.0, 2.0, 4.0])
    np.testing.assert_allclose(scene.minimize_energy(1e-20)[0], [-1.0, -2.0, -4.0])


def test_not_converged_says_why_and_solve_returns_the_rest() -> None:
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("points", 30)
    x = points.add_attribute("x", 1, 1, value=np.linspace(-1, 1, 30) ** 3)
    edges = scene.m.add_primitive("edges", 29)
    ends = edges.add_connectivity("ends", points, [[k, k + 1] for k in range(29)], 2)
    both = edges.add_attribute("x", through=ends, source=x)
    scene.add_energy(1000.0 * (both[0] - both[1]) ** 2)
    scene.add_energy(x * x)
    scene.add_minimize_target(x)
    with pytest.raises(NotConvergedError, match=r"max iterations.*after 3 iterations.*Raise max_iterations") as caught:
        scene.minimize_energy(tolerance=1e-20, max_iterations=3)
    assert "solve()" in str(caught.value)
    solution = scene.solve(tolerance=1e-20, max_iterations=3)
    assert not solution.report.converged
    assert solution.directions[0].shape == solution.gradient[0].shape == (30,)
    np.testing.assert_allclose(scene.minimize_energy(tolerance=1e-24)[0], x.value, rtol=1e-8)


def test_a_target_that_no_energy_knows_is_named() -> None:
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("points", 2)
    x, unused = points.add_attribute("x", 1, 1, value=[1.0, 2.0]), points.add_attribute("unused", 2, 1)
    scene.add_energy(x * x)
    scene.add_minimize_target([x, unused])
    with pytest.raises(NotConvergedError, match=r"m\.points\.unused, instance 0 is not positive definite"):
        scene.minimize_energy()
