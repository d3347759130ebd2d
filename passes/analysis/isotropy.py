"""Proof that a number depends on a matrix F only through what rotations leave alone: on its singular values; or on two
vectors of space only through their lengths and the angle between them.

Under F -> R F Q with rotations R and Q, every matrix made of F is multiplied by rotations from both sides, or is not
known to be. So each of the two indices of a matrix lives in a space: the deformed one, which R turns, the undeformed
one, which Q turns, or one that nothing turns. F maps the undeformed space to the deformed one; F^T F maps the
undeformed one to itself. A product sums over one space; numbers made of indices that all meet their like do not change.
Vectors of space live in the deformed space with their one long index, and R turns them all. What operations do to
spaces is an abstract interpretation, one rule for each operation that has one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from typing import NamedTuple, cast

import numpy as np
from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import MatOp, algebra, elementwise, shape_of, spectral
from yasps.dialects.mat.base import constant_value
from yasps.dialects.mat.comparison import SelectOp
from yasps.dialects.mat.structure import ReshapeOp
from yasps.passes.analysis.dependence import size_of

ISOTROPIC_SHAPES = ((3, 3), (3, 2))
"""Of an F for which there is a projection by singular values."""


class Space(Enum):
    """Where an index of a matrix lives."""

    FIXED = 0
    DEFORMED = 1
    UNDEFORMED = 2


class Spaces(NamedTuple):
    """Of a matrix's rows and columns."""

    rows: Space
    cols: Space


FIXED = Spaces(Space.FIXED, Space.FIXED)
DEFORMATION = Spaces(Space.DEFORMED, Space.UNDEFORMED)
VECTORS = {(3, 1): Spaces(Space.DEFORMED, Space.FIXED), (1, 3): Spaces(Space.FIXED, Space.DEFORMED)}
START = VECTORS | dict.fromkeys(ISOTROPIC_SHAPES, DEFORMATION)
"""Of what an energy sees, by its shape."""


class AnySpace:
    """Of a multiple of the identity: it maps each space to itself, whichever is meant."""


IDENTITY = AnySpace()
Known = Spaces | AnySpace
"""None stands for a matrix that rotations change in an unknown way."""


def depends_on_invariants(block: Block, energy: SSAValue, cut: Sequence[SSAValue], active: Sequence[SSAValue]) -> bool:
    """Do rotations leave the 1x1 value `energy` alone, which sees the `active` values through those of `cut`?

    cut: a matrix, 3x3, 3x2, or a vector that the block reshapes to one of these, row by row, turned from both sides; or
    vectors of space, 3x1 or 1x3, that are all turned alike. True is proven; False may mean that no rule knows an
    operation. What is held constant for differentiation counts as constant, and each side of a choice on its own: the
    proof is about first and second derivatives.
    """
    return _known_spaces(block, energy, cut, active).get(energy) == FIXED


def obstacle(block: Block, energy: SSAValue, cut: Sequence[SSAValue], active: Sequence[SSAValue]) -> MatOp | None:
    """The operation that stops the proof of `depends_on_invariants` in the values of `cut`: the first whose operands
    are known, but not what rotations do to its result. None where there is no such operation, as where the proof
    succeeds."""
    known = _known_spaces(block, energy, cut, active)
    for op in block.ops:
        stops = isinstance(op, MatOp) and op.operands and op.result in known and known[op.result] is None
        if stops and all(known[operand] is not None for operand in op.operands):
            return cast(MatOp, op)
    return None


def _known_spaces(
    block: Block, energy: SSAValue, cut: Sequence[SSAValue], active: Sequence[SSAValue]
) -> dict[SSAValue, Known | None]:
    known: dict[SSAValue, Known | None] = dict.fromkeys(active)
    known |= {value: START[shape_of(value)] for value in cut if shape_of(value) in START}
    for op in block.ops:
        if not isinstance(op, MatOp):
            for result in op.results:
                known.setdefault(result, FIXED)
        elif op.result not in known:
            known[op.result] = _spaces_of(op, [known[operand] for operand in op.operands], cut)
        if energy in known:
            break  # what follows are its derivatives
    return known


