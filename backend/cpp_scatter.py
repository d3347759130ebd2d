"""Adds an energy's local gradient and Hessian blocks of one pack to the global gradient and matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING

from yasps.backend.scene_view import Slot

if TYPE_CHECKING:
    from yasps.backend.cpp_object import _ObjectText


def _starts(sizes: list[int]) -> list[int]:
    return [sum(sizes[:k]) for k in range(len(sizes))]


def _pair(capacity: int, a: str, b: str) -> str:
    return f"{a} * {capacity} - {a} * ({a} - 1) / 2 + {b} - {a}"


def scatter_gradient(text: _ObjectText, slots: list[Slot], capacity: int) -> list[str]:
    entry_at = _starts([slot.size for slot in slots])
    kappa_at = _starts([slot.capacity for slot in slots])
    lines = [
        "for (long l = 0; l < lanes; ++l) {",
        "    const long i = first + l;",
        f"    const int* const kappa = sink->kappa + i * {capacity};",
    ]
    for slot, entry, kappa in zip(slots, entry_at, kappa_at, strict=True):
        if slot.is_target:
            lines += [
                f"    for (long e = 0; e < {slot.size}; ++e)",
                f"        sink->gradient[kappa[{kappa}] - 1 + e] += gradient[{entry} + e][l];",
            ]
            continue
        pull = text.pull_slot(slot, "b", "1", "rows")
        lines += [
            "    {",
            f"        double b[{slot.size}], rows[{slot.rows}];",
            f"        for (long e = 0; e < {slot.size}; ++e) b[e] = gradient[{entry} + e][l];",
            f"        {pull};",
            "        const double* row = rows;",
            f"        for (long k = {kappa}; k < {kappa + slot.capacity}; ++k) {{",
            "            if (!kappa[k]) continue;",
            "            const long size = sink->block_size_at[kappa[k] - 1];",
            "            for (long e = 0; e < size; ++e) sink->gradient[kappa[k] - 1 + e] += *row++;",
            "        }",
            "    }",
        ]
    lines += ["    (void)i;", "}"]
    return lines


def scatter_hessian(text: _ObjectText, slots: list[Slot], n: int, capacity: int, packed: str) -> list[str]:
    entry_at = _starts([slot.size for slot in slots])
    kappa_at = _starts([slot.capacity for slot in slots])
    lines = [
        "for (long l = 0; l < lanes; ++l) {",
        "    const long i = first + l;",
        f"    const int* const kappa = sink->kappa + i * {capacity};",
        f"    const long* const position = sink->position + i * {capacity * (capacity + 1) // 2};",
        "    (void)kappa;",
    ]
    for s, first in enumerate(slots):
        for t in range(s, len(slots)):
            second = slots[t]
            lines.append("    {")
            lines += [
                f"        double b[{first.size * second.size}];",
                f"        for (long r = 0; r < {first.size}; ++r)",
                f"            for (long c = {'r' if s == t else '0'}; c < {second.size}; ++c)",
                f"                b[r * {second.size} + c] = {packed}"
                f"[packed({n}, {entry_at[s]} + r, {entry_at[t]} + c)][l];",
            ]
            if s == t:
                lines += [
                    f"        for (long r = 1; r < {first.size}; ++r)",
                    f"            for (long c = 0; c < r; ++c) b[r * {first.size} + c] = b[c * {first.size} + r];",
                ]
            if first.is_target and second.is_target:
                pair = _pair(capacity, str(kappa_at[s]), str(kappa_at[t]))
                lines.append(f"        add_block(sink->blocks, position[{pair}], b, {first.size}, {second.size});")
            else:
                lines += [f"        {line}" for line in _expand(text, slots, (s, t), kappa_at, capacity)]
            lines.append("    }")
    lines.append("}")
    return lines


def _expand(
    text: _ObjectText, slots: list[Slot], pair: tuple[int, int], kappa_at: list[int], capacity: int
) -> list[str]:
    """J_s^T b J_t for a pair of slots (s, t), one side at a time, and its blocks to their places."""
    s, t = pair
    first, second = slots[s], slots[t]
    if first.rows == 0 or second.rows == 0:
        return []
    left = text.pull_slot(first, "b", str(second.size), "left")
    right = text.pull_slot(second, "turned", "height", "both")
    return [
        f"double left[{first.rows * second.size}], turned[{first.rows * second.size}];",
        f"double both[{first.rows * second.rows}], block[{first.rows * second.rows}];",
        f"const long height = {left};",
        "if (height) {",
        "    for (long r = 0; r < height; ++r)",
        f"        for (long c = 0; c < {second.size}; ++c) turned[c * height + r] = left[r * {second.size} + c];",
        f"    {right};",
        "    long row = 0;",
        f"    for (long p = {kappa_at[s]}; p < {kappa_at[s] + first.capacity}; ++p) {{",
        "        if (!kappa[p]) continue;",
        "        const long rows = sink->block_size_at[kappa[p] - 1];",
        "        long col = 0;",
        f"        for (long q = {kappa_at[t]}; q < {kappa_at[t] + second.capacity}; ++q) {{",
        "            if (!kappa[q]) continue;",
        "            const long cols = sink->block_size_at[kappa[q] - 1];",
        *(["            if (q >= p) {"] if s == t else ["            {"]),
        "                for (long r = 0; r < rows; ++r)",
        "                    for (long c = 0; c < cols; ++c)",
        "                        block[r * cols + c] = both[(col + c) * height + row + r];",
        f"                add_block(sink->blocks, position[{_pair(capacity, 'p', 'q')}], block, rows, cols);",
        "            }",
        "            col += cols;",
        "        }",
        "        row += rows;",
        "    }",
        "}",
    ]
