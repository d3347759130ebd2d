"""Which attributes, and which boundary reads, depend on a target."""

from __future__ import annotations

from xdsl.ir import Block, Operation

from yasps.dialects.rel import AttributeOp, DataOp, JoinOp, RefOp, TargetOp, UnionOp, name_of
from yasps.passes.bodies import source_of


class Reach:
    """Of the declarations in a container's block."""

    def __init__(self, block: Block) -> None:
        self._targets = {name_of(op.variable) for op in block.ops if isinstance(op, TargetOp)}
        self._bodies = {op.symbol: op.body for op in block.ops if isinstance(op, AttributeOp)}
        self._known: dict[str, bool] = {}

    def reaches_target(self, name: str) -> bool:
        """Does the attribute or storage depend on a target?"""
        if name in self._targets:
            return True
        if name not in self._bodies:
            return False
        if name not in self._known:
            self._known[name] = False
            self._known[name] = any(self.is_active(op) for op in self._bodies[name].walk())
        return self._known[name]

    def is_active(self, op: Operation) -> bool:
        """Is this a boundary read that depends on a target?"""
        if isinstance(op, UnionOp):
            return any(self.reaches_target(name_of(member)) for member in op.members)
        if isinstance(op, DataOp):
            return name_of(op.storage) in self._targets
        if isinstance(op, JoinOp | RefOp):
            source = source_of(op)
            return source is not None and self.reaches_target(source)
        return False