def is_deformation(block: Block, value: SSAValue) -> bool:
    """Can `depends_on_invariants` be asked about this value: has it the shape, or is it reshaped to one that has?"""
    sizes = {rows * cols for rows, cols in ISOTROPIC_SHAPES}
    if shape_of(value) in ISOTROPIC_SHAPES:
        return True
    return size_of(value) in sizes and any(_is_reshaped(op, value) for op in block.ops)


def _is_reshaped(op: object, deformation: SSAValue) -> bool:
    return isinstance(op, ReshapeOp) and op.operands[0] is deformation and shape_of(op.result) in ISOTROPIC_SHAPES


def are_two_vectors(values: Sequence[SSAValue]) -> bool:
    """Are these values two vectors of space?"""
    return len(values) == 2 and all(shape_of(value) in VECTORS for value in values)


def _spaces_of(op: MatOp, operands: list[Known | None], cut: Sequence[SSAValue]) -> Known | None:
    if op.HELD_CONSTANT:
        return FIXED
    if any(_is_reshaped(op, value) for value in cut):
        return DEFORMATION
    if not operands:
        entries = constant_value(op.result)
        return IDENTITY if entries is not None and _is_multiple_of_identity(entries) else FIXED
    if isinstance(op, SelectOp) and shape_of(op.operands[0]) == (1, 1):
        return _both(operands[1], operands[2])  # each side is differentiated as if it were always chosen
    if any(operand is None for operand in operands):
        return None
    rule = RULES.get(type(op))
    spaces = [operand for operand in operands if operand is not None]
    found = rule(*spaces) if rule is not None else None
    if found is None and all(operand in (FIXED, IDENTITY) for operand in spaces):
        return FIXED
    return found


def _is_multiple_of_identity(entries: np.ndarray) -> bool:
    rows, cols = entries.shape
    return rows == cols and rows > 1 and bool(np.all(entries == entries[0, 0] * np.eye(rows)))


def _both(a: Known | None, b: Known | None) -> Known | None:
    """Spaces of two matrices that must live in the same ones."""
    if isinstance(a, AnySpace):
        a, b = b, a
    if isinstance(a, Spaces) and isinstance(b, AnySpace):
        return a if a.rows is a.cols else None
    return a if a == b else None


def _times(a: Known, b: Known) -> Known | None:
    if isinstance(a, AnySpace):
        return b
    if isinstance(b, AnySpace):
        return a
    return Spaces(a.rows, b.cols) if a.cols is b.rows else None


def _scaled(factor: Known, matrix: Known) -> Known | None:
    return matrix if factor == FIXED else None


def _turned(a: Known) -> Known:
    return a if isinstance(a, AnySpace) else Spaces(a.cols, a.rows)


def _trace(a: Known) -> Known | None:
    return FIXED if isinstance(a, AnySpace) or a.rows is a.cols else None


RULES: dict[type[MatOp], Callable[..., Known | None]] = {
    elementwise.AddOp: _both,
    elementwise.SubOp: _both,
    elementwise.NegOp: lambda a: a,
    elementwise.ScaleOp: _scaled,
    elementwise.DivideOp: lambda matrix, divisor: _scaled(divisor, matrix),
    algebra.MatmulOp: _times,
    algebra.TransposeOp: _turned,
    algebra.InverseOp: _turned,
    algebra.CofactorOp: lambda a: a,  # R and Q are their own cofactors
    algebra.DetOp: lambda a: FIXED,
    algebra.NormOp: lambda a: FIXED,
    algebra.TraceOp: _trace,
    spectral.EigenvaluesOp: _trace,
    spectral.PolarOp: lambda a: None if isinstance(a, AnySpace) else a,  # of R F Q it is R times that of F times Q
    algebra.DotOp: lambda a, b: FIXED if _both(a, b) is not None else None,
}
"""Spaces of an operation's result, from those of its operands."""
