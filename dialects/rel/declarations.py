"""`rel` operations that declare what a scene holds: entities, connectivities, stored data, attributes, energies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray
from xdsl.dialects.builtin import (
    I64,
    ArrayAttr,
    DenseIntOrFPElementsAttr,
    IntegerAttr,
    StringAttr,
    SymbolNameConstraint,
    SymbolRefAttr,
    UnitAttr,
    i64,
)
from xdsl.ir import Attribute, Block, Operation, Region
from xdsl.irdl import (
    IRDLOperation,
    ParsePropInAttrDict,
    irdl_op_definition,
    opt_prop_def,
    prop_def,
    region_def,
    traits_def,
)
from xdsl.traits import IsolatedFromAbove, NoTerminator, OpTrait, SymbolOpInterface, SymbolTable
from xdsl.utils.exceptions import VerifyException

from yasps.dialects.mat import Matrix, Shape
from yasps.dialects.mat.base import MOST_ENTRIES, dense, is_matrix_type
from yasps.dialects.rel.syntax import DeclaredType, Numbers

PROJECTIONS = ("clamp", "abs", "none")


def symbol(name: str) -> SymbolRefAttr:
    return SymbolRefAttr(name)


class SceneLaws(OpTrait):
    """The paper's laws (sections 4.2 to 4.6), checked for the whole container in one walk."""

    def verify(self, op: Operation) -> None:
        from yasps.dialects.rel.laws import verify_laws

        verify_laws(op)


class Container(IRDLOperation):
    """A symbol table of declarations: a whole scene, or what one object file is made from."""

    sym_name = prop_def(SymbolNameConstraint())
    body = region_def("single_block")
    traits = traits_def(SymbolOpInterface(), SymbolTable(), NoTerminator(), IsolatedFromAbove(), SceneLaws())
    irdl_options = (ParsePropInAttrDict(),)
    assembly_format = "$sym_name attr-dict-with-keyword $body"

    def __init__(self, name: str, ops: Sequence[Operation] = ()) -> None:
        super().__init__(properties={"sym_name": StringAttr(name)}, regions=[Region(Block(list(ops)))])


@irdl_op_definition
class SceneOp(Container):
    """The global scope; meshes, primitives and attributes stand inside."""

    name = "rel.scene"


@irdl_op_definition
class ObjectOp(Container):
    """Everything one object file is generated from: its functions and declarations of what they use.

    `entries` says how others run it: "batch" over all instances, "call" for one instance.
    """

    name = "rel.object"
    entries = prop_def(ArrayAttr[StringAttr])
    assembly_format = "$sym_name `entries` $entries attr-dict-with-keyword $body"

    def __init__(self, name: str, ops: Sequence[Operation], entries: Sequence[str]) -> None:
        super().__init__(name, ops)
        self.entries = ArrayAttr([StringAttr(entry) for entry in entries])


class Declaration(IRDLOperation):
    """A named thing of the scene."""

    sym_name = prop_def(SymbolNameConstraint())
    traits = traits_def(SymbolOpInterface())
    irdl_options = (ParsePropInAttrDict(),)

    @property
    def symbol(self) -> str:
        return self.sym_name.data


@irdl_op_definition
class MeshOp(Declaration):
    """A named group of primitives (paper, 4.1)."""

    name = "rel.mesh"
    scene = prop_def(SymbolRefAttr)
    assembly_format = "$sym_name `in` $scene attr-dict"

    def __init__(self, name: str, scene: str) -> None:
        super().__init__(properties={"sym_name": StringAttr(name), "scene": symbol(scene)})


@irdl_op_definition
class PrimitiveOp(Declaration):
    """A collection of instances. A dynamic one changes its number of instances while the scene lives."""

    name = "rel.primitive"
    mesh = prop_def(SymbolRefAttr)
    size = opt_prop_def(IntegerAttr[I64])
    dynamic = opt_prop_def(UnitAttr)
    assembly_format = "$sym_name `in` $mesh (`size` $size^)? (`dynamic` $dynamic^)? attr-dict"

    def __init__(self, name: str, mesh: str, size: int, dynamic: bool) -> None:
        properties: dict[str, Attribute] = {"sym_name": StringAttr(name), "mesh": symbol(mesh)}
        if dynamic:
            properties["dynamic"] = UnitAttr()
        else:
            properties["size"] = IntegerAttr(size, i64)
        super().__init__(properties=properties)


@irdl_op_definition
class PrimitiveUnionOp(Declaration):
    """The disjoint union of primitives, in this order (paper, 4.6)."""

    name = "rel.primitive_union"
    mesh = prop_def(SymbolRefAttr)
    members = prop_def(ArrayAttr[SymbolRefAttr])
    assembly_format = "$sym_name `in` $mesh `of` $members attr-dict"

    def __init__(self, name: str, mesh: str, members: Sequence[str]) -> None:
        super().__init__(
            properties={
                "sym_name": StringAttr(name),
                "mesh": symbol(mesh),
                "members": ArrayAttr([symbol(m) for m in members]),
            }
        )


