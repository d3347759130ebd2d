"""Which values of a body depend on the active inputs, and through which linear cut an energy does.

If E = phi(L x + c) with L free of the targets, phi's Hessian may be projected instead of E's, at the width of the cut
(paper, 5.4 and 10.4): A >= 0 implies L^T A L >= 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
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


def _used_nonlinearly(dependence: DependenceMap) -> list[SSAValue]:
    """The affine values that the energy's Hessian depends on: not those that are but terms of the energy."""
    bending = [
        op for op in dependence.block.ops if isinstance(op, MatOp) and dependence[op.result] is Dependence.NONLINEAR
    ]
    bent: set[SSAValue] = set()
    for op in reversed(bending):  # users before what they use
        if op.result in bent or not op.is_linear([dependence.is_active(operand) for operand in op.operands]):
            bent.update(op.operands)
    operands = dict.fromkeys(operand for op in bending for operand in op.operands)
    return [value for value in operands if value in bent and dependence[value] is Dependence.AFFINE]


def linear_cut(dependence: DependenceMap, inputs: list[SSAValue]) -> list[SSAValue]:
    """The smallest set of affine values through which the energy sees its inputs; the inputs if none is smaller.

    A minimum vertex cut between the inputs and the operations that are not affine, each value weighing as many entries
    as it has; of equal cuts the one nearest to the energy.
    """
    values: dict[SSAValue, int] = {}
    edges: list[tuple[SSAValue, SSAValue]] = []
    for value in inputs:
        values[value] = len(values)
    for op in dependence.block.ops:
        if not isinstance(op, MatOp):
            continue
        affine = [operand for operand in op.operands if dependence[operand] is Dependence.AFFINE]
        if dependence[op.result] is Dependence.AFFINE:
            values[op.result] = len(values)
            edges += [(operand, op.result) for operand in affine]
    # Every value is an edge from node 2 k to node 2 k + 1, as heavy as it has entries.
    source, sink = 2 * len(values), 2 * len(values) + 1
    unbounded = sum(size_of(value) for value in values) + 1
    arcs = [(2 * k, 2 * k + 1, size_of(value)) for value, k in values.items()]
    arcs += [(2 * values[a] + 1, 2 * values[b], unbounded) for a, b in edges]
    arcs += [(source, 2 * values[value], unbounded) for value in inputs]
    arcs += [(2 * values[value] + 1, sink, unbounded) for value in _used_nonlinearly(dependence)]
    rows, cols, weights = (np.array(column, np.int32) for column in zip(*arcs, strict=True))
    graph = csr_array((weights, (rows, cols)), shape=(sink + 1, sink + 1))
    flow = maximum_flow(graph, source, sink)
    if flow.flow_value >= sum(size_of(value) for value in inputs):
        return inputs
    residual = csr_array(graph - flow.flow)
    residual.eliminate_zeros()
    reaches_sink = set(breadth_first_order(csr_array(residual.T), sink, return_predecessors=False).tolist())
    return [value for value, k in values.items() if 2 * k not in reaches_sink and 2 * k + 1 in reaches_sink]
