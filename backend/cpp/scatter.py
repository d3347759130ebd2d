"""Adds an energy's local Hessian blocks of one pack to the global matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING

from yasps.backend.codegen.slots import block, packed_place, starts
from yasps.backend.cpp.expand import expand_hessian
from yasps.backend.cpp.lanes import add_hessian

if TYPE_CHECKING:
    from yasps.backend.codegen.expanding_text import LocalDerivative
    from yasps.backend.cpp.object import CppObjectText


def scatter_hessian(text: CppObjectText, local: LocalDerivative, packed: str) -> list[str]:
    """Statements that add the blocks of one pack; `packed` names the upper triangle of its local Hessians."""
    count = len(local.slots)
    pairs = [(s, t) for s in range(count) for t in range(s, count)]
    if local.in_lanes:
        return add_hessian(text, local, packed, _add_packs(text, local, pairs, packed))
    direct = [pair for pair in pairs if all(local.slots[k].is_direct for k in pair)]
    lines = _add_packs(text, local, direct, packed)
    return lines if len(direct) == len(pairs) else lines + expand_hessian(text, local, packed)


def _add_packs(text: CppObjectText, local: LocalDerivative, pairs: list[tuple[int, int]], packed: str) -> list[str]:
    """Adds the blocks of pairs of direct slots: for each shape of block a loop over its pairs."""
    slots = local.slots
    entry_at = starts([slot.size for slot in slots])
    kappa_at = starts([slot.capacity for slot in slots])
    lines: list[str] = []
    for rows, cols in dict.fromkeys((slots[s].size, slots[t].size) for s, t in pairs):
        same = [(s, t) for s, t in pairs if (slots[s].size, slots[t].size) == (rows, cols)]
        entries = [
            packed_place(local.n, entry_at[s] + r, entry_at[t] + c)
            for s, t in same
            for r in range(rows)
            for c in range(cols)
        ]
        places = [packed_place(local.capacity, kappa_at[s], kappa_at[t]) for s, t in same]
        text.begin_with("backend/cpp/preludes/scatter.h")
        function = "add_packs_3x3" if (rows, cols) == (3, 3) else f"add_packs<{rows}, {cols}>"
        given = f"sink, position, {local.pairs}, lanes, {packed}, entry, place, {len(same)}"
        body = [
            f"static const short entry[] = {{{', '.join(map(str, entries))}}};",
            f"static const {'short' if max(places) < 1 << 15 else 'int'} place[] = {{{', '.join(map(str, places))}}};",
            f"const long* const position = sink.position + first * {local.pairs};",
            f"{function}({given});",
        ]
        lines += block("", body)
    return lines
