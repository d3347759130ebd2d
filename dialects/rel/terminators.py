"""`rel` operations that end bodies: the value of an attribute, or its derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Self

from xdsl.ir import SSAValue
from xdsl.irdl import (
    AttrSizedOperandSegments,
    IRDLOperation,
    VarOperandDef,
    irdl_op_definition,
    operand_def,
    opt_operand_def,
    traits_def,
    var_operand_def,
)
from xdsl.parser import Parser
from xdsl.printer import Printer
from xdsl.traits import IsTerminator
from xdsl.utils.exceptions import VerifyException

from yasps.dialects.mat import shape_of, spell
from yasps.dialects.mat.syntax import parse_value, parse_values, print_values


def packed_size(width: int) -> int:
    """Entries in the upper triangle of a width x width matrix."""
    return width * (width + 1) // 2


class Terminator(IRDLOperation):
    """The end of a body. Each of its operands, or groups of them, is written after a word; their types are known."""

    traits = traits_def(IsTerminator())
    WORDS: ClassVar[tuple[str, ...]] = ("",)

    def print(self, printer: Printer) -> None:
        """`rel.yield_jacobian %j wrt %x, %y`."""
        for word, (name, _) in zip(self.WORDS, self.get_irdl_definition().operands, strict=True):
            values: SSAValue | Sequence[SSAValue] | None = getattr(self, name)
            if values is not None and values != ():
                printer.print_string(f" {word} " if word else " ")
                print_values(printer, [values] if isinstance(values, SSAValue) else values)
        printer.print_op_attributes(self.attributes)

    @classmethod
    def parse(cls, parser: Parser) -> Self:
        """Parses what `print` prints; raises ParseError."""
        groups: list[list[SSAValue]] = []
        for word, (_, definition) in zip(cls.WORDS, cls.get_irdl_definition().operands, strict=True):
            is_variadic = isinstance(definition, VarOperandDef)
            if word and parser.parse_optional_keyword(word) is None:
                if not is_variadic:
                    parser.raise_error(f"expected {word}")
                groups.append([])
            else:
                groups.append(parse_values(parser) if is_variadic else [parse_value(parser)])
        attributes = parser.parse_optional_attr_dict()
        return cls.build(operands=groups, attributes=attributes)


@irdl_op_definition
class YieldOp(Terminator):
    """The value of an attribute."""

    name = "rel.yield"
    value = operand_def()

    def __init__(self, value: SSAValue) -> None:
        super().__init__(operands=[value])


def _total(values: Sequence[SSAValue]) -> int:
    return sum(shape_of(v)[0] * shape_of(v)[1] for v in values)


@irdl_op_definition
class YieldDerivativeOp(Terminator):
    """An energy (1x1), its gradient (n x 1) and Hessian with respect to the n entries of the boundary inputs `wrt`.

    A missing Hessian is zero: the energy is affine. After `lower-to-scalar` the Hessian is the packed upper triangle.
    The energy is there to be checked together with its derivatives, which may be finite where it is not. So of an
    affine one it is the part without the inputs, and `lower-to-scalar` makes it cheaper: see
    passes/calculus/finite_check.py.

    `cut`: the values whose entries the innermost Hessian is with respect to, the smallest linear cut through which the
    energy sees its inputs; none where that is a basis of constant combinations, and after `lower-to-scalar`.
    """

    name = "rel.yield_derivative"
    energy = operand_def()
    gradient = operand_def()
    hessian = opt_operand_def()
    cut = var_operand_def()
    wrt = var_operand_def()
    irdl_options = (AttrSizedOperandSegments(as_property=True),)
    WORDS: ClassVar = ("", "gradient", "hessian", "cut", "wrt")

    def __init__(
        self,
        energy: SSAValue,
        gradient: SSAValue,
        hessian: SSAValue | None,
        wrt: Sequence[SSAValue],
        cut: Sequence[SSAValue] = (),
    ) -> None:
        super().__init__(operands=[[energy], [gradient], [] if hessian is None else [hessian], list(cut), list(wrt)])

    def verify_(self) -> None:
        count = _total(self.wrt)
        if shape_of(self.energy) != (1, 1):
            raise VerifyException(f"an energy is 1x1, got {spell(shape_of(self.energy))}")
        if shape_of(self.gradient) != (count, 1):
            raise VerifyException(
                f"the gradient with respect to {count} entries is {count}x1, got {spell(shape_of(self.gradient))}"
            )
        if self.hessian is not None and shape_of(self.hessian) not in ((count, count), (packed_size(count), 1)):
            raise VerifyException(
                f"the Hessian with respect to {count} entries is {count}x{count} (or its packed upper triangle), "
                f"got {spell(shape_of(self.hessian))}"
            )


@irdl_op_definition
class YieldJacobianOp(Terminator):
    """Jacobian (p x q): p entries of the attribute by q entries of the boundary inputs `wrt`."""

    name = "rel.yield_jacobian"
    jacobian = operand_def()
    wrt = var_operand_def()
    WORDS: ClassVar = ("", "wrt")

    def __init__(self, jacobian: SSAValue, wrt: Sequence[SSAValue]) -> None:
        super().__init__(operands=[jacobian, list(wrt)])

    def verify_(self) -> None:
        count = _total(self.wrt)
        shape = shape_of(self.jacobian)
        if shape[1] != count:
            raise VerifyException(f"a Jacobian with respect to {count} entries has {count} columns, got {spell(shape)}")


@irdl_op_definition
class YieldPullbackOp(Terminator):
    """J^T v (q x 1) for the cotangent v (p x 1) that the body takes: what `lower-to-scalar` makes of a Jacobian J."""

    name = "rel.yield_pullback"
    cotangent = operand_def()
    wrt = var_operand_def()
    WORDS: ClassVar = ("", "wrt")

    def __init__(self, cotangent: SSAValue, wrt: Sequence[SSAValue]) -> None:
        super().__init__(operands=[cotangent, list(wrt)])

    def verify_(self) -> None:
        count = _total(self.wrt)
        if shape_of(self.cotangent) != (count, 1):
            raise VerifyException(
                f"the cotangent of {count} entries is {count}x1, got {spell(shape_of(self.cotangent))}"
            )


@irdl_op_definition
class YieldCurvatureOp(Terminator):
    """Hessian (q x q) of <v, h(w)> for the cotangent v that the body takes, with respect to the q entries of `wrt`.

    After `lower-to-scalar` it is the packed upper triangle.
    """

    name = "rel.yield_curvature"
    hessian = operand_def()
    wrt = var_operand_def()
    WORDS: ClassVar = ("", "wrt")

    def __init__(self, hessian: SSAValue, wrt: Sequence[SSAValue]) -> None:
        super().__init__(operands=[hessian, list(wrt)])

    def verify_(self) -> None:
        count = _total(self.wrt)
        if shape_of(self.hessian) not in {(count, count), (packed_size(count), 1)}:
            raise VerifyException(
                f"a Hessian with respect to {count} entries is {count}x{count} (or its packed upper triangle), "
                f"got {spell(shape_of(self.hessian))}"
            )


OPS = (YieldOp, YieldDerivativeOp, YieldJacobianOp, YieldPullbackOp, YieldCurvatureOp)
