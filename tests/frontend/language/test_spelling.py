"""Both spellings, checked on every public class rather than on a list."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import yasps
from yasps import Attribute, Connectivity, Mesh, Primitive, PrimitiveBase, PrimitiveUnion, Scene
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.spelling import both_spellings, camel_case, paper_spelling, snake_case

CLASSES = (Scene, Mesh, Primitive, PrimitiveUnion, PrimitiveBase, Entity, Attribute, Connectivity)
MEMBERS = [
    (cls, name)
    for cls in CLASSES
    for name, member in inspect.getmembers(cls)
    if "_" in name and not name.startswith("_") and (callable(member) or isinstance(member, property))
]


@pytest.mark.parametrize(("cls", "name"), MEMBERS, ids=lambda part: getattr(part, "__name__", part))
def test_every_public_member_has_the_papers_spelling(cls: type, name: str) -> None:
    ours, papers = inspect.getattr_static(cls, name), inspect.getattr_static(cls, camel_case(name))
    if isinstance(ours, property):
        assert papers is ours
    else:
        assert papers.__wrapped__ is ours
        assert papers.__doc__ == ours.__doc__


def test_the_list_of_members_is_not_empty() -> None:
    names = {name for _, name in MEMBERS}
    assert {"add_mesh", "add_attribute", "update_value", "minimize_energy", "num_instances", "stop_gradient"} <= names


def test_functions_have_both_spellings() -> None:
    public = [name for name in yasps.__all__ if "_" in name and name.islower() and not name.startswith("_")]
    assert {"add_scene", "concat_cols", "concat_rows"} <= set(public)
    for name in public:
        assert getattr(yasps, camel_case(name)) is getattr(yasps, name)
    assert yasps.scene is yasps.Scene


def snake_case_keywords(function: Any) -> set[str]:
    """Parameters of several words."""
    return {name for name in inspect.signature(function).parameters if "_" in name}


@pytest.mark.parametrize(("cls", "name"), MEMBERS, ids=lambda part: getattr(part, "__name__", part))
def test_keywords_translate_to_the_methods_own(cls: type, name: str) -> None:
    ours = inspect.getattr_static(cls, name)
    if isinstance(ours, property):
        return
    seen: dict[str, object] = {}
    recorder = paper_spelling(lambda **keywords: seen.update(keywords))
    keywords = snake_case_keywords(ours)
    recorder(**{camel_case(keyword): keyword for keyword in keywords})
    assert seen == {keyword: keyword for keyword in keywords}


@pytest.mark.parametrize(
    ("snake", "camel"),
    [
        ("add_mesh", "addMesh"),
        ("num_instances", "numInstances"),
        ("x", "x"),
        ("add_primitive_union", "addPrimitiveUnion"),
    ],
)
def test_names_go_there_and_back(snake: str, camel: str) -> None:
    assert camel_case(snake) == camel
    assert snake_case(camel) == snake


def test_keywords_in_either_spelling() -> None:
    s = Scene("s")
    mesh = s.addMesh("m")
    a = mesh.addPrimitive("a", numInstances=2, isDynamic=False)
    b = mesh.addPrimitive("b", num_instances=2, is_dynamic=True)
    assert (a.numInstances, a.isDynamic, b.num_instances, b.is_dynamic) == (2, False, 2, True)
    x = a.addAttribute("x", rows=1, cols=1)
    square = a.addAttribute("square", computedAttribute=x * x)
    again = a.addAttribute("again", computed_attribute=square)
    s.addEnergy(again, dynamicInstances=True)
    s.addMinimizeTarget(targets=x)
    x.updateValue(values=[1.0, 2.0])
    s.addEnergy(a.addAttribute("cube", computedAttribute=x.dot(x)), dynamic_instances=False)
    assert s.minimizeTargets == (x,)
    np.testing.assert_allclose(s.minimizeEnergy(tolerance=1e-12, maxIterations=50)[0], [1.0, 2.0])
    solution = s.solve(1e-12, maxIterations=50)
    np.testing.assert_allclose(solution.directions[0], [1.0, 2.0])
    assert s.totalEnergy() == s.total_energy() == 10.0
    assert s.compile(needTargets=False) is s.compile(need_targets=True)


def test_a_keyword_in_both_spellings_is_refused() -> None:
    mesh = Scene("s").add_mesh("m")
    with pytest.raises(TypeError, match="num_instances twice"):
        mesh.addPrimitive("a", numInstances=2, num_instances=3)
    with pytest.raises(AttributeError):
        mesh.a  # noqa: B018


def test_an_unknown_keyword_is_refused() -> None:
    with pytest.raises(TypeError, match="number_of_instances"):
        Scene("s").add_mesh("m").addPrimitive("a", numberOfInstances=2)


def test_names_of_parts_given_to_update_are_the_users_own() -> None:
    points = Scene("s").add_mesh("m").add_primitive("points", 2)
    stored = points.add_attribute("restShape", 1, 1)
    points.update(restShape=[1.0, 2.0])
    np.testing.assert_array_equal(stored.value, [1.0, 2.0])


def test_private_and_special_names_stay_as_they_are() -> None:
    @both_spellings
    class Example:
        some_number = 3

        def _not_public(self) -> None: ...

        def do_it(self, how_often: int = 1) -> int:
            return how_often

    assert not hasattr(Example, "_notPublic")
    assert not hasattr(Example, "someNumber")
    assert Example().doIt(howOften=2) == 2  # type: ignore[attr-defined]
