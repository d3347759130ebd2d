"""`differentiate`: gradients, Hessians and Jacobians of a scene (paper, section 5, algorithms 1 to 3).

Each energy is split at its boundary nodes. `rel.derivative` holds its gradient and Hessian with respect to the boundary
inputs that lead to a target; `rel.jacobian` holds, for every attribute a JOIN or UNION leads through on the way, how it
changes with *its* boundary inputs, and `rel.curvature`, only for a nonlinear one, its second derivatives contracted
with a cotangent. Derivatives of shared attributes are so made once and used by every energy.

Inside an energy the smallest linear cut y = L x + c is kept: phi's derivatives are taken with respect to y and pulled
back as L^T g and L^T H L (eq. 3; L is free of the targets, so the curvature term is zero).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from xdsl.context import Context
from xdsl.dialects.builtin import ModuleOp, UnitAttr
from xdsl.ir import Block, Operation, SSAValue
from xdsl.passes import ModulePass

from yasps.dialects.mat import MatOp, matrix_type, shape_of
from yasps.dialects.mat.algebra import TransposeOp
from yasps.dialects.mat.builder import named
from yasps.dialects.mat.calculus import CongruenceOp, GivenDerivativeOp
from yasps.dialects.mat.structure import ReshapeOp
from yasps.dialects.rel import (
    AttributeOp,
    Container,
    CurvatureOp,
    DerivativeOp,
    EnergyOp,
    JacobianOp,
    JoinOp,
    ReadOp,
    RefOp,
    UnionOp,
    YieldCurvatureOp,
    YieldDerivativeOp,
    YieldJacobianOp,
    name_of,
    symbol,
)
from yasps.passes.analysis.dependence import Dependence, DependenceMap, size_of
from yasps.passes.analysis.local_width import LocalWidth
from yasps.passes.analysis.names import value_name
from yasps.passes.analysis.reach import Reach
from yasps.passes.bodies import BodyBuilder, containers, inline_body, is_union, source_of
from yasps.passes.calculus.derivatives import directional, jacobian, pull_back, stacked
from yasps.passes.calculus.linear_cut import constant_map, linear_cut, sees_beside
from yasps.passes.errors import working_on


@dataclass(frozen=True)
class Differentiate(ModulePass):
    """See the module."""

    name = "differentiate"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            _Differentiation(container).run()
            drop_given_derivatives(container)


class _Differentiation:
    def __init__(self, container: Container) -> None:
        block = container.body.block
        self.block = block
        self.attributes = {op.symbol: op for op in block.ops if isinstance(op, AttributeOp)}
        self.energies = [op for op in block.ops if isinstance(op, EnergyOp)]
        self.reach = Reach(block)
        self.width = LocalWidth(block, self.reach)
        self._jacobians: dict[str, JacobianOp] = {}
        self._curvatures: dict[str, CurvatureOp] = {}

    def run(self) -> None:
        made: list[Operation] = []
        for energy in self.energies:
            attribute = self.attributes[name_of(energy.attribute)]
            with working_on(attribute.symbol, attribute):
                derivative = self.differentiate_energy(energy)
            if derivative is not None:
                made.append(derivative)
        for op in (*self._jacobians.values(), *self._curvatures.values(), *made):
            self.block.add_op(op)

    def copy_body(
        self, attribute: AttributeOp, block: Block | None = None
    ) -> tuple[BodyBuilder, SSAValue, list[SSAValue]]:
        """A new body with the attribute's primal operations, its value, and its active boundary inputs."""
        b = BodyBuilder(block or Block())
        value = inline_body(b, self.attributes, attribute)
        active: list[SSAValue] = [op.result for op in b.body.ops if isinstance(op, ReadOp) and self.reach.is_active(op)]
        return b, value, active

    def differentiate_energy(self, energy: EnergyOp) -> DerivativeOp | None:
        attribute = self.attributes[name_of(energy.attribute)]
        b, value, inputs = self.copy_body(attribute)
        if not inputs:
            return None  # constant with respect to every target: no gradient, no Hessian
        self.width.check_expanded(inputs, curved=False)
        dependence = DependenceMap(b.body, inputs)
        one = b.number(1.0)
        hessian: SSAValue | None = None
        cut: list[SSAValue] = []
        checked = value
        if dependence[value] is Dependence.NONLINEAR:
            self.width.check_inputs(inputs)
            hessian, cut = self.hessian(b, dependence, value, one, inputs)
        else:
            checked = _constant_part(b, dependence, value, inputs)
        # From the top again: the energy may depend on the inputs linearly beside the cut. Value numbering makes what
        # both traversals share once.
        gradients = pull_back(b, dependence, {value: one}, inputs)
        gradient = named(stacked(b, inputs, gradients), "gradient")
        b.append(YieldDerivativeOp(checked, gradient, hessian, inputs, cut))
        for read in inputs:
            self.need_jacobians(read.owner)
        derivative = DerivativeOp(f"{attribute.symbol}.derivative", energy, attribute.owner, b.body)
        derivative.location = attribute.location
        if any(self.is_curved_read(read.owner) for read in inputs):
            self.width.check_expanded(inputs, curved=True)
            derivative.curved = UnitAttr()
        return derivative

    def hessian(
        self, b: BodyBuilder, dependence: DependenceMap, value: SSAValue, one: SSAValue, inputs: list[SSAValue]
    ) -> tuple[SSAValue, list[SSAValue]]:
        """L^T S L, with S the Hessian with respect to the smallest linear cut, and that cut.

        The cut is empty where S is with respect to constant combinations of several values, or stands for given
        eigenvalues.
        """
        given = _given_hessian(dependence, value)
        if given is not None:
            symmetric, arguments = given
            whole = named(b.congruence(named(symmetric, "given_hessian"), jacobian(b, arguments, inputs)), "hessian")
            return whole, [] if isinstance(symmetric.owner, CongruenceOp) else arguments
        cut = linear_cut(dependence, inputs)
        if len(cut) == 1 and value_name(cut[0]) is None:
            cut[0].name_hint = "cut"
        constant = constant_map(dependence, inputs, sum(size_of(v) for v in cut))
        values = cut if constant is None else constant.values
        gradients = pull_back(b, dependence, {value: one}, values)
        listed = [gradients.get(v, b.zeros(shape_of(v))) for v in values]
        if sees_beside(listed, values, inputs):  # phi's derivatives would miss that
            constant, cut, values = None, inputs, inputs
            gradients = pull_back(b, dependence, {value: one}, values)
            listed = [gradients.get(v, b.zeros(shape_of(v))) for v in values]
        if constant is None:
            symmetric = named(jacobian(b, listed, cut), "hessian_of_cut")
            return named(b.congruence(symmetric, jacobian(b, cut, inputs)), "hessian"), cut
        directions = []
        for column in constant.expand.T:
            parts = np.split(column, np.cumsum([size_of(v) for v in values])[:-1])
            seeds = {v: b.constant(part.reshape(shape_of(v))) for v, part in zip(values, parts, strict=True)}
            directions.append(seeds)
        moved = directional(b, listed, directions)
        symmetric = b.matmul(b.constant(constant.expand.T), moved)
        return named(b.congruence(symmetric, b.constant(constant.rows)), "hessian"), []

    def is_curved(self, name: str) -> bool:
        """Is the attribute, or one it reads on the way to a target, nonlinear? Known once its Jacobians are made."""
        if name in self._curvatures:
            return True
        if name in self.attributes and is_union(self.attributes[name]):
            return self.is_curved_read(self.attributes[name].body.block.first_op)
        if name not in self._jacobians:
            return False
        terminator = self._jacobians[name].body.block.last_op
        assert isinstance(terminator, YieldJacobianOp)
        return any(self.is_curved_read(value.owner) for value in terminator.wrt)

    def is_curved_read(self, read: object) -> bool:
        """Does this boundary read lead through a nonlinear attribute?"""
        if isinstance(read, UnionOp):
            return any(self.is_curved(name_of(member)) for member in read.members)
        source = source_of(read) if isinstance(read, ReadOp) else None
        return source is not None and self.is_curved(source)

    def need_jacobians(self, read: object) -> None:
        """Makes the Jacobians of the attributes this boundary read leads through."""
        if isinstance(read, UnionOp):
            for member in read.members:
                self.need_jacobian(name_of(member))
        elif isinstance(read, JoinOp | RefOp):
            source = source_of(read)
            if source is not None:
                self.need_jacobian(source)

    def need_jacobian(self, name: str) -> None:
        if name in self._jacobians or name not in self.attributes or not self.reach.reaches_target(name):
            return
        attribute = self.attributes[name]
        if is_union(attribute):
            self.need_jacobians(attribute.body.block.first_op)
            return
        with working_on(name, attribute):
            self.make_jacobian(attribute)

    def make_jacobian(self, attribute: AttributeOp) -> None:
        """The attribute's Jacobian, its curvature if it is nonlinear, and those of what it reads."""
        name = attribute.symbol
        b, value, inputs = self.copy_body(attribute)
        dependence = DependenceMap(b.body, inputs)
        if dependence[value] is Dependence.NONLINEAR:
            self._curvatures[name] = self.curvature(attribute)
        b.append(YieldJacobianOp(jacobian(b, [value], inputs), inputs))
        self._jacobians[name] = JacobianOp(f"{name}.jacobian", symbol(attribute.symbol), attribute.owner, b.body)
        self._jacobians[name].location = attribute.location
        for read in inputs:
            self.need_jacobians(read.owner)

    def curvature(self, attribute: AttributeOp) -> CurvatureOp:
        """Hessian of <v, h(w)> for a nonlinear attribute h: the adjoint form of eq. 3's second term."""
        rows, cols = attribute.matrix_type.get_shape()
        b, value, inputs = self.copy_body(attribute, Block(arg_types=[matrix_type((rows * cols, 1))]))
        self.width.check_inputs(inputs)
        cotangent = b.reshape(named(b.body.args[0], "cotangent"), (rows, cols))
        gradients = pull_back(b, DependenceMap(b.body, inputs), {value: cotangent}, inputs)
        hessian = jacobian(b, [gradients.get(v, b.zeros(shape_of(v))) for v in inputs], inputs)
        b.append(YieldCurvatureOp(hessian, inputs))
        name = f"{attribute.symbol}.curvature"
        made = CurvatureOp(name, symbol(attribute.symbol), attribute.owner, b.body)
        made.location = attribute.location
        return made


