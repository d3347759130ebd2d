"""Through which linear cut an energy sees its inputs.

If E = phi(L x + c) with L free of the targets, phi's Hessian may be projected instead of E's, at the width of the cut
(paper, 5.4 and 10.4): A >= 0 implies L^T A L >= 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from xdsl.ir import Block, SSAValue

from yasps.dialects.mat import MatBuilder, MatOp, shape_of
from yasps.dialects.mat.base import Batch, constant_value
from yasps.dialects.mat.elementwise import DivideOp, ScaleOp
from yasps.passes.analysis.dependence import Dependence, DependenceMap, size_of
from yasps.passes.calculus.derivatives import jacobian


def used_nonlinearly(dependence: DependenceMap) -> list[SSAValue]:
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


def sees_beside(values: Sequence[SSAValue], cut: Sequence[SSAValue], inputs: Sequence[SSAValue]) -> bool:
    """Whether values read inputs on a way that goes through no value of the cut: building operations looks through some
    that undo each other, and so may get to what lies before the cut."""
    seen = set(cut)
    stack = [value for value in values if value not in seen]
    while stack:
        value = stack.pop()
        if value in seen:
            continue
        seen.add(value)
        if value in inputs:
            return True
        if isinstance(value.owner, MatOp) and not value.owner.HELD_CONSTANT:
            stack.extend(value.owner.operands)
    return False


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
    arcs += [(2 * values[value] + 1, sink, unbounded) for value in used_nonlinearly(dependence)]
    rows, cols, weights = (np.array(column, np.int32) for column in zip(*arcs, strict=True))
    # imported here, because a scene whose code is in the cache needs neither
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    graph = csr_array((weights, (rows, cols)), shape=(sink + 1, sink + 1))
    flow = maximum_flow(graph, source, sink)
    if flow.flow_value >= sum(size_of(value) for value in inputs):
        return inputs
    residual = csr_array(graph - flow.flow)
    residual.eliminate_zeros()
    reaches_sink = set(breadth_first_order(csr_array(residual.T), sink, return_predecessors=False).tolist())
    return [value for value, k in values.items() if 2 * k not in reaches_sink and 2 * k + 1 in reaches_sink]


@dataclass(frozen=True)
class ConstantMap:
    """Values that depend on the inputs by a constant matrix of low rank: values = expand basis + c, basis = rows "
    "inputs."""

    values: list[SSAValue]
    expand: NDArray[np.float64]
    """[entries of all values, rank]."""
    rows: NDArray[np.float64]
    """[rank, entries of all inputs]: rows of the values' Jacobian."""


def coefficients(dependence: DependenceMap, inputs: list[SSAValue]) -> tuple[list[SSAValue], Batch | None]:
    """What an energy is nonlinear in, and its Jacobian with respect to the inputs, None where that depends on data.

    A number that a whole value is multiplied with or divided by is left out: the energy is nonlinear in what it is a
    factor of as well.
    """
    values = list(dict.fromkeys(_without_factors(dependence, value) for value in used_nonlinearly(dependence)))
    scratch = MatBuilder(Block())
    matrix = constant_value(jacobian(scratch, values, inputs)) if values else None
    scratch.body.erase(safe_erase=False)
    return values, matrix


def _without_factors(dependence: DependenceMap, value: SSAValue) -> SSAValue:
    """What an affine value is a multiple of, by a number that no input changes."""
    while isinstance(value.owner, ScaleOp | DivideOp):
        (inner,) = [operand for operand in value.owner.operands if dependence.is_active(operand)]
        if shape_of(inner) != shape_of(value):
            break
        value = inner
    return value


def constant_map(dependence: DependenceMap, inputs: list[SSAValue], narrower_than: int) -> ConstantMap | None:
    """How the energy sees its inputs, if that is by constant coefficients of a rank below `narrower_than`.

    So a hinge or a pair of triangles written with more differences than are independent is still projected at the
    width of the independent ones: 9, not 12.
    """
    values, matrix = coefficients(dependence, inputs)
    if matrix is None:
        return None  # the coefficients are data
    chosen: list[int] = []
    for k in range(len(matrix)):
        if len(chosen) < np.linalg.matrix_rank(matrix[[*chosen, k]]):
            chosen.append(k)
    if not chosen or len(chosen) >= narrower_than:
        return None
    rows = matrix[chosen]
    expand = np.round(matrix @ np.linalg.pinv(rows), 12) + 0.0
    if not np.array_equal(expand @ rows, matrix):
        return None  # no exact combination: the wider cut costs time, a rounded one would cost digits
    return ConstantMap(values, expand, rows)
