"""Primitives that get other numbers of instances: the scene is then the one that would have been made with these."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cuda_on_host import HostDevice
from device_checks import on_device
from numpy.typing import NDArray

from yasps import ConnectivityError, DataError, Scene, SceneError
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution.scene_source import CompileRequest, watching_compiles
from yasps.runtime.matrix.ordering import FEWEST_BLOCKS

Array = NDArray[np.float64]
SOLVES: tuple[dict[str, Any], ...] = ({}, {"preconditioner": "two-level"}, {"solver": "direct"})


def around(order: NDArray[np.int64], random: np.random.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each point one to three that are near it in a chain: indices and counts."""
    counts = random.integers(1, 4, len(order))
    place = np.argsort(order)
    near = (np.repeat(place, counts) + random.integers(-2, 3, counts.sum())) % len(order)
    return order[near], counts


def data(first: int, last: int) -> dict[str, Any]:
    """Numbers and indices of `nets` with so many points in its first and its last net."""
    random = np.random.default_rng([first, last])
    order = random.permutation(first)  # which large scenes put right
    chain = np.stack([order[:-1], order[1:]], axis=1)
    return {
        "first.points.x": random.standard_normal((first, 3, 1)),
        "first.points.mass": random.uniform(1, 2, first),
        "first.points.around": around(order, random),
        "first.links.ends": chain,
        "first.links.length": random.uniform(0.1, 0.2, len(chain)),
        "last.points.x": random.standard_normal((last, 3, 1)),
        "both.points.weight": random.uniform(1, 2, first + 2 + last),
        "both.pairs.ends": np.array([[0, first + 2], [1, first + 1], [first, first + 1], [first + 1, 2]]),
    }


def nets(first: int, last: int, longest: int = 1) -> Scene:
    """Two nets of points, and two points in between, in a union: a chain of springs, points drawn to the mean of
    others, weights on the union, and pairs, the third of which are the two in between."""
    given = data(first, last)
    scene = Scene("nets", threads=2, deterministic=True)
    points, x = {}, {}
    for name, count in (("first", first), ("middle", 2), ("last", last)):
        points[name] = scene.add_mesh(name).add_primitive("points", count)
        value = given.get(f"{name}.points.x", np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0]]))
        x[name] = points[name].add_attribute("x", 3, 1, value=value)
    mass = points["first"].add_constant("mass", 1, 1, value=given["first.points.mass"])
    indices, counts = given["first.points.around"]
    around = points["first"].add_connectivity("around", points["first"], indices, counts=counts, longest=longest)
    away = x["first"] - points["first"].add_attribute("middle", through=around, source=x["first"], operation="mean")
    scene.add_energy(points["first"].add_attribute("draw", computed_attribute=mass * away.dot(away)))
    links = scene.first.add_primitive("links", len(given["first.links.ends"]))
    ends = links.add_connectivity("ends", points["first"], given["first.links.ends"], 2)
    one, other = links.add_attribute("x", through=ends, source=x["first"])
    length = links.add_constant("length", 1, 1, value=given["first.links.length"])
    stretch = (one - other).norm() - length
    scene.add_energy(links.add_attribute("spring", computed_attribute=50 * stretch * stretch))
    both = scene.add_mesh("both")
    union = both.add_primitive_union("points", list(points.values()))
    of_all = union.add_attribute("x")
    weight = union.add_constant("weight", 1, 1, value=given["both.points.weight"])
    scene.add_energy(union.add_attribute("hold", computed_attribute=weight * of_all.dot(of_all)))
    pairs = both.add_primitive("pairs", 4, is_dynamic=True)
    of_pair = pairs.add_connectivity("ends", union, given["both.pairs.ends"], 2)
    one, other = pairs.add_attribute("x", through=of_pair, source=of_all)
    scene.add_energy(pairs.add_attribute("pull", computed_attribute=(one - other).dot(one - other)))
    scene.add_minimize_target(list(x.values()))
    return scene


def part_of(scene: Scene, path: str) -> Any:
    """The attribute or connectivity of a path."""
    mesh, primitive, name = path.split(".")
    owner = getattr(getattr(scene, mesh), primitive)
    return owner.attributes[name] if name in owner.attributes else owner.connectivities[name]


def resize(scene: Scene, first: int, last: int, *, without: tuple[str, ...] = (), **others: Any) -> Any:
    given = {part_of(scene, path): value for path, value in data(first, last).items() if path not in without}
    given |= {part_of(scene, path.replace("__", ".")): value for path, value in others.items()}
    counts = {scene.first.points: first, scene.first.links: first - 1, scene.last.points: last}
    return scene.resize(counts, given)


def results(scene: Scene, solves: tuple[dict[str, Any], ...] = SOLVES) -> list[Array]:
    """All that a scene gives, as arrays."""
    found = [np.array([scene.total_energy()]), *scene.energy_values().values(), *scene.gradient()]
    found += [scene.hessian(projected=projected).to_scipy().toarray() for projected in (True, False)]
    found += [scene.both.points["x"].compute().value]
    return found + [part for options in solves for part in scene.solve(1e-20, **options).directions]


