"""J^T H J for a local Hessian H some of whose inputs are not targets themselves, expanded slot by slot.

With J_s the Jacobian of slot s, rows J_s^T H_st are made for all t >= s by one call of the source's `pull`, and
J_t^T (J_s^T H_st)^T for all s <= t by one more, whatever parameterises the slots. So code and calls grow linearly
with the number of slots, and no Jacobian is ever stored. Columns come in packs of 8, the last filled up with zeros.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING

from yasps.backend.codegen.scene_view import Slot

if TYPE_CHECKING:
    from yasps.backend.cpp.object import CppObjectText

EXPAND_PRELUDE = files("yasps.backend.cpp").joinpath("preludes", "expand.h").read_text(encoding="utf-8")


def starts(sizes: Sequence[int]) -> list[int]:
    """Where each of several pieces begins when they are laid end to end."""
    return [sum(sizes[:k]) for k in range(len(sizes))]


def expand(
    text: CppObjectText,
    slots: Sequence[Slot],
    triangle: str,
    use: Callable[[int, int], str],
    is_wanted: Callable[[int, int], bool] = lambda s, t: True,
) -> list[str]:
    """Statements that expand the upper triangle of H for one instance i and `use` each wanted block of slots s <= t.

    What `use(s, t)` gives is a statement: there `block` points to the block's transpose, rows of t's unknowns `across`
    apart with s's unknowns in columns; `height<s>` and `height` are their numbers.
    """
    text.preludes[EXPAND_PRELUDE] = None
    n = sum(slot.size for slot in slots)
    entry_at = starts([slot.size for slot in slots])
    reaching = [s for s, slot in enumerate(slots) if slot.rows]
    partners = {t: [s for s in reaching if s <= t and is_wanted(s, t)] for t in reaching}
    lines: list[str] = []
    for s in sorted({s for group in partners.values() for s in group}):
        packs = packs_of(n - entry_at[s])
        lines += [
            f"V rows{s}[{slots[s].size * packs}], left{s}[{slots[s].rows * packs}];",
            f"copy_rows_of_triangle({triangle}, {n}, {entry_at[s]}, {slots[s].size}, (double*)rows{s}, {8 * packs});",
            f"const long height{s} = {text.pull_slot(slots[s], f'rows{s}', str(packs), f'left{s}')};",
        ]
    for t, group in partners.items():
        if not group:
            continue
        most = packs_of(sum(slots[s].rows for s in group))
        lines += [
            "{",
            f"    V right[{slots[t].size * most}], both[{slots[t].rows * most}];",
            f"    const long breadth = ({' + '.join(f'height{s}' for s in group)} + 7) / 8, across = 8 * breadth;",
            f"    for (long r = 0; breadth && r < {slots[t].size}; ++r) right[(r + 1) * breadth - 1] = splat(0.0);",
            "    long column = 0;",
        ]
        for s in group:
            stride, skipped = 8 * packs_of(n - entry_at[s]), entry_at[t] - entry_at[s]
            lines += [
                f"    copy_transposed((const double*)left{s} + {skipped}, {stride}, height{s}, {slots[t].size}, "
                "(double*)right + column, across);",
                f"    column += height{s};",
            ]
        lines += [f"    const long height = {text.pull_slot(slots[t], 'right', 'breadth', 'both')};"]
        lines += ["    const double* block = (const double*)both;"]
        for s in group:
            lines += [f"    {use(s, t)}", f"    block += height{s};"]
        lines += ["    (void)column, (void)block, (void)height;", "}"]
    return lines


def packs_of(columns: int) -> int:
    """Packs of 8 that hold so many columns."""
    return -(-columns // 8)


def expand_hessian(text: CppObjectText, slots: Sequence[Slot], n: int, capacity: int, packed: str) -> list[str]:
    """Statements that add all blocks of one pack but those between two targets; see scatter_hessian."""
    kappa_at = starts([slot.capacity for slot in slots])

    def add(s: int, t: int) -> str:
        ranges = ", ".join(str(kappa_at[k] + end) for k in (s, t) for end in (0, slots[k].capacity))
        return f"add_expanded(sink, kappa, position, {capacity}, {ranges}, block, across);"

    def is_wanted(s: int, t: int) -> bool:
        return not (slots[s].is_target and slots[t].is_target)

    entries = n * (n + 1) // 2
    return [
        f"V by_lane[8 * {packs_of(entries)}];",
        f"lane_by_lane({packed}, {entries}, by_lane, {packs_of(entries)});",
        "for (long l = 0; l < lanes; ++l) {",
        "    const long i = first + l;",
        f"    const int* const kappa = sink->kappa + i * {capacity};",
        f"    const long* const position = sink->position + i * {capacity * (capacity + 1) // 2};",
        f"    const double* const triangle = (const double*)(by_lane + l * {packs_of(entries)});",
        *(f"    {line}" for line in expand(text, slots, "triangle", add, is_wanted)),
        "    (void)i;",
        "}",
    ]
