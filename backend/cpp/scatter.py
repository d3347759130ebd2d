"""Adds an energy's local gradient and Hessian blocks of one pack to the global gradient and matrix."""

from __future__ import annotations

from importlib.resources import files
from typing import TYPE_CHECKING

from yasps.backend.codegen.object_text import packed_place
from yasps.backend.codegen.scene_view import Slot
from yasps.backend.cpp.expand import expand_hessian, starts

if TYPE_CHECKING:
    from yasps.backend.cpp.object import CppObjectText

SCATTER_PRELUDE = files("yasps.backend.cpp").joinpath("preludes", "scatter.h").read_text(encoding="utf-8")


def scatter_gradient(text: CppObjectText, slots: list[Slot], capacity: int) -> list[str]:
    entry_at = starts([slot.size for slot in slots])
    kappa_at = starts([slot.capacity for slot in slots])
    lines = [
        "for (long l = 0; l < lanes; ++l) {",
        "    const long i = first + l;",
        f"    const int* const kappa = sink->kappa + i * {capacity};",
    ]
    for slot, entry, kappa in zip(slots, entry_at, kappa_at, strict=True):
        if slot.is_target:
            lines += [f"    add_gradient(sink->gradient + kappa[{kappa}] - 1, gradient + {entry}, l, {slot.size});"]
            continue
        pull = text.pull_slot(slot, "b", "1", "rows")
        lines += [
            "    {",
            f"        V b[{slot.size}], rows[{slot.rows}];  // one column; the others are not looked at",
            f"        for (long e = 0; e < {slot.size}; ++e) b[e] = splat(gradient[{entry} + e][l]);",
            f"        {pull};",
            "        const V* row = rows;",
            f"        for (long k = {kappa}; k < {kappa + slot.capacity}; ++k) {{",
            "            if (!kappa[k]) continue;",
            "            const long size = sink->block_size_at[kappa[k] - 1];",
            "            for (long e = 0; e < size; ++e) sink->gradient[kappa[k] - 1 + e] += (*row++)[0];",
            "        }",
            "    }",
        ]
    lines += ["    (void)i;", "}"]
    return lines


def scatter_hessian(text: CppObjectText, slots: list[Slot], n: int, capacity: int, packed: str) -> list[str]:
    """Statements that add the blocks of one pack; `packed` names the upper triangle of its local Hessians, n x n."""
    pairs = [(s, t) for s in range(len(slots)) for t in range(s, len(slots))]
    direct = [pair for pair in pairs if all(slots[k].is_target for k in pair)]
    lines = _add_packs(text, slots, direct, n=n, capacity=capacity, packed=packed)
    if len(direct) < len(pairs):
        lines += expand_hessian(text, slots, n, capacity, packed)
    return lines


def _add_packs(
    text: CppObjectText, slots: list[Slot], pairs: list[tuple[int, int]], *, n: int, capacity: int, packed: str
) -> list[str]:
    """Adds the blocks of pairs of targets: for each shape of block a loop over its pairs."""
    entry_at = starts([slot.size for slot in slots])
    kappa_at = starts([slot.capacity for slot in slots])
    stride = capacity * (capacity + 1) // 2
    lines: list[str] = []
    for rows, cols in dict.fromkeys((slots[s].size, slots[t].size) for s, t in pairs):
        same = [(s, t) for s, t in pairs if (slots[s].size, slots[t].size) == (rows, cols)]
        entries = [
            packed_place(n, entry_at[s] + r, entry_at[t] + c) for s, t in same for r in range(rows) for c in range(cols)
        ]
        places = [packed_place(capacity, kappa_at[s], kappa_at[t]) for s, t in same]
        text.preludes[SCATTER_PRELUDE] = None
        if (rows, cols) != (3, 3):
            text.externs[_add_packs_of_shape(rows, cols)] = None
        lines += [
            "{",
            f"    static const short entry[] = {{{', '.join(map(str, entries))}}};",
            f"    static const short place[] = {{{', '.join(map(str, places))}}};",
            f"    const long* const position = sink->position + first * {stride};",
            f"    add_packs_{rows}x{cols}(sink, position, {stride}, lanes, {packed}, entry, place, {len(same)});",
            "}",
        ]
    return lines


def _add_packs_of_shape(rows: int, cols: int) -> str:
    """The function that adds blocks of this shape; see add_packs_3x3 in the prelude."""
    size = rows * cols
    vectors = -(-size // 8)
    return f"""\
static void add_packs_{rows}x{cols}(const yasps_sink* sink, const long* position, long stride, long lanes, const V* h,
                                    const short* at, const short* place, long pairs) {{
    V block[8 * {vectors}];
    for (long p = 0; p < pairs; ++p, at += {size}) {{
        for (long k = 0; k + 8 <= {size}; k += 8) {{
            V entries[8];
            for (long e = 0; e < 8; ++e) entries[e] = h[at[k + e]];
            transpose(entries);
            for (long l = 0; l < 8; ++l) block[{vectors} * l + k / 8] = entries[l];
        }}
        for (long k = {size // 8 * 8}; k < {size}; ++k)
            for (long l = 0; l < 8; ++l) ((double*)(block + {vectors} * l))[k] = h[at[k]][l];
        for (long l = 0; l < lanes; ++l) {{
            const double* const b = (const double*)(block + {vectors} * l);
            add_block(sink, position[l * stride + place[p]], b, {rows}, {cols});
        }}
    }}
}}
"""
