"""`mat` operations of linear algebra."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import irdl_op_definition

from yasps.dialects.mat.base import (
    Batch,
    MatOp,
    Shape,
    ShapeError,
    is_identity,
    is_one,
    same_shapes,
    shape_of,
    spell,
    square,
    vectors,
)
from yasps.dialects.scalar.graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder

LARGEST_DETERMINANT = 4
"""Determinants, cofactors and inverses are straight-line code by minors; beyond 4x4 that code explodes."""


@irdl_op_definition
class MatmulOp(MatOp):
    """a b, the matrix product."""

    name = "mat.matmul"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        (rows, inner), (inner_b, cols) = shapes
        if inner != inner_b:
            raise ShapeError(
                f"a product of {spell(shapes[0])} and {spell(shapes[1])} does not exist: {inner} != {inner_b}"
            )
        return rows, cols

    def simplify(self) -> SSAValue | None:
        a, b = self.operands
        return b if is_identity(a) else a if is_identity(b) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0] @ inputs[1]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return sum(active) <= 1

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        x, y = self.operands
        dx, dy = tangents
        return b.total((dx and b.matmul(dx, y), dy and b.matmul(x, dy)))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        x, y = self.operands
        return (b.matmul(cotangent, b.transpose(y)), b.matmul(b.transpose(x), cotangent))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        (rows, inner), (_, cols) = shape_of(self.operands[0]), shape_of(self.operands[1])
        a, b = inputs
        made = s.products([a[i * inner : (i + 1) * inner] for i in range(rows)], [b[j::cols] for j in range(cols)])
        return [entry for row in made for entry in row]


@irdl_op_definition
class TransposeOp(MatOp):
    """Transpose."""

    name = "mat.transpose"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return shapes[0][1], shapes[0][0]

    def simplify(self) -> SSAValue | None:
        operand = self.operands[0]
        if shape_of(operand) == (1, 1):
            return operand
        return operand.owner.operands[0] if isinstance(operand.owner, TransposeOp) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0].swapaxes(1, 2)

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.transpose(tangents[0])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.transpose(cotangent),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        rows, cols = shape_of(self.operands[0])
        return [inputs[0][i * cols + j] for j in range(cols) for i in range(rows)]


@irdl_op_definition
class DotOp(MatOp):
    """Sum of the entry-wise product: the dot product of vectors, the Frobenius product of matrices."""

    name = "mat.dot"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        same_shapes("a dot product", shapes)
        return 1, 1

    def simplify(self) -> SSAValue | None:
        a, b = self.operands
        if shape_of(a) != (1, 1):
            return None
        return b if is_one(a) else a if is_one(b) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return cast(Batch, (inputs[0] * inputs[1]).sum(axis=(1, 2), keepdims=True))

    def is_linear(self, active: Sequence[bool]) -> bool:
        return sum(active) <= 1

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        x, y = self.operands
        dx, dy = tangents
        if x is y:
            return dx and b.scale(b.number(2.0), b.dot(x, dx))
        return b.total((dx and b.dot(dx, y), dy and b.dot(x, dy)))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        x, y = self.operands
        if x is y:
            return (b.scale(b.scale(b.number(2.0), cotangent), x), None)
        return (b.scale(cotangent, y), b.scale(cotangent, x))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.dot(*inputs)]


@irdl_op_definition
class CrossOp(MatOp):
    """Cross product of two 3-vectors, both rows or both columns."""

    name = "mat.cross"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return vectors("a cross product", shapes, 3)

    def evaluate(self, *inputs: Batch) -> Batch:
        x, y = (v.reshape(len(v), 3) for v in inputs)
        entries = [x[:, i] * y[:, j] - x[:, j] * y[:, i] for i, j in ((1, 2), (2, 0), (0, 1))]
        return np.stack(entries, axis=1).reshape(-1, *inputs[0].shape[1:])

    def is_linear(self, active: Sequence[bool]) -> bool:
        return sum(active) <= 1

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        x, y = self.operands
        dx, dy = tangents
        return b.total((dx and b.cross(dx, y), dy and b.cross(x, dy)))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        x, y = self.operands
        return (b.cross(y, cotangent), b.cross(cotangent, x))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        x, y = inputs
        return [s.sub(s.mul(x[i], y[j]), s.mul(x[j], y[i])) for i, j in ((1, 2), (2, 0), (0, 1))]


@irdl_op_definition
class TraceOp(MatOp):
    """Sum of the diagonal."""

    name = "mat.trace"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        square("a trace", shapes[0])
        return 1, 1

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if shape_of(self.operands[0]) == (1, 1) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return cast(Batch, np.trace(inputs[0], axis1=1, axis2=2))[:, None, None]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.trace(tangents[0])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.scale(cotangent, b.identity(shape_of(self.operands[0])[0])),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        size = shape_of(self.operands[0])[0]
        return [s.sum(inputs[0][:: size + 1])]


@irdl_op_definition
class SumOp(MatOp):
    """Sum of all entries."""

    name = "mat.sum"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return 1, 1

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if shape_of(self.operands[0]) == (1, 1) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return cast(Batch, inputs[0].sum(axis=(1, 2), keepdims=True))

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.sum(tangents[0])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.scale(cotangent, b.constant(np.ones(shape_of(self.operands[0])))),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.sum(inputs[0])]


@irdl_op_definition
class NormOp(MatOp):
    """Euclidean (Frobenius) norm, sqrt(sum of squares); it has no derivative at 0.

    A smooth function of it may have one, such as its square: `passes/calculus/derivatives.py` looks at what becomes of
    the norm and takes the limit there (`mat.over_norm`). The rules here are those of the norm itself, NaN at 0.
    """

    name = "mat.norm"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return 1, 1

    def evaluate(self, *inputs: Batch) -> Batch:
        # Not np.linalg.norm: it conjugates, and complex step needs an analytic function.
        return cast(Batch, np.sqrt((inputs[0] * inputs[0]).sum(axis=(1, 2), keepdims=True)))

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.divide(b.dot(self.operands[0], tangents[0]), self.result)

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.scale(b.divide(cotangent, self.result), self.operands[0]),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.unary("sqrt", s.dot(inputs[0], inputs[0]))]


def _small_square(word: str, shape: Shape) -> Shape:
    square(word, shape)
    if shape[0] > LARGEST_DETERMINANT:
        raise ShapeError(f"{word} is available up to {spell((LARGEST_DETERMINANT,) * 2)}, got {spell(shape)}")
    return shape


def _without(b: MatBuilder, a: SSAValue, row: int, col: int) -> SSAValue:
    """The square matrix without this row and this column."""
    last = shape_of(a)[0] - 1
    upper = [b.block(a, 0, 0, row, last + 1)] if row else []
    lower = [b.block(a, row + 1, 0, last - row, last + 1)] if row < last else []
    a = b.concat_rows([*upper, *lower])
    left = [b.block(a, 0, 0, last, col)] if col else []
    right = [b.block(a, 0, col + 1, last, last - col)] if col < last else []
    return b.concat_cols([*left, *right])


def _minor(s: ScalarGraph, entries: Sequence[Node], size: int, rows: tuple[int, ...], cols: tuple[int, ...]) -> Node:
    """Determinant of the sub-matrix of these rows and columns, by expansion along its first row."""

    @cache
    def expand(first: int, columns: tuple[int, ...]) -> Node:
        if not columns:
            return s.one
        total = s.zero
        for position, column in enumerate(columns):
            rest = columns[:position] + columns[position + 1 :]
            term = s.mul(entries[rows[first] * size + column], expand(first + 1, rest))
            total = s.sub(total, term) if position % 2 else s.add(total, term)
        return total

    return expand(0, cols)


def _cofactors(s: ScalarGraph, entries: Sequence[Node], size: int) -> list[Node]:
    everything = tuple(range(size))
    cofactors = []
    for i in everything:
        for j in everything:
            rows, cols = (tuple(k for k in everything if k != removed) for removed in (i, j))
            minor = _minor(s, entries, size, rows, cols)
            cofactors.append(s.neg(minor) if (i + j) % 2 else minor)
    return cofactors


def _cofactors_numpy(a: Batch) -> Batch:
    """Cofactor matrices [n, k, k] by minors (also of singular, complex or exact matrices)."""
    size = a.shape[1]
    result = np.empty_like(a)
    for i in range(size):
        for j in range(size):
            minor = np.delete(np.delete(a, i, axis=1), j, axis=2)
            result[:, i, j] = _determinant_numpy(minor) * (-1 if (i + j) % 2 else 1)
    return result


def _determinant_numpy(a: Batch) -> Batch:
    """Determinants [n] by expansion along the first row."""
    size = a.shape[1]
    if size == 0:
        return np.ones_like(a, shape=len(a))
    total = np.zeros_like(a, shape=len(a))
    for j in range(size):
        total = total + a[:, 0, j] * _determinant_numpy(np.delete(a[:, 1:], j, axis=2)) * (-1 if j % 2 else 1)
    return total


@irdl_op_definition
class DetOp(MatOp):
    """Determinant; its gradient is the cofactor matrix, also where the matrix is singular."""

    name = "mat.det"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        _small_square("a determinant", shapes[0])
        return 1, 1

    def evaluate(self, *inputs: Batch) -> Batch:
        return _determinant_numpy(inputs[0])[:, None, None]

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.dot(b.cofactor(self.operands[0]), tangents[0])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.scale(cotangent, b.cofactor(self.operands[0])),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        # Along the first row of cofactors, so that the determinant shares them with its gradient.
        size = shape_of(self.operands[0])[0]
        return [s.dot(inputs[0][:size], _cofactors(s, inputs[0], size)[:size])]


@irdl_op_definition
class CofactorOp(MatOp):
    """Matrix of cofactors, the gradient of the determinant: det(a) a^-T where a is regular."""

    name = "mat.cofactor"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return _small_square("a cofactor matrix", shapes[0])

    def evaluate(self, *inputs: Batch) -> Batch:
        return _cofactors_numpy(inputs[0])

    def is_linear(self, active: Sequence[bool]) -> bool:
        return shape_of(self.operands[0])[0] <= 2

    def _directional(self, b: MatBuilder, direction: SSAValue) -> SSAValue | None:
        matrix = self.operands[0]
        size = shape_of(matrix)[0]
        if size == 1:
            return None
        if size == 2:  # cof(a) = tr(a) I - a^T
            return b.sub(b.scale(b.trace(direction), b.identity(2)), b.transpose(direction))
        if size == 3:  # row i of cof(a) is a_{i+1} x a_{i+2}
            rows = []
            for i in range(3):
                after, last = (i + 1) % 3, (i + 2) % 3
                rows.append(
                    b.add(
                        b.cross(b.row(direction, after), b.row(matrix, last)),
                        b.cross(b.row(matrix, after), b.row(direction, last)),
                    )
                )
            return b.concat_rows(rows)
        # Entry (i, j) is, but for its sign, the determinant of the matrix without row i and column j.
        rows = []
        for i in range(size):
            entries = []
            for j in range(size):
                change = b.dot(b.cofactor(_without(b, matrix, i, j)), _without(b, direction, i, j))
                entries.append(change if (i + j) % 2 == 0 else b.neg(change))
            rows.append(b.concat_cols(entries))
        return b.concat_rows(rows)

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and self._directional(b, tangents[0])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        # Cofactors are a gradient (of det), so their Jacobian is symmetric.
        return (self._directional(b, cotangent),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return _cofactors(s, inputs[0], shape_of(self.operands[0])[0])


@irdl_op_definition
class InverseOp(MatOp):
    """Inverse of a regular matrix."""

    name = "mat.inverse"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return _small_square("an inverse", shapes[0])

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if is_identity(self.operands[0]) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        determinant = _determinant_numpy(inputs[0])[:, None, None]
        return cast(Batch, _cofactors_numpy(inputs[0]).swapaxes(1, 2) / determinant)

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        inverse = self.result
        return tangents[0] and b.neg(b.matmul(b.matmul(inverse, tangents[0]), inverse))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        transposed = b.transpose(self.result)
        return (b.neg(b.matmul(b.matmul(transposed, cotangent), transposed)),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        size = shape_of(self.operands[0])[0]
        cofactors = _cofactors(s, inputs[0], size)
        reciprocal = s.div(s.one, s.dot(inputs[0][:size], cofactors[:size]))
        return [s.mul(reciprocal, cofactors[j * size + i]) for i in range(size) for j in range(size)]


OPS = (MatmulOp, TransposeOp, DotOp, CrossOp, TraceOp, SumOp, NormOp, DetOp, CofactorOp, InverseOp)
