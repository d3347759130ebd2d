"""`mat` operations that work entry by entry, or by one scalar on all entries."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, cast

from xdsl.dialects.builtin import FloatAttr, f64
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import irdl_op_definition, prop_def
from xdsl.parser import Parser
from xdsl.printer import Printer

from yasps.dialects.mat.base import Batch, MatOp, Shape, ShapeError, is_one, is_zero, same_shapes, spell
from yasps.dialects.mat.syntax import parse_number, parse_value, print_values, spelled
from yasps.dialects.scalar.functions import FUNCTIONS, ScalarFunction
from yasps.dialects.scalar.graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder


@irdl_op_definition
class AddOp(MatOp):
    """a + b."""

    name = "mat.add"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return same_shapes("a sum", shapes)

    def simplify(self) -> SSAValue | None:
        a, b = self.operands
        return b if is_zero(a) else a if is_zero(b) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0] + inputs[1]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return b.total(tangents)

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (cotangent, cotangent)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.add(a, b) for a, b in zip(*inputs, strict=True)]


@irdl_op_definition
class SubOp(MatOp):
    """a - b."""

    name = "mat.sub"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return same_shapes("a difference", shapes)

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if is_zero(self.operands[1]) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0] - inputs[1]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        da, db = tangents
        if db is None:
            return da
        return b.neg(db) if da is None else b.sub(da, db)

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (cotangent, b.neg(cotangent))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.sub(a, b) for a, b in zip(*inputs, strict=True)]


@irdl_op_definition
class NegOp(MatOp):
    """-a."""

    name = "mat.neg"
    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return shapes[0]

    def simplify(self) -> SSAValue | None:
        producer = self.operands[0].owner
        return producer.operands[0] if isinstance(producer, NegOp) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return -inputs[0]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return b.neg(tangents[0]) if tangents[0] is not None else None

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.neg(cotangent),)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.neg(a) for a in inputs[0]]


@irdl_op_definition
class HadamardOp(MatOp):
    """Entry-wise product."""

    name = "mat.hadamard"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return same_shapes("an entry-wise product", shapes)

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0] * inputs[1]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return sum(active) <= 1

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        x, y = self.operands
        dx, dy = tangents
        return b.total((dx and b.hadamard(dx, y), dy and b.hadamard(x, dy)))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        x, y = self.operands
        return (b.hadamard(cotangent, y), b.hadamard(cotangent, x))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.mul(a, b) for a, b in zip(*inputs, strict=True)]


@irdl_op_definition
class ScaleOp(MatOp):
    """s m, a 1x1 value times a matrix."""

    name = "mat.scale"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        if shapes[0] != (1, 1):
            raise ShapeError(f"the factor must be 1x1, got {spell(shapes[0])}")
        return shapes[1]

    def simplify(self) -> SSAValue | None:
        factor, matrix = self.operands
        if is_one(factor) or is_zero(matrix):
            return matrix
        return factor if is_one(matrix) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return inputs[0] * inputs[1]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return sum(active) <= 1

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        factor, matrix = self.operands
        dfactor, dmatrix = tangents
        return b.total((dfactor and b.scale(dfactor, matrix), dmatrix and b.scale(factor, dmatrix)))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        factor, matrix = self.operands
        return (b.dot(cotangent, matrix), b.scale(factor, cotangent))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.mul(inputs[0][0], a) for a in inputs[1]]


@irdl_op_definition
class DivideOp(MatOp):
    """m / s, a matrix divided by a 1x1 value."""

    name = "mat.divide"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        if shapes[1] != (1, 1):
            raise ShapeError(f"the divisor must be 1x1, got {spell(shapes[1])}")
        return shapes[0]

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if is_one(self.operands[1]) or is_zero(self.operands[0]) else None

    def evaluate(self, *inputs: Batch) -> Batch:
        return cast(Batch, inputs[0] / inputs[1])

    def is_linear(self, active: Sequence[bool]) -> bool:
        return not active[1]

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        _, divisor = self.operands
        dmatrix, ddivisor = tangents
        # d(m / s) = (dm - (m / s) ds) / s
        numerator = b.difference(dmatrix, ddivisor and b.scale(ddivisor, self.result))
        return numerator and b.divide(numerator, divisor)

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        to_matrix = b.divide(cotangent, self.operands[1])
        return (to_matrix, b.neg(b.dot(to_matrix, self.result)))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        divisor = inputs[1][0]
        if len(inputs[0]) > 2:  # one division and a product for each entry
            reciprocal = s.div(s.one, divisor)
            return [s.mul(reciprocal, a) for a in inputs[0]]
        return [s.div(a, divisor) for a in inputs[0]]


class EntrywiseFunction(MatOp, abc.ABC):
    """y = f(x) on every entry."""

    ARITY: ClassVar = 1

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return shapes[0]

    @abc.abstractmethod
    def derivative(self, b: MatBuilder) -> SSAValue:
        """f'(x), entry by entry."""

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return tangents[0] and b.hadamard(self.derivative(b), tangents[0])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return (b.hadamard(self.derivative(b), cotangent),)