def _given_hessian(dependence: DependenceMap, value: SSAValue) -> tuple[SSAValue, list[SSAValue]] | None:
    """The Hessian that is given with the energy, and its arguments, if all of these are affine in the inputs."""
    energy = value.owner
    slope = energy.operands[1].owner if isinstance(energy, GivenDerivativeOp) else None
    gradient = slope.operands[0].owner if isinstance(slope, ReshapeOp | TransposeOp) else slope
    if not isinstance(energy, GivenDerivativeOp) or not isinstance(gradient, GivenDerivativeOp):
        return None
    arguments = list(energy.operands[2:])
    if arguments != list(gradient.operands[2:]):
        return None
    if any(dependence[argument] is not Dependence.AFFINE for argument in arguments):
        return None
    return gradient.operands[1], arguments


def drop_given_derivatives(container: Container) -> None:
    """Leaves of values with given derivatives the values, and of what only these derivatives are made of nothing."""
    for definition in container.body.block.ops:
        for block in (block for region in definition.regions for block in region.blocks):
            given = [op for op in block.ops if isinstance(op, GivenDerivativeOp)]
            for op in given:
                op.result.replace_all_uses_with(op.operands[0])
            if given:
                _erase_unused(block)


def _erase_unused(block: Block) -> None:
    for op in reversed([op for op in block.ops if isinstance(op, MatOp)]):
        if not op.result.uses:
            block.erase_op(op)


def _constant_part(b: BodyBuilder, dependence: DependenceMap, value: SSAValue, inputs: list[SSAValue]) -> SSAValue:
    """The affine value for inputs of 0, conditions left as they are: what it has of its own beside its gradient."""
    values = {read: b.zeros(shape_of(read)) for read in inputs}
    for op in list(b.body.ops):
        if isinstance(op, MatOp) and dependence.is_active(op.result):
            values[op.result] = b.copy(op, [values.get(operand, operand) for operand in op.operands])
    return values.get(value, value)
