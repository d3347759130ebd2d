"""Slots of an energy or Jacobian laid end to end, and code for several of them at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

from yasps.backend.codegen.scene_view import Slot


@dataclass(frozen=True)
class SlotRange:
    """Neighbouring slots that differ only in which connected instance they read: code for them is a loop.

    first: number of the first slot; count: how many. entry, leaf: where the first one's entries and leaves begin.
    """

    slot: Slot
    first: int
    count: int
    entry: int
    leaf: int


def ranges_of(slots: Sequence[Slot]) -> list[SlotRange]:
    """The slots as few ranges, in order."""
    ranges: list[SlotRange] = []
    first = entry = leaf = 0
    for _, group in groupby(
        enumerate(slots), key=lambda item: (item[1].source, item[1].connectivity, item[0] - item[1].position)
    ):
        same = [slot for _, slot in group]
        ranges.append(SlotRange(same[0], first, len(same), entry, leaf))
        first += len(same)
        entry += sum(slot.size for slot in same)
        leaf += sum(slot.capacity for slot in same)
    return ranges


def starts(sizes: Sequence[int]) -> list[int]:
    """Where each of several pieces begins when they are laid end to end."""
    return [sum(sizes[:k]) for k in range(len(sizes))]


def packed_place(n: int, row: int, col: int) -> int:
    """Where an entry stands in the packed upper triangle of a symmetric n x n matrix; as in sink.h."""
    row, col = min(row, col), max(row, col)
    return row * n - row * (row - 1) // 2 + col - row


def place(start: int, k: str, step: int = 1) -> str:
    """Text of start + k * step, where no k is 0."""
    product = k if step == 1 else f"{k} * {step}"
    return str(start) if not k else product if start == 0 else f"{start} + {product}"


def indented(lines: Sequence[str]) -> list[str]:
    """The lines, one level deeper."""
    return [f"    {line}" for line in lines]


def block(head: str, lines: Sequence[str]) -> list[str]:
    """The lines in braces, after `head`."""
    return [f"{head} {{".lstrip(), *indented(lines), "}"]


def each(same: SlotRange, body: Callable[[SlotRange, str], list[str]], *, scope: bool = False) -> list[str]:
    """What `body` gives for slot k of a range, as a loop; without k if there is one slot, in braces if it declares."""
    if same.count > 1:
        return block(f"for (long k = 0; k < {same.count}; ++k)", body(same, "k"))
    return block("", body(same, "")) if scope else body(same, "")
