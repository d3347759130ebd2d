"""`rel` operations inside bodies: the boundary nodes of the paper (5.3), calls of scalar functions, and terminators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from xdsl.dialects.builtin import ArrayAttr, IntegerAttr, IntegerType, StringAttr, SymbolRefAttr, UnitAttr, i64
from xdsl.ir import Attribute, SSAValue
from xdsl.irdl import (
    AttrSizedOperandSegments,
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
from xdsl.traits import IsTerminator, Pure
from xdsl.utils.exceptions import VerifyException

from yasps.dialects.mat import Matrix, matrix_type, shape_of, spell
from yasps.dialects.mat.calculus import ISOTROPIC_WIDTHS, PROJECTION_MODES
from yasps.dialects.rel.declarations import symbol

JOIN_OPERATIONS = ("sum", "mean")


class ReadOp(IRDLOperation):
    """A boundary node: the only way a body sees anything outside itself."""

    result = result_def()
    traits = traits_def(Pure())
    irdl_options = (ParsePropInAttrDict(),)

    @property
    def matrix_type(self) -> Matrix:
        return cast(Matrix, self.result.type)


@irdl_op_definition
class DataOp(ReadOp):
    """Stored numbers of the instance itself, or of an ancestor (its mesh or the scene)."""

    name = "rel.data"
    storage = prop_def(SymbolRefAttr)
    assembly_format = "$storage attr-dict `:` type($result)"

    def __init__(self, storage: str, type_: Matrix) -> None:
        super().__init__(properties={"storage": symbol(storage)}, result_types=[type_])


@irdl_op_definition
class RefOp(ReadOp):
    """Another attribute of the same lineage."""

    name = "rel.ref"
    attribute = prop_def(SymbolRefAttr)
    assembly_format = "$attribute attr-dict `:` type($result)"

    def __init__(self, attribute: str, type_: Matrix) -> None:
        super().__init__(properties={"attribute": symbol(attribute)}, result_types=[type_])


@irdl_op_definition
class JoinOp(ReadOp):
    """JOIN: values at the connected instances, one row of r c entries each (paper, eq. 2).

    Through a connectivity of variable arity their "sum" or "mean" instead, of the source's shape; placement indices are
    gathered one below the other, and 0 fills up to the largest arity.
    """

    name = "rel.join"
    source = prop_def(SymbolRefAttr)
    connectivity = prop_def(SymbolRefAttr)
    operation = opt_prop_def(StringAttr)
    assembly_format = "$source `through` $connectivity (`operation` $operation^)? attr-dict `:` type($result)"

    def __init__(self, source: str, connectivity: str, type_: Matrix, operation: str | None = None) -> None:
        properties: dict[str, Attribute] = {"source": symbol(source), "connectivity": symbol(connectivity)}
        if operation is not None:
            properties["operation"] = StringAttr(operation)
        super().__init__(properties=properties, result_types=[type_])

    @property
    def reduction(self) -> str | None:
        """ "sum", "mean" or None."""
        return self.operation.data if self.operation is not None else None

    def verify_(self) -> None:
        if self.reduction not in (None, *JOIN_OPERATIONS):
            raise VerifyException(f"operation must be one of {', '.join(JOIN_OPERATIONS)}, got {self.reduction!r}")


@irdl_op_definition
class UnionOp(ReadOp):
    """UNION: the value of the member this instance of a primitive union comes from (paper, 4.6).

    Placement indices of members with fewer parameters are padded with 0 (appendix A.3).
    """

    name = "rel.union"
    members = prop_def(ArrayAttr[SymbolRefAttr])
    assembly_format = "$members attr-dict `:` type($result)"

    def __init__(self, members: Sequence[str], type_: Matrix) -> None:
        super().__init__(properties={"members": ArrayAttr([symbol(m) for m in members])}, result_types=[type_])


@irdl_op_definition
class TargetIndexOp(ReadOp):
    """Where this instance of a target starts in the global gradient, counted from 1 (paper, appendix A.3)."""

    name = "rel.target_index"
    target = prop_def(SymbolRefAttr)
    assembly_format = "$target attr-dict `:` type($result)"

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
    irdl_options = (ParsePropInAttrDict(),)
    assembly_format = (
        "$function `(` $inputs `)` (`uniform` $uniform^)? attr-dict `:` functional-type(operands, results)"
    )

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


@irdl_op_definition
class ProjectOp(IRDLOperation):
    """The projection kernel on the packed upper triangle (row-major) of a `width` x `width` symmetric matrix.

    `isotropic in` f: the matrix is the Hessian of an energy isotropic in f, by f's entries (row-major, 3x3 or 3x2). The
    result is the same, but may be found by the singular values of f.
    """

    name = "rel.project"
    packed = operand_def()
    deformation = opt_operand_def()
    result = result_def()
    width = prop_def(IntegerAttr)
    mode = prop_def(StringAttr)
    traits = traits_def(Pure())
    irdl_options = (ParsePropInAttrDict(),)
    assembly_format = (
        "$packed `width` $width `mode` $mode (`isotropic` `in` $deformation^ `:` type($deformation))? attr-dict "
        "`:` type($packed) `->` type($result)"
    )

    def __init__(self, packed: SSAValue, width: int, mode: str, deformation: SSAValue | None = None) -> None:
        super().__init__(
            operands=[packed, deformation],
            properties={"width": IntegerAttr(width, i64), "mode": StringAttr(mode)},
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
        if self.mode.data not in PROJECTION_MODES:
            raise VerifyException(f"mode must be one of {', '.join(PROJECTION_MODES)}, got {self.mode.data!r}")


def packed_size(width: int) -> int:
    """Entries in the upper triangle of a width x width matrix."""
    return width * (width + 1) // 2


@irdl_op_definition
class YieldOp(IRDLOperation):
    """The value of an attribute."""

    name = "rel.yield"
    value = operand_def()
    traits = traits_def(IsTerminator())
    irdl_options = (ParsePropInAttrDict(),)
    assembly_format = "$value attr-dict `:` type($value)"

    def __init__(self, value: SSAValue) -> None:
        super().__init__(operands=[value])


def _total(values: Sequence[SSAValue]) -> int:
    return sum(shape_of(v)[0] * shape_of(v)[1] for v in values)


@irdl_op_definition
class YieldDerivativeOp(IRDLOperation):
    """An energy (1x1), its gradient (n x 1) and Hessian with respect to the n entries of the boundary inputs `wrt`.

    A missing Hessian is zero: the energy is affine. After `lower-to-scalar` the Hessian is the packed upper triangle.
    The energy is there to be checked together with its derivatives, which may be finite where it is not. So of an
    affine one it is the part without the inputs, and `lower-to-scalar` makes it cheaper: see
    passes/calculus/finite_check.py.
    """

    name = "rel.yield_derivative"
    energy = operand_def()
    gradient = operand_def()
    hessian = opt_operand_def()
    wrt = var_operand_def()
    traits = traits_def(IsTerminator())
    irdl_options = (ParsePropInAttrDict(), AttrSizedOperandSegments(as_property=True))
    assembly_format = (
        "$energy `:` type($energy) `gradient` $gradient `:` type($gradient) (`hessian` $hessian^ `:` type($hessian))? "
        "`wrt` $wrt `:` type($wrt) attr-dict"
    )

    def __init__(self, energy: SSAValue, gradient: SSAValue, hessian: SSAValue | None, wrt: Sequence[SSAValue]) -> None:
        super().__init__(operands=[[energy], [gradient], [] if hessian is None else [hessian], list(wrt)])

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
class YieldJacobianOp(IRDLOperation):
    """Jacobian (p x q): p entries of the attribute by q entries of the boundary inputs `wrt`.

    After `lower-to-scalar` it is J^T v (q x 1) for the cotangent v the body takes as its argument.
    """

    name = "rel.yield_jacobian"
    jacobian = operand_def()
    wrt = var_operand_def()
    traits = traits_def(IsTerminator())
    irdl_options = (ParsePropInAttrDict(),)
    assembly_format = "$jacobian `:` type($jacobian) `wrt` $wrt `:` type($wrt) attr-dict"

    def __init__(self, jacobian: SSAValue, wrt: Sequence[SSAValue]) -> None:
        super().__init__(operands=[jacobian, list(wrt)])

    def verify_(self) -> None:
        count = _total(self.wrt)
        shape = shape_of(self.jacobian)
        if shape[1] != count and shape != (count, 1):
            raise VerifyException(f"a Jacobian with respect to {count} entries has {count} columns, got {spell(shape)}")


@irdl_op_definition
class YieldCurvatureOp(IRDLOperation):
    """Hessian (q x q) of <v, h(w)> for the cotangent v that the body takes, with respect to the q entries of `wrt`.

    After `lower-to-scalar` it is the packed upper triangle.
    """

    name = "rel.yield_curvature"
    hessian = operand_def()
    wrt = var_operand_def()
    traits = traits_def(IsTerminator())
    irdl_options = (ParsePropInAttrDict(),)
    assembly_format = "$hessian `:` type($hessian) `wrt` $wrt `:` type($wrt) attr-dict"

    def __init__(self, hessian: SSAValue, wrt: Sequence[SSAValue]) -> None:
        super().__init__(operands=[hessian, list(wrt)])

    def verify_(self) -> None:
        count = _total(self.wrt)
        if shape_of(self.hessian) not in {(count, count), (packed_size(count), 1)}:
            raise VerifyException(
                f"a Hessian with respect to {count} entries is {count}x{count} (or its packed upper triangle), "
                f"got {spell(shape_of(self.hessian))}"
            )


READS = (DataOp, RefOp, JoinOp, UnionOp, TargetIndexOp)
OPS = (*READS, ApplyOp, ProjectOp, YieldOp, YieldDerivativeOp, YieldJacobianOp, YieldCurvatureOp)

__all__ = [
    "OPS",
    "READS",
    "ApplyOp",
    "DataOp",
    "JoinOp",
    "ProjectOp",
    "ReadOp",
    "RefOp",
    "TargetIndexOp",
    "UnionOp",
    "YieldCurvatureOp",
    "YieldDerivativeOp",
    "YieldJacobianOp",
    "YieldOp",
    "packed_size",
]
