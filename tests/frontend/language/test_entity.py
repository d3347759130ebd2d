"""What scenes, meshes and primitives share."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Mesh, Primitive, Scene
from yasps.frontend.language.entity import Entity


@pytest.fixture
def points() -> Primitive:
    """Three points with an attribute x."""
    primitive = Scene("s").add_mesh("m").add_primitive("points", 3)
    primitive.add_attribute("x", 3, 1)
    return primitive


def test_lineage_goes_up_to_the_scene(points: Primitive) -> None:
    assert points.lineage() == [points, points.mesh, points.scene]
    assert points.scene.lineage() == [points.scene]
    assert points._parent is points.mesh
    assert points.scene._parent is None


def test_labels_and_paths(points: Primitive) -> None:
    assert [entity.label for entity in points.lineage()] == ["primitive m.points", "mesh m", "scene s"]
    assert [entity.path for entity in points.lineage()] == ["m.points", "m", ""]
    assert [repr(entity) for entity in points.lineage()] == [
        "<primitive m.points: 3 instances>",
        "<mesh m: 1 instances>",
        "<scene s: 1 instances>",
    ]


def test_attributes_are_reached_by_brackets(points: Primitive) -> None:
    assert points["x"] is points.attributes["x"]
    assert "x" in points
    assert "y" not in points
    with pytest.raises(AttributeError, match=r"'x' is an attribute: write \['x'\]"):
        points.x  # noqa: B018
    with pytest.raises(TypeError, match="iterated"):
        list(points)


def test_a_missing_part_lists_what_there_is(points: Primitive) -> None:
    with pytest.raises(AttributeError, match="primitive points has no 'tets'; it has x"):
        points.tets  # noqa: B018
    with pytest.raises(AttributeError, match="it has nothing"):
        Scene("empty").mesh  # noqa: B018


def test_python_can_ask_for_special_names(points: Primitive) -> None:
    assert not hasattr(points, "__len__")
    assert not hasattr(Primitive.__new__(Primitive), "tets")  # nothing is set yet


@pytest.mark.parametrize("level", [Scene, Mesh, Primitive])
def test_stored_attributes_on_every_level(points: Primitive, level: type[Entity]) -> None:
    entity = next(entity for entity in points.lineage() if isinstance(entity, level))
    value = np.arange(4.0 * entity.num_instances)
    stored = entity.add_attribute("matrix", rows=2, cols=2, value=value)
    constant = entity.add_constant("constant", rows=2, cols=2, value=value)
    empty = entity.add_constant("empty", 1, 1)
    for attribute in (stored, constant):
        assert attribute.shape == (2, 2)
        np.testing.assert_array_equal(attribute.compute().array, value.reshape(-1, 2, 2))
    np.testing.assert_array_equal(empty.value, np.zeros(entity.num_instances))


def test_counts_may_be_numpy_integers(points: Primitive) -> None:
    assert points.add_attribute("y", np.int32(2), np.int64(1)).shape == (2, 1)  # type: ignore[arg-type]


def test_first_values_are_copied(points: Primitive) -> None:
    value = np.ones((3, 2))
    attribute = points.add_attribute("y", 2, 1, value=value)
    value[...] = 5.0
    np.testing.assert_array_equal(attribute.value, np.ones(6))


def test_only_dynamic_primitives_follow_their_data(points: Primitive) -> None:
    pairs = points.mesh.add_primitive("pairs", 0, is_dynamic=True)
    union = points.mesh.add_primitive_union("union", [points, pairs])
    assert [e.follows_data for e in (points, pairs, union, points.mesh, points.scene)] == [False, True, *[False] * 3]
    points.set_num_instances(3)
    union.set_num_instances(3)
    points.mesh.set_num_instances(1)
