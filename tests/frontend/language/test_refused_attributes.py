"""What attributes, names, JOIN and UNION refuse: the error, what its message names, and that nothing changed."""

from __future__ import annotations

import numpy as np
import pytest
from refusals import Refused, check_refused

from yasps import (
    ConnectivityError,
    DataError,
    LineageError,
    NameTakenError,
    SceneError,
    ShapeMismatchError,
    concat_cols,
    concat_rows,
    constant,
    zeros,
)

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
    "a slice of nothing": Refused(lambda w: w.x[3:], ShapeMismatchError, ("chooses no row", "3x1")),
    "three indices": Refused(lambda w: w.x[0, 0, 0], ShapeMismatchError, ("a[i, j]", "3 indices")),  # type: ignore[index]
    "block outside": Refused(lambda w: w.x.block(1, 0, 3, 1), ShapeMismatchError, ("rows 1..3", "3x1")),
    "det of a vector": Refused(lambda w: w.x.det(), ShapeMismatchError, ("det", "3x1")),
    "inverse of 5x5": Refused(
        lambda w: (w.body["density"] * np.eye(5)).inverse(), ShapeMismatchError, ("inverse", "5x5")
    ),
    "cross of 2-vectors": Refused(
        lambda w: w.nodes["mass"].cross(w.nodes["mass"]), ShapeMismatchError, ("cross", "cloth.nodes.mass", "2x1")
    ),
    "division by a vector": Refused(lambda w: w.x / w.x, ShapeMismatchError, ("divide", "3x1")),
    "an empty constant": Refused(lambda w: constant([]), ShapeMismatchError, ("shape (0,)",)),
    "a constant of three dimensions": Refused(
        lambda w: constant(np.zeros((1, 2, 3))), ShapeMismatchError, ("(1, 2, 3)",)
    ),
    # what is symbolic
    "truth value": Refused(lambda w: bool(w.x), SceneError, ("body.points.x", "no truth value", "compute().value")),
    "if a < b": Refused(lambda w: not w.x.norm(), SceneError, ("truth value",)),
    "np.asarray": Refused(lambda w: np.asarray(w.x), SceneError, ("body.points.x", "compute().array")),
    "np.array": Refused(lambda w: np.array(w.x), SceneError, ("symbolic", "*")),
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
}


@pytest.mark.parametrize("case", TABLE.values(), ids=TABLE.keys())
def test_refused_with_a_message_and_without_a_trace(case: Refused) -> None:
    check_refused(case)