@irdl_op_definition
class ConnectivityOp(Declaration):
    """A map from each instance of one primitive to `arity` instances of another (paper, 4.4).

    Of a `variable` one, `arity` is the most instances any instance refers to; -1 fills the rows of the others.
    """

    name = "rel.connectivity"
    source = prop_def(SymbolRefAttr)
    target = prop_def(SymbolRefAttr)
    arity = prop_def(IntegerAttr[I64])
    variable = opt_prop_def(UnitAttr)
    assembly_format = "$sym_name `from` $source `to` $target `arity` $arity (`variable` $variable^)? attr-dict"

    def __init__(self, name: str, source: str, target: str, arity: int, variable: bool = False) -> None:
        properties: dict[str, Attribute] = {
            "sym_name": StringAttr(name),
            "source": symbol(source),
            "target": symbol(target),
            "arity": IntegerAttr(arity, i64),
        }
        if variable:
            properties["variable"] = UnitAttr()
        super().__init__(properties=properties)


@irdl_op_definition
class StorageOp(Declaration):
    """Numbers the user supplies, one matrix for each instance of the owner (paper, 4.2).

    A constant never takes part in differentiation. `numbers`: those of a constant of the scene that `lift-constants`
    took out of formulas; no code depends on them.
    """

    name = "rel.storage"
    owner = prop_def(SymbolRefAttr)
    type = prop_def(Attribute)
    constant = opt_prop_def(UnitAttr)
    numbers = opt_prop_def(DenseIntOrFPElementsAttr)
    custom_directives = (DeclaredType, Numbers)
    assembly_format = (
        "$sym_name `on` $owner `:` custom<DeclaredType>($type) (`constant` $constant^)? "
        "(`numbers` custom<Numbers>($numbers)^)? attr-dict"
    )

    def __init__(
        self, name: str, owner: str, type_: Matrix, constant: bool, numbers: NDArray[np.float64] | None = None
    ) -> None:
        properties: dict[str, Attribute] = {"sym_name": StringAttr(name), "owner": symbol(owner), "type": type_}
        if constant:
            properties["constant"] = UnitAttr()
        if numbers is not None:
            properties["numbers"] = dense(numbers, type_)
        super().__init__(properties=properties)

    def verify_(self) -> None:
        if not is_matrix_type(self.type):
            raise VerifyException(
                f"{self.symbol} must be a matrix tensor<RxCxf64> of 1 to {MOST_ENTRIES} entries, not {self.type}"
            )
        if self.numbers is not None and (self.constant is None or self.numbers.type != self.type):
            raise VerifyException(f"{self.symbol} has numbers: it must be a constant of their type {self.numbers.type}")

    def known_numbers(self) -> NDArray[np.float64] | None:
        """The numbers taken out of formulas, [1, rows, columns]; None for numbers of the user."""
        if self.numbers is None:
            return None
        return np.array(self.numbers.get_values(), np.float64).reshape(1, *storage_shape(self))


@irdl_op_definition
class AttributeOp(Declaration):
    """A computed value on every instance of its owner. Without a body it is a declaration (defined elsewhere).

    Of an `output` attribute the user wants the values of all instances.
    """

    name = "rel.attribute"
    output = opt_prop_def(UnitAttr)
    owner = prop_def(SymbolRefAttr)
    type = prop_def(Attribute)
    body = region_def()
    traits = traits_def(IsolatedFromAbove())
    custom_directives = (DeclaredType,)
    assembly_format = (
        "$sym_name `on` $owner `:` custom<DeclaredType>($type) (`output` $output^)? attr-dict-with-keyword ($body^)?"
    )

    def __init__(self, name: str, owner: str, type_: Matrix, body: Block | None) -> None:
        super().__init__(
            properties={"sym_name": StringAttr(name), "owner": symbol(owner), "type": type_},
            regions=[Region(body) if body is not None else Region()],
        )

    @property
    def matrix_type(self) -> Matrix:
        return cast(Matrix, self.type)


@irdl_op_definition
class EnergyOp(IRDLOperation):
    """This attribute is a term of the energy to minimise (paper, 4.7)."""

    name = "rel.energy"
    attribute = prop_def(SymbolRefAttr)
    projection = prop_def(StringAttr)
    dynamic = opt_prop_def(UnitAttr)
    irdl_options = (ParsePropInAttrDict(),)
    assembly_format = "$attribute `projection` $projection (`dynamic` $dynamic^)? attr-dict"

    def __init__(self, attribute: str, projection: str, dynamic: bool) -> None:
        properties: dict[str, Attribute] = {"attribute": symbol(attribute), "projection": StringAttr(projection)}
        if dynamic:
            properties["dynamic"] = UnitAttr()
        super().__init__(properties=properties)

    def verify_(self) -> None:
        if self.projection.data not in PROJECTIONS:
            raise VerifyException(f"projection must be one of {', '.join(PROJECTIONS)}, got {self.projection.data!r}")


