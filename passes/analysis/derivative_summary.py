"""What there is to say about a `rel.derivative` in one line: its energy, cut, projection and operations."""

from __future__ import annotations

from dataclasses import dataclass

from xdsl.dialects import arith, func
from xdsl.dialects.func import FuncOp
from xdsl.ir import SSAValue

from yasps.dialects.mat import MatOp, shape_of, spell
from yasps.dialects.mat.structure import ConstantOp, IdentityOp
from yasps.dialects.rel import ApplyOp, DerivativeOp, YieldDerivativeOp, name_of
from yasps.passes.analysis.names import value_name

ON_MATRICES = "on matrices"
"""What stands for the function in counts of operations before `lower-to-scalar`."""


@dataclass(frozen=True)
class DerivativeSummary:
    """inputs, cut: names and shapes of the boundary inputs that lead to targets, and of the cut, if it is written down.

    projection: the energy's mode; projects: where, how wide and why, once `project-psd` has decided.
    operations: on matrices, or on numbers for each function after `lower-to-scalar`.
    """

    energy: str
    inputs: tuple[str, ...]
    cut: tuple[str, ...]
    projection: str
    projects: str | None
    operations: dict[str, int]

    @staticmethod
    def of(derivative: DerivativeOp) -> DerivativeSummary:
        """What the operation says about itself at its stage of the pipeline."""
        block = derivative.body.block
        terminator = block.last_op
        assert isinstance(terminator, YieldDerivativeOp)
        container = derivative.parent_op()
        functions = {} if container is None else {op.sym_name.data: op for op in _functions(container)}
        counts: dict[str, int] = {}
        for op in block.ops:
            if isinstance(op, ApplyOp) and name_of(op.function) in functions:
                name = name_of(op.function)
                counts[name.rpartition(".")[2]] = operation_count(functions[name])
            elif isinstance(op, MatOp) and not isinstance(op, ConstantOp | IdentityOp):
                counts[ON_MATRICES] = counts.get(ON_MATRICES, 0) + 1
        return DerivativeSummary(
            name_of(derivative.attribute),
            tuple(map(_described, terminator.wrt)),
            tuple(map(_described, terminator.cut)),
            derivative.projection.data,
            derivative.projects.data if derivative.projects is not None else None,
            counts,
        )

    def line(self) -> str:
        """One line for a dump."""
        parts = [f"energy @{self.energy} of {', '.join(self.inputs)}"]
        if self.cut:
            parts.append(f"cut {', '.join(self.cut)}")
        where = "" if self.projects is None else " " + self.projects.partition(":")[0]
        parts.append(f"projection {self.projection}{where}")
        if self.operations:
            parts.append("operations: " + ", ".join(f"{name} {count}" for name, count in self.operations.items()))
        return "; ".join(parts)


def operation_count(function: FuncOp) -> int:
    """Operations on numbers: all but constants and the return."""
    return sum(not isinstance(op, arith.ConstantOp | func.ReturnOp) for op in function.body.block.ops)


def _functions(container: object) -> list[FuncOp]:
    regions = getattr(container, "regions", ())
    return [op for region in regions for block in region.blocks for op in block.ops if isinstance(op, FuncOp)]


def _described(value: SSAValue) -> str:
    name = value_name(value)
    return spell(shape_of(value)) if name is None else f"{name} {spell(shape_of(value))}"
