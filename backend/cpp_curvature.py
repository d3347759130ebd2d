"""Code for nonlinear parameterisations: the curvature term of eq. 3, and the dense local Hessian it needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING

from yasps.backend.scene_view import Slot

if TYPE_CHECKING:
    from yasps.backend.cpp_object import _ObjectText

DENSE_PRELUDE = files("yasps.backend").joinpath("dense_prelude.h").read_text(encoding="utf-8")


def row_starts(text: _ObjectText, slots: Sequence[Slot]) -> list[str]:
    """Declares `at`: where each slot's rows start when all slots are expanded to the targets, and their number."""
    lines = [f"long at[{len(slots) + 1}];", "at[0] = 0;"]
    for k, slot in enumerate(slots):  # of nothing, a pull only counts its rows
        rows = text.pull_slot(slot, "(const double*)0", "0", "(double*)0")
        lines.append(f"at[{k + 1}] = at[{k}] + {rows};")
    return lines


def expand_into(
    text: _ObjectText, slots: Sequence[Slot], entry: Callable[[int, int, str, str], str], out: str, width: str
) -> list[str]:
    """Adds J^T H J to the square matrix `out` of `width` columns, for the symmetric H given by `entry(s, t, r, c)`."""
    lines: list[str] = []
    for s, first in enumerate(slots):
        for t in range(s, len(slots)):
            second = slots[t]
            if first.rows == 0 or second.rows == 0:
                continue
            left = text.pull_slot(first, "b", str(second.size), "left")
            right = text.pull_slot(second, "turned", "height", "both")
            lines += [
                "{",
                f"    double b[{first.size * second.size}], left[{first.rows * second.size}];",
                f"    double turned[{first.rows * second.size}], both[{first.rows * second.rows}];",
                f"    for (long r = 0; r < {first.size}; ++r)",
                f"        for (long c = 0; c < {second.size}; ++c)",
                f"            b[r * {second.size} + c] = {entry(s, t, 'r', 'c')};",
                f"    const long height = {left};",
                "    for (long r = 0; r < height; ++r)",
                f"        for (long c = 0; c < {second.size}; ++c)",
                f"            turned[c * height + r] = left[r * {second.size} + c];",
                f"    const long across = {right};",
                "    for (long r = 0; r < height; ++r)",
                "        for (long c = 0; c < across; ++c) {",
                f"            {out}[(at[{s}] + r) * {width} + at[{t}] + c] += both[c * height + r];",
                *(
                    [f"            {out}[(at[{t}] + c) * {width} + at[{s}] + r] += both[c * height + r];"]
                    if s != t
                    else []
                ),
                "        }",
                "}",
            ]
    return lines


def starts_of(slots: Sequence[Slot]) -> list[int]:
    """Where each slot's entries start among the boundary inputs."""
    return [sum(slot.size for slot in slots[:k]) for k in range(len(slots))]


def symmetric_entry(array: str, n: int, at: Sequence[int], lane: str = "") -> Callable[[int, int, str, str], str]:
    """Entry (r, c) of the block of slots s <= t in a packed n x n matrix."""

    def entry(s: int, t: int, r: str, c: str) -> str:
        if s != t:
            return f"{array}[packed({n}, {at[s]} + {r}, {at[t]} + {c})]{lane}"
        low, high = f"({r} < {c} ? {r} : {c})", f"({r} < {c} ? {c} : {r})"
        return f"{array}[packed({n}, {at[s]} + {low}, {at[t]} + {high})]{lane}"

    return entry


def curve_body(text: _ObjectText, slots: Sequence[Slot], second: str | None, transposed: Sequence[str]) -> list[str]:
    """Statements of the entry `curve`: own curvature (`second` fills the array of that name, packed) and the sources'.

    `transposed` fills w = J^T v.
    """
    q = sum(slot.size for slot in slots)
    at = starts_of(slots)
    lines = row_starts(text, slots)
    if second is not None:
        lines += [f"double second[{q * (q + 1) // 2}];", second]
        lines += expand_into(text, slots, symmetric_entry("second", q, at), "out", "n")
    if any(text.scene.is_curved(slot.source) for slot in slots):
        lines += transposed
        for k, slot in enumerate(slots):
            if text.scene.is_curved(slot.source):
                call = text.curve_slot(slot, f"w + {at[k]}", f"out + at[{k}] * (n + 1)", "n")
                lines.append(f"{call};")
    lines.append(f"return at[{len(slots)}];")
    return lines


def dense_hessian(text: _ObjectText, slots: Sequence[Slot], capacity: int, packed: str | None) -> list[str]:
    """Statements for one pack: the dense local Hessian of each lane, projected and scattered."""
    text.preludes[DENSE_PRELUDE] = None
    at = starts_of(slots)
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
        entry = symmetric_entry(packed, count, at, "[l]")
        lines += [f"    {line}" for line in expand_into(text, slots, entry, "local", "n")]
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
