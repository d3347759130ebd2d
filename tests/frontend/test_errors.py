"""What the frontend refuses: the class of the error, what its message names, and that nothing changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from yasps import (
    Attribute,
    Connectivity,
    ConnectivityError,
    DataError,
    LineageError,
    Mesh,
    NameTakenError,
    NotConvergedError,
    NotFiniteError,
    Primitive,
    PrimitiveUnion,
    Scene,
    SceneError,
    ShapeMismatchError,
    YaspsError,
    concat_cols,
    concat_rows,
    constant,
    zeros,
)
from yasps.frontend.attribute import Stored
from yasps.frontend.entity import Entity
from yasps.frontend.primitive import PrimitiveBase


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


NAN = [np.nan] * 15
TABLE: dict[str, Refused] = {
    # lineage (paper, 4.3)
    "two primitives": Refused(
        lambda w: w.x + w.tets["volume"],
        LineageError,
        ("body.points.x", "body.tets.volume", "primitive body.points", "primitive body.tets", "JOIN"),
    ),
    "two meshes": Refused(
        lambda w: w.body["density"] * w.cloth["density"],
        LineageError,
        ("body.density", "cloth.density", "mesh body", "mesh cloth"),
    ),
    "a primitive and another mesh": Refused(
        lambda w: w.cloth["density"] * w.x, LineageError, ("cloth.density", "body.points.x")
    ),
    "a member and its union": Refused(
        lambda w: w.all_points["x"] - w.x, LineageError, ("all.points.x", "body.points.x", "UNION")
    ),
    "two scenes": Refused(lambda w: w.x - w.foreign, LineageError, ("body.points.x", "another", "scene world")),
    "lineage in concat_rows": Refused(
        lambda w: concat_rows([w.x, w.u]), LineageError, ("body.points.x", "cloth.nodes.x")
    ),
    "naming another primitive's expression": Refused(
        lambda w: w.tets.add_attribute("e", computed_attribute=w.x * 2.0),
        LineageError,
        ("primitive body.points", "primitive body.tets", "JOIN"),
    ),
    "naming a primitive's expression on its mesh": Refused(
        lambda w: w.body.add_attribute("e", computed_attribute=w.x), LineageError, ("body.points.x", "mesh body")
    ),
    # shapes
    "sum of shapes": Refused(lambda w: w.x + w.x.T, ShapeMismatchError, ("body.points.x", "3x1", "1x3")),
    "product of shapes": Refused(lambda w: w.x * w.x, ShapeMismatchError, ("3x1",)),
    "concat of shapes": Refused(lambda w: concat_cols([w.x, w.x.T]), ShapeMismatchError, ("3x1", "1x3")),
    "resize to another size": Refused(lambda w: w.x.resize(2, 2), ShapeMismatchError, ("3x1", "2x2")),
    "resize to half rows": Refused(lambda w: w.x.resize(1.5, 2), ShapeMismatchError, ("1.5", "integer")),  # type: ignore[arg-type]
    "row out of range": Refused(lambda w: w.x.row(3), ShapeMismatchError, ("body.points.x", "no row 3")),
    "column out of range": Refused(lambda w: w.x.col(-2), ShapeMismatchError, ("no column -2",)),
    "row 1.0": Refused(lambda w: w.x.row(1.0), ShapeMismatchError, ("integer", "1.0")),  # type: ignore[arg-type]
    "index True": Refused(lambda w: w.x[True], ShapeMismatchError, ("integer", "True")),
    "a slice": Refused(lambda w: w.x[0:2], ShapeMismatchError, ("sliced", "block")),  # type: ignore[index]
    "three indices": Refused(lambda w: w.x[0, 0, 0], ShapeMismatchError, ("a[i, j]", "3 indices")),  # type: ignore[index]
    "one index of a matrix": Refused(lambda w: w.x.outer(w.x)[0], ShapeMismatchError, ("3x3", "a[i, j]")),
    "block outside": Refused(lambda w: w.x.block(1, 0, 3, 1), ShapeMismatchError, ("rows 1..3", "3x1")),
    "det of a vector": Refused(lambda w: w.x.det(), ShapeMismatchError, ("det", "3x1")),
    "inverse of 5x5": Refused(
        lambda w: (w.body["density"] * np.eye(5)).inverse(), ShapeMismatchError, ("inverse", "5x5")
    ),
    "cross of 2-vectors": Refused(
        lambda w: w.nodes["mass"].cross(w.nodes["mass"]), ShapeMismatchError, ("cross", "cloth.nodes.mass", "2x1")
    ),
    "division by a vector": Refused(lambda w: w.x / w.x, ShapeMismatchError, ("divide", "3x1")),
    "iteration": Refused(lambda w: list(w.x), ShapeMismatchError, ("body.points.x", "iterated", "row(i)")),
    "an empty constant": Refused(lambda w: constant([]), ShapeMismatchError, ("shape (0,)",)),
    "a constant of three dimensions": Refused(
        lambda w: constant(np.zeros((1, 2, 3))), ShapeMismatchError, ("(1, 2, 3)",)
    ),
    # what is symbolic
    "truth value": Refused(lambda w: bool(w.x), SceneError, ("body.points.x", "no truth value", "compute().value")),
    "if a < b": Refused(lambda w: not w.x.norm(), SceneError, ("truth value",)),
    "np.asarray": Refused(lambda w: np.asarray(w.x), SceneError, ("body.points.x", "compute().array")),
    "np.dot": Refused(lambda w: np.dot(np.eye(3), w.x), SceneError, ("symbolic", "*")),
    "constant of attributes": Refused(lambda w: constant([w.x, w.x]), SceneError, ("symbolic", "concat_rows")),
    "computing a number": Refused(lambda w: constant(3.0).compute(), SceneError, ("number", "no instances")),
    "adding text": Refused(lambda w: w.x + "1", DataError, ("real numbers", "<U1")),
    "adding None": Refused(lambda w: w.x + None, DataError, ("real numbers", "object")),
    "power of a list": Refused(lambda w: w.x ** [1, 2], DataError, ("exponent", "[1, 2]")),  # type: ignore[operator]
    "power NaN": Refused(lambda w: w.x ** float("nan"), DataError, ("exponent", "nan")),
    "power True": Refused(lambda w: w.x**True, DataError, ("exponent", "True")),
    # numbers
    "NaN": Refused(lambda w: w.x.update_value(NAN), DataError, ("body.points.x", "entry 0", "nan", "15")),
    "infinity": Refused(lambda w: w.x.update_value([0.0] * 14 + [-np.inf]), DataError, ("entry 14", "-inf")),
    "too few": Refused(lambda w: w.x.update_value([1.0] * 14), DataError, ("body.points.x", "5 x 3x1 = 15", "14")),
    "too many": Refused(lambda w: w.x.update_value(np.zeros((6, 3))), DataError, ("15", "18", "(6, 3)")),
    "none at all": Refused(lambda w: w.x.update_value([]), DataError, ("15", "got 0")),
    "ragged": Refused(lambda w: w.x.update_value([[1.0], [2.0, 3.0]]), DataError, ("body.points.x", "ragged")),
    "complex": Refused(lambda w: w.x.update_value(np.zeros(15, complex)), DataError, ("real numbers", "complex128")),
    "text": Refused(lambda w: w.x.update_value(["1"] * 15), DataError, ("real numbers", "<U1")),
    "None": Refused(lambda w: w.x.update_value(None), DataError, ("real numbers", "object")),  # type: ignore[arg-type]
    "an attribute as numbers": Refused(lambda w: w.x.update_value(w.x), SceneError, ("symbolic",)),
    "numbers of a computed attribute": Refused(
        lambda w: w.energy.update_value([0.0] * 5), SceneError, ("body.points.energy", "computed")
    ),
    "first values of a wrong count": Refused(
        lambda w: w.points.add_attribute("y", 3, 1, value=[1.0, 2.0]), DataError, ("body.points.y", "15", "2")
    ),
    "first values NaN": Refused(
        lambda w: w.points.add_constant("y", 3, 1, value=NAN), DataError, ("body.points.y", "nan")
    ),
    "wrong size on a dynamic primitive": Refused(
        lambda w: w.pairs["offset"].update_value([1.0, 2.0, 3.0]), DataError, ("all.pairs.offset", "2x1", "3")
    ),
    # names
    "attribute twice": Refused(
        lambda w: w.points.add_attribute("x", 3, 1), NameTakenError, ("primitive body.points", "an attribute", "'x'")
    ),
    "constant twice": Refused(lambda w: w.points.add_constant("x", 3, 1), NameTakenError, ("'x'",)),
    "attribute named like a connectivity": Refused(
        lambda w: w.tets.add_attribute("tet2point", 1, 1), NameTakenError, ("a part", "'tet2point'")
    ),
    "connectivity named like an attribute": Refused(
        lambda w: w.points.add_connectivity("x", w.nodes, [0] * 5, 1), NameTakenError, ("'x'",)
    ),
    "connectivity twice": Refused(
        lambda w: w.tets.add_connectivity("tet2point", w.points, [0] * 2, 1), NameTakenError, ("'tet2point'",)
    ),
    "primitive twice": Refused(lambda w: w.body.add_primitive("points", 2), NameTakenError, ("mesh body", "'points'")),
    "union named like a primitive": Refused(
        lambda w: w.body.add_primitive_union("points", [w.tets]), NameTakenError, ("mesh body", "'points'")
    ),
    "mesh twice": Refused(lambda w: w.scene.add_mesh("body"), NameTakenError, ("scene world", "'body'")),
    "mesh named like the scene": Refused(lambda w: w.scene.add_mesh("world"), NameTakenError, ("'world'", "own name")),
    "attribute named like the scene": Refused(
        lambda w: w.scene.add_attribute("world", 1, 1), NameTakenError, ("'world'", "own name")
    ),
    "mesh that hides a method": Refused(
        lambda w: w.scene.add_mesh("add_energy"), NameTakenError, ("'add_energy'", "Scene", "member")
    ),
    "mesh that hides a method in the paper's spelling": Refused(
        lambda w: w.scene.add_mesh("minimizeEnergy"), NameTakenError, ("'minimizeEnergy'", "member")
    ),
    "primitive that hides a property": Refused(
        lambda w: w.body.add_primitive("num_instances", 1), NameTakenError, ("'num_instances'", "Mesh")
    ),
    "primitive that hides a field": Refused(
        lambda w: w.body.add_primitive("attributes", 1), NameTakenError, ("member",)
    ),
    "connectivity that hides a method": Refused(
        lambda w: w.tets.add_connectivity("update", w.points, [0] * 2, 1), NameTakenError, ("'update'", "Primitive")
    ),
    # JOIN (paper, 4.5)
    "JOIN through another primitive's connectivity": Refused(
        lambda w: w.points.add_attribute("j", through=w.tet2point, source=w.x),
        ConnectivityError,
        ("primitive body.points", "body.tets.tet2point", "starts at body.tets"),
    ),
    "JOIN of a source elsewhere": Refused(
        lambda w: w.tets.add_attribute("j", through=w.tet2point, source=w.u),
        LineageError,
        ("cloth.nodes.x", "primitive cloth.nodes", "body.tets.tet2point", "primitive body.points"),
    ),
    "JOIN of a mesh's attribute": Refused(
        lambda w: w.tets.add_attribute("j", through=w.tet2point, source=w.body["density"]),
        LineageError,
        ("body.density", "mesh body"),
    ),
    "JOIN of a number": Refused(
        lambda w: w.tets.add_attribute("j", through=w.tet2point, source=zeros(3, 1)),
        LineageError,
        ("a number", "nowhere"),
    ),
    "JOIN without source": Refused(
        lambda w: w.tets.add_attribute("j", through=w.tet2point),
        SceneError,
        ("through=connectivity", "source=attribute"),
    ),
    "JOIN without connectivity": Refused(
        lambda w: w.tets.add_attribute("j", source=w.x), SceneError, ("through=connectivity", "source=attribute")
    ),
    "JOIN by a connectivity's name": Refused(
        lambda w: w.tets.add_attribute("j", through="tet2point", source=w.x),  # type: ignore[arg-type]
        SceneError,
        ("through=connectivity",),
    ),
    # what an attribute is
    "two kinds at once": Refused(
        lambda w: w.tets.add_attribute("j", 3, 1, through=w.tet2point, source=w.x), SceneError, ("not several",)
    ),
    "a name alone on a primitive": Refused(
        lambda w: w.tets.add_attribute("j"), ShapeMismatchError, ("rows and cols", "UNION")
    ),
    "rows alone": Refused(lambda w: w.tets.add_attribute("j", 3), ShapeMismatchError, ("both rows and cols",)),
    "numbers of an expression": Refused(
        lambda w: w.points.add_attribute("j", computed_attribute=w.x, value=[1.0]),
        SceneError,
        ("value", "rows and cols"),
    ),
    "numbers of a UNION": Refused(
        lambda w: w.all_points.add_attribute("rest", value=[1.0]), SceneError, ("all.points", "value")
    ),
    "an expression that is a number": Refused(
        lambda w: w.points.add_attribute("j", computed_attribute=3.0),  # type: ignore[arg-type]
        SceneError,
        ("computed_attribute", "3.0"),
    ),
    "an unknown attribute": Refused(
        lambda w: w.points["velocity"], SceneError, ("body.points", "'velocity'", "x, rest")
    ),
    # UNION (paper, 4.6)
    "UNION of an attribute a member lacks": Refused(
        lambda w: w.all_points.add_attribute("rest"), SceneError, ("all.points.rest", "cloth.nodes", "'rest'")
    ),
    "UNION of shapes": Refused(
        lambda w: w.all_points.add_attribute("mass"),
        ShapeMismatchError,
        ("body.points.mass 1x1", "cloth.nodes.mass 2x1", "one shape"),
    ),
    "UNION twice": Refused(lambda w: w.all_points.add_attribute("x"), NameTakenError, ("'x'",)),
    "union of nothing": Refused(
        lambda w: w.body.add_primitive_union("u", []), SceneError, ("mesh body", "at least one")
    ),
    "union of one bare primitive": Refused(
        lambda w: w.body.add_primitive_union("u", w.points),  # type: ignore[arg-type]
        SceneError,
        ("list of primitives", "body.points"),
    ),
    "union of a mesh": Refused(
        lambda w: w.body.add_primitive_union("u", [w.cloth]),  # type: ignore[list-item]
        SceneError,
        ("members are primitives", "mesh cloth"),
    ),
    "union of names": Refused(
        lambda w: w.body.add_primitive_union("u", "points"),  # type: ignore[arg-type]
        SceneError,
        ("members are primitives",),
    ),
    "union with a repeated member": Refused(
        lambda w: w.body.add_primitive_union("u", [w.points, w.points]), SceneError, ("same member twice",)
    ),
    "union across scenes": Refused(
        lambda w: w.body.add_primitive_union("u", [w.points, w.other.body.points]), SceneError, ("another scene",)
    ),
    # connectivities (paper, 4.4)
    "index too large": Refused(
        lambda w: w.tets.add_connectivity("c", w.points, [0, 5], 1),
        ConnectivityError,
        ("body.tets.c", "index 5 of instance 1", "primitive body.points has 5 instances", "0..4"),
    ),
    "index negative": Refused(
        lambda w: w.tet2point.update_value([0, 1, 2, 3, 1, 2, 3, -1]), ConnectivityError, ("index -1", "slot 3")
    ),
    "index beyond 32 bits": Refused(
        lambda w: w.tets.add_connectivity("c", w.points, np.array([2**32, 0]), 1), ConnectivityError, ("4294967296",)
    ),
    "too few rows": Refused(
        lambda w: w.tets.add_connectivity("c", w.points, [0], 1), ConnectivityError, ("2 x 1", "got 1 rows")
    ),
    "no whole rows": Refused(
        lambda w: w.tet2point.update_value([0, 1, 2]),
        ConnectivityError,
        ("body.tets.tet2point", "arity 4", "3 indices"),
    ),
    "rows of another arity": Refused(
        lambda w: w.tet2point.update_value([[0, 1], [1, 2]]), ConnectivityError, ("arity 4", "2 indices each")
    ),
    "indices of three dimensions": Refused(
        lambda w: w.tet2point.update_value(np.zeros((2, 2, 2), int)), ConnectivityError, ("(2, 2, 2)",)
    ),
    "ragged indices": Refused(
        lambda w: w.tet2point.update_value([[0], [1, 2]]), ConnectivityError, ("arity 4", "ragged")
    ),
    "indices 1.0": Refused(
        lambda w: w.tet2point.update_value(np.zeros((2, 4))), ConnectivityError, ("integers", "float64", "astype(int)")
    ),
    "indices True": Refused(lambda w: w.tet2point.update_value([True] * 8), ConnectivityError, ("integers", "bool")),
    "indices as text": Refused(lambda w: w.tet2point.update_value(["0"] * 8), ConnectivityError, ("integers", "<U1")),
    "connectivity to a mesh": Refused(
        lambda w: w.tets.add_connectivity("c", w.body, [0, 0], 1),  # type: ignore[arg-type]
        ConnectivityError,
        ("primitive body.tets", "mesh body"),
    ),
    "connectivity to another scene": Refused(
        lambda w: w.tets.add_connectivity("c", w.other.body.points, [0, 0], 1), ConnectivityError, ("another scene",)
    ),
    "two connectivities of different length": Refused(
        lambda w: w.pairs.add_connectivity("c", w.points, [0, 1, 2], 1),
        ConnectivityError,
        ("all.pairs.c", "3 rows", "2 instances"),
    ),
    "union as source with too many rows": Refused(
        lambda w: w.all_points.add_connectivity("c", w.points, [0] * 9, 1), ConnectivityError, ("8 x 1", "9 rows")
    ),
    # sizes
    "no instances of a static primitive": Refused(
        lambda w: w.body.add_primitive("p", 0), SceneError, ("mesh body", "'p'", "is_dynamic=True")
    ),
    "resizing a static primitive": Refused(lambda w: w.points.set_num_instances(6), SceneError, ("fixed", "5", "6")),
    "resizing a union": Refused(lambda w: w.all_points.set_num_instances(6), SceneError, ("all.points", "8", "6")),
    "resizing a mesh": Refused(lambda w: w.body.set_num_instances(2), SceneError, ("mesh body", "1", "2")),
    # update
    "update of different lengths": Refused(
        lambda w: w.pairs.update(pair2point=[[0, 1]], weight=[1.0, 2.0]),
        DataError,
        ("primitive all.pairs", "pair2point: 1", "weight: 2"),
    ),
    "update of a part of a dynamic primitive": Refused(
        lambda w: w.pairs.update(pair2point=[[0, 1]]), DataError, ("pair2point: 1", "not given", "weight: 2")
    ),
    "update of a static primitive's size": Refused(
        lambda w: w.points.update(x=np.zeros((6, 3))), DataError, ("x: 6", "not dynamic", "5 instances")
    ),
    "update with a bad last part": Refused(
        lambda w: w.pairs.update(pair2point=[[0, 1]], weight=[np.nan]), DataError, ("all.pairs.weight", "nan")
    ),
    "update with a bad index": Refused(
        lambda w: w.pairs.update(weight=[1.0], pair2point=[[0, 99]]), ConnectivityError, ("index 99",)
    ),
    "update of what is not there": Refused(
        lambda w: w.pairs.update(weights=[1.0]), SceneError, ("'weights'", "pair2point, weight")
    ),
    "update of a computed attribute": Refused(lambda w: w.points.update(energy=[1.0] * 5), SceneError, ("'energy'",)),
    "update that fills no instance": Refused(lambda w: w.points.update(x=[1.0] * 4), DataError, ("3x1", "4 numbers")),
    # energies and targets (paper, 4.7)
    "energy of a vector": Refused(
        lambda w: w.scene.add_energy(w.x), ShapeMismatchError, ("body.points.x", "3x1", "1x1")
    ),
    "energy twice": Refused(lambda w: w.scene.add_energy(w.energy), SceneError, ("body.points.energy", "already")),
    "energy of another scene": Refused(
        lambda w: w.scene.add_energy(w.foreign.dot(w.foreign)), SceneError, ("belongs to scene 'world'", "same name")
    ),
    "energy that is a number": Refused(
        lambda w: w.scene.add_energy(constant(1.0)), SceneError, ("an energy", "number")
    ),
    "energy that is a float": Refused(lambda w: w.scene.add_energy(1.0), SceneError, ("an energy", "1.0")),  # type: ignore[arg-type]
    "static energy on a dynamic primitive": Refused(
        lambda w: w.scene.add_energy(w.pairs["weight"] * 1.0, dynamic_instances=False),
        SceneError,
        ("dynamic primitive all.pairs", "dynamic_instances=True"),
    ),
    "an unknown projection": Refused(
        lambda w: w.scene.add_energy(w.points["mass"], projection="psd"), SceneError, ("'psd'", "clamp")
    ),
    "target computed": Refused(
        lambda w: w.scene.add_minimize_target(w.energy), SceneError, ("body.points.energy", "computed", "stored")
    ),
    "target joined": Refused(
        lambda w: w.scene.add_minimize_target([w.u, w.all_points["x"]]), SceneError, ("all.points.x", "computed")
    ),
    "target constant": Refused(
        lambda w: w.scene.add_minimize_target(w.rest), SceneError, ("body.points.rest", "add_constant")
    ),
    "target twice": Refused(lambda w: w.scene.add_minimize_target(w.x), SceneError, ("body.points.x", "already")),
    "target twice in one list": Refused(lambda w: w.scene.add_minimize_target([w.u, w.u]), SceneError, ("already",)),
    "target of another scene": Refused(
        lambda w: w.scene.add_minimize_target([w.u, w.foreign]), SceneError, ("body.points.x", "scene 'world'")
    ),
    "target by name": Refused(
        lambda w: w.scene.add_minimize_target("x"),  # type: ignore[arg-type]
        SceneError,
        ("minimisation target", "'x'"),
    ),
    "target 3": Refused(lambda w: w.scene.add_minimize_target(3), SceneError, ("list", "3")),  # type: ignore[arg-type]
    "evaluation of another scene's attribute": Refused(
        lambda w: w.scene.evaluate(w.foreign * 1.0), SceneError, ("scene 'world'",)
    ),
    # results
    "result without energies": Refused(
        lambda w: w.other.minimize_energy(), SceneError, ("no energy yet", "add_energy")
    ),
    "total energy without energies": Refused(lambda w: w.other.total_energy(), SceneError, ("no energy yet",)),
    "negative tolerance": Refused(lambda w: w.scene.minimize_energy(-1e-3), DataError, ("tolerance", "-0.001")),
    "NaN tolerance": Refused(lambda w: w.scene.solve(float("nan")), DataError, ("tolerance", "nan")),
    "tolerance as text": Refused(lambda w: w.scene.solve("1e-6"), DataError, ("tolerance", "'1e-6'")),  # type: ignore[arg-type]
    "half an iteration": Refused(lambda w: w.scene.solve(1e-3, 1.5), DataError, ("max_iterations", "1.5")),  # type: ignore[arg-type]
    "negative iterations": Refused(lambda w: w.scene.solve(1e-3, -1), DataError, ("max_iterations", "-1")),
    # scenes
    "an unknown device": Refused(lambda w: Scene("s", device="gpu"), SceneError, ("'gpu'", "cpu", "cuda:N")),
    "threads of a GPU": Refused(lambda w: Scene("s", device="cuda", threads=2), SceneError, ("threads=2", "GPU")),
    "no threads": Refused(lambda w: Scene("s", threads=0), SceneError, ("threads=0",)),
    "threads as text": Refused(lambda w: Scene("s", threads="2"), SceneError, ("threads='2'",)),  # type: ignore[arg-type]
}

ILLEGAL_NAMES = ["", "__x", "_x", "a.b", "a b", "2d", "x\n", "é", "a/b", None, 3, b"x"]
MAKERS: dict[str, Callable[[World, Any], object]] = {
    "mesh": lambda w, name: w.scene.add_mesh(name),
    "primitive": lambda w, name: w.body.add_primitive(name, 1),
    "union": lambda w, name: w.body.add_primitive_union(name, [w.points]),
    "connectivity": lambda w, name: w.tets.add_connectivity(name, w.points, [0, 1], 1),
    "attribute": lambda w, name: w.points.add_attribute(name, 1, 1),
    "constant": lambda w, name: w.points.add_constant(name, 1, 1),
    "expression": lambda w, name: w.points.add_attribute(name, computed_attribute=w.x),
    "JOIN": lambda w, name: w.tets.add_attribute(name, through=w.tet2point, source=w.x),
    "UNION": lambda w, name: w.all_points.add_attribute(name),
    "scene": lambda w, name: Scene(name),
}
BAD_COUNTS = [0, -1, 1.0, 2.5, True, "3", None, np.float64(2.0), np.nan]
COUNTED: dict[str, tuple[Callable[[World, Any], object], type[YaspsError]]] = {
    "rows": (lambda w, n: w.points.add_attribute("n", rows=n, cols=1), ShapeMismatchError),
    "cols": (lambda w, n: w.points.add_constant("n", rows=1, cols=n), ShapeMismatchError),
    "arity": (lambda w, n: w.tets.add_connectivity("n", w.points, [0, 1], n), ConnectivityError),
    "num_instances": (lambda w, n: w.body.add_primitive("n", n), SceneError),
}


@pytest.fixture
def world() -> World:
    """A fresh one for each test."""
    return make_world()


def assert_refused(world: World, call: Callable[[World], object], error: type[YaspsError]) -> str:
    """Calls, and returns the message; the scene must be as before."""
    before = snapshot(world.scene), snapshot(world.other)
    with pytest.raises(error) as caught:
        call(world)
    assert caught.type is error
    assert (snapshot(world.scene), snapshot(world.other)) == before
    return str(caught.value)


@pytest.mark.parametrize("case", TABLE.values(), ids=TABLE.keys())
def test_refused_with_a_message_and_without_a_trace(world: World, case: Refused) -> None:
    message = assert_refused(world, case.call, case.error)
    for word in case.words:
        assert word in message


@pytest.mark.parametrize("name", ILLEGAL_NAMES, ids=repr)
@pytest.mark.parametrize("maker", MAKERS)
def test_illegal_names(world: World, maker: str, name: object) -> None:
    message = assert_refused(world, lambda w: MAKERS[maker](w, name), NameTakenError)
    assert repr(name) in message
    assert "starts with a letter" in message


@pytest.mark.parametrize("count", BAD_COUNTS, ids=repr)
@pytest.mark.parametrize("what", COUNTED)
def test_counts_are_positive_integers(world: World, what: str, count: object) -> None:
    call, error = COUNTED[what]
    message = assert_refused(world, lambda w: call(w, count), error)
    assert "num_instances" in message if what == "num_instances" else what in message


@pytest.mark.parametrize("count", [-1, 1.0, True], ids=repr)
def test_dynamic_sizes_are_integers(world: World, count: Any) -> None:
    assert_refused(world, lambda w: w.pairs.set_num_instances(count), SceneError)


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
