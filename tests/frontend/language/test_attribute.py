"""Attributes: every operator against NumPy, broadcasting over the lineage, numbers in and out."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import Attribute, ComputedValue, Primitive, Scene, concat_cols, concat_rows, constant, identity, zeros
from yasps.frontend.language.nodes import Computed, Joined, Named, Stored, United, operands_of

Floats = NDArray[np.float64]
N = 11  # more than one pack of eight instances
RNG = np.random.default_rng(20)
V, W = RNG.standard_normal((2, N, 3, 1))
R = RNG.standard_normal((N, 1, 3))
S = RNG.uniform(0.5, 2.0, (N, 1, 1))
A, B = RNG.standard_normal((2, N, 3, 3)) + 3 * np.eye(3)
C = RNG.standard_normal((N, 2, 3))
K: Any = RNG.standard_normal((3, 3))  # Any: NumPy's stubs say `array * attribute` is an array


def computed_together(expressions: Sequence[Attribute]) -> list[Floats]:
    """Values of several attributes of one primitive by one compile."""
    flat = concat_cols([e.reshape(1, e.shape[0] * e.shape[1]) for e in expressions]).compute().array[:, 0, :]
    sizes = [e.shape[0] * e.shape[1] for e in expressions]
    parts = np.split(flat, np.cumsum(sizes)[:-1], axis=1)
    return [part.reshape(-1, *e.shape) for part, e in zip(parts, expressions, strict=True)]


@pytest.fixture
def points() -> Primitive:
    """A primitive with matrices v, w (3x1), r (1x3), s (1x1, positive), a, b (3x3) and c (2x3)."""
    primitive = Scene("s").add_mesh("m").add_primitive("points", N)
    for name, value in {"v": V, "w": W, "r": R, "s": S, "a": A, "b": B, "c": C}.items():
        primitive.add_attribute(name, value.shape[1], value.shape[2], value=value)
    return primitive


def swapped(m: Floats) -> Floats:
    """Transposes of a batch."""
    return np.swapaxes(m, 1, 2)


def summed(m: Floats) -> Floats:
    """Sums of a batch, 1x1."""
    return np.asarray(m.sum(axis=(1, 2), keepdims=True))


# name: what is written with attributes, and its meaning on arrays [instances, rows, columns].
Operation = tuple[Callable[[Primitive], Attribute], Floats]
OPERATIONS: dict[str, Operation] = {
    "v + w": (lambda p: p["v"] + p["w"], V + W),
    "v - w": (lambda p: p["v"] - p["w"], V - W),
    "-v": (lambda p: -p["v"], -V),
    "a * v is a matrix product": (lambda p: p["a"] * p["v"], A @ V),
    "a * b is a matrix product": (lambda p: p["a"] * p["b"], A @ B),
    "a @ b": (lambda p: p["a"] @ p["b"], A @ B),
    "r * v is a 1x1 product": (lambda p: p["r"] * p["v"], R @ V),
    "v * r is outer": (lambda p: p["v"] * p["r"], V @ R),
    "s * v scales": (lambda p: p["s"] * p["v"], S * V),
    "v * s scales": (lambda p: p["v"] * p["s"], S * V),
    "v / s": (lambda p: p["v"] / p["s"], V / S),
    "v / 2": (lambda p: p["v"] / 2, V / 2),
    "1 / s": (lambda p: 1 / p["s"], 1 / S),
    "2 * v": (lambda p: 2 * p["v"], 2 * V),
    "v * 2.5": (lambda p: p["v"] * 2.5, 2.5 * V),
    "np.float64 * v": (lambda p: np.float64(2) * p["v"], 2 * V),
    "np.float32 * v": (lambda p: np.float32(2) * p["v"], 2 * V),
    "np.int64 + s": (lambda p: np.int64(2) + p["s"], 2 + S),
    "np.float64 - s": (lambda p: np.float64(2) - p["s"], 2 - S),
    "np.float64 / s": (lambda p: np.float64(2) / p["s"], 2 / S),
    "array @ v": (lambda p: K @ p["v"], K @ V),
    "array * a": (lambda p: K * p["a"], K @ A),
    "a @ array": (lambda p: p["a"] @ K, A @ K),
    "array + a": (lambda p: K + p["a"], K + A),
    "array - a": (lambda p: K - p["a"], K - A),
    "v + list": (lambda p: p["v"] + [1, 2, 3], V + np.array([[1.0], [2.0], [3.0]])),
    "list - v": (lambda p: [1, 2, 3] - p["v"], np.array([[1.0], [2.0], [3.0]]) - V),
    "sum([v, w, v])": (lambda p: sum([p["v"], p["w"], p["v"]]), V + W + V),  # type: ignore[dict-item, return-value]
    "v ** 3": (lambda p: p["v"] ** 3, V**3),
    "s ** -1.5": (lambda p: p["s"] ** -1.5, S**-1.5),
    "hadamard": (lambda p: p["a"].hadamard(p["b"]), A * B),
    "hadamard with an array": (lambda p: p["a"].hadamard(K), A * K),
    "sqrt": (lambda p: p["s"].sqrt(), np.sqrt(S)),
    "exp": (lambda p: p["v"].exp(), np.exp(V)),
    "log": (lambda p: p["s"].log(), np.log(S)),
    "sin": (lambda p: p["v"].sin(), np.sin(V)),
    "cos": (lambda p: p["v"].cos(), np.cos(V)),
    "tan": (lambda p: (0.3 * p["v"]).tan(), np.tan(0.3 * V)),
    "asin": (lambda p: (0.4 * p["s"]).asin(), np.arcsin(0.4 * S)),
    "acos": (lambda p: (0.4 * p["s"]).acos(), np.arccos(0.4 * S)),
    "abs": (lambda p: p["v"].abs(), np.abs(V)),
    "v ** s": (lambda p: p["v"].exp() ** p["s"], np.exp(V) ** S),
    "dot of vectors": (lambda p: p["v"].dot(p["w"]), summed(V * W)),
    "dot of matrices": (lambda p: p["a"].dot(p["b"]), summed(A * B)),
    "dot with a list": (lambda p: p["v"].dot([0, 0, 9.8]), 9.8 * V[:, 2:]),
    "cross": (lambda p: p["v"].cross(p["w"]), np.cross(V, W, axis=1)),
    "outer": (lambda p: p["v"].outer(p["w"]), V @ swapped(W)),
    "outer of a row": (lambda p: p["r"].outer(p["w"]), swapped(R) @ swapped(W)),
    "transpose": (lambda p: p["c"].transpose(), swapped(C)),
    "T": (lambda p: p["c"].T * p["c"], swapped(C) @ C),
    "trace": (lambda p: p["a"].trace(), np.trace(A, axis1=1, axis2=2).reshape(N, 1, 1)),
    "sum": (lambda p: p["c"].sum(), summed(C)),
    "norm": (lambda p: p["c"].norm(), np.sqrt(summed(C * C))),
    "det": (lambda p: p["a"].det(), np.linalg.det(A).reshape(N, 1, 1)),
    "inverse": (lambda p: p["a"].inverse(), np.linalg.inv(A)),
    "flatten is row-major": (lambda p: p["c"].flatten(), C.reshape(N, 6, 1)),
    "reshape is row-major": (lambda p: p["c"].reshape(3, 2), C.reshape(N, 3, 2)),
    "resize": (lambda p: p["a"].resize(1, 9), A.reshape(N, 1, 9)),
    "block": (lambda p: p["a"].block(1, 0, 2, 3), A[:, 1:3, 0:3]),
    "row": (lambda p: p["a"].row(1), A[:, 1:2]),
    "last row": (lambda p: p["a"].row(-1), A[:, 2:3]),
    "column": (lambda p: p["c"].col(-2), C[:, :, 1:2]),
    "a[i, j]": (lambda p: p["a"][1, -1], A[:, 1:2, 2:3]),
    "v[i]": (lambda p: p["v"][2], V[:, 2:3]),
    "r[-1]": (lambda p: p["r"][-1], R[:, :, 2:3]),
    "v[np.int32]": (lambda p: p["v"][np.int32(1)], V[:, 1:2]),  # type: ignore[index]
    "concat_rows": (
        lambda p: concat_rows([p["r"], p["c"], [[1, 2, 3]]]),
        np.concatenate([R, C, np.tile([[[1, 2, 3]]], (N, 1, 1))], 1),
    ),
    "concat_cols": (lambda p: concat_cols([p["v"], p["a"]]), np.concatenate([V, A], 2)),
    "identity": (lambda p: p["a"] - identity(3), A - np.eye(3)),
    "zeros": (lambda p: p["c"] - zeros(2, 3), C),
    "constant": (
        lambda p: p["a"] * constant([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
        A @ [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]],
    ),
    "stop_gradient": (lambda p: p["a"].stop_gradient(), A),
    "with_derivatives": (lambda p: p["v"].with_derivatives(p["v"], identity(3)), V),
}


def test_operators_mean_what_numpy_means(points: Primitive) -> None:
    expressions = [write(points) for write, _ in OPERATIONS.values()]
    for name, value, (_, expected) in zip(OPERATIONS, computed_together(expressions), OPERATIONS.values(), strict=True):
        assert value.shape == expected.shape, name
        np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-13, err_msg=name)


def test_every_operator_method_is_tried() -> None:
    """A public method of Attribute that no entry above calls would be untested."""
    about_numbers = {"compute", "update_value"}
    methods = {
        name
        for name, member in vars(Attribute).items()
        if callable(member) and not name.startswith("_") and name == name.lower() and name not in about_numbers
    }
    used = {name for write, _ in OPERATIONS.values() for name in write.__code__.co_names}
    assert methods - used == set()


# -- lineage -------------------------------------------------------------------------------------------------


def test_higher_levels_broadcast_and_the_deepest_owns(points: Primitive) -> None:
    mesh, scene = points.mesh, points.scene
    dt = scene.add_attribute("dt", 1, 1, value=0.5)
    gravity = scene.add_constant("gravity", 3, 1, value=[0, 0, -9.8])
    density = mesh.add_attribute("density", 1, 1, value=3.0)
    assert (dt * gravity).owner is scene
    assert (dt * density).owner is mesh
    assert (density * dt).owner is mesh
    assert (points["v"] * dt).owner is points
    assert (dt * (density * points["v"])).owner is points
    assert constant(2.0).owner is None
    assert (constant(2.0) * dt).owner is scene
    fall = points["v"] + dt * gravity * density
    np.testing.assert_allclose(fall.compute().array, V + 0.5 * 3.0 * np.array([[0], [0], [-9.8]]), rtol=1e-14)
    np.testing.assert_allclose((dt * gravity).compute().array, [[[0.0], [0.0], [-4.9]]])
    np.testing.assert_allclose((dt * density).value, [1.5])


def test_a_higher_expression_gets_a_name_lower_down(points: Primitive) -> None:
    dt = points.scene.add_attribute("dt", 1, 1, value=0.5)
    squared = points.add_attribute("squared", computed_attribute=dt * dt)
    number = points.add_attribute("number", computed_attribute=constant([1.0, 2.0]))
    assert squared.owner is number.owner is points
    np.testing.assert_array_equal(squared.value, np.full(N, 0.25))
    np.testing.assert_array_equal(number.compute().array, np.tile([[1.0], [2.0]], (N, 1, 1)))


# -- numbers -------------------------------------------------------------------------------------------------


def test_value_is_flat_and_array_is_not(points: Primitive) -> None:
    result = (points["c"] * 2.0).compute()
    assert isinstance(result, ComputedValue)
    assert result.value.shape == (N * 2 * 3,)
    assert result.array.shape == (N, 2, 3)
    np.testing.assert_array_equal(result.value, (2 * C).reshape(-1))


def test_stored_numbers_come_back_as_copies(points: Primitive) -> None:
    taken = points["v"].compute()
    taken.array[...] = 7.0
    np.testing.assert_array_equal(points["v"].value, V.reshape(-1))
    given = V.copy()
    points["v"].update_value(given)
    given[...] = 7.0
    np.testing.assert_array_equal(points["v"].value, V.reshape(-1))
    points["v"].update_value(points["v"].value)
    np.testing.assert_array_equal(points["v"].value, V.reshape(-1))


@pytest.mark.parametrize(
    "value",
    [
        W.reshape(-1).tolist(),
        W[:, :, 0],
        W,
        np.asfortranarray(W[:, :, 0]),
        W.astype(np.longdouble),
        np.repeat(W, 2, axis=0)[::2],
        tuple(map(tuple, W[:, :, 0])),
    ],
    ids=["flat list", "rows", "matrices", "column-major", "long double", "strided", "tuples"],
)
def test_numbers_are_read_row_by_row(points: Primitive, value: Any) -> None:
    points["v"].update_value(value)
    np.testing.assert_array_equal(points["v"].compute().array, W)


def test_integers_and_truth_values_become_numbers(points: Primitive) -> None:
    points["s"].update_value(np.arange(N))
    np.testing.assert_array_equal(points["s"].value, np.arange(N, dtype=float))
    points["s"].update_value([True, False] * 5 + [True])
    np.testing.assert_array_equal(points["s"].value, [1, 0] * 5 + [1])


def test_new_numbers_are_seen_by_the_next_result(points: Primitive) -> None:
    doubled = points["v"] * 2.0
    np.testing.assert_array_equal(doubled.value, 2 * V.reshape(-1))
    points["v"].update_value(W)
    np.testing.assert_array_equal(doubled.value, 2 * W.reshape(-1))


def test_stored_attributes_start_at_zero(points: Primitive) -> None:
    assert not points.add_attribute("fresh", 2, 2).value.any()


# -- what it says about itself -------------------------------------------------------------------------------


def test_repr_names_kind_place_and_shape(points: Primitive) -> None:
    assert repr(points["v"]) == "<stored attribute m.points.v 3x1>"
    assert repr(points["v"] * 2.0) == "<computed attribute m.points.an expression 3x1>"
    assert repr(points.add_attribute("twice", computed_attribute=points["v"] * 2.0)) == (
        "<named attribute m.points.twice 3x1>"
    )
    assert repr(constant([[1, 2]])) == "<computed attribute a number 1x2>"
    assert repr(points.scene.add_attribute("dt", 1, 1)) == "<stored attribute dt 1x1>"


def test_it_knows_the_users_line(points: Primitive) -> None:
    line = (lambda: 0).__code__.co_firstlineno + 1
    expression = points["v"].dot(points["w"])
    assert Path(expression.where.file).name == "test_attribute.py"
    assert expression.where.line == line
    assert str(points.addAttribute("p", rows=1, cols=1).where).endswith(f"test_attribute.py:{line + 3}")


def test_nodes_list_what_they_are_computed_from(points: Primitive) -> None:
    v, w = points["v"], points["w"]
    to_itself = points.add_connectivity("to_itself", points, range(N), 1)
    union = points.mesh.add_primitive_union("union", [points])
    joined, united = points.add_attribute("j", through=to_itself, source=v), union.add_attribute("v")
    named = points.add_attribute("named", computed_attribute=v)
    for attribute, kind, operands in (
        (v, Stored, ()),
        (v + w, Computed, (v, w)),
        (joined, Joined, (v,)),
        (united, United, (v,)),
        (named, Named, (v,)),
    ):
        assert isinstance(attribute.node, kind)
        assert operands_of(attribute.node) == operands


def test_forgotten_expressions_are_freed(points: Primitive) -> None:
    expression = points["v"] * 3.0
    expression.compute()
    alive = weakref.ref(expression)
    del expression
    gc.collect()
    assert alive() is None
