"""A scene on which wrong calls are tried, and how they are.

Many of the calls are refused by a type checker too; those carry an ignore.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from yasps import (
    Attribute,
    Connectivity,
    Mesh,
    Primitive,
    PrimitiveBase,
    PrimitiveUnion,
    Scene,
    YaspsError,
)
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.nodes import Stored


@dataclass
class World:
    """A scene with two meshes, a union and a dynamic primitive; `other` is another scene of the same name."""

    scene: Scene
    body: Mesh
    cloth: Mesh
    points: Primitive
    tets: Primitive
    nodes: Primitive
    pairs: Primitive
    all_points: PrimitiveUnion
    x: Attribute
    rest: Attribute
    u: Attribute
    tet2point: Connectivity
    pair2point: Connectivity
    energy: Attribute
    other: Scene
    foreign: Attribute


def make_world() -> World:
    """Builds it; no machine code is made for it."""
    scene = Scene("world")
    body, cloth = scene.add_mesh("body"), scene.add_mesh("cloth")
    points, tets = body.add_primitive("points", 5), body.add_primitive("tets", 2)
    nodes = cloth.add_primitive("nodes", 3)
    x = points.add_attribute("x", 3, 1, value=np.arange(15.0))
    rest = points.add_constant("rest", 3, 1)
    points.add_attribute("mass", 1, 1)
    u = nodes.add_attribute("x", 3, 1)
    nodes.add_attribute("mass", 2, 1)
    body.add_attribute("density", 1, 1, value=2.0)
    cloth.add_attribute("density", 1, 1, value=3.0)
    scene.add_attribute("dt", 1, 1, value=0.01)
    tets.add_attribute("volume", 1, 1)
    tet2point = tets.add_connectivity("tet2point", points, [0, 1, 2, 3, 1, 2, 3, 4], 4)
    all_points = scene.add_mesh("all").add_primitive_union("points", [points, nodes])
    all_points.add_attribute("x")
    pairs = scene.all.add_primitive("pairs", 0, is_dynamic=True)
    pair2point = pairs.add_connectivity("pair2point", all_points, [], 2)
    pairs.add_constant("weight", 1, 1)
    pairs.add_constant("offset", 2, 1)
    pairs.update(pair2point=[[0, 5], [1, 7]], weight=[1.0, 2.0], offset=[0.0] * 4)
    energy = points.add_attribute("energy", computed_attribute=x.dot(x))
    scene.add_energy(energy)
    scene.add_minimize_target(x)
    other = Scene("world")
    foreign = other.add_mesh("body").add_primitive("points", 5).add_attribute("x", 3, 1)
    return World(
        scene,
        body,
        cloth,
        points,
        tets,
        nodes,
        pairs,
        all_points,
        x,
        rest,
        u,
        tet2point,
        pair2point,
        energy,
        other,
        foreign,
    )


def snapshot(entity: Entity) -> dict[str, Any]:
    """All that can change about an entity and what is below it, as plain comparable values."""
    state: dict[str, Any] = {"instances": entity.num_instances}
    for name, attribute in entity.attributes.items():
        numbers = attribute.node.array.tolist() if isinstance(attribute.node, Stored) else None
        state[f"attribute {name}"] = (id(attribute), attribute.shape, numbers)
    for name, child in entity._children.items():
        if isinstance(child, Entity):
            state[f"part {name}"] = snapshot(child)
        else:
            state[f"connectivity {name}"] = (id(child), child.indices.tolist())
    if isinstance(entity, PrimitiveBase):
        state["connectivities"] = list(entity.connectivities)
    if isinstance(entity, Scene):
        state["energies"] = [id(energy) for energy in entity.energies]
        state["targets"] = [id(target) for target in entity.minimize_targets]
        state["compiled"] = id(entity._compiled)
    return state


@dataclass(frozen=True)
class Refused:
    """A call that must raise `error` with a message that has all the `words`."""

    call: Callable[[World], object]
    error: type[YaspsError]
    words: tuple[str, ...]


def assert_refused(world: World, call: Callable[[World], object], error: type[YaspsError]) -> str:
    """Calls, and returns the message; the scene must be as before."""
    before = snapshot(world.scene), snapshot(world.other)
    with pytest.raises(error) as caught:
        call(world)
    assert caught.type is error
    assert (snapshot(world.scene), snapshot(world.other)) == before
    return str(caught.value)


def check_refused(case: Refused) -> None:
    """The case's call on a fresh scene raises its error, whose message has its words; the scene is as before."""
    message = assert_refused(make_world(), case.call, case.error)
    for word in case.words:
        assert word in message