def refuse(request: CompileRequest) -> None:
    raise AssertionError(f"{request.scene_name} was compiled")


def assert_same_bits(one: list[Array], other: list[Array]) -> None:
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_resized_scene_is_a_new_one_and_compiles_nothing() -> None:
    """To the last bit: sparsity, orders inside, unions, what solvers keep. The last size is large enough that dof
    blocks are reordered, and the one before it so small that pairs are a large part."""
    scene = nets(20, 5)
    compiled, report = scene.compile(), scene.compile_report
    results(scene)
    for first, last in ((31, 4), (4, 9), (FEWEST_BLOCKS // 8, 1)):
        with watching_compiles(refuse):
            resize(scene, first, last)
            found = results(scene)
        assert scene.compile() is compiled
        assert scene.compile_report is report
        assert_same_bits(found, results(nets(first, last)))


def test_large_scenes_are_reordered_anew() -> None:
    scene, count = nets(20, 5), FEWEST_BLOCKS
    scene.solve(1e-8)
    resize(scene, count, 3)
    fresh = nets(count, 3)
    for one in (scene, fresh):
        one.compile().update_structure()
    order = scene.compile().static_matrix.order
    assert order is not None
    np.testing.assert_array_equal(order, fresh.compile().static_matrix.order)
    assert_same_bits(scene.solve(1e-12).directions, fresh.solve(1e-12).directions)


def test_rows_of_variable_arity_longer_than_ever_compile() -> None:
    """The only thing that does, unless room was asked for."""
    for longest in (1, 7):
        scene = nets(20, 5, longest)
        compiled = scene.compile()
        resize(scene, 6, 2, first__points__around=(np.arange(12) % 6, [7, 1, 1, 1, 1, 1]))
        assert (scene.compile() is compiled) == (longest == 7)
        gradient, _ = Interpreter(scene.compile().module, scene.compile().data()).assemble()
        np.testing.assert_allclose(np.concatenate(scene.gradient()), gradient, rtol=1e-13, atol=1e-13)
    scene.first.points.around.update_value(np.zeros(6, int), np.ones(6, int))
    assert scene.compile() is compiled
    for arguments in ({"arity": 2, "longest": 3}, {"counts": [], "longest": 0}):
        with pytest.raises(ConnectivityError, match="longest"):
            scene.first.links.add_connectivity("other", scene.first.points, [], **arguments)


def test_one_primitive_by_names_and_indices_of_others_in_a_union() -> None:
    """What leads to instances of another size must be given; the rest of a union is renumbered."""
    scene, pairs = nets(20, 5), [[20, 21], [22, 26], [21, 22]]
    scene.both.pairs.update(ends=pairs)
    with pytest.raises(DataError, match=r"both\.points\.weight"):
        scene.last.points.resize(8, x=np.zeros((8, 3)))
    with pytest.raises(ConnectivityError, match=r"both.pairs.ends leads to instances of .* 8 for 5"):
        scene.resize({scene.last.points: 8}, {scene.last.points["x"]: np.zeros(24)} | weights(scene, 30))
    scene.both.pairs.update(ends=[[20, 21], [21, 20]])
    scene.resize({scene.last.points: 8}, {scene.last.points["x"]: np.zeros(24)} | weights(scene, 30))
    np.testing.assert_array_equal(scene.both.pairs.ends.indices, [[20, 21], [21, 20]])
    given = data(7, 5)
    points = {part_of(scene, path): given[path] for path in given if path.startswith("first.")}
    scene.resize({scene.first.points: 7, scene.first.links: 6}, points | weights(scene, 17))
    np.testing.assert_array_equal(scene.both.pairs.ends.indices, [[7, 8], [8, 7]])
    scene.first.links.resize(2, ends=[[0, 1], [1, 2]], length=[1.0, 2.0])
    assert scene.first.links["spring"].compute().value.shape == (2,)
    scene.solve()


def weights(scene: Scene, count: int) -> dict[Any, Array]:
    return {scene.both.points["weight"]: np.ones(count)}


def test_a_target_that_nothing_leads_to() -> None:
    """No connectivity changes with it, and yet everything has another place."""
    scene = nets(20, 5)
    scene.both.pairs.update(ends=[[20, 21], [21, 20]])
    compiled = scene.compile()
    compiled.assemble()
    for count in (9, 2):
        scene.resize(
            {scene.last.points: count}, {scene.last.points["x"]: np.ones(3 * count)} | weights(scene, 22 + count)
        )
        gradient, hessian = Interpreter(compiled.module, compiled.data()).assemble()
        np.testing.assert_allclose(np.concatenate(scene.gradient()), gradient, rtol=1e-13, atol=1e-13)
        difference = abs(scene.hessian().to_scipy() - hessian)
        assert difference.max() < 1e-13 * abs(hessian).max()


def test_a_dynamic_primitive_may_be_emptied_and_filled_with_the_others() -> None:
    scene = nets(20, 5)
    counts = {scene.first.points: 6, scene.first.links: 5, scene.both.pairs: 0}
    given = {path: value for path, value in data(6, 5).items() if not path.startswith(("both.pairs", "last"))}
    scene.resize(counts, {part_of(scene, path): value for path, value in given.items()})
    assert scene.both.pairs.num_instances == 0
    scene.gradient()
    scene.resize({scene.both.pairs: 2}, {scene.both.pairs.ends: [[0, 6], [12, 1]]})
    assert scene.both.pairs["pull"].compute().value.shape == (2,)


def test_a_change_is_taken_back() -> None:
    scene = nets(20, 5)
    before, found = {path: value.copy() for path, value in scene.numbers().items()}, results(scene, ())
    assert scene.resize(*resize(scene, 31, 4))[0] == {
        scene.first.points: 31,
        scene.first.links: 30,
        scene.last.points: 4,
    }
    after = scene.numbers()
    for path, value in before.items():
        np.testing.assert_array_equal(after[path], value)
    assert_same_bits(results(scene, ()), found)


CASES = {
    "numbers are missing": ({"without": ("first.points.mass",)}, DataError, "first.points.mass"),
    "indices are missing": ({"without": ("first.links.ends",)}, DataError, "first.links.ends"),
    "numbers of a union are missing": ({"without": ("both.points.weight",)}, DataError, "both.points.weight"),
    "what leads there is missing": ({"without": ("both.pairs.ends",)}, ConnectivityError, "leads to instances of"),
    "too few numbers": ({"first__points__mass": np.ones(20)}, DataError, "30 x 1x1"),
    "no finite numbers": ({"last__points__x": np.full((8, 3), np.nan)}, DataError, "not finite"),
    "an index out of range": ({"first__links__ends": np.full((29, 2), 30)}, ConnectivityError, "out of range"),
    "an index of a union": ({"both__pairs__ends": [[0, 40]] * 4}, ConnectivityError, "40 instances"),
    "too few rows": ({"first__links__ends": np.zeros((3, 2), int)}, ConnectivityError, "got 3 rows"),
    "too few counts": ({"first__points__around": ([0, 0], [1, 1])}, ConnectivityError, "needs 30 counts"),
    "too many pairs": ({"both__pairs__ends": np.zeros((7, 2), int)}, DataError, "gets 4"),
    "computed": ({"first__links__spring": np.zeros(29)}, SceneError, "computed"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_refused_change_leaves_every_bit(case: str, nets_of_20: Scene) -> None:
    arguments, error, match = CASES[case]
    scene = nets_of_20
    before = {path: value.copy() for path, value in scene.numbers().items()}
    found = results(scene, ())
    with pytest.raises(error, match=match):
        resize(scene, 30, 8, **arguments)
    assert scene.first.points.num_instances == 20
    after = scene.numbers()
    assert list(after) == list(before)
    for path, value in before.items():
        np.testing.assert_array_equal(after[path], value)
    assert_same_bits(results(scene, ()), found)


@pytest.fixture(scope="module")
def nets_of_20() -> Scene:
    return nets(20, 5)


def test_what_has_no_size_of_its_own(nets_of_20: Scene) -> None:
    scene: Any = nets_of_20
    with pytest.raises(SceneError, match=r"resize those of first.points, middle.points, last.points"):
        scene.resize({scene.both.points: 3}, {})
    with pytest.raises(SceneError, match="mesh first, which is one instance of itself"):
        scene.resize({scene.first: 3}, {})
    with pytest.raises(SceneError, match="only primitives can be resized, got 'points'"):
        scene.resize({"points": 3}, {})
    with pytest.raises(SceneError, match="another scene"):
        scene.resize({nets(3, 1).last.points: 3}, {})
    with pytest.raises(SceneError, match="another scene"):
        scene.resize({}, {nets(3, 1).last.points["x"]: [0, 0, 0]})
    with pytest.raises(SceneError, match="positive integer"):
        scene.resize({scene.last.points: 0}, {})
    with pytest.raises(SceneError, match="stored attributes and connectivities, got 'x'"):
        scene.resize({scene.last.points: 3}, {"x": np.zeros((3, 3))})
    with pytest.raises(SceneError, match="takes a table"):
        scene.resize(scene.last.points, 3)
    with pytest.raises(SceneError, match="takes a table"):
        scene.resize({scene.last.points: 3}, [])
    with pytest.raises(SceneError, match="no connectivity or stored attribute 'y'"):
        scene.last.points.resize(3, y=1)


def test_on_a_device() -> None:
    """Made of the host: arrays are moved there, and nothing is compiled."""
    scene = on_device(nets(20, 5), HostDevice(), deterministic=True)
    scene.solve()
    for first, last in ((31, 4), (4, 9)):
        fresh = nets(first, last)
        with watching_compiles(refuse):
            resize(scene, first, last)
            solved = scene.solve(1e-26)
        wanted = fresh.solve(1e-26)
        for one, other in zip(solved.gradient, wanted.gradient, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)
        for one, other in zip(solved.directions, wanted.directions, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
        assert scene.total_energy() == pytest.approx(fresh.total_energy(), rel=1e-12)
