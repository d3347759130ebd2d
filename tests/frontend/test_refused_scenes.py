"""What connectivities, sizes, energies, targets and scenes refuse, and names and counts that none can be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from refusals import Refused, World, assert_refused, check_refused, make_world

from yasps import (
    ConnectivityError,
    DataError,
    NameTakenError,
    Scene,
    SceneError,
    ShapeMismatchError,
    YaspsError,
    constant,
)

NAN = [np.nan] * 15
TABLE: dict[str, Refused] = {
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
    "resizing a static primitive": Refused(lambda w: w.points.set_num_instances(6), SceneError, ("resize", "5", "6")),
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
        lambda w: w.points.update(x=np.zeros((6, 3))), DataError, ("body.points.x", "5 x 3x1 = 15", "(6, 3)")
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
    "update that fills no instance": Refused(lambda w: w.points.update(x=[1.0] * 4), DataError, ("3x1", "got 4")),
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


@pytest.mark.parametrize("case", TABLE.values(), ids=TABLE.keys())
def test_refused_with_a_message_and_without_a_trace(case: Refused) -> None:
    check_refused(case)


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
