"""Dynamic primitives that grow and shrink, atomic updates, unions of unions, fixed members."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import Attribute, Connectivity, Mesh, Primitive, PrimitiveUnion, Scene

Floats = NDArray[np.float64]
RNG = np.random.default_rng(11)


@dataclass
class Contact:
    """Two groups of points, their union, and weighted springs between pairs of them."""

    scene: Scene
    pairs: Primitive
    ends: Connectivity
    weight: Attribute
    targets: tuple[Attribute, Attribute]

    def expected(self) -> tuple[float, Floats, Floats]:
        """Energy, gradient and Hessian, dense: sum of w |x_i - x_j|^2 / 2 over pairs plus |x|^2 / 2."""
        x = np.concatenate([target.value.reshape(-1, 2) for target in self.targets])
        laplacian = np.eye(len(x))
        for (i, j), w in zip(self.ends.indices, self.weight.value, strict=True):
            laplacian[np.ix_([i, j], [i, j])] += w * np.array([[1, -1], [-1, 1]])
        gradient = laplacian @ x
        return float((x * gradient).sum() / 2), gradient.reshape(-1), np.asarray(np.kron(laplacian, np.eye(2)), float)

    def check(self) -> None:
        """Energy, gradient, Hessian and solution against dense linear algebra."""
        energy, gradient, H = self.expected()
        assert self.scene.total_energy() == pytest.approx(energy, rel=1e-13)
        np.testing.assert_allclose(np.concatenate(self.scene.gradient()), gradient, rtol=1e-12, atol=1e-13)
        solution = np.concatenate(self.scene.minimize_energy(1e-26))
        np.testing.assert_allclose(solution, np.linalg.solve(H, gradient), rtol=1e-9, atol=1e-12)
        compiled = self.scene.compile()
        found = (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()
        np.testing.assert_allclose(found, H, rtol=1e-12, atol=1e-13)


@pytest.fixture
def contact() -> Contact:
    """Three and four points in the plane, no pair yet."""
    scene = Scene("contact")
    groups = []
    for name, count in (("a", 3), ("b", 4)):
        points = scene.add_mesh(name).add_primitive("points", count)
        points.add_attribute("x", 2, 1, value=RNG.standard_normal((count, 2)))
        groups.append(points)
    both = scene.add_mesh("both")
    union = both.add_primitive_union("points", groups)
    x = union.add_attribute("x")
    pairs = both.add_primitive("pairs", 0, is_dynamic=True)
    ends = pairs.add_connectivity("ends", union, [], 2)
    weight = pairs.add_constant("weight", 1, 1)
    joined = pairs.add_attribute("x", through=ends, source=x)
    apart = joined.row(0) - joined.row(1)
    scene.add_energy(pairs.add_attribute("spring", computed_attribute=0.5 * weight * apart.dot(apart)))
    scene.add_energy(0.5 * x.dot(x))
    targets = (groups[0]["x"], groups[1]["x"])
    scene.add_minimize_target(targets)
    return Contact(scene, pairs, ends, weight, targets)


def test_growing_shrinking_to_empty_and_back(contact: Contact) -> None:
    compiled = contact.scene.compile()
    for ends in ([], [[0, 3]], [[0, 3], [1, 2], [6, 2], [5, 0], *[[4, 1]] * 12], [[2, 6]], [], [[1, 5], [5, 6]]):
        contact.pairs.update(ends=ends, weight=RNG.uniform(1, 2, len(ends)))
        assert contact.pairs.num_instances == len(ends)
        assert contact.pairs["spring"].compute().value.shape == (len(ends),)
        contact.check()
    assert contact.scene.compile() is compiled


def test_parts_may_follow_one_after_the_other(contact: Contact) -> None:
    contact.ends.update_value([[0, 3], [1, 4]])
    contact.weight.update_value([1.0, 2.0])
    contact.check()
    contact.weight.update_value([3.0])
    contact.ends.update_value([[6, 4]])
    assert contact.pairs.num_instances == 1
    contact.check()


def test_a_part_of_the_same_size_may_be_updated_alone(contact: Contact) -> None:
    contact.pairs.update(ends=[[0, 3], [1, 4]], weight=[1.0, 2.0])
    contact.pairs.update(weight=[5.0, 6.0])
    np.testing.assert_array_equal(contact.weight.value, [5, 6])
    contact.check()
    contact.pairs.update(ends=[[1, 4], [2, 6]])
    contact.check()
    contact.pairs.update()
    contact.check()


def test_a_first_connectivity_sizes_a_dynamic_primitive() -> None:
    mesh = Scene("s").add_mesh("m")
    points = mesh.add_primitive("points", 3)
    pairs = mesh.add_primitive("pairs", 0, is_dynamic=True)
    pairs.add_connectivity("ends", points, [[0, 1], [1, 2]], 2)
    assert pairs.num_instances == 2
    assert pairs.add_attribute("w", 1, 1).value.shape == (2,)


def test_static_primitives_update_too() -> None:
    mesh = Scene("s").add_mesh("m")
    points = mesh.add_primitive("points", 3)
    x, y = points.add_attribute("x", 1, 1), points.add_attribute("y", 2, 1)
    total = x + y[0] + y[1]
    assert not total.value.any()
    points.update(x=[1.0, 2.0, 3.0], y=np.arange(6.0).reshape(3, 2))
    np.testing.assert_array_equal(total.value, [2.0, 7.0, 12.0])


@pytest.fixture
def drops() -> tuple[Scene, Primitive, Attribute]:
    """A dynamic primitive whose variable is the target, between two static ones in a union."""
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    first, last = mesh.add_primitive("first", 2), mesh.add_primitive("last", 2)
    drops = mesh.add_primitive("drops", 3, is_dynamic=True)
    for primitive, start in ((first, 1.0), (drops, 10.0), (last, 100.0)):
        primitive.add_attribute("x", 1, 1, value=start + np.arange(primitive.num_instances))
    union = mesh.add_primitive_union("all", [first, drops, last])
    union.add_attribute("x")
    watch = mesh.add_primitive("watch", 2)
    watched = watch.add_connectivity("watched", union, [0, 6], 1)
    joined = watch.add_attribute("x", through=watched, source=union["x"])
    scene.add_energy(joined * joined)
    scene.add_energy(0.5 * union["x"] * union["x"])
    scene.add_minimize_target([first["x"], drops["x"], last["x"]])
    return scene, drops, drops["x"]


def test_targets_of_a_dynamic_primitive_change_the_size_of_the_system(
    drops: tuple[Scene, Primitive, Attribute],
) -> None:
    scene, primitive, x = drops
    union: PrimitiveUnion = scene.m.all
    for values in ([10.0, 11.0, 12.0], [20.0, 21.0, 22.0, 23.0, 24.0], [30.0, 31.0, 32.0]):
        primitive.update(x=values)
        everything = np.concatenate([[1.0, 2.0], values, [100.0, 101.0]])
        np.testing.assert_array_equal(union["x"].value, everything)
        # watched instances 0 and 6 of the union: 6 is a drop or one of `last`, as the drops' number has it
        factor = 1 + 2 * np.isin(np.arange(len(everything)), [0, 6])
        gradient = scene.gradient()
        assert [len(part) for part in gradient] == [2, len(values), 2]
        np.testing.assert_allclose(np.concatenate(gradient), factor * everything, rtol=1e-14)
        np.testing.assert_allclose(np.concatenate(scene.minimize_energy(1e-24)), everything, rtol=1e-10)
        H = scene.compile().static_matrix.to_scipy() + scene.compile().dynamic_matrix.to_scipy()
        np.testing.assert_allclose(H.toarray(), np.diag(factor.astype(float)))
    assert x.value.shape == (3,)


def test_a_target_without_instances_has_an_empty_result() -> None:
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    drops = mesh.add_primitive("drops", 0, is_dynamic=True)
    y, x = mesh.add_attribute("y", 1, 1, value=3.0), drops.add_attribute("x", 2, 1)
    scene.add_energy(y * y)
    scene.add_energy(x.dot(x))
    scene.add_minimize_target([x, y])
    empty, one = scene.minimize_energy(1e-20)
    assert empty.shape == (0,)
    np.testing.assert_allclose(one, [3.0])
    drops.update(x=[1.0, 2.0])
    np.testing.assert_allclose(np.concatenate(scene.minimize_energy(1e-20)), [1.0, 2.0, 3.0])
    x.update_value([])
    empty, one = scene.minimize_energy(1e-20)
    assert empty.shape == (0,)
    np.testing.assert_allclose(one, [3.0])


def test_a_system_without_unknowns_has_an_empty_solution() -> None:
    scene = Scene("s")
    drops = scene.add_mesh("m").add_primitive("drops", 0, is_dynamic=True)
    x = drops.add_attribute("x", 2, 1)
    scene.add_energy(x.dot(x))
    scene.add_minimize_target(x)
    assert scene.total_energy() == 0.0
    assert scene.minimize_energy()[0].shape == scene.gradient()[0].shape == (0,)
    assert (x * 2.0).value.shape == (0,)


def test_a_static_energy_follows_a_dynamic_connectivity_below_it() -> None:
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    points = mesh.add_primitive("points", 3)
    x = points.add_attribute("x", 1, 1, value=[1.0, 2.0, 4.0])
    links = mesh.add_primitive("links", 0, is_dynamic=True)
    point_of = links.add_connectivity("point", points, [0, 1], 1)
    linked = links.add_attribute("x", through=point_of, source=x)
    readers = mesh.add_primitive("readers", 1)
    link_of = readers.add_connectivity("link", links, [1], 1)
    read = readers.add_attribute("x", through=link_of, source=linked)
    scene.add_energy(read * read, dynamic_instances=False)
    scene.add_energy(0.5 * x * x)
    scene.add_minimize_target(x)
    np.testing.assert_allclose(scene.minimize_energy(1e-24)[0], x.value)
    np.testing.assert_allclose(scene.compile().static_matrix.to_scipy().toarray(), np.diag([1.0, 3.0, 1.0]))
    point_of.update_value([0, 2])
    np.testing.assert_allclose(scene.gradient()[0], [1.0, 2.0, 12.0])
    np.testing.assert_allclose(scene.minimize_energy(1e-24)[0], x.value)
    np.testing.assert_allclose(scene.compile().static_matrix.to_scipy().toarray(), np.diag([1.0, 1.0, 3.0]))


# -- unions --------------------------------------------------------------------------------------------------


@pytest.fixture
def nested() -> Mesh:
    """Free points, fixed points (a constant), points moved by one vector; unions of two and of a union and one."""
    mesh = Scene("s").add_mesh("m")
    free, fixed, moved = (mesh.add_primitive(name, count) for name, count in (("free", 2), ("fixed", 3), ("moved", 2)))
    free.add_attribute("x", 2, 1, value=RNG.standard_normal((2, 2)))
    fixed.add_constant("x", 2, 1, value=RNG.standard_normal((3, 2)))
    shift = mesh.add_attribute("shift", 2, 1, value=[0.5, -0.25])
    rest = moved.add_constant("rest", 2, 1, value=RNG.standard_normal((2, 2)))
    moved.add_attribute("x", computed_attribute=rest + shift)
    inner = mesh.add_primitive_union("inner", [fixed, moved])
    inner.add_attribute("x")
    outer = mesh.add_primitive_union("outer", [free, inner])
    outer.add_attribute("x")
    return mesh


def test_union_stacks_its_members(nested: Mesh) -> None:
    shifted = nested.moved["rest"].value + np.tile([0.5, -0.25], 2)
    inner = np.concatenate([nested.fixed["x"].value, shifted])
    np.testing.assert_allclose(nested.inner["x"].value, inner)
    np.testing.assert_allclose(nested.outer["x"].value, np.concatenate([nested.free["x"].value, inner]))
    assert nested.outer["x"].shape == (2, 1)
    assert nested.outer.num_instances == 7


def test_union_of_unions_with_a_fixed_member_differentiates(nested: Mesh) -> None:
    scene = nested.scene
    pairs = nested.add_primitive("pairs", 21)
    every = np.array([[i, j] for i in range(7) for j in range(i)])
    ends = pairs.add_connectivity("ends", nested.outer, every, 2)
    joined = pairs.add_attribute("x", through=ends, source=nested.outer["x"])
    apart = joined.row(0) - joined.row(1)
    scene.add_energy(0.5 * apart.dot(apart))
    scene.add_minimize_target([nested["shift"], nested.free["x"]])
    # x = J q + c with q = (shift, free): free points are unknowns 2..5, fixed ones none, moved ones add the shift
    J = np.zeros((7, 3))
    J[0, 1] = J[1, 2] = J[5, 0] = J[6, 0] = 1
    laplacian = 7 * np.eye(7) - np.ones((7, 7))
    x = nested.outer["x"].value.reshape(7, 2)
    gradient, H = (J.T @ laplacian @ x).reshape(-1), np.kron(J.T @ laplacian @ J, np.eye(2))
    np.testing.assert_allclose(np.concatenate(scene.gradient()), gradient, rtol=1e-12)
    np.testing.assert_allclose(np.concatenate(scene.minimize_energy(1e-26)), np.linalg.solve(H, gradient), rtol=1e-9)


def test_a_union_of_fixed_members_alone_has_no_derivative(nested: Mesh) -> None:
    scene = nested.scene
    both = nested.add_primitive_union("both", [nested.fixed])
    both.add_attribute("x")
    x, free = both["x"], nested.free["x"]
    scene.add_energy(x.dot(x))
    scene.add_energy(free.dot(free))
    scene.add_minimize_target(free)
    np.testing.assert_allclose(scene.gradient()[0], 2 * free.value)
    assert scene.total_energy() == pytest.approx((nested.fixed["x"].value ** 2).sum() + (free.value**2).sum())


def test_a_union_has_attributes_of_its_own(nested: Mesh) -> None:
    weight = nested.outer.add_attribute("weight", 1, 1, value=np.arange(7.0))
    weighted = nested.outer.add_attribute("weighted", computed_attribute=weight * nested.outer["x"])
    expected = np.arange(7.0)[:, None] * nested.outer["x"].value.reshape(7, 2)
    np.testing.assert_allclose(weighted.value, expected.reshape(-1))
