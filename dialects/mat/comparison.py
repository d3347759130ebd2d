"""`mat` operations that compare and choose: truth values, select, min, max, abs.

A truth value is an f64 matrix of zeros and ones, so that there is one type of value. A condition is true where its real
part is less or greater than 0: NaN is false, and so is every comparison with NaN. Lowering makes `arith.cmpf` and
`arith.select` of a comparison and its choice; the zeros and ones are not computed then.

Conditions are constant for differentiation. Between their kinks the operations here are linear in what they choose
from, and at a kink they have the derivative of what they return (docs/language.md, "At kinks").
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray
from xdsl.dialects.builtin import StringAttr
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import irdl_op_definition, prop_def
from xdsl.parser import Parser
from xdsl.printer import Printer

from yasps.dialects.mat.base import Batch, MatOp, Shape, ShapeError, constant_value, same_shapes, shape_of, spell
from yasps.dialects.mat.elementwise import EntrywiseFunction
from yasps.dialects.mat.syntax import parse_values, print_values
from yasps.dialects.scalar.graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder

PREDICATES = ("lt", "le")

# -- meanings in NumPy, by the order of real parts: analytic between the kinks, as complex step needs it ---------------


def is_less(a: Batch, b: Batch) -> NDArray[np.bool_]:
    """a < b, entry by entry."""
    return np.asarray(np.real(a) < np.real(b), bool)


def is_less_equal(a: Batch, b: Batch) -> NDArray[np.bool_]:
    """a <= b, entry by entry."""
    return np.asarray(np.real(a) <= np.real(b), bool)


def is_true(a: Batch) -> NDArray[np.bool_]:
    """Which entries are true as conditions."""
    return is_less(a, np.zeros(())) | is_less(np.zeros(()), a)


def minimum(a: Batch, b: Batch) -> Batch:
    """The smaller, entry by entry; the first where they are equal, NaN where one is."""
    return np.where(is_less(b, a) | ~is_less_equal(b, b), b, a)


def maximum(a: Batch, b: Batch) -> Batch:
    """The greater, entry by entry; the first where they are equal, NaN where one is."""
    return np.where(is_less(a, b) | ~is_less_equal(b, b), b, a)


def absolute(a: Batch) -> Batch:
    """a or -a, whichever has a real part >= 0."""
    return np.where(is_less(a, np.zeros(())), -a, a)


# -- operations --------------------------------------------------------------------------------------------------------


@irdl_op_definition
class CompareOp(MatOp):
    """1 where a < b (`predicate = "lt"`) or a <= b (`"le"`), 0 elsewhere; constant for differentiation."""

    name = "mat.compare"
    ARITY: ClassVar = 2
    HELD_CONSTANT: ClassVar = True
    predicate = prop_def(StringAttr)

    def print_inner(self, printer: Printer) -> None:
        """`mat.compare lt %a, %b : 1x1`."""
        printer.print_identifier_or_string_literal(self.predicate.data)
        printer.print_string(" ")
        print_values(printer, self.operands)

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        predicate = StringAttr(parser.parse_identifier_or_str_literal())
        return parse_values(parser), {"predicate": predicate}

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        predicate = cast(StringAttr, properties["predicate"]).data
        if predicate not in PREDICATES:
            raise ShapeError(f"predicate must be one of {', '.join(PREDICATES)}, got {predicate!r}")
        return same_shapes("a comparison", shapes)

    def evaluate(self, *inputs: Batch) -> Batch:
        compare = is_less if self.predicate.data == "lt" else is_less_equal
        return compare(*inputs).astype(float)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.compare(self.predicate.data, a, b) for a, b in zip(*inputs, strict=True)]


@irdl_op_definition
class SelectOp(MatOp):
    """select(condition, a, b): a where the condition is true, else b. The condition is 1x1 or one for each entry."""

    name = "mat.select"
    ARITY: ClassVar = 3

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        shape = same_shapes("a choice", shapes[1:])
        if shapes[0] not in ((1, 1), shape):
            wanted = "1x1" if shape == (1, 1) else f"1x1 or {spell(shape)}"
            raise ShapeError(f"the condition must be {wanted}, got {spell(shapes[0])}")
        return shape

    def simplify(self) -> SSAValue | None:
        condition, a, b = self.operands
        if a is b:
            return a
        known = constant_value(condition)
        if known is None or (is_true(known).any() and not is_true(known).all()):
            return None
        return a if is_true(known).all() else b

    def evaluate(self, *inputs: Batch) -> Batch:
        return np.where(is_true(inputs[0]), inputs[1], inputs[2])

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return b.select_tangent(self.operands[0], tangents[1], tangents[2])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        condition, zero = self.operands[0], b.zeros(shape_of(cotangent))
        return (None, b.select(condition, cotangent, zero), b.select(condition, zero, cotangent))

    def chosen_by(self, b: MatBuilder) -> tuple[int, int, SSAValue] | None:
        condition = self.operands[0]
        return (1, 2, condition) if shape_of(condition) == (1, 1) else None

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        conditions = inputs[0] if len(inputs[0]) > 1 else list(inputs[0]) * len(inputs[1])
        return [s.select(c, a, b) for c, a, b in zip(conditions, *inputs[1:], strict=True)]


class _Extremum(MatOp, abc.ABC):
    """The smaller or the greater of two, entry by entry; the first at a tie."""

    ARITY: ClassVar = 2

    @abc.abstractmethod
    def takes_second(self, b: MatBuilder) -> SSAValue:
        """Where the result is the second operand, as a truth value."""

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return same_shapes(f"a {cls.word()}imum", shapes)

    def simplify(self) -> SSAValue | None:
        return self.operands[0] if self.operands[0] is self.operands[1] else None

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        return b.select_tangent(self.takes_second(b), tangents[1], tangents[0])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        second, zero = self.takes_second(b), b.zeros(shape_of(cotangent))
        return (b.select(second, zero, cotangent), b.select(second, cotangent, zero))

    def chosen_by(self, b: MatBuilder) -> tuple[int, int, SSAValue] | None:
        return (1, 0, self.takes_second(b)) if shape_of(self.result) == (1, 1) else None


@irdl_op_definition
class MinOp(_Extremum):
    """The smaller of two, entry by entry; NaN where one is."""

    name = "mat.min"

    def takes_second(self, b: MatBuilder) -> SSAValue:
        return b.less(self.operands[1], self.operands[0])

    def evaluate(self, *inputs: Batch) -> Batch:
        return minimum(*inputs)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.binary("min", a, b) for a, b in zip(*inputs, strict=True)]


@irdl_op_definition
class MaxOp(_Extremum):
    """The greater of two, entry by entry; NaN where one is."""

    name = "mat.max"

    def takes_second(self, b: MatBuilder) -> SSAValue:
        return b.less(self.operands[0], self.operands[1])

    def evaluate(self, *inputs: Batch) -> Batch:
        return maximum(*inputs)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.binary("max", a, b) for a, b in zip(*inputs, strict=True)]


@irdl_op_definition
class AbsOp(EntrywiseFunction):
    """Absolute value: a where a >= 0, else -a, and the derivative of that.

    So its square has the right curvature at 0, which it would not have if the derivative were 0 there.
    """

    name = "mat.abs"

    def evaluate(self, *inputs: Batch) -> Batch:
        return absolute(inputs[0])

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def derivative(self, b: MatBuilder) -> SSAValue:
        x = self.operands[0]
        one = b.constant(np.ones(shape_of(x)))
        return b.select(b.less(x, b.zeros(shape_of(x))), b.neg(one), one)

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.unary("abs", a) for a in inputs[0]]


OPS = (CompareOp, SelectOp, MinOp, MaxOp, AbsOp)
