"""What all `mat` operations share: types, the generic syntax, shape laws and the four meanings of an operation."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import NDArray
from xdsl.dialects.builtin import (
    DenseIntOrFPElementsAttr,
    Float64Type,
    IntegerType,
    TensorType,
    f64,
)
from xdsl.interfaces import HasFolderInterface
from xdsl.ir import Attribute, OpResult, SSAValue
from xdsl.irdl import IRDLOperation, result_def, traits_def, var_operand_def
from xdsl.parser import Parser
from xdsl.printer import Printer
from xdsl.traits import Pure
from xdsl.utils.exceptions import VerifyException

from yasps.dialects.mat.syntax import parse_type, parse_values, print_type, print_values
from yasps.dialects.scalar.graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder

Shape = tuple[int, int]
Matrix = TensorType[Float64Type | IntegerType]
Batch = NDArray[Any]
"""Values of all instances: shape [instances, rows, columns]; float, complex (complex step) or exact rationals."""


class ShapeError(ValueError):
    """Shapes that an operation can't combine; the message is in terms of rows and columns."""


class NotDifferentiableError(ValueError):
    """An operation that has no derivative rule stands between an energy and its targets."""


@lru_cache
def matrix_type(shape: Shape, element: Float64Type | IntegerType = f64) -> Matrix:
    return TensorType(element, shape)


MOST_ENTRIES = 2**20
"""Of a matrix. Passes and kernels unroll all entries; what is far larger is a damaged file, not a small matrix."""


def is_matrix_type(type_: Attribute) -> bool:
    if not isinstance(type_, TensorType) or len(type_.get_shape()) != 2:
        return False
    rows, cols = type_.get_shape()
    return min(rows, cols) >= 1 and rows * cols <= MOST_ENTRIES


def shape_of(value: SSAValue) -> Shape:
    """Rows and columns of a `mat` value."""
    rows, cols = cast(Matrix, value.type).get_shape()
    return rows, cols


def spell(shape: Shape) -> str:
    return f"{shape[0]}x{shape[1]}"


class MatOp(IRDLOperation, HasFolderInterface, abc.ABC):
    """An operation on small dense matrices, evaluated for every instance of a primitive alike.

    A subclass says in one place: its shape law (`infer`), its NumPy meaning (`evaluate`), its derivative
    (`pushforward` and `pullback`) and its scalar code (`lower`).
    """

    inputs = var_operand_def()
    result = result_def()
    traits = traits_def(Pure())

    ARITY: ClassVar[int | None] = None
    """Number of operands; None means any number from one."""
    DIFFERENTIABLE: ClassVar[bool] = True
    HELD_CONSTANT: ClassVar[bool] = False
    """Is the result constant for differentiation, whatever the operands? Then the derivative rules give None."""
    HELD_OPERANDS: ClassVar[tuple[int, ...]] = ()
    """Operands that only the derivative's limits are made of: their own tangents are never asked for."""

    def __init__(
        self,
        inputs: Sequence[SSAValue],
        result_type: Matrix,
        properties: dict[str, Attribute] | None = None,
    ) -> None:
        super().__init__(operands=[list(inputs)], result_types=[result_type], properties=properties or {})

    @classmethod
    def word(cls) -> str:
        """The operation's name without its dialect."""
        return cls.name.removeprefix("mat.")

    # -- syntax --------------------------------------------------------------------------------------------

    def print(self, printer: Printer) -> None:
        """`mat.sub %b, %a : 1x3`: what `print_inner` prints, and the type of the result."""
        printer.print_string(" ")
        self.print_inner(printer)
        printer.print_op_attributes(self.attributes)
        printer.print_string(" : ")
        print_type(printer, self.result.type)

    @classmethod
    def parse(cls, parser: Parser) -> Self:
        """Parses what `print` prints; raises ParseError."""
        operands, given = cls.parse_inner(parser)
        attributes = parser.parse_optional_attr_dict()
        parser.parse_punctuation(":")
        position = parser.pos
        type_ = parse_type(parser)
        if not is_matrix_type(type_):
            parser.raise_error(f"{cls.name} gives a matrix of 1 to {MOST_ENTRIES} entries", position, parser.pos)
        properties = cls.properties_of(given, cast(Matrix, type_))
        return cls.create(operands=operands, result_types=[type_], properties=properties, attributes=attributes)

    def print_inner(self, printer: Printer) -> None:
        """Prints operands and properties. An operation that writes its properties in words has its own."""
        print_values(printer, self.operands)
        if self.properties:
            printer.print_string(" ")
            printer.print_attr_dict(self.properties)

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        """Parses what `print_inner` prints: the operands, and what `properties_of` makes the properties of."""
        values = parse_values(parser)
        has_properties = bool(cls.get_irdl_definition().properties)
        return values, parser.parse_optional_attr_dict() if has_properties else {}

    @classmethod
    def properties_of(cls, given: dict[str, Any], type_: Matrix) -> dict[str, Attribute]:
        """The properties, of what `parse_inner` found and the type of the result."""
        del type_
        return given

    # -- shape law -----------------------------------------------------------------------------------------

    @classmethod
    @abc.abstractmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        """Shape of the result; raises ShapeError with a message in the user's terms."""

    def verify_(self) -> None:
        for value in (*self.operands, self.result):
            if not is_matrix_type(value.type):
                raise VerifyException(
                    f"{self.name} takes and gives matrices tensor<RxCxf64> of 1 to {MOST_ENTRIES} entries, not "
                    f"{value.type}"
                )
        if self.ARITY is not None and len(self.operands) != self.ARITY:
            raise VerifyException(f"{self.name} takes {self.ARITY} operands, got {len(self.operands)}")
        try:
            expected = self.infer([shape_of(v) for v in self.operands], dict(self.properties))
        except ShapeError as error:
            raise VerifyException(f"{self.name}: {error}") from error
        if expected != shape_of(self.result):
            raise VerifyException(
                f"{self.name} gives {spell(expected)} here, but its type says {spell(shape_of(self.result))}"
            )

    # -- meanings ------------------------------------------------------------------------------------------

    @abc.abstractmethod
    def evaluate(self, *inputs: Batch) -> Batch:
        """NumPy meaning over all instances at once: [n, r, c] arrays to an [n, r, c] array."""

    def is_linear(self, active: Sequence[bool]) -> bool:
        """Is the result affine in its active operands taken together (the others held constant)?

        Between kinks is enough: second derivatives are zero wherever they exist.
        """
        del active
        return False

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        """Tangent of the result for tangents of the operands; None stands for zero."""
        del b, tangents
        if self.HELD_CONSTANT:
            return None
        raise NotDifferentiableError(f"{self.name} has no derivative rule")

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        """Cotangents of the operands for a cotangent of the result; None stands for zero."""
        del b, cotangent
        if self.HELD_CONSTANT:
            return [None] * len(self.operands)
        raise NotDifferentiableError(f"{self.name} has no derivative rule")

    def chosen_by(self, b: MatBuilder) -> tuple[int, int, SSAValue] | None:
        """For a whole choice: (k, m, c) where the result is operand k if the 1x1 truth value c holds, else operand m.

        Reverse mode uses it to leave the derivative of the other operand out, even where that is not finite.
        """
        del b
        return None

    @abc.abstractmethod
    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        """Scalar code: row-major entries of the operands to row-major entries of the result."""

    # -- folding -------------------------------------------------------------------------------------------

    def simplify(self) -> SSAValue | None:
        """An operand (or an operand's operand) that equals the result, if there is one."""
        return None

    def fold(self) -> Sequence[SSAValue | Attribute] | None:
        simpler = self.simplify()
        if simpler is not None:
            return (simpler,) if simpler.type == self.result.type else None
        values = [constant_value(operand) for operand in self.operands]
        if not values or any(value is None for value in values):
            return None
        with np.errstate(all="ignore"):
            folded = self.evaluate(*[cast(Batch, value)[None] for value in values])[0]
        if not np.all(np.isfinite(folded)):
            return None
        return (dense(folded, cast(Matrix, self.result.type)),)


