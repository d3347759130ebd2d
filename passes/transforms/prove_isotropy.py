"""`prove-isotropy`: finds energies that see one matrix F, and of F only what rotations leave alone.

Their Hessian with respect to F falls apart in the frames of F's singular value decomposition, so that it is projected
at a fraction of the cost of its eigenvalues (`runtime/projection/isotropic.cpp`). The projection gets F as a second
operand; its meaning stays the same. An energy without a proof stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from xdsl.context import Context
from xdsl.dialects.builtin import ModuleOp, StringAttr
from xdsl.ir import Block, Operation, SSAValue
from xdsl.passes import ModulePass

from yasps.dialects.mat import MatOp, Matrix, shape_of
from yasps.dialects.mat.calculus import ISOTROPIC_WIDTHS, ProjectPsdOp
from yasps.dialects.rel import AttributeOp, Container, DerivativeOp, ReadOp, YieldDerivativeOp, name_of
from yasps.passes.analysis.dependence import DependenceMap, size_of
from yasps.passes.analysis.isotropy import depends_on_invariants, is_deformation
from yasps.passes.bodies import BodyBuilder, containers, inline_body
from yasps.passes.calculus.linear_cut import linear_cut
from yasps.passes.errors import working_on


@dataclass(frozen=True)
class ProveIsotropy(ModulePass):
    """See the module."""

    name = "prove-isotropy"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            attributes = {a.symbol: a for a in container.body.block.ops if isinstance(a, AttributeOp)}
            for derivative in _derivatives(container):
                energy = attributes.get(name_of(derivative.attribute))
                if energy is not None and energy.body.blocks:
                    with working_on(energy.symbol, energy):
                        _prove(derivative, energy, attributes)


def _derivatives(container: Container) -> list[DerivativeOp]:
    return [op for op in container.body.block.ops if isinstance(op, DerivativeOp)]


def _prove(derivative: DerivativeOp, energy: AttributeOp, attributes: dict[str, AttributeOp]) -> None:
    block = derivative.body.block
    projection = next((op for op in block.ops if isinstance(op, ProjectPsdOp)), None)
    if projection is None or len(projection.operands) > 1:
        return
    width = shape_of(projection.result)[0]
    if width not in ISOTROPIC_WIDTHS:
        return
    deformation = _isotropic_in(derivative, energy, attributes, width)
    if deformation is None:
        return
    matrix = cast(Matrix, projection.result.type)
    told = ProjectPsdOp([projection.operands[0], deformation], matrix, dict(projection.properties))
    block.insert_op_before(told, projection)
    projection.result.replace_all_uses_with(told.result)
    block.erase_op(projection)
    assert derivative.projects is not None
    shape = "3x3" if width == 9 else "3x2"
    why = f"by singular values: isotropic in this {shape} matrix"
    derivative.projects = StringAttr(f"{derivative.projects.data}; {why}")


def _isotropic_in(
    derivative: DerivativeOp, energy: AttributeOp, attributes: dict[str, AttributeOp], width: int
) -> SSAValue | None:
    """The value of the derivative's body that the energy is isotropic in, and that the projected Hessian is of."""
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    b = BodyBuilder(Block())
    value = inline_body(b, attributes, energy)
    same = _same_values(b.body, derivative.body.block)
    inputs: list[SSAValue] = [
        op.result for op in b.body.ops if isinstance(op, ReadOp) and same.get(op.result) in set(terminator.wrt)
    ]
    if len(inputs) < len(terminator.wrt):
        return None
    # As `differentiate` did: a Hessian this wide that is not in all inputs is in the cut.
    cut = linear_cut(DependenceMap(b.body, inputs), inputs)
    if len(cut) != 1 or size_of(cut[0]) != width or not is_deformation(b.body, cut[0]):
        return None
    return same.get(cut[0]) if depends_on_invariants(b.body, value, cut[0], inputs) else None


def _same_values(one: Block, other: Block) -> dict[SSAValue, SSAValue]:
    """For values of one body those of another that are computed in the same way from the same reads."""

    def key(op: Operation, operands: list[SSAValue]) -> tuple[object, ...]:
        properties = sorted(op.properties.items(), key=lambda item: item[0])
        return (op.name, op.results[0].type, *map(id, operands), *properties)

    computed = {key(op, list(op.operands)): op.results[0] for op in other.ops if isinstance(op, MatOp | ReadOp)}
    same: dict[SSAValue, SSAValue] = {}
    for op in one.ops:
        operands = [same.get(operand) for operand in op.operands]
        known = [operand for operand in operands if operand is not None]
        found = computed.get(key(op, known)) if len(known) == len(operands) else None
        if found is not None:
            same[op.results[0]] = found
    return same
