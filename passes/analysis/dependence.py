"""How the values of a body depend on its active inputs: not at all, affinely or nonlinearly."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import MatOp, shape_of


class Dependence(Enum):
    """How a value depends on the active inputs; AFFINE is meant between kinks, as `MatOp.is_linear` is."""

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
        if op.HELD_CONSTANT:
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
