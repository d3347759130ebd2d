"""Derivatives of functions of a norm where it is 0 and near there, against power series in many digits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from mat_bodies import run_block
from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import Batch, MatBuilder, matrix_type
from yasps.dialects.mat.algebra import NormOp
from yasps.dialects.mat.comparison import AbsOp
from yasps.dialects.mat.trigonometry import LARGEST_ORDER, Atan2Op, stumpff
from yasps.passes.analysis.dependence import DependenceMap
from yasps.passes.calculus.derivatives import jacobian, pull_back

Written = Callable[[MatBuilder, SSAValue], SSAValue]
DIRECTION = np.array([0.6, -0.8, 0.3])
LENGTHS = (0.0, 1e-300, 1e-160, 1e-9, 1e-5, 1e-3, 0.1, 1.0)


def derivatives(write: Written, at: Batch) -> tuple[Batch, Batch, Batch]:
    """Values [n], gradients [n, size] and Hessians of a 1x1 function of a column at these points [n, size]."""
    size = at.shape[1]
    block = Block(arg_types=[matrix_type((size, 1))])
    b, x = MatBuilder(block), block.args[0]
    result = write(b, x)
    gradient = pull_back(b, DependenceMap(block, [x]), {result: b.number(1.0)}, [x])[x]
    hessian, forward = jacobian(b, [gradient], [x]), jacobian(b, [result], [x])
    with np.errstate(all="ignore"):
        values = run_block(block, [at[:, :, None]])
    found = values[gradient][:, :, 0]
    # Forward mode gives up what is far below rounding, where the norm underflows.
    np.testing.assert_allclose(values[forward][:, 0], found, rtol=1e-13, atol=1e-150)
    return values[result][:, 0, 0], found, values[hessian]


def derivatives_at(write: Written, at: Batch) -> tuple[float, Batch, Batch]:
    """The same at one point."""
    values, gradients, hessians = derivatives(write, at[None])
    return values.item(), gradients[0], hessians[0]


def norm(b: MatBuilder, x: SSAValue) -> SSAValue:
    return b.emit(NormOp, [x])


def power(b: MatBuilder, x: SSAValue, exponent: float) -> SSAValue:
    return b.power(norm(b, x), exponent)


def entry(b: MatBuilder, x: SSAValue, k: int) -> SSAValue:
    return b.block(x, k, 0, 1, 1)


SMOOTH: dict[str, tuple[Written, Callable[[Any], Any]]] = {
    "n^2": (lambda b, x: power(b, x, 2.0), lambda s: s),
    "n n": (lambda b, x: b.scale(norm(b, x), norm(b, x)), lambda s: s),
    "cos n": (lambda b, x: b.apply("cos", norm(b, x)), lambda s: mpmath.cos(mpmath.sqrt(s))),
    "n sin n": (
        lambda b, x: b.scale(norm(b, x), b.apply("sin", norm(b, x))),
        lambda s: mpmath.sqrt(s) * mpmath.sin(mpmath.sqrt(s)),
    ),
    "exp(-n^2)": (lambda b, x: b.apply("exp", b.neg(power(b, x, 2.0))), lambda s: mpmath.exp(-s)),
    "log(2 + n^2)": (
        lambda b, x: b.apply("log", b.plus(power(b, x, 2.0), 2.0)),
        lambda s: mpmath.log(2 + s),
    ),
    "sqrt(1 + n^2)": (lambda b, x: b.sqrt(b.add(b.number(1.0), power(b, x, 2.0))), lambda s: mpmath.sqrt(1 + s)),
    "an angle's square": (
        lambda b, x: b.power(b.emit(Atan2Op, [norm(b, x), b.number(0.75)]), 2.0),
        lambda s: mpmath.atan(mpmath.sqrt(s) / 0.75) ** 2,
    ),
    **{
        f"c_{k}": (lambda b, x, k=k: b.stumpff(k, b.dot(x, x)), lambda s, k=k: exact_stumpff(k, s))
        for k in range(LARGEST_ORDER - 3)
    },
}


def exact_stumpff(order: int, s: Any) -> Any:
    """Its power series, as far as 50 digits need it for s up to 100."""
    term = total = mpmath.mpf(1) / mpmath.factorial(order)
    for j in range(1, 60):
        term *= -s / ((2 * j + order) * (2 * j + order - 1))
        total += term
    return total


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_functions_of_norms(name: str) -> None:
    """Relative to the largest entry, also where squares underflow."""
    write, exact = SMOOTH[name]
    points = np.outer(LENGTHS, DIRECTION)
    for x, *found in zip(points, *derivatives(write, points), strict=True):
        with mpmath.workdps(50):
            exactly = [mpmath.mpf(float(entry)) for entry in x]
            series = [mpmath.re(c) for c in mpmath.taylor(exact, sum(e * e for e in exactly), 2)]
            slope, bend = 2 * series[1], 8 * series[2]
            gradient = np.array([float(slope * e) for e in exactly])
            hessian = np.array([[float(slope * (a is b) + bend * a * b) for a in exactly] for b in exactly])
        np.testing.assert_allclose(found[0], float(series[0]), rtol=1e-13, atol=1e-310)
        np.testing.assert_allclose(found[1], gradient, rtol=1e-12, atol=1e-12 * np.abs(gradient).max())
        np.testing.assert_allclose(found[2], hessian, rtol=0, atol=1e-12 * np.abs(hessian).max())


@pytest.mark.parametrize("order", range(LARGEST_ORDER + 1))
def test_stumpff_functions_are_exact_to_rounding(order: int) -> None:
    """On both sides of where series end, and far from there."""
    at = np.array([0.0, 1e-320, 1e-30, 1e-8, 0.3, 3.9, 4.0, np.nextafter(4.0, 5.0), 5.0, 40.0, 99.0])
    with mpmath.workdps(50):
        exact = np.array([float(exact_stumpff(order, mpmath.mpf(float(s)))) for s in at])
    np.testing.assert_allclose(stumpff(order, at), exact, rtol=5e-14, atol=1e-14)


ROOTS: dict[str, tuple[Written, float]] = {
    "n^3": (lambda b, x: power(b, x, 3.0), 0.0),
    "n^2.5": (lambda b, x: power(b, x, 2.5), 0.0),
    "s (1 - n)": (lambda b, x: b.scale(b.dot(x, x), b.sub(b.number(1.0), norm(b, x))), 2.0),
    "s n": (lambda b, x: b.scale(b.dot(x, x), norm(b, x)), 0.0),
    "a mollified norm": (lambda b, x: b.sub(power(b, x, 2.0), b.scale(b.number(1 / 3), power(b, x, 3.0))), 2.0),
    "1 - cos of 3 n": (lambda b, x: b.sub(b.number(1.0), b.apply("cos", b.scale(b.number(3.0), norm(b, x)))), 9.0),
    "times a number that is 0": (lambda b, x: b.scale(b.sub(entry(b, x, 0), entry(b, x, 0)), norm(b, x)), 0.0),
    "an absolute value": (lambda b, x: b.sum(b.power(b.emit(AbsOp, [x]), 2.0)), 2.0),
}
"""Functions with a gradient of 0 and this multiple of the identity as their Hessian at 0."""


@pytest.mark.parametrize("name", ROOTS)
def test_second_derivatives_at_zero(name: str) -> None:
    write, curvature = ROOTS[name]
    _, gradient, hessian = derivatives_at(write, np.zeros(3))
    np.testing.assert_array_equal(gradient, np.zeros(3))
    np.testing.assert_allclose(hessian, curvature * np.eye(3), rtol=1e-15)


KINKED: dict[str, Written] = {
    "n": norm,
    "(n - 1)^2": lambda b, x: b.power(b.sub(norm(b, x), b.number(1.0)), 2.0),
    "exp n": lambda b, x: b.apply("exp", norm(b, x)),
    "sqrt(n)^2": lambda b, x: b.power(b.sqrt(norm(b, x)), 2.0),
    "an angle": lambda b, x: b.emit(Atan2Op, [norm(b, x), b.number(1.0)]),
    "a folded rod": lambda b, x: b.power(b.emit(Atan2Op, [norm(b, x), b.number(-1.0)]), 2.0),
    "n (1 + x_0)": lambda b, x: b.scale(norm(b, x), b.add(b.number(1.0), entry(b, x, 0))),
}


def test_infinite_curvature_is_reported_with_the_gradient() -> None:
    """n^1.5 has the gradient 0; reverse mode, which needs its curvature, does not find it. Never 0 without a word."""
    block = Block(arg_types=[matrix_type((3, 1))])
    b, x = MatBuilder(block), block.args[0]
    result = power(b, x, 1.5)
    gradient = pull_back(b, DependenceMap(block, [x]), {result: b.number(1.0)}, [x])[x]
    with np.errstate(all="ignore"):
        assert np.isnan(run_block(block, [np.zeros((1, 3, 1))])[gradient]).all()


@pytest.mark.parametrize("name", KINKED)
def test_kinks_have_no_gradient(name: str) -> None:
    _, gradient, hessian = derivatives_at(KINKED[name], np.zeros(3))
    assert not np.isfinite(gradient).any()
    assert not np.isfinite(np.diag(hessian)).any()


BENT: dict[str, Written] = {
    "n x_0": lambda b, x: b.scale(norm(b, x), entry(b, x, 0)),
    "n |2 x|": lambda b, x: b.scale(norm(b, x), norm(b, b.scale(b.number(2.0), x))),
}
"""The gradient is 0 at 0; second derivatives depend on the direction, or can't be seen not to."""


