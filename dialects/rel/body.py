"""`rel` operations inside bodies: the boundary nodes of the paper (5.3) and calls of scalar functions."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import Self, cast

from xdsl.dialects.builtin import ArrayAttr, IntegerAttr, IntegerType, StringAttr, SymbolRefAttr, UnitAttr, i64
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import (
    IRDLOperation,
    ParsePropInAttrDict,
    irdl_op_definition,
    operand_def,
    opt_operand_def,
    opt_prop_def,
    prop_def,
    result_def,
    traits_def,
    var_operand_def,
    var_result_def,
)
from xdsl.parser import Parser
from xdsl.printer import Printer
from xdsl.traits import Pure
from xdsl.utils.exceptions import VerifyException

from yasps.dialects.mat import Matrix, matrix_type, shape_of
from yasps.dialects.mat.calculus import ISOTROPIC_WIDTHS, PROJECTION_MODES, TWO_VECTORS
from yasps.dialects.mat.syntax import parse_type, parse_value, parse_values, print_type, print_values
from yasps.dialects.rel.declarations import symbol
from yasps.dialects.rel.syntax import ResultType
from yasps.dialects.rel.terminators import packed_size

JOIN_OPERATIONS = ("sum", "mean")


class ReadOp(IRDLOperation):
    """A boundary node: the only way a body sees anything outside itself."""

    result = result_def()
    traits = traits_def(Pure())
    irdl_options = (ParsePropInAttrDict(),)
    custom_directives = (ResultType,)

    @property
    def matrix_type(self) -> Matrix:
        return cast(Matrix, self.result.type)


@irdl_op_definition
class DataOp(ReadOp):
    """Stored numbers of the instance itself, or of an ancestor (its mesh or the scene)."""

    name = "rel.data"
    storage = prop_def(SymbolRefAttr)
    assembly_format = "$storage attr-dict `:` custom<ResultType>(type($result))"

    def __init__(self, storage: str, type_: Matrix) -> None:
        super().__init__(properties={"storage": symbol(storage)}, result_types=[type_])


@irdl_op_definition
class RefOp(ReadOp):
    """Another attribute of the same lineage."""

    name = "rel.ref"
    attribute = prop_def(SymbolRefAttr)
    assembly_format = "$attribute attr-dict `:` custom<ResultType>(type($result))"

    def __init__(self, attribute: str, type_: Matrix) -> None:
        super().__init__(properties={"attribute": symbol(attribute)}, result_types=[type_])


class JoinOp(ReadOp):
    """JOIN: what the source has at the connected instances."""

    source = prop_def(SymbolRefAttr)
    connectivity = prop_def(SymbolRefAttr)
    operation = opt_prop_def(StringAttr)

    def __init__(self, source: str, connectivity: str, type_: Matrix, operation: str | None = None) -> None:
        properties: dict[str, Attribute] = {"source": symbol(source), "connectivity": symbol(connectivity)}
        if operation is not None:
            properties["operation"] = StringAttr(operation)
        super().__init__(properties=properties, result_types=[type_])

    @property
    def reduction(self) -> str | None:
        """ "sum", "mean" or None."""
        return self.operation.data if self.operation is not None else None


@irdl_op_definition
class JoinNumbersOp(JoinOp):
    """JOIN: values at the connected instances, one row of r c entries each (paper, eq. 2).

    Through a connectivity of variable arity their "sum" or "mean" instead, of the source's shape.
    """

    name = "rel.join"
    assembly_format = (
        "$source `through` $connectivity (`operation` $operation^)? attr-dict `:` custom<ResultType>(type($result))"
    )

    def verify_(self) -> None:
        _verify_element(self, of_indices=False)
        if self.reduction not in (None, *JOIN_OPERATIONS):
            raise VerifyException(f"operation must be one of {', '.join(JOIN_OPERATIONS)}, got {self.reduction!r}")


@irdl_op_definition
class JoinIndicesOp(JoinOp):
    """Placement indices at the connected instances, one row each; of a variable arity, 0 fills up to the largest."""

    name = "rel.join_indices"
    assembly_format = "$source `through` $connectivity attr-dict `:` custom<ResultType>(type($result))"

    def verify_(self) -> None:
        _verify_element(self, of_indices=True)


def _verify_element(op: ReadOp, *, of_indices: bool) -> None:
    if isinstance(op.matrix_type.element_type, IntegerType) != of_indices:
        raise VerifyException(f"{op.name} gives {'placement indices' if of_indices else 'numbers'}, not the other")


class UnionOp(ReadOp):
    """UNION: what the member has that this instance of a primitive union comes from."""

    members = prop_def(ArrayAttr[SymbolRefAttr])

    def __init__(self, members: Sequence[str], type_: Matrix) -> None:
        super().__init__(properties={"members": ArrayAttr([symbol(m) for m in members])}, result_types=[type_])


@irdl_op_definition
class UnionNumbersOp(UnionOp):
    """UNION: the value of the member this instance of a primitive union comes from (paper, 4.6)."""

    name = "rel.union"
    assembly_format = "$members attr-dict `:` custom<ResultType>(type($result))"

    def verify_(self) -> None:
        _verify_element(self, of_indices=False)


@irdl_op_definition
class UnionIndicesOp(UnionOp):
    """Placement indices of the member this instance comes from, a row; 0 fills up to the longest (appendix A.3)."""

    name = "rel.union_indices"
    assembly_format = "$members attr-dict `:` custom<ResultType>(type($result))"

    def verify_(self) -> None:
        _verify_element(self, of_indices=True)


@irdl_op_definition
class TargetIndexOp(ReadOp):
    """Where this instance of a target starts in the global gradient, counted from 1 (paper, appendix A.3)."""

    name = "rel.target_index"
    target = prop_def(SymbolRefAttr)
    assembly_format = "$target attr-dict `:` custom<ResultType>(type($result))"

    def __init__(self, target: str) -> None:
        super().__init__(properties={"target": symbol(target)}, result_types=[matrix_type((1, 1), IntegerType(32))])


@irdl_op_definition
class ApplyOp(IRDLOperation):
    """Calls a scalar function with all entries of the operands, row-major; its results fill the results likewise.

    A `uniform` one reads only what is the same for all instances, so that a kernel calls it once.
    """

    name = "rel.apply"
    function = prop_def(SymbolRefAttr)
    uniform = opt_prop_def(UnitAttr)
    inputs = var_operand_def()
    values = var_result_def()
    traits = traits_def(Pure())

    def __init__(
        self, function: str, inputs: Sequence[SSAValue], result_types: Sequence[Matrix], *, uniform: bool = False
    ) -> None:
        properties: dict[str, Attribute] = {"function": symbol(function)}
        if uniform:
            properties["uniform"] = UnitAttr()
        super().__init__(properties=properties, operands=[list(inputs)], result_types=[list(result_types)])

    def verify_(self) -> None:
        if self.uniform is not None and not all(isinstance(value.owner, DataOp) for value in self.inputs):
            raise VerifyException("a uniform call reads stored numbers only")

    def print(self, printer: Printer) -> None:
        """`rel.apply @f(%a, %b) uniform : 1x1, 6x1`."""
        printer.print_string(" ")
        printer.print_attribute(self.function)
        with printer.in_parens():
            print_values(printer, self.inputs)
        if self.uniform is not None:
            printer.print_string(" uniform")
        printer.print_op_attributes(self.attributes)
        printer.print_string(" : ")
        printer.print_list(self.result_types, lambda type_: print_type(printer, type_))

    @classmethod
    def parse(cls, parser: Parser) -> Self:
        """Parses what `print` prints; raises ParseError."""
        properties: dict[str, Attribute] = {"function": SymbolRefAttr(parser.parse_symbol_name())}
        with parser.in_parens():
            inputs = parse_values(parser)
        if parser.parse_optional_keyword("uniform"):
            properties["uniform"] = UnitAttr()
        attributes = parser.parse_optional_attr_dict()
        parser.parse_punctuation(":")
        types = parser.parse_comma_separated_list(parser.Delimiter.NONE, lambda: parse_type(parser))
        return cls.create(operands=inputs, properties=properties, result_types=types, attributes=attributes)


@irdl_op_definition
class ProjectOp(IRDLOperation):
    """The projection kernel on the packed upper triangle (row-major) of a `width` x `width` symmetric matrix.

    `isotropic in` f: the matrix is the Hessian of an energy isotropic in f, by f's entries (row-major, 3x3 or 3x2). The
    result is the same, but may be found by the singular values of f. `isotropic in vectors` f: the same of an energy of
    two vectors of space, one after the other, found in their plane and across it.
    """

    name = "rel.project"
    packed = operand_def()
    deformation = opt_operand_def()
    result = result_def()
    width = prop_def(IntegerAttr)
    mode = prop_def(StringAttr)
    vectors = opt_prop_def(UnitAttr)
    traits = traits_def(Pure())

    def __init__(
        self, packed: SSAValue, width: int, mode: str, deformation: SSAValue | None = None, *, vectors: bool = False
    ) -> None:
        super().__init__(
            operands=[packed, deformation],
            properties={
                "width": IntegerAttr(width, i64),
                "mode": StringAttr(mode),
                "vectors": UnitAttr() if vectors else None,
            },
            result_types=[packed.type],
        )

    def verify_(self) -> None:
        width = self.width.value.data
        if shape_of(self.packed) != (packed_size(width), 1):
            raise VerifyException(f"the upper triangle of a {width}x{width} matrix has {packed_size(width)} entries")
        if self.deformation is not None:
            rows, cols = shape_of(self.deformation)
            if width not in ISOTROPIC_WIDTHS or rows * cols != width:
                raise VerifyException(
                    f"a 9x9 matrix can be isotropic in 9 entries and a 6x6 in 6, got {width}x{width} and {rows}x{cols}"
                )
        if self.vectors is not None and (self.deformation is None or width != prod(TWO_VECTORS)):
            raise VerifyException(f"two vectors have a 6x6 matrix, got {width}x{width}")
        if self.mode.data not in PROJECTION_MODES:
            raise VerifyException(f"mode must be one of {', '.join(PROJECTION_MODES)}, got {self.mode.data!r}")

    def print(self, printer: Printer) -> None:
        """`rel.project %s width 9 mode "clamp" isotropic in %f : 45x1`."""
        printer.print_string(" ")
        print_values(printer, [self.packed])
        printer.print_string(f" width {self.width.value.data} mode ")
        printer.print_string_literal(self.mode.data)
        if self.deformation is not None:
            printer.print_string(" isotropic in vectors " if self.vectors is not None else " isotropic in ")
            print_values(printer, [self.deformation])
        printer.print_op_attributes(self.attributes)
        printer.print_string(" : ")
        print_type(printer, self.result.type)

    @classmethod
    def parse(cls, parser: Parser) -> Self:
        """Parses what `print` prints; raises ParseError."""
        operands = [parse_value(parser)]
        parser.parse_keyword("width")
        width = IntegerAttr(parser.parse_integer(), i64)
        parser.parse_keyword("mode")
        mode = StringAttr(parser.parse_str_literal())
        properties: dict[str, Attribute] = {"width": width, "mode": mode}
        if parser.parse_optional_keyword("isotropic"):
            parser.parse_keyword("in")
            if parser.parse_optional_keyword("vectors"):
                properties["vectors"] = UnitAttr()
            operands.append(parse_value(parser))
        attributes = parser.parse_optional_attr_dict()
        parser.parse_punctuation(":")
        return cls.create(
            operands=operands, result_types=[parse_type(parser)], properties=properties, attributes=attributes
        )


READS = (DataOp, RefOp, JoinNumbersOp, JoinIndicesOp, UnionNumbersOp, UnionIndicesOp, TargetIndexOp)
OPS = (*READS, ApplyOp, ProjectOp)

__all__ = [
    "OPS",
    "READS",
    "ApplyOp",
    "DataOp",
    "JoinIndicesOp",
    "JoinNumbersOp",
    "JoinOp",
    "ProjectOp",
    "ReadOp",
    "RefOp",
    "TargetIndexOp",
    "UnionIndicesOp",
    "UnionNumbersOp",
    "UnionOp",
]
