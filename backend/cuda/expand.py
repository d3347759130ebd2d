"""J^T H J for a local Hessian H some of whose inputs are not targets themselves, a row at a time.

No expanded block is ever held: of the block of slots s and t there is J_s^T H_st, whose columns are few, and one row of
the result. So the stack of a thread does not grow with the number of slots, and with what is behind one only linearly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from yasps.backend.codegen.slots import SlotRange, block

if TYPE_CHECKING:
    from yasps.backend.cuda.object import CudaObjectText


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
            entry = f"{one.entry} + s * {size} + e, {other.entry} + t * {across} + c"
            column = [
                f"double b[{size}];",
                f"for (long e = 0; e < {size}; ++e) b[e] = {triangle}[packed_place({n}, {entry})];",
                *text.pull_slot(one.slot, "s", "b", "1", "left[c]", into="height ="),
            ]
            row = [
                f"double b[{across}], row[{other.slot.rows}];",
                f"for (long c = 0; c < {across}; ++c) b[c] = left[c][r];",
                *text.pull_slot(other.slot, "t", "b", "1", "row", into="const long breadth ="),
                use(one, other),
            ]
            pair = [
                f"double left[{across}][{one.slot.rows}];",
                "long height = 0;",
                *block(f"for (long c = 0; c < {across}; ++c)", column),
                *block("for (long r = 0; r < height; ++r)", row),
            ]
            lines.append(f"for (long s = 0; s < {one.count}; ++s)")
            lines += [f"    {line}" for line in block(f"for (long t = {begin}; t < {other.count}; ++t)", pair)]
    return lines