def dense(values: Batch, type_: Matrix) -> DenseIntOrFPElementsAttr[Float64Type | IntegerType]:
    """The attribute of a constant with these entries, row-major."""
    if isinstance(type_.element_type, IntegerType):
        entries: list[Any] = [int(v) for v in values.ravel()]
    else:
        entries = [float(v) for v in values.ravel()]
    return cast(
        "DenseIntOrFPElementsAttr[Float64Type | IntegerType]",
        DenseIntOrFPElementsAttr.from_list(cast(Any, type_), entries),
    )


def constant_value(value: SSAValue) -> Batch | None:
    """Entries [rows, columns] of a `mat.constant` or `mat.identity`, or None for any other value."""
    if not isinstance(value, OpResult):
        return None
    if value.op.name == "mat.identity":
        return np.eye(shape_of(value)[0])
    if value.op.name != "mat.constant":
        return None
    attribute = cast("DenseIntOrFPElementsAttr[Float64Type]", value.op.properties["value"])
    return np.array(attribute.get_values()).reshape(shape_of(value))


def is_zero(value: SSAValue) -> bool:
    entries = constant_value(value)
    return entries is not None and not np.any(entries)


def is_identity(value: SSAValue) -> bool:
    entries = constant_value(value)
    return (
        entries is not None and entries.shape[0] == entries.shape[1] and bool(np.all(entries == np.eye(len(entries))))
    )


def is_one(value: SSAValue) -> bool:
    entries = constant_value(value)
    return entries is not None and entries.shape == (1, 1) and entries[0, 0] == 1


def same_shapes(word: str, shapes: Sequence[Shape]) -> Shape:
    if any(shape != shapes[0] for shape in shapes):
        raise ShapeError(f"{word} needs equal shapes, got " + " and ".join(spell(s) for s in shapes))
    return shapes[0]


def vectors(word: str, shapes: Sequence[Shape], length: int | None = None) -> Shape:
    shape = same_shapes(word, shapes)
    if min(shape) != 1 or (length is not None and max(shape) != length):
        wanted = f"vectors of {length} entries (3x1 or 1x3)" if length else "vectors (Nx1 or 1xN)"
        raise ShapeError(f"{word} needs {wanted}, got {spell(shape)}")
    return shape


def square(word: str, shape: Shape) -> Shape:
    if shape[0] != shape[1]:
        raise ShapeError(f"{word} needs a square matrix, got {spell(shape)}")
    return shape
