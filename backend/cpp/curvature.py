"""Code for nonlinear parameterisations: the curvature term of eq. 3, and the dense local Hessian it needs."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from typing import TYPE_CHECKING

from yasps.backend.codegen.scene_view import Slot
from yasps.backend.cpp.expand import expand, starts

if TYPE_CHECKING:
    from yasps.backend.cpp.object import CppObjectText

DENSE_PRELUDE = files("yasps.backend.cpp").joinpath("preludes", "dense.h").read_text(encoding="utf-8")


def row_starts(text: CppObjectText, slots: Sequence[Slot]) -> list[str]:
    """Declares `at`: where each slot's rows start when all slots are expanded to the targets, and their number."""
    lines = [f"long at[{len(slots) + 1}];", "at[0] = 0;"]
    for k, slot in enumerate(slots):  # of nothing, a pull only counts its rows
        rows = text.pull_slot(slot, "(const V*)0", "0", "(V*)0")
        lines.append(f"at[{k + 1}] = at[{k}] + {rows};")
    return lines


def expand_into(text: CppObjectText, slots: Sequence[Slot], triangle: str, out: str, width: str) -> list[str]:
    """Adds J^T H J to the square matrix `out` of `width` columns, for the H with this upper triangle."""

    def add(s: int, t: int) -> str:
        function = "add_to_dense_diagonal" if s == t else "add_to_dense"
        return f"{function}({out}, {width}, at[{s}], height{s}, at[{t}], height, block, across);"

    return expand(text, slots, triangle, add)


def curve_body(text: CppObjectText, slots: Sequence[Slot], second: str | None, transposed: Sequence[str]) -> list[str]:
    """Statements of the entry `curve`: own curvature (`second` fills the array of that name, packed) and the sources'.

    `transposed` fills w = J^T v.
    """
    q = sum(slot.size for slot in slots)
    at = starts([slot.size for slot in slots])
    lines = row_starts(text, slots)
    if second is not None:
        lines += [f"double second[{q * (q + 1) // 2}];", second]
        lines += expand_into(text, slots, "second", "out", "n")
    if any(text.scene.is_curved(slot.source) for slot in slots):
        lines += transposed
        for k, slot in enumerate(slots):
            if text.scene.is_curved(slot.source):
                call = text.curve_slot(slot, f"w + {at[k]}", f"out + at[{k}] * (n + 1)", "n")
                lines.append(f"{call};")
    lines.append(f"return at[{len(slots)}];")
    return lines


def dense_hessian(text: CppObjectText, slots: Sequence[Slot], capacity: int, packed: str | None) -> list[str]:
    """Statements for one pack: the dense local Hessian of each lane, projected and scattered."""
    text.preludes[DENSE_PRELUDE] = None
    at = starts([slot.size for slot in slots])
    count = sum(slot.size for slot in slots)
    lines = [
        "for (long l = 0; l < lanes; ++l) {",
        "    const long i = first + l;",
        *(f"    {line}" for line in row_starts(text, slots)),
        f"    const long n = at[{len(slots)}];",
        f"    double local[{max(1, sum(slot.rows for slot in slots)) ** 2}];",
        "    for (long k = 0; k < n * n; ++k) local[k] = 0.0;",
    ]
    if packed is not None:
        entries = count * (count + 1) // 2
        lines += [
            f"    double triangle[{entries}];",
            f"    for (long k = 0; k < {entries}; ++k) triangle[k] = {packed}[k][l];",
            *(f"    {line}" for line in expand_into(text, slots, "triangle", "local", "n")),
        ]
    for k, slot in enumerate(slots):
        if text.scene.is_curved(slot.source):
            call = text.curve_slot(slot, "v", f"local + at[{k}] * (n + 1)", "n")
            lines += [
                "    {",
                f"        double v[{slot.size}];",
                f"        for (long e = 0; e < {slot.size}; ++e) v[e] = gradient[{at[k]} + e][l];",
                f"        {call};",
                "    }",
            ]
    pairs = capacity * (capacity + 1) // 2
    lines += [
        f"    const long changed = project_and_scatter(sink, sink->kappa + i * {capacity},",
        f"                                             sink->position + i * {pairs}, {capacity}, local, n);",
        "    if (changed < 0) return i;",
        "    *sink->projected += changed;",
        "}",
    ]
    return lines
