"""Norms that may be 0 where derivatives are taken: which they are, and when what is made of them is smooth there.

The norm n of x has no derivative at x = 0, but what is computed from n has one there if its derivative with respect to
n is exactly 0. So the passes look at values as functions of their norms, too. Where n = 0, the gradient of f(n) is
f'(n) / n x, whose factor tends to f''(0) if f'(0) = 0, and a value's tangents through n are those with n held, if its
derivative with respect to n is 0. If it is not, they are made NaN or infinite, and reported.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence

from xdsl.ir import SSAValue

from yasps.dialects.mat import MatBuilder, MatOp, algebra, comparison, elementwise, structure
from yasps.dialects.mat.base import is_zero

PRODUCTS = (
    elementwise.ScaleOp,
    elementwise.HadamardOp,
    algebra.MatmulOp,
    algebra.DotOp,
    algebra.CrossOp,
)
"""Linear in each of two operands: 0 where one is."""
LINEAR = (
    elementwise.NegOp,
    algebra.TransposeOp,
    algebra.TraceOp,
    algebra.SumOp,
    structure.ReshapeOp,
    structure.BlockOp,
    structure.EmbedOp,
)
"""Linear in their operand."""
SUMS = (elementwise.AddOp, elementwise.SubOp, structure.ConcatRowsOp, structure.ConcatColsOp)
"""Linear in all operands together."""
_CHOICES = (comparison.CompareOp, comparison.SelectOp, comparison.MinOp, comparison.MaxOp)


def smooth_norms(outputs: Sequence[SSAValue], seeded: Collection[SSAValue]) -> list[algebra.NormOp]:
    """Norms that the outputs are computed from, that depend on the seeded values and that may be 0, operands first.

    Those that the outputs are divided by are not among them: where they are 0 the outputs are not finite anyway.
    """
    depends: dict[SSAValue, bool] = dict.fromkeys(seeded, True)
    norms: list[algebra.NormOp] = []
    for op in _operands_first(outputs, lambda op: op.result in seeded or op.HELD_CONSTANT):
        depends[op.result] = any(depends.get(operand, False) for operand in op.operands)
        if isinstance(op, algebra.NormOp) and depends[op.result]:
            norms.append(op)
    divided = divisors(outputs)
    return [norm for norm in norms if norm.result not in divided]


def divisors(outputs: Sequence[SSAValue]) -> set[SSAValue]:
    """Values that the outputs are divided by, whatever is chosen."""
    found: set[SSAValue] = set()
    for op in _operands_first(outputs, lambda op: isinstance(op, _CHOICES)):
        if isinstance(op, elementwise.DivideOp):
            found.add(op.operands[1])
        elif isinstance(op, elementwise.PowOp) and op.power < 0:
            found.add(op.operands[0])
    return found


def inverse_for_tangents(b: MatBuilder, norm: SSAValue, slopes: Sequence[SSAValue | None]) -> SSAValue:
    """1 / n; where n is 0, it is 0 if all the slopes are, else infinite.

    slopes: derivatives with respect to n of all whose tangents are wanted. The tangent of n, x . dx times this inverse,
    is then 0 where it does not matter and NaN where there is none.
    """
    zero, one = b.number(0.0), b.number(1.0)
    size = b.total([b.dot(slope, slope) for slope in slopes if slope is not None and not _vanishes(slope, norm)])
    if size is None:
        return b.select(b.less_equal(norm, zero), zero, b.divide(one, norm))
    return b.over_norm(b.select(b.less_equal(size, zero), zero, one), norm)


def _vanishes(value: SSAValue, norm: SSAValue) -> bool:
    """Can the value be seen to be 0 where the norm is?"""
    known: dict[SSAValue, bool] = {}
    for op in _operands_first([value], lambda op: False):
        zeros = [known.get(operand, False) for operand in op.operands]
        if isinstance(op, comparison.SelectOp):
            condition = op.operands[0].owner
            known[op.result] = (
                isinstance(condition, comparison.CompareOp)
                and condition.operands[0] is norm
                and is_zero(condition.operands[1])
                and zeros[1]
            )
        elif isinstance(op, PRODUCTS):
            known[op.result] = any(zeros)
        elif isinstance(op, elementwise.DivideOp):
            known[op.result] = zeros[0]
        else:
            known[op.result] = is_zero(op.result) or (isinstance(op, SUMS + LINEAR) and all(zeros))
    return known.get(value, False)


def _operands_first(outputs: Sequence[SSAValue], stops_at: Callable[[MatOp], bool]) -> Iterator[MatOp]:
    """Operations that the outputs are computed by, each once and after those of its operands.

    Those at which it stops are left out, with what they alone are computed from.
    """
    done: set[SSAValue] = set()
    stack = list(outputs)
    while stack:
        value = stack[-1]
        op = value.owner
        if value in done or not isinstance(op, MatOp) or stops_at(op):
            done.add(value)
            stack.pop()
            continue
        missing = [operand for operand in op.operands if operand not in done]
        if missing:
            stack.extend(missing)
            continue
        done.add(value)
        stack.pop()
        yield op
