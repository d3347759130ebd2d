"""`outline-modules`: one `rel.object` for each object file (paper, 7.1).

Energies' values and derivatives, and the attributes that JOINs and UNIONs reach (values, Jacobians, placement indices),
become objects of their own with the scalar functions they call. What they use of others stays declared in the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

from xdsl.context import Context
from xdsl.dialects.builtin import ModuleOp
from xdsl.dialects.func import FuncOp
from xdsl.ir import Operation
from xdsl.passes import ModulePass

from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    Container,
    CurvatureOp,
    DerivativeOp,
    EnergyOp,
    JacobianOp,
    ObjectOp,
    ReadOp,
    SceneOp,
    UnionOp,
    name_of,
)
from yasps.passes.bodies import containers, source_of


@dataclass(frozen=True)
class OutlineModules(ModulePass):
    """See the module."""

    name = "outline-modules"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            if isinstance(container, SceneOp):
                _outline(op, container)


def _outline(module: ModuleOp, scene: Container) -> None:
    ops = list(scene.body.block.ops)
    functions = {op.sym_name.data: op for op in ops if isinstance(op, FuncOp)}
    entries = _entries(ops)
    for op in ops:
        if isinstance(op, AttributeOp) and op.body.blocks:
            definition: Operation = op.clone()
            declaration = op
            declaration.detach_region(declaration.body)
            declaration.add_region(AttributeOp(op.symbol, "", op.matrix_type, None).detach_region(0))
        elif isinstance(op, DerivativeOp | JacobianOp | CurvatureOp):
            definition = op
            scene.body.block.detach_op(op)
        else:
            continue
        called = [name_of(call.function) for call in definition.walk() if isinstance(call, ApplyOp)]
        parts = [functions[name] for name in dict.fromkeys(called)]
        for part in parts:
            scene.body.block.detach_op(part)
        symbol = op.symbol
        module.body.block.add_op(ObjectOp(f"{symbol}.object", [definition, *parts], entries[symbol]))


def _entries(ops: list[Operation]) -> dict[str, list[str]]:
    """How each definition is run: over all instances, for single ones, or both."""
    entries: dict[str, list[str]] = {}

    def add(name: str, entry: str) -> None:
        known = entries.setdefault(name, [])
        if entry not in known:
            known.append(entry)

    for op in ops:
        if isinstance(op, EnergyOp):
            add(name_of(op.attribute), "batch")
        elif isinstance(op, DerivativeOp):
            add(op.symbol, "batch")
            if op.indices is not None:
                add(name_of(op.indices), "batch")
        elif isinstance(op, JacobianOp | CurvatureOp):
            add(op.symbol, "call")
        elif isinstance(op, AttributeOp) and op.output is not None:
            add(op.symbol, "batch")
    for op in ops:
        for region in op.regions:
            for read in region.walk():
                if isinstance(read, UnionOp):
                    for member in read.members:
                        add(name_of(member), "call")
                elif isinstance(read, ReadOp):
                    source = source_of(read)
                    if source is not None:
                        add(source, "call")
    for op in ops:  # kept for reading, run by nobody
        if isinstance(op, AttributeOp):
            entries.setdefault(op.symbol, [])
    return entries