@pytest.mark.parametrize("name", BENT)
def test_second_derivatives_without_a_limit_are_not_finite(name: str) -> None:
    _, gradient, hessian = derivatives_at(BENT[name], np.zeros(3))
    np.testing.assert_array_equal(gradient, np.zeros(3))
    assert not np.isfinite(hessian[np.triu_indices(3)]).any()


def test_the_slope_by_another_variable_must_vanish_too() -> None:
    """x_3 n(x_0 .. x_2): mixed second derivatives have no limit at n = 0, even where x_3 is 0."""
    write: Written = lambda b, x: b.scale(entry(b, x, 3), norm(b, b.block(x, 0, 0, 3, 1)))  # noqa: E731
    _, gradient, hessian = derivatives_at(write, np.zeros(4))
    np.testing.assert_array_equal(gradient, np.zeros(4))
    assert not np.isfinite(hessian[:3, :3]).any()  # of each entry the upper triangle is what is used


@pytest.mark.parametrize(
    "inside", [norm, lambda b, x: b.divide(b.apply("sin", norm(b, x)), norm(b, x))], ids=["n", "sin(n) / n"]
)
def test_a_choice_keeps_the_kink_out(inside: Written) -> None:
    """The side with the norm is not taken at 0; and taken elsewhere."""

    def write(b: MatBuilder, x: SSAValue) -> SSAValue:
        return b.select(b.less(b.number(1e-3), norm(b, x)), inside(b, x), b.scale(b.number(5.0), b.dot(x, x)))

    _, gradient, hessian = derivatives_at(write, np.zeros(3))
    np.testing.assert_array_equal(gradient, np.zeros(3))
    np.testing.assert_array_equal(hessian, 10.0 * np.eye(3))
    for ours, own in zip(derivatives_at(write, DIRECTION), derivatives_at(inside, DIRECTION), strict=True):
        np.testing.assert_allclose(ours, own, rtol=1e-14, atol=1e-14)
