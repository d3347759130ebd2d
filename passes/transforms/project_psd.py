"""`project-psd`: decides for each energy where its Hessian is made positive semi-definite (paper, 5.4, 7.2, 10.4).

Where all layers below an energy are affine, projecting at the boundary is enough; and where the Hessian is L^T S L with
L free of the targets, S is smaller still and is projected instead. So are the eigenvalues themselves, S being diagonal,
where the user gave the eigensystem. Where a layer below is nonlinear, its curvature term
is part of the Hessian, and only the whole local Hessian, expanded to the targets and compressed, can be projected.
"""

from __future__ import annotations

from dataclasses import dataclass

from xdsl.context import Context
from xdsl.dialects.builtin import ModuleOp, StringAttr
from xdsl.ir import SSAValue
from xdsl.passes import ModulePass

from yasps.dialects.mat import MatBuilder, shape_of
from yasps.dialects.mat.builder import named
from yasps.dialects.mat.calculus import CongruenceOp
from yasps.dialects.rel import DerivativeOp, YieldDerivativeOp
from yasps.passes.analysis.dependence import DependenceMap
from yasps.passes.bodies import containers


@dataclass(frozen=True)
class ProjectPsd(ModulePass):
    """See the module."""

    name = "project-psd"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            for derivative in container.body.block.ops:
                if isinstance(derivative, DerivativeOp):
                    _project(derivative)


def _project(derivative: DerivativeOp) -> None:
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    mode = derivative.projection.data
    if terminator.hessian is None and derivative.curved is None:
        derivative.projects = StringAttr("nowhere: the energy is affine, its Hessian is zero")
        return
    if mode == "none":
        derivative.projects = StringAttr("nowhere: switched off")
        return
    if derivative.curved is not None:
        derivative.projects = StringAttr(
            "the whole local Hessian, expanded to the targets: an input is nonlinear in them"
        )
        return
    assert terminator.hessian is not None
    symmetric, is_given = _innermost(derivative, terminator)
    full, width = shape_of(terminator.hessian)[0], shape_of(symmetric)[0]
    reason = "the energy reads its inputs through a linear cut" if width < full else "no narrower linear cut"
    if is_given:
        reason = "its eigenvalues are given"
    derivative.projects = StringAttr(f"{width}x{width} of {full}x{full}: {reason}")
    _insert(derivative, terminator, symmetric, mode)


def _innermost(derivative: DerivativeOp, terminator: YieldDerivativeOp) -> tuple[SSAValue, bool]:
    """The smallest symmetric S with Hessian = L^T S L, and whether it holds eigenvalues that the user gave.

    L is free of the inputs, or has the eigenvectors that were given with those.
    """
    assert terminator.hessian is not None
    dependence = DependenceMap(derivative.body.block, terminator.wrt)
    value: SSAValue = terminator.hessian
    is_given = False
    while isinstance(value.owner, CongruenceOp):
        middle, linear = value.owner.operands
        if shape_of(middle)[0] > shape_of(value)[0]:
            break
        is_given = is_given or dependence.is_active(linear)
        value = middle
    return value, is_given


def _insert(derivative: DerivativeOp, terminator: YieldDerivativeOp, symmetric: SSAValue, mode: str) -> None:
    """Adds the projection behind `symmetric` and pulls its result back, for the Hessian alone."""
    assert terminator.hessian is not None
    derivative.body.block.detach_op(terminator)
    b = MatBuilder(derivative.body.block)
    projected = {symmetric: named(b.project_psd(symmetric, mode), "projected")}

    def hessian(value: SSAValue) -> SSAValue:
        if value not in projected:
            op = value.owner
            assert isinstance(op, CongruenceOp)
            projected[value] = b.congruence(hessian(op.operands[0]), op.operands[1])
        return projected[value]

    energy, gradient, wrt, cut = terminator.energy, terminator.gradient, terminator.wrt, terminator.cut
    b.append(YieldDerivativeOp(energy, gradient, named(hessian(terminator.hessian), "hessian"), wrt, cut))
    terminator.erase()