@irdl_op_definition
class TargetOp(IRDLOperation):
    """This stored variable is minimised over. Targets are numbered in order (paper, appendix A.1)."""

    name = "rel.target"
    variable = prop_def(SymbolRefAttr)
    irdl_options = (ParsePropInAttrDict(),)
    assembly_format = "$variable attr-dict"

    def __init__(self, variable: str) -> None:
        super().__init__(properties={"variable": symbol(variable)})


@irdl_op_definition
class DerivativeOp(Declaration):
    """Gradient and Hessian of an energy with respect to its boundary inputs (paper, 5.3).

    `indices` names the attribute that computes where they go (appendix A); `projects` says where the Hessian is
    made positive semi-definite, how wide and why. A `curved` energy reads attributes that are nonlinear in the targets:
    the curvature term of eq. 3 is added, and its Hessian is projected as a whole, expanded to the targets (7.2).
    """

    name = "rel.derivative"
    attribute = prop_def(SymbolRefAttr)
    owner = prop_def(SymbolRefAttr)
    projection = prop_def(StringAttr)
    dynamic = opt_prop_def(UnitAttr)
    indices = opt_prop_def(SymbolRefAttr)
    projects = opt_prop_def(StringAttr)
    curved = opt_prop_def(UnitAttr)
    body = region_def("single_block")
    traits = traits_def(IsolatedFromAbove())
    assembly_format = (
        "$sym_name `of` $attribute `on` $owner `projection` $projection (`dynamic` $dynamic^)? "
        "(`curved` $curved^)? (`indices` $indices^)? (`projects` $projects^)? attr-dict-with-keyword $body"
    )

    def __init__(self, name: str, energy: EnergyOp, owner: SymbolRefAttr, body: Block) -> None:
        properties: dict[str, Attribute] = {
            "sym_name": StringAttr(name),
            "attribute": energy.attribute,
            "owner": owner,
            "projection": energy.projection,
        }
        if energy.dynamic is not None:
            properties["dynamic"] = UnitAttr()
        super().__init__(properties=properties, regions=[Region(body)])


@irdl_op_definition
class JacobianOp(Declaration):
    """How an attribute between energies and targets changes with its boundary inputs.

    Joins and unions read the values of `attribute` at other instances; derivatives go back through this Jacobian.
    """

    name = "rel.jacobian"
    attribute = prop_def(SymbolRefAttr)
    owner = prop_def(SymbolRefAttr)
    indices = opt_prop_def(SymbolRefAttr)
    body = region_def("single_block")
    traits = traits_def(IsolatedFromAbove())
    assembly_format = "$sym_name `of` $attribute `on` $owner (`indices` $indices^)? attr-dict-with-keyword $body"

    def __init__(self, name: str, attribute: SymbolRefAttr, owner: SymbolRefAttr, body: Block) -> None:
        super().__init__(
            properties={"sym_name": StringAttr(name), "attribute": attribute, "owner": owner}, regions=[Region(body)]
        )


@irdl_op_definition
class CurvatureOp(Declaration):
    """Second derivatives of a nonlinear attribute h, contracted with a cotangent v: the Hessian of <v, h(w)>.

    This is the second term of eq. 3 in adjoint form: one q x q matrix, never a third-order object.
    """

    name = "rel.curvature"
    attribute = prop_def(SymbolRefAttr)
    owner = prop_def(SymbolRefAttr)
    body = region_def("single_block")
    traits = traits_def(IsolatedFromAbove())
    assembly_format = "$sym_name `of` $attribute `on` $owner attr-dict-with-keyword $body"

    def __init__(self, name: str, attribute: SymbolRefAttr, owner: SymbolRefAttr, body: Block) -> None:
        super().__init__(
            properties={"sym_name": StringAttr(name), "attribute": attribute, "owner": owner}, regions=[Region(body)]
        )


def name_of(reference: SymbolRefAttr) -> str:
    """The symbol a reference names."""
    return reference.root_reference.data


def storage_shape(op: StorageOp) -> Shape:
    rows, cols = cast(Matrix, op.type).get_shape()
    return rows, cols


OPS = (
    SceneOp,
    ObjectOp,
    MeshOp,
    PrimitiveOp,
    PrimitiveUnionOp,
    ConnectivityOp,
    StorageOp,
    AttributeOp,
    EnergyOp,
    TargetOp,
    DerivativeOp,
    JacobianOp,
    CurvatureOp,
)