class TabledFunction(EntrywiseFunction):
    """A function of the table in `dialects/scalar/functions.py`."""

    FUNCTION: ClassVar[ScalarFunction]

    def evaluate(self, *inputs: Batch) -> Batch:
        return self.FUNCTION.evaluate(inputs[0])

    def derivative(self, b: MatBuilder) -> SSAValue:
        return self.FUNCTION.derivative(b, self.operands[0], self.result)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.unary(self.FUNCTION.name, a) for a in inputs[0]]


def _operation(function: ScalarFunction) -> type[TabledFunction]:
    @irdl_op_definition
    class Operation(TabledFunction):
        __doc__ = f"{function.about} of every entry."
        name = f"mat.{function.name}"
        FUNCTION: ClassVar = function

    Operation.__name__ = Operation.__qualname__ = f"{function.name.capitalize()}Op"
    return Operation


TABLED = {function.name: _operation(function) for function in FUNCTIONS}
"""The operation of each function of the table, by its name."""
SqrtOp = TABLED["sqrt"]
SinOp, CosOp, TanOp = TABLED["sin"], TABLED["cos"], TABLED["tan"]
"""Those that passes look for."""


@irdl_op_definition
class PowOp(EntrywiseFunction):
    """x ** p with a constant exponent p; integer exponents are exact products, for any sign of x."""

    name = "mat.pow"
    exponent = prop_def(FloatAttr)

    def print_inner(self, printer: Printer) -> None:
        """`mat.pow %a exponent 2.0 : 1x1`."""
        print_values(printer, self.operands)
        printer.print_string(f" exponent {spelled(self.power)}")

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        operand = parse_value(parser)
        parser.parse_keyword("exponent")
        return [operand], {"exponent": FloatAttr(float(parse_number(parser)), f64)}

    @property
    def power(self) -> float:
        return float(self.exponent.value.data)

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if self.power == 1.0 else None

    def evaluate(self, *inputs: Batch) -> Batch:
        exponent: float | int = self.power
        if exponent == int(exponent):
            exponent = int(exponent)
            if exponent < 0:  # NumPy refuses negative integer powers of integers, and 1 / x is what is meant
                return cast(Batch, 1 / inputs[0] ** -exponent)
        return cast(Batch, inputs[0] ** exponent)

    def is_linear(self, active: Sequence[bool]) -> bool:
        return self.power in (0.0, 1.0)

    def derivative(self, b: MatBuilder) -> SSAValue:
        if self.power == -1.0:
            return b.neg(b.power(self.result, 2.0))  # a second division less
        return b.scale(b.number(self.power), b.power(self.operands[0], self.power - 1.0))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.power(a, self.power) for a in inputs[0]]


OPS: tuple[type[MatOp], ...] = (AddOp, SubOp, NegOp, HadamardOp, ScaleOp, DivideOp, PowOp, *TABLED.values())
