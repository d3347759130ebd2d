"""J^T H J for a local Hessian H some of whose inputs are not targets themselves, a row at a time.

No expanded block is ever held: of the block of slots s and t there is J_s^T H_st, whose columns are few, and one row of
the result. So the stack of a thread does not grow with the number of slots, and with what is behind one only linearly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING

from yasps.backend.codegen.object_text import indented

if TYPE_CHECKING:
    from yasps.backend.cuda.object import CudaObjectText, SlotRange

DENSE_PRELUDE = files("yasps.backend.cuda").joinpath("preludes", "dense.cuh").read_text(encoding="utf-8")


def expand(
    text: CudaObjectText,
    ranges: Sequence[SlotRange],
    triangle: str,
    use: Callable[[SlotRange, SlotRange], str],
    is_wanted: Callable[[SlotRange, SlotRange], bool] = lambda s, t: True,
) -> list[str]:
    """Statements that expand the upper triangle of H for one instance i and `use` each row of each wanted block.

    What `use` gives is a statement: there `row` is row r of the block of slots s <= t of the two ranges, `breadth`
    numbers.
    """
    n = sum(same.count * same.slot.size for same in ranges)
    reaching = [same for same in ranges if same.slot.rows]
    lines: list[str] = []
    for k, one in enumerate(reaching):
        for other in reaching[k:]:
            if not is_wanted(one, other):
                continue
            size, across = one.slot.size, other.slot.size
            begin = "s" if other is one else "0"
            lines += [
                f"for (long s = 0; s < {one.count}; ++s)",
                f"    for (long t = {begin}; t < {other.count}; ++t) {{",
                f"        double left[{across}][{one.slot.rows}];",
                "        long height = 0;",
                f"        for (long c = 0; c < {across}; ++c) {{",
                f"            double b[{size}];",
                f"            for (long e = 0; e < {size}; ++e)",
                f"                b[e] = {triangle}[packed_place({n}, {one.entry} + s * {size} + e, "
                f"{other.entry} + t * {across} + c)];",
                "            height = 0;",
                *indented(indented(indented(text.pull_slot(one, "s", "b", "left[c]", "height")))),
                "        }",
                "        for (long r = 0; r < height; ++r) {",
                f"            double b[{across}], row[{other.slot.rows}];",
                f"            for (long c = 0; c < {across}; ++c) b[c] = left[c][r];",
                "            long breadth = 0;",
                *indented(indented(indented(text.pull_slot(other, "t", "b", "row", "breadth")))),
                f"            {use(one, other)}",
                "        }",
                "    }",
            ]
    return lines


def row_starts(text: CudaObjectText, ranges: Sequence[SlotRange]) -> list[str]:
    """Declares `at`: where each slot's rows start when all slots are expanded to the targets, and their number."""
    slots = sum(same.count for same in ranges)
    lines = [f"long at[{slots + 1}];", "at[0] = 0;"]
    for same in ranges:
        pull = text.pull_slot(same, "k", "(const double*)0", "(double*)0", f"at[{same.first} + k + 1]")
        lines += [
            f"for (long k = 0; k < {same.count}; ++k) {{",
            f"    at[{same.first} + k + 1] = at[{same.first} + k];",
            *indented(pull),
            "}",
        ]
    return lines


def expand_merged(text: CudaObjectText, ranges: Sequence[SlotRange], triangle: str) -> list[str]:
    """Adds J^T H J to the packed triangle `packed`; needs `step`, `at`, `to` and `width`."""

    def add(one: SlotRange, other: SlotRange) -> str:
        p, q = f"at[{one.first} + s]", f"at[{other.first} + t]"
        return f"add_merged_row(packed, step, width, to, {p}, r, {q}, breadth, row);"

    return expand(text, ranges, triangle, add)


def curve_behind(text: CudaObjectText, ranges: Sequence[SlotRange], v: str) -> list[str]:
    """Adds the curvature behind all slots, contracted with their parts of v."""
    lines: list[str] = []
    for same in ranges:
        if text.scene.is_curved(same.slot.source):
            part = f"{v} + {same.entry} + k * {same.slot.size}"
            curve = text.curve_slot(same, "k", part, f"to + at[{same.first} + k]")
            lines += [f"for (long k = 0; k < {same.count}; ++k) {{", *indented(curve), "}"]
    return lines


def curve_body(
    text: CudaObjectText, ranges: Sequence[SlotRange], second: str | None, transposed: Sequence[str]
) -> list[str]:
    """Statements of the entry `curve`: own curvature (`second` fills the array of that name, packed) and the sources'.

    `transposed` fills w = J^T v.
    """
    text.preludes[DENSE_PRELUDE] = None
    q = sum(same.count * same.slot.size for same in ranges)
    lines = row_starts(text, ranges)
    if second is not None:
        lines += [f"double second[{q * (q + 1) // 2}];", second, *expand_merged(text, ranges, "second")]
    behind = curve_behind(text, ranges, "w")
    return [*lines, *transposed, *behind] if behind else lines
