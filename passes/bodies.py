"""Copying bodies: the one way passes rebuild attribute bodies, each value once."""

from __future__ import annotations

from xdsl.ir import Block, Operation, SSAValue

from yasps.dialects.mat import MatBuilder, MatOp
from yasps.dialects.mat.builder import named
from yasps.dialects.rel import AttributeOp, Container, JoinOp, ReadOp, RefOp, UnionOp, YieldOp, name_of


class BodyBuilder(MatBuilder):
    """A `MatBuilder` that also makes each boundary read once."""

    def __init__(self, body: Block) -> None:
        super().__init__(body)
        self._reads: dict[tuple[object, ...], SSAValue] = {}

    def read(self, op: ReadOp) -> SSAValue:
        """The value of an equal read in this body."""
        key = (type(op), op.result.type, *sorted(op.properties.items(), key=lambda item: item[0]))
        if key not in self._reads:
            copy = op.clone()
            self.append(copy)
            self._reads[key] = copy.result
        return named(self._reads[key], op.result.name_hint)


def inline_body(b: BodyBuilder, attributes: dict[str, AttributeOp], attribute: AttributeOp) -> SSAValue:
    """Copies the attribute's body, and those of the attributes it refers to; returns its value.

    References to UNION attributes stay: there the branch is taken, in a function of their own.
    """
    values: dict[SSAValue, SSAValue] = {}
    for op in attribute.body.block.ops:
        if isinstance(op, RefOp) and not is_union(attributes[name_of(op.attribute)]):
            inlined = inline_body(b, attributes, attributes[name_of(op.attribute)])
            values[op.result] = named(inlined, op.result.name_hint)
        elif isinstance(op, ReadOp):
            values[op.result] = b.read(op)
        elif isinstance(op, MatOp):
            values[op.result] = b.copy(op, [values[v] for v in op.operands])
        elif isinstance(op, YieldOp):
            return values[op.value]
    raise ValueError(f"@{attribute.symbol} has no rel.yield")


def is_union(attribute: AttributeOp) -> bool:
    """Is the attribute nothing but a UNION?"""
    return bool(attribute.body.blocks) and isinstance(attribute.body.block.first_op, UnionOp)


def source_of(read: ReadOp) -> str | None:
    """Name of the attribute or storage whose values a JOIN or a reference reads at other instances."""
    if isinstance(read, JoinOp):
        return name_of(read.source)
    return name_of(read.attribute) if isinstance(read, RefOp) else None


def containers(module: Operation) -> list[Container]:
    """The scene or objects of a module, in order."""
    return [op for op in module.regions[0].block.ops if isinstance(op, Container)]
