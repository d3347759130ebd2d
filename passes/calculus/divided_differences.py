"""Divided differences of a function of eigenvalues: what second derivatives need, right where eigenvalues are equal.

For E(A) = f(l) with the eigenvalues l of A, and c the derivative of f, the derivative of E is Q diag(c) Q^T. How that
turns with Q has a factor (c_j - c_i) / (l_j - l_i) for each pair (Daleckii and Krein 1965). For a function that is
symmetric in the two its limit for equal eigenvalues is a derivative of c; but the quotient is what rounding leaves of
it, long before they are equal. So both are computed: the quotient, and the mean of the derivative of c_j - c_i on the
way from where l_i and l_j are both their mean to where they are, by Gauss' rule,

    (c_j - c_i) / (l_j - l_i)  =  1/2 int_0^1 (d_j - d_i)(c_j - c_i) at l_i = m - t r, l_j = m + t r  dt

with m = (l_i + l_j) / 2, r = (l_j - l_i) / 2. The integrand is even in t, so two points have the accuracy of four. The
mean is taken where it explains c_j - c_i to rounding, and the quotient where it does not: eigenvalues are far apart, f
has a kink between them, or it is not symmetric. In the last case there is no limit, the quotient is infinite where they
are equal, and that is reported.

The curvature of an attribute h (`rel.curvature`) takes the slopes of what is behind a JOIN as an argument. How these
depend on the eigenvalues is not known there, and the quotient is all there is: 0 / 0 where eigenvalues are equal.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from xdsl.ir import Operation, SSAValue

from yasps.dialects.mat import MatBuilder, MatOp, shape_of
from yasps.dialects.mat.spectral import pairs

POINTS, WEIGHTS = (array[2:] for array in np.polynomial.legendre.leggauss(4))
"""Of Gauss' rule on (-1, 1), the positive half: the weights' sum is 1."""
ROUNDING = 64 * float(np.finfo(np.float64).eps)
"""By how much c_j - c_i may differ from what the mean says, beside what c and its derivatives are made of."""

ALIKE = 1e-6
"""By which share second derivatives may differ and still be equal. Loose: those of chance differ by much more."""

DerivativeAlong = Callable[[MatBuilder, SSAValue, SSAValue, SSAValue], SSAValue | None]
"""(builder, value, of, direction) -> derivative of the value along a direction of `of`, all else held; None for 0."""


def divided_differences(
    b: MatBuilder, values: SSAValue, slopes: SSAValue, derivative_along: DerivativeAlong
) -> SSAValue:
    """One column: (c_j - c_i) / (l_j - l_i) of each pair (i, j) of eigenvalues.

    values: the eigenvalues l, one column; slopes: c, computed from them and perhaps from others, which are held.
    """
    between = _computed_from(b, values, slopes)
    is_known = not _has_argument(slopes)

    def slope_along(nearer: SSAValue, direction: SSAValue) -> SSAValue | None:
        moved = {values: nearer}
        for op in between:
            moved[op.result] = b.copy(op, [moved.get(operand, operand) for operand in op.operands])
        return derivative_along(b, moved.get(slopes, slopes), nearer, direction)

    along = slope_along if is_known else None
    return b.concat_rows([_of_pair(b, values, slopes, pair, along) for pair in pairs(shape_of(values)[0])])


def _of_pair(
    b: MatBuilder,
    values: SSAValue,
    slopes: SSAValue,
    pair: tuple[int, int],
    slope_along: Callable[[SSAValue, SSAValue], SSAValue | None] | None,
) -> SSAValue:
    i, j = pair
    apart = np.zeros(shape_of(values))
    apart[i], apart[j] = -1.0, 1.0
    direction = b.constant(apart)
    distance, rise = b.dot(direction, values), b.dot(direction, slopes)
    quotient = b.divide(rise, distance)
    if slope_along is None:
        return quotient
    mean = b.number(0.0)
    for point, weight in zip(POINTS, WEIGHTS, strict=True):
        nearer = b.sub(values, b.scale(b.scale(b.number(float(0.5 * (1 - point))), distance), direction))
        slope = slope_along(nearer, direction)
        if slope is not None:
            mean = b.add(mean, b.scale(b.number(float(0.5 * weight)), b.dot(direction, slope)))
    sizes = b.add(_size(b, slopes, pair), b.scale(b.abs(mean), _size(b, values, pair)))
    unexplained = b.abs(b.sub(rise, b.scale(mean, distance)))
    is_explained = b.less_equal(unexplained, b.scale(b.number(ROUNDING), sizes))
    # Where they are equal c_i and c_j may be so by chance; of a symmetric function c_ii and c_jj are equal there, too.
    zeros = b.zeros(shape_of(values))
    by_i, by_j = (slope_along(values, b.unit(shape_of(values), k)) or zeros for k in pair)
    differ = b.abs(b.sub(b.row(by_i, i), b.row(by_j, j)))
    is_even = b.less_equal(differ, b.scale(b.number(ALIKE), b.add(_size(b, by_i, pair), _size(b, by_j, pair))))
    is_apart = b.less(b.number(0.0), b.abs(distance))
    return b.select(is_explained, b.select(is_apart, mean, b.select(is_even, mean, quotient)), quotient)


def _has_argument(value: SSAValue) -> bool:
    """Is the value computed from an argument of its block?"""
    seen, stack = {value}, [value]
    while stack:
        op = stack.pop().owner
        if not isinstance(op, Operation):
            return True
        new = [operand for operand in op.operands if operand not in seen]
        seen.update(new)
        stack += new
    return False


def _size(b: MatBuilder, column: SSAValue, pair: tuple[int, int]) -> SSAValue:
    """Sum of the magnitudes of two entries."""
    first, second = (b.abs(b.row(column, k)) for k in pair)
    return b.add(first, second)


def _computed_from(b: MatBuilder, values: SSAValue, slopes: SSAValue) -> list[MatOp]:
    """Operations between the eigenvalues and their slopes, operands first."""
    depends = {values}
    users = []
    for op in b.body.ops:
        if isinstance(op, MatOp) and any(operand in depends for operand in op.operands):
            depends.add(op.result)
            users.append(op)
    needed = {slopes}
    for op in reversed(users):
        if op.result in needed:
            needed.update(op.operands)
    return [op for op in users if op.result in needed]
