"""Which values of a body depend on the active inputs, and through which linear cut an energy does.

If E = phi(L x + c) with L free of the targets, phi's Hessian may be projected instead of E's, at the width of the cut
(paper, 5.4 and 10.4): A >= 0 implies L^T A L >= 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import MatOp, shape_of
from yasps.dialects.mat.calculus import StopGradientOp


class Dependence(Enum):
    """How a value depends on the active inputs."""

    CONSTANT = 0
    AFFINE = 1
    NONLINEAR = 2


class DependenceMap:
    """Dependence of every value of a block on the `active` values."""

    def __init__(self, block: Block, active: Iterable[SSAValue]) -> None:
        self.block = block
        self._kinds: dict[SSAValue, Dependence] = dict.fromkeys(active, Dependence.AFFINE)
        for op in block.ops:
            if isinstance(op, MatOp) and op.result not in self._kinds:
                kind = self._of_operation(op)
                if kind is not Dependence.CONSTANT:
                    self._kinds[op.result] = kind

    def _of_operation(self, op: MatOp) -> Dependence:
        if isinstance(op, StopGradientOp):
            return Dependence.CONSTANT
        kinds = [self[operand] for operand in op.operands]
        if all(kind is Dependence.CONSTANT for kind in kinds):
            return Dependence.CONSTANT
        linear = op.is_linear([kind is not Dependence.CONSTANT for kind in kinds])
        return Dependence.AFFINE if linear and Dependence.NONLINEAR not in kinds else Dependence.NONLINEAR

    def __getitem__(self, value: SSAValue) -> Dependence:
        return self._kinds.get(value, Dependence.CONSTANT)

    def is_active(self, value: SSAValue) -> bool:
        return self[value] is not Dependence.CONSTANT


def size_of(value: SSAValue) -> int:
    rows, cols = shape_of(value)
    return rows * cols


def linear_cut(dependence: DependenceMap, inputs: list[SSAValue]) -> list[SSAValue]:
    """The affine values an energy depends on nonlinearly, in order; the inputs themselves if those are not wider."""
    used_nonlinearly: dict[SSAValue, None] = {}
    for op in dependence.block.ops:
        if isinstance(op, MatOp) and dependence[op.result] is Dependence.NONLINEAR:
            for operand in op.operands:
                if dependence[operand] is Dependence.AFFINE:
                    used_nonlinearly[operand] = None
    cut = list(used_nonlinearly)
    if sum(size_of(v) for v in cut) < sum(size_of(v) for v in inputs):
        return cut
    return inputs
