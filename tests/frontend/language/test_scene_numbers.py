"""All numbers of a scene by name, and digests of its formulas."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yasps import Attribute, ConnectivityError, DataError, Scene, SceneError


def small() -> Scene:
    """A constant, a variable, indices of fixed and of variable arity, a dynamic primitive."""
    scene = Scene("small", threads=1)
    scene.add_constant("stiffness", 1, 1, value=2.0)
    mesh = scene.add_mesh("mesh")
    points = mesh.add_primitive("points", 3)
    x = points.add_attribute("x", 2, 1, value=np.arange(6.0))
    ring = points.add_connectivity("ring", points, [1, 2, 0], counts=[2, 0, 1])
    points.add_attribute("around", through=ring, source=x, operation="sum")
    pairs = mesh.add_primitive("pairs", 0, is_dynamic=True)
    ends = pairs.add_connectivity("ends", points, [], 2)
    pairs.add_attribute("positions", through=ends, source=x)
    pairs.add_constant("weight", 1, 1)
    return scene


def test_numbers_have_paths_and_are_read_only() -> None:
    numbers = small().numbers()
    assert list(numbers) == ["stiffness", "mesh.points.x", "mesh.points.ring", "mesh.pairs.weight", "mesh.pairs.ends"]
    assert numbers["mesh.points.x"].shape == (3, 2, 1)
    np.testing.assert_array_equal(numbers["mesh.points.ring"], [[1, 2], [-1, -1], [0, -1]])
    for array in numbers.values():
        assert not array.flags.writeable


def test_numbers_go_from_one_scene_to_another() -> None:
    one, other = small(), small()
    one.mesh.points["x"].update_value(np.ones(6))
    one.mesh.points.ring.update_value([0, 1, 1], counts=[1, 1, 1])
    one.mesh.pairs.update(ends=[[0, 1], [1, 2]], weight=[3.0, 4.0])
    other.set_numbers({path: array.copy() for path, array in one.numbers().items()})
    for path, array in one.numbers().items():
        np.testing.assert_array_equal(other.numbers()[path], array)
    assert other.mesh.pairs.num_instances == 2
    other.set_numbers({"mesh.points.x": np.zeros((3, 2, 1))})
    assert not other.mesh.points["x"].value.any()


@pytest.mark.parametrize(
    ("values", "error", "words"),
    [
        ({"mesh.points.y": [1.0]}, SceneError, "scene small has no stored numbers or indices 'mesh.points.y'"),
        ({"mesh.points.around": np.zeros(6)}, SceneError, "has no stored numbers"),
        ({"mesh.points.x": np.zeros(5)}, DataError, "mesh.points.x"),
        ({"stiffness": np.nan}, DataError, "stiffness"),
        ({"mesh.pairs.ends": [[0, 7]], "mesh.pairs.weight": [1.0]}, ConnectivityError, "mesh.pairs.ends"),
        ({"mesh.pairs.ends": [[0, 1]]}, DataError, "all parts need the same number of instances"),
    ],
)
def test_numbers_that_do_not_fit_change_nothing(values: dict[str, object], error: type[Exception], words: str) -> None:
    scene = small()
    before = {path: array.copy() for path, array in scene.numbers().items()}
    with pytest.raises(error, match=words):
        scene.set_numbers({"stiffness": 3.0, **values})  # type: ignore[dict-item]
    for path, array in scene.numbers().items():
        np.testing.assert_array_equal(array, before[path])


def digest(formula: Callable[[Attribute, Attribute], Attribute]) -> str:
    """Of an energy of x, 3x1, and a constant."""
    scene = Scene("s", threads=1)
    points = scene.add_mesh("m").add_primitive("points", 2)
    x, k = points.add_attribute("x", 3, 1), points.add_constant("k", 1, 1)
    points.add_attribute("energy", computed_attribute=formula(x, k))
    scene.add_energy(points["energy"])
    return scene.formulas()["m.points.energy"]


def test_formulas_are_told_apart() -> None:
    formulas: list[Callable[[Attribute, Attribute], Attribute]] = [
        lambda x, k: 0.5 * k * x.dot(x),
        lambda x, k: 0.25 * k * x.dot(x),
        lambda x, k: 0.5 * k * x.dot(x).sin(),
        lambda x, k: 0.5 * k * x.dot(x).cos(),
        lambda x, k: 0.5 * x.dot(x),
        lambda x, k: 0.5 * k * x[0] * x[0],
        lambda x, k: 0.5 * k * x[1] * x[1],
    ]
    digests = [digest(formula) for formula in formulas]
    assert len(set(digests)) == len(formulas)
    assert digests == [digest(formula) for formula in formulas]
