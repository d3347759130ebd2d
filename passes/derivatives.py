"""Derivatives inside one body, at the level of matrices: memoised traversals, not rewriting patterns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from xdsl.ir import SSAValue

from yasps.dialects.mat import MatBuilder, MatOp, shape_of
from yasps.passes.linear_cut import DependenceMap, size_of


def pull_back(
    b: MatBuilder, dependence: DependenceMap, seeds: Mapping[SSAValue, SSAValue], stop_at: Sequence[SSAValue]
) -> dict[SSAValue, SSAValue]:
    """Reverse mode: cotangents of the values `stop_at` for the cotangents `seeds`.

    The block must hold the primal operations already; the cotangents are appended to it. Values that the seeds
    don't reach are missing from the result.
    """
    cotangents = dict(seeds)
    stops = set(stop_at)
    for op in reversed([op for op in dependence.block.ops if isinstance(op, MatOp)]):
        cotangent = cotangents.get(op.result)
        if cotangent is None or op.result in stops or not dependence.is_active(op.result):
            continue
        for operand, part in zip(op.operands, op.pullback(b, cotangent), strict=True):
            if part is not None and dependence.is_active(operand):
                known = cotangents.get(operand)
                cotangents[operand] = part if known is None else b.add(known, part)
    return {value: cotangents[value] for value in stop_at if value in cotangents}


class PushForward:
    """Forward mode along one direction: tangents of values for the tangents of a few, made on demand."""

    def __init__(self, b: MatBuilder, seeds: Mapping[SSAValue, SSAValue]) -> None:
        self.b = b
        self._tangents: dict[SSAValue, SSAValue | None] = dict(seeds)

    def __getitem__(self, value: SSAValue) -> SSAValue | None:
        """Tangent of the value; None stands for zero."""
        stack = [value]
        while stack:
            current = stack[-1]
            op = current.owner
            if current in self._tangents or not isinstance(op, MatOp):
                self._tangents.setdefault(current, None)
                stack.pop()
                continue
            missing = [operand for operand in op.operands if operand not in self._tangents]
            if missing:
                stack.extend(missing)
                continue
            tangents = [self._tangents[operand] for operand in op.operands]
            nonzero = any(tangent is not None for tangent in tangents)
            self._tangents[current] = op.pushforward(self.b, tangents) if nonzero else None
            stack.pop()
        return self._tangents[value]


def jacobian(b: MatBuilder, outputs: Sequence[SSAValue], inputs: Sequence[SSAValue]) -> SSAValue:
    """Jacobian of the outputs' entries (rows) with respect to the inputs' entries (columns), column by column."""
    columns = []
    for value in inputs:
        shape = shape_of(value)
        for position in range(size_of(value)):
            push = PushForward(b, {value: b.unit(shape, position)})
            parts = []
            for output in outputs:
                tangent = push[output]
                parts.append(b.zeros((size_of(output), 1)) if tangent is None else b.flat(tangent))
            columns.append(b.concat_rows(parts))
    return b.concat_cols(columns)


def stacked(b: MatBuilder, values: Sequence[SSAValue], parts: Mapping[SSAValue, SSAValue]) -> SSAValue:
    """One column of all entries of the parts of these values; a missing part is zero."""
    return b.concat_rows([b.flat(parts[v]) if v in parts else b.zeros((size_of(v), 1)) for v in values])
