"""`mat` operations that make, cut and put together matrices without arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from xdsl.dialects.builtin import DenseArrayBase, DenseIntOrFPElementsAttr, Float64Type, IntegerType, i64
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import irdl_op_definition, prop_def
from xdsl.parser import Parser
from xdsl.printer import Printer

from yasps.dialects.mat.base import (
    Batch,
    MatOp,
    Matrix,
    Shape,
    ShapeError,
    constant_value,
    dense,
    shape_of,
    spell,
)
from yasps.dialects.mat.syntax import parse_integers, parse_numbers, parse_value, print_numbers, print_values
from yasps.dialects.scalar.graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder


def _integers(properties: dict[str, Attribute], name: str, count: int) -> tuple[int, ...]:
    attribute = cast("DenseArrayBase[IntegerType]", properties[name])
    values = tuple(int(v) for v in attribute.get_values())
    if len(values) != count:
        raise ShapeError(f"{name} takes {count} integer{'s' if count > 1 else ''}, got {len(values)}")
    return values


@lru_cache
def integers(values: tuple[int, ...]) -> DenseArrayBase[IntegerType]:
    """The property of an operation that takes integers."""
    return DenseArrayBase.from_list(i64, values)


@irdl_op_definition
class ConstantOp(MatOp):
    """A matrix of numbers."""

    name = "mat.constant"
    ARITY: ClassVar = 0
    value = prop_def(DenseIntOrFPElementsAttr)

    def print_inner(self, printer: Printer) -> None:
        """`mat.constant [[1.0, 0.0]] : 1x2`, or one number for all entries."""
        print_numbers(printer, self.entries())

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        return [], {"entries": parse_numbers(parser), "fail": parser.raise_error}

    @classmethod
    def properties_of(cls, given: dict[str, Any], type_: Matrix) -> dict[str, Attribute]:
        entries = given["entries"]
        if entries.shape not in ((1, 1), type_.get_shape()):
            given["fail"](f"numbers for {spell(entries.shape)}, but a type of {spell(_shape(type_))}")
        return {"value": dense(np.broadcast_to(entries, _shape(type_)), type_)}

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        type_ = cast("DenseIntOrFPElementsAttr[Float64Type | IntegerType]", properties["value"]).type
        rows, cols = type_.get_shape()
        return rows, cols

    def entries(self) -> Batch:
        return cast(Batch, constant_value(self.result))

    def evaluate(self, *inputs: Batch) -> Batch:
        return self.entries()[None]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return None

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return ()

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.constant(v) for v in self.entries().ravel()]


@irdl_op_definition
class IdentityOp(MatOp):
    """The identity matrix of `size` rows."""

    name = "mat.identity"
    ARITY: ClassVar = 0
    size = prop_def(DenseArrayBase)

    def print_inner(self, printer: Printer) -> None:
        """`mat.identity : 3x3`."""

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        return [], {}

    @classmethod
    def properties_of(cls, given: dict[str, Any], type_: Matrix) -> dict[str, Attribute]:
        return {"size": integers(_shape(type_)[:1])}

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        (size,) = _integers(properties, "size", 1)
        if size < 1:
            raise ShapeError(f"an identity matrix has at least one row, got {size}")
        return size, size

    def evaluate(self, *inputs: Batch) -> Batch:
        return np.eye(shape_of(self.result)[0])[None]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return None

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return ()

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        size = shape_of(self.result)[0]
        return [s.one if i == j else s.zero for i in range(size) for j in range(size)]


@irdl_op_definition
class ReshapeOp(MatOp):
    """The same entries, row-major, in another shape."""

    name = "mat.reshape"
    ARITY: ClassVar = 1
    shape = prop_def(DenseArrayBase)

    def print_inner(self, printer: Printer) -> None:
        """`mat.reshape %a : 9x1`."""
        print_values(printer, self.operands)

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        return [parse_value(parser)], {}

    @classmethod
    def properties_of(cls, given: dict[str, Any], type_: Matrix) -> dict[str, Attribute]:
        return {"shape": integers(_shape(type_))}

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        rows, cols = _integers(properties, "shape", 2)
        if rows < 1 or cols < 1 or rows * cols != shapes[0][0] * shapes[0][1]:
            raise ShapeError(
                f"{spell(shapes[0])} has {shapes[0][0] * shapes[0][1]} entries, which don't fill {spell((rows, cols))}"
            )
        return rows, cols

    def simplify(self) -> SSAValue | None:
        operand = self.operands[0]
        if shape_of(operand) == shape_of(self.result):
            return operand
        inner = operand.owner
        if isinstance(inner, ReshapeOp) and shape_of(inner.operands[0]) == shape_of(self.result):
            return inner.operands[0]
        return None

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0].reshape(len(inputs[0]), *shape_of(self.result))

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.reshape(tangents[0], shape_of(self.result))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.reshape(cotangent, shape_of(self.operands[0])),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return list(inputs[0])


@irdl_op_definition
class BlockOp(MatOp):
    """The rows x cols block whose first entry is (row, col): `block = [row, col, rows, cols]`."""

    name = "mat.block"
    ARITY: ClassVar = 1
    block = prop_def(DenseArrayBase)

    def print_inner(self, printer: Printer) -> None:
        """`mat.block %a[row, col] : 1x3`."""
        _print_at(printer, self.operands[0], self.bounds[:2])

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        return _parse_at(parser)

    @classmethod
    def properties_of(cls, given: dict[str, Any], type_: Matrix) -> dict[str, Attribute]:
        return {"block": integers((*given["corner"], *_shape(type_)))}

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        row, col, rows, cols = _integers(properties, "block", 4)
        if row < 0 or col < 0 or rows < 1 or cols < 1 or row + rows > shapes[0][0] or col + cols > shapes[0][1]:
            raise ShapeError(
                f"rows {row}..{row + rows - 1}, columns {col}..{col + cols - 1} are not inside a {spell(shapes[0])} "
                "matrix"
            )
        return rows, cols

    @property
    def bounds(self) -> tuple[int, int, int, int]:
        row, col, rows, cols = _integers(dict(self.properties), "block", 4)
        return row, col, rows, cols

    def simplify(self) -> SSAValue | None:
        operand = self.operands[0]
        if shape_of(operand) == shape_of(self.result):
            return operand
        producer = operand.owner
        row, col, rows, cols = self.bounds
        if isinstance(producer, ConcatRowsOp | ConcatColsOp):  # a part that went in whole
            axis = producer.AXIS
            start, wanted, across = ((row, rows, (col, cols)), (col, cols, (row, rows)))[axis]
            position = 0
            for part in producer.operands:
                length = shape_of(part)[axis]
                if position == start and length == wanted and across == (0, shape_of(part)[1 - axis]):
                    return part
                position += length
        return None

    def evaluate(self, *inputs: Batch) -> Batch:
        row, col, rows, cols = self.bounds
        return inputs[0][:, row : row + rows, col : col + cols]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.block(tangents[0], *self.bounds)

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        row, col, _, _ = self.bounds
        return (b.embed(cotangent, row, col, shape_of(self.operands[0])),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        row, col, rows, cols = self.bounds
        width = shape_of(self.operands[0])[1]
        return [inputs[0][(row + i) * width + col + j] for i in range(rows) for j in range(cols)]


@irdl_op_definition
class EmbedOp(MatOp):
    """A matrix of zeros with the operand at (row, col): `place = [row, col, rows, cols]` of the whole."""

    name = "mat.embed"
    ARITY: ClassVar = 1
    place = prop_def(DenseArrayBase)

    def print_inner(self, printer: Printer) -> None:
        """`mat.embed %a[row, col] : 3x4`."""
        _print_at(printer, self.operands[0], self.corner)

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        return _parse_at(parser)

    @classmethod
    def properties_of(cls, given: dict[str, Any], type_: Matrix) -> dict[str, Attribute]:
        return {"place": integers((*given["corner"], *_shape(type_)))}

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        row, col, rows, cols = _integers(properties, "place", 4)
        if row < 0 or col < 0 or row + shapes[0][0] > rows or col + shapes[0][1] > cols:
            raise ShapeError(f"{spell(shapes[0])} at ({row}, {col}) does not fit into {spell((rows, cols))}")
        return rows, cols

    @property
    def corner(self) -> tuple[int, int]:
        row, col, _, _ = _integers(dict(self.properties), "place", 4)
        return row, col

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if shape_of(self.operands[0]) == shape_of(self.result) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        row, col = self.corner
        rows, cols = shape_of(self.operands[0])
        result = np.zeros_like(inputs[0], shape=(len(inputs[0]), *shape_of(self.result)))
        result[:, row : row + rows, col : col + cols] = inputs[0]
        return result

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.embed(tangents[0], *self.corner, shape_of(self.result))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.block(cotangent, *self.corner, *shape_of(self.operands[0])),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        row, col = self.corner
        rows, cols = shape_of(self.operands[0])
        height, width = shape_of(self.result)
        entries = [s.zero] * (height * width)
        for i in range(rows):
            start = (row + i) * width + col
            entries[start : start + cols] = inputs[0][i * cols : (i + 1) * cols]
        return entries


class _ConcatOp(MatOp):
    AXIS: ClassVar[int]

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        if not shapes:
            raise ShapeError("nothing to put together")
        across = 1 - cls.AXIS
        if any(shape[across] != shapes[0][across] for shape in shapes):
            wanted = "columns" if cls.AXIS == 0 else "rows"
            raise ShapeError(f"parts need equally many {wanted}, got " + ", ".join(spell(s) for s in shapes))
        length = sum(shape[cls.AXIS] for shape in shapes)
        return (length, shapes[0][1]) if cls.AXIS == 0 else (shapes[0][0], length)

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if len(self.operands) == 1 else None

    def evaluate(self, *inputs: Batch) -> Batch:
        (count,) = np.broadcast_shapes(*[(len(part),) for part in inputs])  # 0 where a primitive is empty
        parts = [np.broadcast_to(part, (count, *part.shape[1:])) for part in inputs]
        return np.concatenate(parts, axis=self.AXIS + 1)

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        if all(tangent is None for tangent in tangents):
            return None
        parts = [
            b.zeros(shape_of(operand)) if tangent is None else tangent
            for operand, tangent in zip(self.operands, tangents, strict=True)
        ]
        return b.concat_rows(parts) if self.AXIS == 0 else b.concat_cols(parts)

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        parts = []
        start = 0
        for operand in self.operands:
            rows, cols = shape_of(operand)
            corner = (start, 0) if self.AXIS == 0 else (0, start)
            parts.append(b.block(cotangent, *corner, rows, cols))
            start += (rows, cols)[self.AXIS]
        return parts


@irdl_op_definition
class ConcatRowsOp(_ConcatOp):
    """Parts one below the other."""

    name = "mat.concat_rows"
    AXIS: ClassVar = 0

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [entry for part in inputs for entry in part]


@irdl_op_definition
class ConcatColsOp(_ConcatOp):
    """Parts side by side."""

    name = "mat.concat_cols"
    AXIS: ClassVar = 1

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        entries: list[Node] = []
        for i in range(shape_of(self.result)[0]):
            for operand, part in zip(self.operands, inputs, strict=True):
                cols = shape_of(operand)[1]
                entries.extend(part[i * cols : (i + 1) * cols])
        return entries


def _shape(type_: Matrix) -> Shape:
    rows, cols = type_.get_shape()
    return rows, cols


def _print_at(printer: Printer, value: SSAValue, corner: tuple[int, int]) -> None:
    print_values(printer, [value])
    printer.print_string(f"[{corner[0]}, {corner[1]}]")


def _parse_at(parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
    value = parse_value(parser)
    position = parser.pos
    corner = parse_integers(parser)
    if len(corner) != 2:
        parser.raise_error("a row and a column are needed", position, parser.pos)
    return [value], {"corner": corner}


def constant_of(values: Batch, type_: Matrix) -> ConstantOp:
    """A `mat.constant` with these entries [rows, columns]."""
    return ConstantOp([], type_, {"value": dense(values, type_)})


OPS = (ConstantOp, IdentityOp, ReshapeOp, BlockOp, EmbedOp, ConcatRowsOp, ConcatColsOp)
