"""J^T H J for a local Hessian H some of whose inputs are not targets themselves, expanded slot by slot.

With J_s the Jacobian of slot s, rows J_s^T H_st are made for all t >= s by one call of the source's `pull`, and
J_t^T (J_s^T H_st)^T for all s <= t by one more, whatever parameterises the slots. So code and calls grow linearly
with the number of slots, and no Jacobian is ever stored. Columns come in packs of 8, the last filled up with zeros.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from yasps.backend.codegen.scene_view import Slot
from yasps.backend.codegen.slots import block, starts

if TYPE_CHECKING:
    from yasps.backend.codegen.expanding_text import LocalDerivative
    from yasps.backend.cpp.object import CppObjectText

NO_MEMORY = "return YASPS_NO_MEMORY;"


def expand(
    text: CppObjectText,
    slots: Sequence[Slot],
    triangle: str,
    use: Callable[[int, int], str],
    is_wanted: Callable[[int, int], bool] = lambda s, t: True,
    *,
    or_else: str = NO_MEMORY,
) -> list[str]:
    """Statements that expand the upper triangle of H for one instance i and `use` each wanted block of slots s <= t.

    What `use(s, t)` gives is a statement: there `block` points to the block's transpose, rows of t's unknowns `across`
    apart with s's unknowns in columns; `height<s>` and `height` are their numbers. or_else: the statement where memory
    runs out.
    """
    text.begin_with("backend/cpp/preludes/expand.h")
    n = sum(slot.size for slot in slots)
    entry_at = starts([slot.size for slot in slots])
    reaching = [s for s, slot in enumerate(slots) if slot.rows]
    partners = {t: [s for s in reaching if s <= t and is_wanted(s, t)] for t in reaching}
    lines: list[str] = []
    for s in sorted({s for group in partners.values() for s in group}):
        packs = packs_of(n - entry_at[s])
        lines += [
            *text.array(f"rows{s}", slots[s].size * packs, or_else),
            *text.array(f"left{s}", slots[s].rows * packs, or_else),
            f"copy_rows_of_triangle({triangle}, {n}, {entry_at[s]}, {slots[s].size}, (double*)rows{s}, {8 * packs});",
            *text.pull_slot(slots[s], "", f"rows{s}", str(packs), f"left{s}", into=f"const long height{s} ="),
        ]
    for t, group in partners.items():
        if not group:
            continue
        most = packs_of(sum(slots[s].rows for s in group))
        body = [
            *text.array("right", slots[t].size * most, or_else),
            *text.array("both", slots[t].rows * most, or_else),
            f"const long breadth = ({' + '.join(f'height{s}' for s in group)} + 7) / 8, across = 8 * breadth;",
            f"for (long r = 0; breadth && r < {slots[t].size}; ++r) right[(r + 1) * breadth - 1] = splat(0.0);",
            "long column = 0;",
        ]
        for s in group:
            stride, skipped = 8 * packs_of(n - entry_at[s]), entry_at[t] - entry_at[s]
            left = f"(const double*)left{s} + {skipped}, {stride}, height{s}, {slots[t].size}"
            body += [f"copy_transposed({left}, (double*)right + column, across);", f"column += height{s};"]
        body += text.pull_slot(slots[t], "", "right", "breadth", "both", into="const long height =")
        body.append("const double* block = (const double*)both;")
        for s in group:
            body += [use(s, t), f"block += height{s};"]
        lines += block("", [*body, "(void)column, (void)block, (void)height;"])
    return lines


def packs_of(columns: int) -> int:
    """Packs of 8 that hold so many columns."""
    return -(-columns // 8)


def in_lanes(local: LocalDerivative, lines: Sequence[str]) -> list[str]:
    """Runs the lines for each instance i of a pack, with its kappa and positions."""
    head = ["const long i = first + l;", f"const int* const kappa = sink.kappa + i * {local.capacity};"]
    if any("position" in line for line in lines):
        head.append(f"const long* const position = sink.position + i * {local.pairs};")
    return block("for (long l = 0; l < lanes; ++l)", [*head, *lines, "(void)i;"])


def expand_hessian(text: CppObjectText, local: LocalDerivative, packed: str) -> list[str]:
    """Statements that add all blocks of one pack but those of two direct slots; see scatter_hessian."""
    slots, kappa_at = local.slots, starts([slot.capacity for slot in local.slots])

    def add(s: int, t: int) -> str:
        ranges = ", ".join(str(kappa_at[k] + end) for k in (s, t) for end in (0, slots[k].capacity))
        return f"add_expanded(sink, kappa, position, {local.capacity}, {ranges}, block, across);"

    def is_wanted(s: int, t: int) -> bool:
        return not (slots[s].is_direct and slots[t].is_direct)

    entries = local.n * (local.n + 1) // 2
    packs = packs_of(entries)
    triangle = f"const double* const triangle = (const double*)(by_lane + l * {packs});"
    return [
        *text.array("by_lane", 8 * packs),
        f"lane_by_lane({packed}, {entries}, by_lane, {packs});",
        *in_lanes(local, [triangle, *expand(text, slots, "triangle", add, is_wanted)]),
    ]
