"""What a compiled scene must find again when numbers, indices and sizes change, and what a refused change leaves."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import ConnectivityError, DataError, Primitive, Scene
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.matrix.ordering import FEWEST_BLOCKS


def check(scene: Scene) -> CpuScene:
    """Gradient and Hessian are those of the interpreter, which keeps nothing."""
    compiled = scene.compile()
    assert isinstance(compiled, CpuScene)
    gradient = compiled.assemble()
    expected, hessian = Interpreter(compiled.module, compiled.data()).assemble()
    np.testing.assert_allclose(gradient, expected, rtol=1e-13, atol=1e-13)
    found = compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()
    np.testing.assert_allclose(found.toarray(), hessian.toarray(), rtol=1e-13, atol=1e-13)
    return compiled


def pairs_scene() -> tuple[Scene, Primitive]:
    """Five points, each held at its place, and weighted pairs that come and go."""
    scene = Scene("pairs", threads=1)
    mesh = scene.add_mesh("m")
    points = mesh.add_primitive("points", 5)
    x = points.add_attribute("x", 1, 1, value=np.arange(5.0) ** 2)
    scene.add_energy(points.add_attribute("hold", computed_attribute=0.5 * x * x))
    pairs = mesh.add_primitive("pairs", 2, is_dynamic=True)
    ends = pairs.add_connectivity("ends", points, [[0, 1], [1, 2]], 2)
    weight = pairs.add_constant("weight", 1, 1, value=[2.0, 3.0])
    both = pairs.add_attribute("both", through=ends, source=x)
    gap = both.row(1) - both.row(0)
    scene.add_energy(pairs.add_attribute("spring", computed_attribute=weight * gap * gap))
    scene.add_minimize_target(x)
    return scene, pairs


def test_as_many_pairs_at_other_places() -> None:
    scene, pairs = pairs_scene()
    check(scene)
    for ends in ([[3, 4], [0, 2]], [[4, 0], [2, 1]]):
        pairs.connectivities["ends"].update_value(ends)
        check(scene)
    pairs.update(ends=[[1, 3], [1, 4]], weight=[5.0, 7.0])
    check(scene)


def test_numbers_of_the_same_count_alone() -> None:
    """They lie in another array than before."""
    scene, pairs = pairs_scene()
    check(scene)
    for k in range(5):
        weights = np.array([1.0 + k, 20.0 + k])
        pairs.update(weight=weights)
        gaps = np.array([1.0, 3.0])
        np.testing.assert_allclose(scene.energy_values()["m.pairs.spring"], weights * gaps**2)
        check(scene)


def test_a_target_that_grows_moves_those_after_it() -> None:
    """The energy behind it reads nothing of what has grown."""
    scene = Scene("growing", threads=1)
    mesh = scene.add_mesh("m")
    drops, points = mesh.add_primitive("drops", 2, is_dynamic=True), mesh.add_primitive("points", 3)
    y = drops.add_attribute("y", 1, 1, value=[1.0, 2.0])
    x = points.add_attribute("x", 1, 1, value=[3.0, 4.0, 5.0])
    scene.add_energy(drops.add_attribute("drop", computed_attribute=y * y))
    scene.add_energy(points.add_attribute("point", computed_attribute=x * x))
    scene.add_minimize_target([y, x])
    for numbers in ([1.0, 2.0], [7.0, 8.0, 9.0, 10.0], [6.0]):
        drops.update(y=numbers)
        check(scene)
        of_y, of_x = scene.gradient()
        np.testing.assert_allclose(of_y, 2 * np.array(numbers))
        np.testing.assert_allclose(of_x, [6.0, 8.0, 10.0])


def test_a_refused_update_of_several_parts_changes_none() -> None:
    scene, pairs = pairs_scene()
    before = scene.gradient()[0]
    with pytest.raises(DataError, match="same number of instances"):
        pairs.update(ends=[[3, 4], [0, 2], [1, 4]], weight=[1.0, 2.0])
    with pytest.raises(DataError):
        pairs.update(ends=[[3, 4], [0, 2]], weight=[1.0, np.nan, 3.0])
    assert pairs.connectivities["ends"].indices.tolist() == [[0, 1], [1, 2]]
    np.testing.assert_array_equal(scene.gradient()[0], before)


@pytest.mark.parametrize("wrong", [5, -1, 2**31 - 1])
def test_the_number_of_instances_is_no_index(wrong: int) -> None:
    _, pairs = pairs_scene()
    with pytest.raises(ConnectivityError, match=f"index {wrong} of instance 1"):
        pairs.connectivities["ends"].update_value([[0, 4], [1, wrong]])
    assert pairs.connectivities["ends"].indices.tolist() == [[0, 1], [1, 2]]


def test_rows_of_variable_arity_that_get_shorter() -> None:
    scene = Scene("stars", threads=1)
    mesh = scene.add_mesh("m")
    points, stars = mesh.add_primitive("points", 5), mesh.add_primitive("stars", 2)
    x = points.add_attribute("x", 1, 1, value=[10.0, 20.0, 30.0, 40.0, 50.0])
    rays = stars.add_connectivity("rays", points, [1, 2, 3, 4], counts=[3, 1])
    total = stars.add_attribute("total", through=rays, source=x, operation="sum")
    scene.add_energy(stars.add_attribute("pull", computed_attribute=total * total))
    scene.add_minimize_target(x)
    for indices, counts, sums in (([1, 2, 3, 4], [3, 1], [90.0, 50.0]), ([2, 4], [1, 1], [30.0, 50.0])):
        rays.update_value((indices, counts))
        np.testing.assert_allclose(total.compute().array.ravel(), sums)
        check(scene)


def springs_in_random_order(*, own_target: bool) -> Scene:
    """Enough springs for an order of their own. Each reads the rest length of another one, or a target of its own."""
    count = FEWEST_BLOCKS + 100
    rng = np.random.default_rng(3)
    scene = Scene("springs", threads=1)
    mesh = scene.add_mesh("m")
    points = mesh.add_primitive("points", count)
    x = points.add_attribute("x", 1, 1, value=np.arange(count) + rng.normal(0, 0.1, count))
    springs = mesh.add_primitive("springs", count - 1)
    ends = springs.add_connectivity(
        "ends", points, rng.permutation(np.column_stack([np.arange(count - 1), np.arange(1, count)])), 2
    )
    both = springs.add_attribute("both", through=ends, source=x)
    numbers = rng.uniform(0.5, 1.5, count - 1)
    targets = [x]
    if own_target:
        rest = springs.add_attribute("rest", 1, 1, value=numbers)
        targets.append(rest)
    else:
        own = springs.add_constant("length", 1, 1, value=numbers)
        partner = springs.add_connectivity("partner", springs, rng.permutation(count - 1), 1)
        rest = springs.add_attribute("rest", through=partner, source=own) + own
    stretch = both.row(1) - both.row(0) - rest
    scene.add_energy(springs.add_attribute("spring", computed_attribute=stretch * stretch))
    scene.add_minimize_target(targets)
    return scene


@pytest.mark.parametrize("own_target", [False, True])
def test_only_instances_that_do_not_read_each_other_have_another_order(own_target: bool) -> None:
    scene = springs_in_random_order(own_target=own_target)
    compiled = scene.compile()
    assert isinstance(compiled, CpuScene)
    for _ in range(2):
        gradient = compiled.assemble()
        np.testing.assert_allclose(
            gradient, Interpreter(compiled.module, compiled.data()).assemble()[0], rtol=1e-12, atol=1e-12
        )
        for target in scene.minimize_targets:
            target.update_value(1.1 * target.value)
    assert (compiled.placements[compiled._terms[0].symbol].ordered is not None) == own_target
