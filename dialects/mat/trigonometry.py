"""`mat` operations of trigonometry, entry by entry; angles in radians."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import irdl_op_definition

from yasps.dialects.mat.base import Batch, MatOp, Shape, same_shapes, shape_of
from yasps.dialects.mat.elementwise import EntrywiseFunction
from yasps.dialects.scalar_graph import Node, ScalarGraph

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder


@irdl_op_definition
class SinOp(EntrywiseFunction):
    """Sine."""

    name = "mat.sin"
    FUNCTION: ClassVar = "sin"

    def derivative(self, b: MatBuilder) -> SSAValue:
        return b.cos(self.operands[0])


@irdl_op_definition
class CosOp(EntrywiseFunction):
    """Cosine."""

    name = "mat.cos"
    FUNCTION: ClassVar = "cos"

    def derivative(self, b: MatBuilder) -> SSAValue:
        return b.neg(b.sin(self.operands[0]))


@irdl_op_definition
class TanOp(EntrywiseFunction):
    """Tangent."""

    name = "mat.tan"
    FUNCTION: ClassVar = "tan"

    def derivative(self, b: MatBuilder) -> SSAValue:
        # 1 + tan^2
        return b.add(b.constant(np.ones(shape_of(self.result))), b.power(self.result, 2.0))


def _arcsine_derivative(b: MatBuilder, x: SSAValue) -> SSAValue:
    """1 / sqrt((1 - x) (1 + x)), which does not cancel near 1 and -1."""
    one = b.constant(np.ones(shape_of(x)))
    return b.power(b.sqrt(b.hadamard(b.sub(one, x), b.add(one, x))), -1.0)


@irdl_op_definition
class AsinOp(EntrywiseFunction):
    """Arc sine, of [-1, 1]; its derivative is infinite at -1 and 1."""

    name = "mat.asin"
    FUNCTION: ClassVar = "asin"

    def derivative(self, b: MatBuilder) -> SSAValue:
        return _arcsine_derivative(b, self.operands[0])


@irdl_op_definition
class AcosOp(EntrywiseFunction):
    """Arc cosine, of [-1, 1]; its derivative is infinite at -1 and 1."""

    name = "mat.acos"
    FUNCTION: ClassVar = "acos"

    def derivative(self, b: MatBuilder) -> SSAValue:
        return b.neg(_arcsine_derivative(b, self.operands[0]))


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


OPS = (SinOp, CosOp, TanOp, AsinOp, AcosOp, Atan2Op)
