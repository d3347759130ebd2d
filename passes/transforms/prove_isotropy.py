"""`prove-isotropy`: finds energies that see one matrix F, or two vectors, and of them only what rotations leave alone.

Their Hessian with respect to F falls apart in the frames of F's singular value decomposition, so that it is projected
at a fraction of the cost of its eigenvalues (`runtime/projection/isotropic.cpp`); that of two vectors in the plane that
both lie in (`runtime/projection/two_vectors.cpp`). F, or the vectors, are the cut that `differentiate` wrote down. The
projection gets them as a second operand; its meaning stays the same. An energy without a proof stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from xdsl.context import Context
from xdsl.dialects.builtin import ModuleOp, StringAttr
from xdsl.ir import Block
from xdsl.passes import ModulePass

from yasps.dialects.mat import Matrix, shape_of
from yasps.dialects.mat.builder import MatBuilder
from yasps.dialects.mat.calculus import ISOTROPIC_WIDTHS, ProjectPsdOp
from yasps.dialects.rel import DerivativeOp, YieldDerivativeOp, name_of
from yasps.passes.analysis.dependence import size_of
from yasps.passes.analysis.isotropy import are_two_vectors, depends_on_invariants, is_deformation
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
    terminator = block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    if projection is None or len(projection.operands) > 1:
        return
    width, cut = shape_of(projection.result)[0], list(terminator.cut)
    if sum(size_of(value) for value in cut) != width:
        return
    is_matrix = width in ISOTROPIC_WIDTHS and len(cut) == 1 and is_deformation(block, cut[0])
    if not is_matrix and not are_two_vectors(cut):
        return
    if not depends_on_invariants(block, terminator.energy, cut, terminator.wrt):
        return
    if is_matrix:
        seen, shape = cut[0], "3x3" if width == 9 else "3x2"
        why = f"by singular values: isotropic in this {shape} matrix"
    else:
        b = MatBuilder(Block())
        seen = b.concat_rows([b.reshape(value, (1, 3)) for value in cut])
        for op in list(b.body.ops):
            block.insert_op_before(b.body.detach_op(op), projection)
        why = "in the plane of two vectors and across it: isotropic in them"
    matrix = cast(Matrix, projection.result.type)
    told = ProjectPsdOp([projection.operands[0], seen], matrix, dict(projection.properties))
    block.insert_op_before(told, projection)
    told.result.name_hint = projection.result.name_hint
    projection.result.replace_all_uses_with(told.result)
    block.erase_op(projection)
    assert derivative.projects is not None
    derivative.projects = StringAttr(f"{derivative.projects.data}; {why}")
