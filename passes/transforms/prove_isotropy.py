"""`prove-isotropy`: finds energies that see one matrix F, and of F only what rotations leave alone.

Their Hessian with respect to F falls apart in the frames of F's singular value decomposition, so that it is projected
at a fraction of the cost of its eigenvalues (`runtime/projection/isotropic.cpp`). F is the cut that `differentiate`
wrote down. The projection gets it as a second operand; its meaning stays the same. An energy without a proof stays as
it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from xdsl.context import Context
from xdsl.dialects.builtin import ModuleOp, StringAttr
from xdsl.ir import SSAValue
from xdsl.passes import ModulePass

from yasps.dialects.mat import Matrix, shape_of
from yasps.dialects.mat.calculus import ISOTROPIC_WIDTHS, ProjectPsdOp
from yasps.dialects.rel import DerivativeOp, YieldDerivativeOp, name_of
from yasps.passes.analysis.dependence import size_of
from yasps.passes.analysis.isotropy import depends_on_invariants, is_deformation
from yasps.passes.bodies import containers
from yasps.passes.errors import working_on


@dataclass(frozen=True)
class ProveIsotropy(ModulePass):
    """See the module."""

    name = "prove-isotropy"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            for derivative in container.body.block.ops:
                if isinstance(derivative, DerivativeOp):
                    with working_on(name_of(derivative.attribute), derivative):
                        _prove(derivative)


def _prove(derivative: DerivativeOp) -> None:
    block = derivative.body.block
    projection = next((op for op in block.ops if isinstance(op, ProjectPsdOp)), None)
    if projection is None or len(projection.operands) > 1:
        return
    width = shape_of(projection.result)[0]
    deformation = _isotropic_in(derivative, width) if width in ISOTROPIC_WIDTHS else None
    if deformation is None:
        return
    matrix = cast(Matrix, projection.result.type)
    told = ProjectPsdOp([projection.operands[0], deformation], matrix, dict(projection.properties))
    block.insert_op_before(told, projection)
    told.result.name_hint = projection.result.name_hint
    projection.result.replace_all_uses_with(told.result)
    block.erase_op(projection)
    assert derivative.projects is not None
    shape = "3x3" if width == 9 else "3x2"
    why = f"by singular values: isotropic in this {shape} matrix"
    derivative.projects = StringAttr(f"{derivative.projects.data}; {why}")


def _isotropic_in(derivative: DerivativeOp, width: int) -> SSAValue | None:
    """The value of the derivative's body that the energy is isotropic in, and that the projected Hessian is of."""
    block = derivative.body.block
    terminator = block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    if len(terminator.cut) != 1:
        return None
    (deformation,) = terminator.cut
    if size_of(deformation) != width or not is_deformation(block, deformation):
        return None
    return deformation if depends_on_invariants(block, terminator.energy, deformation, terminator.wrt) else None
