"""Comparisons, choices, angles, packing: values, refusals, and derivatives through compiled scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from mat_bodies import relative_error
from small_scenes import along_each_unknown, emit

from yasps import (
    Attribute,
    DataError,
    LineageError,
    NotFiniteError,
    Primitive,
    Scene,
    SceneError,
    ShapeMismatchError,
    atan2,
    concat_rows,
    hypot,
    maximum,
    minimum,
    select,
)
from yasps.backend.reference.interpreter import Interpreter
from yasps.dialects.scalar.functions import FUNCTIONS
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import load_runtime

N = 11
RNG = np.random.default_rng(5)
A, B = RNG.uniform(-0.9, 0.9, (2, N, 2, 2))
S = RNG.uniform(-0.9, 0.9, (N, 1, 1))
A[0, 0, 0], B[0, 0, 0], S[1] = 0.25, 0.25, 0.0  # a tie and a zero


@pytest.fixture
def points() -> Primitive:
    """A primitive with a, b (2x2) and s (1x1)."""
    primitive = Scene("s").add_mesh("m").add_primitive("points", N)
    for name, value in {"a": A, "b": B, "s": S}.items():
        primitive.add_attribute(name, value.shape[1], value.shape[2], value=value)
    return primitive


def test_values(points: Primitive) -> None:
    a, b, s = points["a"], points["b"], points["s"]
    inside = 0.1 + 0.4 * abs(a)  # inside every function's domain
    cases = {
        "a < b": (a < b, A < B),
        "a <= b": (a <= b, A <= B),
        "a > b": (a > b, A > B),
        "a >= b": (a >= b, A >= B),
        "s < 0.5": (s < 0.5, S < 0.5),
        "v > list": (a.col(0) > [0.1, 0.2], A[:, :, :1] > np.array([[0.1], [0.2]])),
        "np.float64 < s": (np.float64(0.1) < s, S > 0.1),
        "select by entry": (select(a < b, a, 2.0 * b), np.where(A < B, A, 2 * B)),
        "select by one": (select(s < 0.0, a, b), np.where(S < 0, A, B)),
        "select by a number": (select(s, a, b), np.where(S != 0, A, B)),
        "select of numbers": (select(s <= 0.0, 1.0, -1.0), np.where(S <= 0, 1.0, -1.0)),
        "minimum": (minimum(a, b), np.minimum(A, B)),
        "maximum": (maximum(s, 0.0), np.maximum(S, 0)),
        "abs": (abs(a), np.abs(A)),
        ".abs()": (a.abs(), np.abs(A)),
        **{f.name: (getattr(inside, f.name)(), f.evaluate(0.1 + 0.4 * abs(A))) for f in FUNCTIONS},
        **{f"{f.ufunc.__name__} of NumPy": (f.ufunc(inside), f.evaluate(0.1 + 0.4 * abs(A))) for f in FUNCTIONS},
        "hypot": (hypot(a, b), np.hypot(A, B)),
        "hypot of numbers": (hypot(s, -1.0), np.hypot(S, -1.0)),
        "atan2": (atan2(a, b), np.arctan2(A, B)),
        "atan2 of numbers": (atan2(s, -1.0), np.arctan2(S, -1.0)),
        "power by one": ((a + 1.0 * np.ones((2, 2))) ** s, (A + 1) ** S),
        "power by entry": ((a + 1.0 * np.ones((2, 2))) ** b, (A + 1) ** B),
    }
    for name, (attribute, wanted) in cases.items():
        found = attribute.compute().array
        assert found.shape == wanted.shape, name
        assert relative_error(found, np.asarray(wanted, float)) < 1e-14, name


def test_attributes_are_still_told_apart_by_identity(points: Primitive) -> None:
    a = points["a"]
    assert a == a  # noqa: PLR0124
    assert a != points["b"]
    assert {a: 1}[a] == 1


def test_packing(points: Primitive) -> None:
    packed = points["s", "a", "s"]
    assert packed.shape == (1, 6)
    assert packed.owner is points
    wanted = np.concatenate([S.reshape(N, 1), A.reshape(N, 4), S.reshape(N, 1)], axis=1)
    np.testing.assert_array_equal(packed.compute().array[:, 0, :], wanted)
    assert points["a",].shape == (1, 4)


REFUSED: dict[str, tuple[Callable[[Primitive], object], type[Exception], tuple[str, ...]]] = {
    "== as a condition": (lambda p: select(p["a"] == p["b"], p["a"], p["b"]), SceneError, ("==", "<=")),
    "a chain": (lambda p: 0 < p["s"] < 1, SceneError, ("no truth value", "select")),
    "Python's max": (lambda p: max(p["s"], p["s"] + 1.0), SceneError, ("maximum(a, b)",)),
    "shapes of a comparison": (
        lambda p: p["a"] < p["a"].reshape(4, 1),
        ShapeMismatchError,
        ("comparison", "2x2", "4x1"),
    ),
    "shapes of a choice": (lambda p: select(p["s"], p["a"], np.zeros(2)), ShapeMismatchError, ("choice", "2x2")),
    "shape of a condition": (lambda p: select(p["a"], p["s"], p["s"]), ShapeMismatchError, ("condition must be 1x1",)),
    "shapes of minimum": (lambda p: minimum(p["a"], np.zeros(2)), ShapeMismatchError, ("minimum", "2x2")),
    "text": (lambda p: maximum(p["s"], "1"), DataError, ("real numbers",)),
    "packing nothing": (lambda p: p[()], SceneError, ("names no attribute",)),
    "packing what is not there": (lambda p: p["a", "c"], SceneError, ("no attribute 'c'",)),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case: str, points: Primitive) -> None:
    write, error, words = REFUSED[case]
    with pytest.raises(error) as caught:
        write(points)
    for word in words:
        assert word in str(caught.value)


def test_two_primitives_do_not_meet(points: Primitive) -> None:
    other = points.mesh.add_primitive("other", N)
    t = other.add_attribute("t", 1, 1)
    with pytest.raises(LineageError, match="select of"):
        select(points["s"] < 0.0, points["s"], t)


# -- energies --------------------------------------------------------------------------------------------------

ENERGIES: dict[str, Callable[[Attribute, Attribute], Attribute]] = {
    "a barrier with a reach": lambda d, e: select(d.norm() < 1.5, (d.norm() - 1.5) ** 2 * (d.norm() / 1.5).log(), 0.0),
    "nested": lambda d, e: select(
        d.norm() < 1.0, d.norm() ** 2, select(e.norm() < 1.2, d.norm() * e.norm(), e.norm() ** 3)
    ),
    "minimum": lambda d, e: minimum(d.norm(), e.norm()) ** 3,
    "maximum": lambda d, e: maximum(d.dot(e), e[0]) ** 2 * e[1],
    "minimum by entry": lambda d, e: minimum(d, e).dot(e),
    "abs": lambda d, e: abs(d).sum() ** 2 + abs(d.dot(e)) * d[0],
    "select by entry": lambda d, e: select(d < e, d.hadamard(d), e.exp()).sum(),
    "atan2": lambda d, e: atan2(d[0], e[1]) ** 2,
    "tan, asin, acos": lambda d, e: (
        (0.1 * d[0]).tan() * e[0] + (d.dot(e) / (1.0 + d.dot(e) ** 2)).asin() + (d[1] / (1.0 + d[1] ** 2)).acos() ** 2
    ),
    "acos with a guard": lambda d, e: select(abs(d[0]) < 0.5, d[0].acos(), d[0] ** 2),
    "power": lambda d, e: (1.0 + d.norm()) ** e.norm(),
}


def energies(projection: str) -> Scene:
    """All of them on triples of points; every branch is taken by some and not by others."""
    random = np.random.default_rng(0)
    scene = Scene("choices")
    mesh = scene.add_mesh("m")
    points, triples = mesh.add_primitive("v", 6), mesh.add_primitive("t", N)
    x = points.add_attribute("x", 3, 1, value=random.standard_normal((6, 3)))
    corners = triples.add_connectivity("corners", points, [random.permutation(6)[:3] for _ in range(N)], 3)
    corner = triples.add_attribute("x", through=corners, source=x)
    d, e = corner.row(0) - corner.row(1), corner.row(2) - corner.row(1)
    for k, write in enumerate(ENERGIES.values()):
        scene.add_energy(triples.add_attribute(f"e{k}", computed_attribute=write(d, e)), projection=projection)
    scene.add_minimize_target(x)
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("vector_math", [True, False], ids=["vector-math", "lane-by-lane"])
@pytest.mark.parametrize("projection", ["none", "clamp"])
def test_kernels_compute_what_the_interpreter_does(projection: str, vector_math: bool) -> None:
    compiler = find_compiler()
    if vector_math and not compiler.has_vector_math:
        pytest.skip("this C library has no vector functions")
    scene = energies(projection)
    scene._runtime = load_runtime(replace(compiler, has_vector_math=vector_math))
    compiled = scene.compile()
    text = "".join(code.text for code in compiled.program.codes.values())
    assert ("_ZGVeN8vv_atan2" in text) is vector_math
    interpreter = Interpreter(compiled.module, compiled.data())
    for name, found in compiled.energies().items():
        assert relative_error(found, interpreter.value(name).ravel()) < 1e-13, name
    gradient = compiled.assemble()
    hessian = (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()
    wanted_gradient, wanted_hessian = interpreter.assemble()
    assert relative_error(gradient, wanted_gradient) < 1e-13
    assert relative_error(hessian, wanted_hessian.toarray()) < 1e-12


@pytest.mark.slow
def test_derivatives_are_those_of_complex_step() -> None:
    """Of the energy before any pass, and of the gradient after all of them."""
    emitted = emit(energies("none"))
    slopes = along_each_unknown(emitted.module, emitted.data, emitted.targets, lambda i: i.total_energy())
    run_pipeline(emitted.module)
    gradient, hessian = Interpreter(emitted.module, emitted.data).assemble()
    curvatures = along_each_unknown(emitted.module, emitted.data, emitted.targets, lambda i: i.gradient())
    assert relative_error(gradient, slopes) < 1e-13
    assert relative_error(hessian.toarray(), curvatures) < 1e-13


def _one_point(write: Callable[[Attribute], Attribute], at: list[float]) -> Scene:
    scene = Scene("one")
    point = scene.add_mesh("m").add_primitive("v", 1)
    x = point.add_attribute("x", 3, 1, value=at)
    scene.add_energy(point.add_attribute("e", computed_attribute=write(x) + 0.5 * x.dot(x)), projection="none")
    scene.add_minimize_target(x)
    return scene


def test_kinks_in_kernels() -> None:
    """What is added to 1/2 x.x has gradient and Hessian 0 at 0."""
    for write in (
        lambda x: abs(x).sum() - x.sum(),
        lambda x: select(x.norm() <= 0.0, 0.0, x.norm().sqrt()),
        lambda x: maximum(2.0 - x[0] ** 2, x.norm().sqrt()) + x[0] ** 2,
    ):
        compiled = _one_point(write, [0.0, 0.0, 0.0]).compile()
        assert compiled.assemble().tolist() == [0.0, 0.0, 0.0]
        assert compiled.static_matrix.to_scipy().toarray().tolist() == np.eye(3).tolist()


@pytest.mark.parametrize(
    "write",
    [
        lambda x: x.norm(),
        lambda x: (x.norm() - 1.0) ** 2,
        lambda x: x[0].sqrt(),
        lambda x: x[0].log(),
        lambda x: atan2(x[0], x[1]),
        lambda x: (1.0 + x[0]).acos(),
    ],
)
def test_infinite_derivatives_are_reported(write: Callable[[Attribute], Attribute]) -> None:
    with pytest.raises(NotFiniteError, match=r"m\.v\.e"):
        _one_point(write, [0.0, 0.0, 0.0]).gradient()


def test_nan_is_not_swallowed_by_minimum() -> None:
    """minimum(1, log(-1)) in machine code, whichever comes first."""
    points = Scene("s").add_mesh("m").add_primitive("v", 9)
    x = points.add_attribute("x", 1, 1, value=-np.ones(9))
    for attribute in (minimum(x.log(), 1.0), minimum(1.0, x.log()), maximum(x.log(), 1.0), maximum(1.0, x.log())):
        assert np.isnan(concat_rows([attribute, x]).compute().array[:, 0, 0]).all()


def test_a_condition_leaves_no_zeros_and_ones_in_the_code() -> None:
    scene = _one_point(lambda x: select((x[0] < x[1]) * (x[1] < x[2]), x[0].exp() * x[1], x[2].sin()), [0.0, 1.0, 2.0])
    text = "".join(code.text for code in scene.compile().program.codes.values())
    assert " < " in text
    assert " ? " in text
    assert "? splat(1.0)" not in text
    assert " | " not in text  # no condition compared with 0
