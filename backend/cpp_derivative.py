"""The kernel of an energy's derivatives: gather, derive, project, pull back, scatter, 8 instances at a time.

Local blocks go to the global matrix as they are made. A slot that is a target itself is written directly; any other
is expanded by its source's `pull`, applied from the left to the block and, transposed, from the right: for two slots s
and t, J_s^T H_st J_t costs one call for each side, whatever parameterises them, so code grows linearly with their
number.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from xdsl.ir import SSAValue

from yasps.backend.cpp_curvature import dense_hessian
from yasps.backend.scene_view import Slot
from yasps.dialects.mat import shape_of
from yasps.dialects.rel import ApplyOp, DerivativeOp, ProjectOp, YieldDerivativeOp

if TYPE_CHECKING:
    from yasps.backend.cpp_object import _ObjectText


def derivative_body(text: _ObjectText, derivative: DerivativeOp) -> list[str]:
    """Statements of the entry point `derive`."""
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    slots = [slot for read in text.scene.wrt(derivative) for slot in text.scene.slots(read)]
    n = sum(slot.size for slot in slots)
    capacity = sum(slot.capacity for slot in slots)
    derive = terminator.gradient.owner
    assert isinstance(derive, ApplyOp)
    names = text.names()
    lines = [f"V gradient[{n}];"]
    outputs = ["gradient"]
    hessian = terminator.hessian
    if hessian is not None:
        middle = derive.values[1]
        lines.append(f"V middle[{shape_of(middle)[0]}];")
        names[middle] = "middle"
        outputs.append("middle")
    lines.append(text.call(derive, names, outputs, "V"))
    lines += ["V check = splat(0.0);", f"for (long k = 0; k < {n}; ++k) check += gradient[k] * 0.0;"]
    if hessian is not None:
        lines += [
            f"for (long k = 0; k < {shape_of(derive.values[1])[0]}; ++k) check += middle[k] * 0.0;",
        ]
    lines += [
        "for (long l = 0; l < lanes; ++l)",
        "    if (check[l] != 0.0) return first + l;  // not finite",
    ]
    scatter: list[str] = []
    if derivative.curved is not None:
        scatter = dense_hessian(text, slots, capacity, "middle" if hessian is not None else None)
    elif hessian is not None:
        scatter = _hessian(text, terminator, names, slots, n=n, capacity=capacity)
    if scatter:
        lines += ["if (sink->blocks) {", *(f"    {line}" for line in scatter), "}"]
    lines += _scatter_gradient(text, slots, capacity)
    return [
        "for (long first = begin; first < end; first += 8) {",
        "    const long lanes = end - first < 8 ? end - first : 8;",
        *(f"    {line}" for line in [*text.gather_pack(), *lines]),
        "}",
        "return -1;",
    ]


def _hessian(
    text: _ObjectText,
    terminator: YieldDerivativeOp,
    names: dict[SSAValue, str],
    slots: list[Slot],
    *,
    n: int,
    capacity: int,
) -> list[str]:
    hessian = terminator.hessian
    assert hessian is not None
    lines: list[str] = []
    packed = "middle"
    pull_back = hessian.owner
    project = pull_back if isinstance(pull_back, ProjectOp) else None
    if isinstance(pull_back, ApplyOp) and pull_back is not terminator.gradient.owner:
        project = next(v.owner for v in pull_back.inputs if isinstance(v.owner, ProjectOp))
    if project is not None:
        width = project.width.value.data
        lines += [
            f"const long changed = sink->project((double*)middle, {width}, (int)lanes, sink->mode);",
            "if (changed < 0) return first - changed - 1;",
            "*sink->projected += changed;",
        ]
        names[project.result] = "middle"
    if isinstance(pull_back, ApplyOp) and pull_back is not terminator.gradient.owner:
        lines.append(f"V hessian[{shape_of(hessian)[0]}];")
        lines.append(text.call(pull_back, names, ["hessian"], "V"))
        packed = "hessian"
    lines += _scatter_hessian(text, slots, n, capacity, packed)
    return lines


def _starts(sizes: list[int]) -> list[int]:
    return [sum(sizes[:k]) for k in range(len(sizes))]


def _pair(capacity: int, a: str, b: str) -> str:
    return f"{a} * {capacity} - {a} * ({a} - 1) / 2 + {b} - {a}"


def _scatter_gradient(text: _ObjectText, slots: list[Slot], capacity: int) -> list[str]:
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


def _scatter_hessian(text: _ObjectText, slots: list[Slot], n: int, capacity: int, packed: str) -> list[str]:
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
