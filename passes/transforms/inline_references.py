"""`inline-references`: bodies read only data, JOINs and UNION attributes, the paper's boundary nodes (5.3).

References to other attributes of the same lineage are replaced by what those compute, so that differentiation sees each
energy down to its boundary; attributes that nobody needs any more are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

from xdsl.context import Context
from xdsl.dialects.builtin import ModuleOp
from xdsl.ir import Block, Region
from xdsl.passes import ModulePass

from yasps.dialects.rel import AttributeOp, EnergyOp, ReadOp, UnionOp, YieldOp, name_of
from yasps.passes.bodies import BodyBuilder, containers, inline_body, source_of


@dataclass(frozen=True)
class InlineReferences(ModulePass):
    """See the module."""

    name = "inline-references"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            block = container.body.block
            attributes = {a.symbol: a for a in block.ops if isinstance(a, AttributeOp)}
            bodies: dict[str, Block] = {}
            for name, attribute in attributes.items():
                if attribute.body.blocks:
                    body = Block()
                    b = BodyBuilder(body)
                    b.append(YieldOp(inline_body(b, attributes, attribute)))
                    bodies[name] = body
            for name, body in bodies.items():
                attributes[name].detach_region(attributes[name].body)
                attributes[name].add_region(Region(body))
            needed = _needed(container.body.block, attributes)
            for name, attribute in attributes.items():
                if name not in needed:
                    block.detach_op(attribute)
                    attribute.erase()


def _needed(block: Block, attributes: dict[str, AttributeOp]) -> set[str]:
    """Energies and outputs, and what their bodies read."""
    stack = [name_of(op.attribute) for op in block.ops if isinstance(op, EnergyOp)]
    stack += [name for name, attribute in attributes.items() if attribute.output is not None]
    needed: set[str] = set()
    while stack:
        name = stack.pop()
        if name in needed or name not in attributes:
            continue
        needed.add(name)
        for region in attributes[name].regions:
            for op in region.walk():
                if isinstance(op, UnionOp):
                    stack.extend(name_of(member) for member in op.members)
                elif isinstance(op, ReadOp):
                    source = source_of(op)
                    if source is not None:
                        stack.append(source)
    return needed
