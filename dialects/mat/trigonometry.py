"""`mat` operations on two coordinates, and Stumpff functions, entry by entry; angles in radians."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from xdsl.dialects.builtin import IntegerAttr, i64
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import irdl_op_definition, prop_def
from xdsl.parser import Parser
from xdsl.printer import Printer

from yasps.dialects.mat.base import Batch, MatOp, Shape, ShapeError, same_shapes
from yasps.dialects.mat.elementwise import EntrywiseFunction
from yasps.dialects.mat.syntax import parse_values, print_values
from yasps.dialects.scalar.graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder

LARGEST_ORDER = 9
"""Of a Stumpff function; second derivatives of those up to order 5 need it."""
LARGEST_OF_SERIES = 4.0
"""Up to this argument Stumpff functions are series; beyond, the closed forms cancel no more than two digits."""
LAST_OF_SERIES = 32
"""The series end with the term of 1 / 32!, less than 1e-17 of the first for every order."""


def arctan2(y: Batch, x: Batch) -> Batch:
    """NumPy's arctan2, and for complex numbers its analytic continuation from the real branch.

    By arctan of the smaller quotient, so that an imaginary part far below rounding (complex step) is kept.
    """
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return cast(Batch, np.arctan2(np.asarray(y, float), np.asarray(x, float)))
    flat = np.abs(np.real(y)) <= np.abs(np.real(x))
    behind = np.where(np.real(x) < 0, np.copysign(np.pi, np.real(y)), 0.0)
    upright = np.copysign(np.pi / 2, np.real(y))
    with np.errstate(all="ignore"):
        return np.where(flat, np.arctan(y / x) + behind, upright - np.arctan(x / y))


@irdl_op_definition
class Atan2Op(MatOp):
    """atan2(y, x): the angle of (x, y), in (-pi, pi]; it jumps where y = 0 > x and has no derivative at (0, 0)."""

    name = "mat.atan2"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return same_shapes("an angle by atan2", shapes)

    def evaluate(self, *inputs: Batch) -> Batch:
        return arctan2(*inputs)

    def _partials(self, b: MatBuilder) -> tuple[SSAValue, SSAValue]:
        """x / r^2 and y / r^2: the derivative by y, and minus that by x."""
        y, x = self.operands
        inverse = b.power(b.add(b.hadamard(x, x), b.hadamard(y, y)), -1.0)
        return b.hadamard(x, inverse), b.hadamard(y, inverse)

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        dy, dx = tangents
        by_y, by_x = self._partials(b)
        return b.difference(dy and b.hadamard(by_y, dy), dx and b.hadamard(by_x, dx))

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        by_y, by_x = self._partials(b)
        return (b.hadamard(by_y, cotangent), b.neg(b.hadamard(by_x, cotangent)))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [s.binary("atan2", y, x) for y, x in zip(*inputs, strict=True)]


@irdl_op_definition
class HypotOp(MatOp):
    """sqrt(x^2 + y^2) without overflow between; it has no derivative at (0, 0)."""

    name = "mat.hypot"
    ARITY: ClassVar = 2

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        return same_shapes("a length by hypot", shapes)

    def evaluate(self, *inputs: Batch) -> Batch:
        x, y = inputs
        if np.iscomplexobj(x) or np.iscomplexobj(y):
            return cast(Batch, np.sqrt(x * x + y * y))
        return cast(Batch, np.hypot(np.asarray(x, float), np.asarray(y, float)))

    def _partials(self, b: MatBuilder) -> list[SSAValue]:
        """x / h and y / h."""
        inverse = b.power(self.result, -1.0)
        return [b.hadamard(leg, inverse) for leg in self.operands]

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        pairs = zip(self._partials(b), tangents, strict=True)
        return b.total([tangent and b.hadamard(partial, tangent) for partial, tangent in pairs])

    def pullback(self, b: MatBuilder, cotangent: SSAValue) -> Sequence[SSAValue | None]:
        return [b.hadamard(partial, cotangent) for partial in self._partials(b)]

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [_hypot_node(s, x, y) for x, y in zip(*inputs, strict=True)]


def _hypot_node(s: ScalarGraph, x: Node, y: Node) -> Node:
    """The longer leg times sqrt(1 + (shorter / longer)^2)."""
    a, b = s.unary("abs", x), s.unary("abs", y)
    longer, shorter = s.binary("max", a, b), s.binary("min", a, b)
    ratio = s.div(shorter, longer)
    length = s.mul(longer, s.unary("sqrt", s.add(s.one, s.mul(ratio, ratio))))
    return s.select(s.compare("le", longer, s.zero), longer, length)


def stumpff(order: int, s: Batch) -> Batch:
    """c_k(s) = 1/k! - s/(k + 2)! + s^2/(k + 4)! - ..., entry by entry, for s >= 0; complex too (complex step)."""
    s = np.asarray(s)
    is_small = np.abs(np.real(s)) <= LARGEST_OF_SERIES
    small, large = np.where(is_small, s, 0.0), np.where(is_small, 1.0, s)
    series: Batch = np.zeros(s.shape)
    for k in range(order + 2 * ((LAST_OF_SERIES - order) // 2), order - 1, -2):
        series = 1.0 / math.factorial(k) - small * series
    with np.errstate(invalid="ignore"):
        root = np.sqrt(large)
    closed = np.cos(root) if order % 2 == 0 else np.sin(root) / root
    for k in range(order % 2, order, 2):
        closed = (1.0 / math.factorial(k) - closed) / large
    return np.where(is_small, series, closed)


@irdl_op_definition
class StumpffOp(EntrywiseFunction):
    """Stumpff function c_k(s) = 1/k! - s/(k + 2)! + s^2/(k + 4)! - ... for s >= 0, smooth at 0 too.

    With n = sqrt(s): c_0 = cos n, c_1 = sin(n) / n, c_2 = (1 - cos n) / n^2, c_3 = (n - sin n) / n^3.
    """

    name = "mat.stumpff"
    order = prop_def(IntegerAttr)

    def print_inner(self, printer: Printer) -> None:
        """`mat.stumpff 3 %s : 1x1`."""
        printer.print_string(f"{self.order.value.data} ")
        print_values(printer, self.operands)

    @classmethod
    def parse_inner(cls, parser: Parser) -> tuple[list[SSAValue], dict[str, Any]]:
        order = IntegerAttr(parser.parse_integer(), i64)
        return parse_values(parser), {"order": order}

    @property
    def k(self) -> int:
        return int(self.order.value.data)

    @classmethod
    def infer(cls, shapes: Sequence[Shape], properties: dict[str, Attribute]) -> Shape:
        order = cast(IntegerAttr, properties["order"]).value.data
        if not 0 <= order <= LARGEST_ORDER:
            raise ShapeError(f"the order of a Stumpff function is one of 0 to {LARGEST_ORDER}, got {order}")
        return shapes[0]

    def evaluate(self, *inputs: Batch) -> Batch:
        return stumpff(self.k, inputs[0])

    def derivative(self, b: MatBuilder) -> SSAValue:
        # (k c_{k+2} - c_{k+1}) / 2, which does not cancel near 0: the terms are k : k + 2
        s = self.operands[0]
        first, second = b.stumpff(self.k + 1, s), b.stumpff(self.k + 2, s) if self.k else None
        change = b.difference(second and b.scale(b.number(float(self.k)), second), first)
        return b.scale(b.number(0.5), cast(SSAValue, change))

    def lower(self, s: ScalarGraph, *inputs: Sequence[Node]) -> list[Node]:
        return [_stumpff_node(s, self.k, a) for a in inputs[0]]


def _stumpff_node(s: ScalarGraph, order: int, a: Node) -> Node:
    """Functions of the same number share sine, cosine and what remains of the series: c_k = 1/k! - s c_{k+2}."""
    series = s.zero
    for k in range(order + 2 * ((LAST_OF_SERIES - order) // 2), order - 1, -2):
        series = s.sub(s.constant(1.0 / math.factorial(k)), s.mul(a, series))
    root = s.unary("sqrt", a)
    closed = s.unary("cos", root) if order % 2 == 0 else s.div(s.unary("sin", root), root)
    for k in range(order % 2, order, 2):
        closed = s.div(s.sub(s.constant(1.0 / math.factorial(k)), closed), a)
    is_small = s.compare("le", s.unary("abs", a), s.constant(LARGEST_OF_SERIES))
    return s.select(is_small, series, closed)


OPS = (Atan2Op, HypotOp, StumpffOp)
