"""Which branches of UNIONs an instance of an energy takes, as a number.

Instances are sorted by it, so that those that are evaluated together, in the lanes of a pack or the threads of a warp,
take the same branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from yasps.backend.codegen.slots import block
from yasps.dialects.rel import name_of

if TYPE_CHECKING:
    from yasps.backend.codegen.object_text import ObjectText
    from yasps.backend.codegen.scene_view import Slot


def branch_number(text: ObjectText, slots: Sequence[Slot]) -> tuple[list[str], int]:
    """Statements that declare `number`, the same for all instances i that are of the same branches in these slots; and
    how many numbers there are, none and 1 where all instances are of the same."""
    lines = ["unsigned long number = 0;"]
    total = 1
    for slot in slots:
        if slot.reduction is not None:  # many instances, each of its own branch
            continue
        branch, end = branch_of(text, slot.source, "j", 1)
        if end > 1 and (end > 2 or may_be_direct(text, slot.source)):
            total *= end
            lines += block("", [f"const long j = {text.slot_index(slot)};", f"number = number * {end} + {branch};"])
    return ([], 1) if total == 1 else (lines, total)


def may_be_direct(text: ObjectText, source: str) -> bool:
    """Is the source direct at some instances?"""
    scene = text.scene
    if scene.is_direct(source) or scene.is_constant(source):
        return True
    return scene.is_union(source) and any(may_be_direct(text, member) for member in scene.union_members(source))


def branch_of(text: ObjectText, source: str, index: str, free: int) -> tuple[str, int]:
    """Expression for the branch of a source at an instance: 0 where it is direct, else a number from `free` on; and
    the first number that is free then."""
    scene = text.scene
    if scene.is_direct(source) or scene.is_constant(source):
        return "0", free
    if not scene.is_union(source):
        return str(free), free + 1
    offsets = text.bind("offsets", name_of(scene.attributes[source].owner))
    members: list[str] = []
    for k, member in enumerate(scene.union_members(source)):
        number, free = branch_of(text, member, f"({index} - {offsets}[{k}])" if k else index, free)
        members.append(number)
    *firsts, last = members
    chosen = [f"{index} < {offsets}[{k}] ? {number} : " for k, number in enumerate(firsts, start=1)]
    return f"({''.join(chosen)}{last})", free
