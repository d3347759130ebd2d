"""Builds `mat` operations into a block, each value once (value numbering), folded as they are made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from xdsl.dialects.builtin import Float64Type, FloatAttr, IntegerAttr, IntegerType, StringAttr, f64, i64
from xdsl.ir import Attribute, Block, Operation, SSAValue

from yasps.dialects.mat import algebra, calculus, comparison, elementwise, spectral, structure, trigonometry
from yasps.dialects.mat.base import MatOp, Matrix, Shape, dense, matrix_type, shape_of


def named(value: SSAValue, name: str | None) -> SSAValue:
    """The value, called by this name in dumps unless it has one."""
    if name is not None and value.name_hint is None:
        value.name_hint = name
    return value


class MatBuilder:
    """Appends operations to `body`. Equal operations on equal operands give the same value."""

    def __init__(self, body: Block) -> None:
        self.body = body
        self._known: dict[tuple[object, ...], SSAValue] = {}
        self._ages: dict[SSAValue, int] = {}

    def append(self, op: Operation) -> None:
        self.body.add_op(op)
        for result in op.results:
            self._ages[result] = 1 + len(self._ages)

    def age(self, value: SSAValue) -> int:
        """A number that is smaller than those of all values made later; 0 for what this builder has not made."""
        return self._ages.get(value, 0)

    def emit(
        self,
        op_class: type[MatOp],
        operands: Sequence[SSAValue],
        properties: dict[str, Attribute] | None = None,
        element: Float64Type | IntegerType | None = None,
        name_hint: str | None = None,
    ) -> SSAValue:
        """The value of this operation, made now unless it is there already or folds to something simpler."""
        properties = properties or {}
        if element is None:
            element = cast(Matrix, operands[0].type).element_type if operands else f64
        key = (op_class, *[id(v) for v in operands], *sorted(properties.items(), key=lambda item: item[0]))
        found = self._known.get(key)
        if found is not None:
            return named(found, name_hint)
        shape = op_class.infer([shape_of(v) for v in operands], properties)
        # Not by the constructor, which looks at each operand anew: that takes most of the time.
        op = op_class.create(operands=operands, result_types=[matrix_type(shape, element)], properties=properties)
        result: SSAValue
        folded = op.fold()
        if folded is None:
            self.append(op)
            result = op.result
        else:
            op.erase()
            if isinstance(folded[0], SSAValue):
                result = folded[0]
            else:
                result = self.emit(structure.ConstantOp, [], {"value": folded[0]}, element)
        self._known[key] = result
        return named(result, name_hint)

    def copy(self, op: MatOp, operands: Sequence[SSAValue]) -> SSAValue:
        """The same operation on other operands."""
        element = cast(Matrix, op.result.type).element_type
        return self.emit(type(op), operands, dict(op.properties), element, op.result.name_hint)

    # -- leaves --------------------------------------------------------------------------------------------

    def constant(self, values: ArrayLike, element: Float64Type | IntegerType = f64) -> SSAValue:
        entries = np.atleast_2d(np.asarray(values, float))
        rows, cols = entries.shape
        key = (structure.ConstantOp, rows, cols, entries.tobytes(), element)
        if key not in self._known:
            value = dense(entries, matrix_type((rows, cols), element))
            self._known[key] = self.emit(structure.ConstantOp, [], {"value": value}, element)
        return self._known[key]

    def number(self, value: float) -> SSAValue:
        return self.constant([[value]])

    def zeros(self, shape: Shape, element: Float64Type | IntegerType = f64) -> SSAValue:
        return self.constant(np.zeros(shape), element)

    def identity(self, size: int) -> SSAValue:
        return self.emit(structure.IdentityOp, [], {"size": structure.integers((size,))}, f64)

    def unit(self, shape: Shape, position: int) -> SSAValue:
        """Zeros with a one at this row-major position."""
        entries = np.zeros(shape)
        entries.flat[position] = 1.0
        return self.constant(entries)

    # -- arithmetic ----------------------------------------------------------------------------------------

    def add(self, a: SSAValue, b: SSAValue) -> SSAValue:
        return self.emit(elementwise.AddOp, [a, b])

    def plus(self, a: SSAValue, number: float) -> SSAValue:
        """The number added to every entry."""
        return self.add(a, self.constant(np.full(shape_of(a), number)))

    def sub(self, a: SSAValue, b: SSAValue) -> SSAValue:
        return self.emit(elementwise.SubOp, [a, b])

    def neg(self, a: SSAValue) -> SSAValue:
        return self.emit(elementwise.NegOp, [a])

    def hadamard(self, a: SSAValue, b: SSAValue) -> SSAValue:
        if shape_of(a) == (1, 1):
            return self.scale(a, b)
        return self.emit(elementwise.HadamardOp, [a, b])

    def scale(self, factor: SSAValue, matrix: SSAValue) -> SSAValue:
        swapped = self._known.get((elementwise.ScaleOp, id(matrix), id(factor)))
        if swapped is not None and shape_of(matrix) == (1, 1):
            return swapped  # a product of numbers, made before in the other order
        return self.emit(elementwise.ScaleOp, [factor, matrix])

    def divide(self, matrix: SSAValue, divisor: SSAValue) -> SSAValue:
        return self.emit(elementwise.DivideOp, [matrix, divisor])

    def power(self, a: SSAValue, exponent: float) -> SSAValue:
        if exponent == 0.0:
            return self.constant(np.ones(shape_of(a)))
        return self.emit(elementwise.PowOp, [a], {"exponent": FloatAttr(exponent, f64)})

    def sqrt(self, a: SSAValue) -> SSAValue:
        return self.apply("sqrt", a)

    def apply(self, name: str, a: SSAValue) -> SSAValue:
        """A function of the table in `dialects/scalar/functions.py`, entry by entry."""
        return self.emit(elementwise.TABLED[name], [a])

    def abs(self, a: SSAValue) -> SSAValue:
        return self.emit(comparison.AbsOp, [a])

    def stumpff(self, order: int, s: SSAValue) -> SSAValue:
        return self.emit(trigonometry.StumpffOp, [s], {"order": IntegerAttr(order, i64)})

    def total(self, terms: Sequence[SSAValue | None]) -> SSAValue | None:
        """Sum of the terms that are there; None if none is."""
        result: SSAValue | None = None
        for term in terms:
            if term is not None:
                result = term if result is None else self.add(result, term)
        return result

    def difference(self, a: SSAValue | None, b: SSAValue | None) -> SSAValue | None:
        """a - b where None stands for zero."""
        if b is None:
            return a
        return self.neg(b) if a is None else self.sub(a, b)

    # -- choices -------------------------------------------------------------------------------------------

    def less(self, a: SSAValue, b: SSAValue) -> SSAValue:
        return self.emit(comparison.CompareOp, [a, b], {"predicate": StringAttr("lt")})

    def less_equal(self, a: SSAValue, b: SSAValue) -> SSAValue:
        return self.emit(comparison.CompareOp, [a, b], {"predicate": StringAttr("le")})

    def select(self, condition: SSAValue, a: SSAValue, b: SSAValue) -> SSAValue:
        return self.emit(comparison.SelectOp, [condition, a, b])

    def select_tangent(self, condition: SSAValue, a: SSAValue | None, b: SSAValue | None) -> SSAValue | None:
        """A choice between tangents, where None stands for zero."""
        if a is None and b is None:
            return None
        zero = self.zeros(shape_of(cast(SSAValue, a or b)))
        return self.select(condition, zero if a is None else a, zero if b is None else b)

    # -- linear algebra ------------------------------------------------------------------------------------

    def matmul(self, a: SSAValue, b: SSAValue) -> SSAValue:
        return self.emit(algebra.MatmulOp, [a, b])

    def transpose(self, a: SSAValue) -> SSAValue:
        return self.emit(algebra.TransposeOp, [a])

    def dot(self, a: SSAValue, b: SSAValue) -> SSAValue:
        if shape_of(a) == (1, 1):
            return self.scale(a, b)
        return self.emit(algebra.DotOp, [a, b])

    def cross(self, a: SSAValue, b: SSAValue) -> SSAValue:
        return self.emit(algebra.CrossOp, [a, b])

    def trace(self, a: SSAValue) -> SSAValue:
        return self.emit(algebra.TraceOp, [a])

    def sum(self, a: SSAValue) -> SSAValue:
        return self.emit(algebra.SumOp, [a])

    def det(self, a: SSAValue) -> SSAValue:
        return self.emit(algebra.DetOp, [a])

    def cofactor(self, a: SSAValue) -> SSAValue:
        return self.emit(algebra.CofactorOp, [a])

    def inverse(self, a: SSAValue) -> SSAValue:
        return self.emit(algebra.InverseOp, [a])

    def spectral(self, a: SSAValue, slopes: SSAValue, differences: SSAValue | None = None) -> SSAValue:
        """Q diag(slopes) Q^T; without divided differences they are quotients. See SpectralOp."""
        if differences is None:
            values = self.emit(spectral.EigenvaluesOp, [a])
            differences = self.concat_rows(
                [
                    self.divide(self._rise(slopes, i, j), self._rise(values, i, j))
                    for i, j in spectral.pairs(shape_of(a)[0])
                ]
            )
        return self.emit(spectral.SpectralOp, [a, slopes, differences])

    def _rise(self, column: SSAValue, i: int, j: int) -> SSAValue:
        """Entry j less entry i."""
        return self.sub(self.row(column, j), self.row(column, i))

    def spectral_tangent(self, a: SSAValue, differences: SSAValue, tangent: SSAValue) -> SSAValue:
        return self.emit(spectral.SpectralTangentOp, [a, differences, tangent])

    def over_norm(self, slope: SSAValue, norm: SSAValue, limit: SSAValue | None = None) -> SSAValue:
        """slope / norm; where both are 0 it is `limit`, and 0 without one. See OverNormOp."""
        limit = self.zeros(shape_of(slope)) if limit is None else limit
        return self.emit(calculus.OverNormOp, [slope, norm, limit])

    def congruence(self, symmetric: SSAValue, linear: SSAValue) -> SSAValue:
        return self.emit(calculus.CongruenceOp, [symmetric, linear])

    def project_psd(self, symmetric: SSAValue, mode: str) -> SSAValue:
        return self.emit(calculus.ProjectPsdOp, [symmetric], {"mode": StringAttr(mode)})

    # -- structure -----------------------------------------------------------------------------------------

    def reshape(self, a: SSAValue, shape: Shape) -> SSAValue:
        return self.emit(structure.ReshapeOp, [a], {"shape": structure.integers(shape)})

    def flat(self, a: SSAValue) -> SSAValue:
        """All entries, row-major, as one column."""
        rows, cols = shape_of(a)
        return self.reshape(a, (rows * cols, 1))

    def block(self, a: SSAValue, row: int, col: int, rows: int, cols: int) -> SSAValue:
        return self.emit(structure.BlockOp, [a], {"block": structure.integers((row, col, rows, cols))})

    def row(self, a: SSAValue, index: int) -> SSAValue:
        return self.block(a, index, 0, 1, shape_of(a)[1])

    def embed(self, a: SSAValue, row: int, col: int, shape: Shape) -> SSAValue:
        return self.emit(structure.EmbedOp, [a], {"place": structure.integers((row, col, *shape))})

    def concat_rows(self, parts: Sequence[SSAValue]) -> SSAValue:
        return self.emit(structure.ConcatRowsOp, parts)

    def concat_cols(self, parts: Sequence[SSAValue]) -> SSAValue:
        return self.emit(structure.ConcatColsOp, parts)
