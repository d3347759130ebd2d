"""Meshes: primitives and unions under them."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Mesh, Primitive, PrimitiveUnion, Scene


@pytest.fixture
def mesh() -> Mesh:
    """An empty mesh."""
    return Scene("s").add_mesh("m")


def test_a_primitive_is_reached_by_its_name(mesh: Mesh) -> None:
    points = mesh.add_primitive("points", 4)
    assert mesh.points is points
    assert isinstance(points, Primitive)
    assert (points.path, points.num_instances, points.is_dynamic) == ("m.points", 4, False)
    assert points.mesh is mesh
    assert points.scene is mesh.scene
    with pytest.raises(AttributeError, match="mesh m has no 'tets'; it has points"):
        mesh.tets  # noqa: B018


def test_numpy_integers_count(mesh: Mesh) -> None:
    assert mesh.add_primitive("points", np.int64(4)).num_instances == 4  # type: ignore[arg-type]


def test_a_dynamic_primitive_may_start_empty(mesh: Mesh) -> None:
    pairs = mesh.add_primitive("pairs", 0, is_dynamic=True)
    assert (pairs.num_instances, pairs.is_dynamic) == (0, True)


def test_a_mesh_is_one_instance_of_itself(mesh: Mesh) -> None:
    assert mesh.num_instances == 1
    assert not mesh.is_dynamic
    np.testing.assert_array_equal(mesh.add_attribute("m", 2, 2, value=np.eye(2)).value, [1, 0, 0, 1])


def test_a_union_counts_its_members_in_order(mesh: Mesh) -> None:
    a, b, c = mesh.add_primitive("a", 2), mesh.add_primitive("b", 3), mesh.add_primitive("c", 0, is_dynamic=True)
    union = mesh.add_primitive_union("u", [b, a, c])
    assert isinstance(union, PrimitiveUnion)
    assert mesh.u is union
    assert union.members == (b, a, c)
    assert union.num_instances == 5
    assert union.is_dynamic
    np.testing.assert_array_equal(union.offsets(), [0, 3, 5, 5])
    assert [union.offset_of(member) for member in (b, a, c)] == [0, 3, 5]
    assert not mesh.add_primitive_union("static", (a, b)).is_dynamic


def test_a_union_reaches_across_meshes_of_the_scene(mesh: Mesh) -> None:
    other = mesh.scene.add_mesh("other").add_primitive("points", 2)
    union = mesh.add_primitive_union("all", [mesh.add_primitive("points", 3), other])
    assert union.num_instances == 5
    assert union.path == "m.all"


def test_names_are_free_in_each_mesh(mesh: Mesh) -> None:
    second = mesh.scene.add_mesh("second")
    assert mesh.add_primitive("points", 1) is not second.add_primitive("points", 1)
    assert second.points.path == "second.points"
