"""The kernel of an energy's derivatives on a device: one thread gathers, derives, projects, pulls back and scatters.

Blocks between targets go from registers to the global matrix; any other is expanded a row at a time (cuda_expand).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from yasps.backend.codegen.object_text import indented, packed_place
from yasps.backend.cuda.expand import DENSE_PRELUDE, curve_behind, expand, expand_merged, row_starts
from yasps.backend.cuda.object import BLOCKS_AT_ONCE, THIS_THREAD, ranges_of
from yasps.dialects.mat import shape_of
from yasps.dialects.rel import ApplyOp, DerivativeOp, ProjectOp, YieldDerivativeOp
from yasps.runtime.core.sink import DEVICE_FIELDS

if TYPE_CHECKING:
    from yasps.backend.codegen.scene_view import Slot
    from yasps.backend.cuda.object import CudaObjectText, SlotRange

LARGEST_STACK = 2560
"""Bytes of a thread's stack that a Hessian and its projection may take; larger ones go to global memory."""

ALL_THREADS = "(long)gridDim.x * blockDim.x"
LARGEST_SMALL_WIDTH = 6
"""Of a local Hessian whose kernel needs few registers."""

PARAMETERS = ", ".join(f"{type_} {name}" for type_, name in DEVICE_FIELDS)
"""Of the entry `derive`, after the number of instances; sink.h says what they are."""


def blocks_at_once(text: CudaObjectText, derivative: DerivativeOp) -> int:
    """Of the entry `derive` on a multiprocessor: as many as cost next to no spills (docs/gpu.md)."""
    if derivative.curved is not None:
        return BLOCKS_AT_ONCE - 2
    width = sum(slot.size for read in text.scene.wrt(derivative) for slot in text.scene.slots(read))
    return BLOCKS_AT_ONCE if width <= LARGEST_SMALL_WIDTH else BLOCKS_AT_ONCE - 1


def derivative_body(text: CudaObjectText, derivative: DerivativeOp) -> list[str]:
    """Statements of the entry point `derive`."""
    terminator = derivative.body.block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    slots = [slot for read in text.scene.wrt(derivative) for slot in text.scene.slots(read)]
    derive = terminator.gradient.owner
    assert isinstance(derive, ApplyOp)
    capacity = sum(slot.capacity for slot in slots)
    if derivative.curved is not None:
        hessian = _merged_hessian(text, slots, capacity, derive, has_hessian=terminator.hessian is not None)
    elif terminator.hessian is not None:
        hessian = _hessian(text, derivative, terminator, derive, slots)
    else:
        hessian = []
    n = sum(slot.size for slot in slots)
    outputs = ["energy", "gradient", "middle", "deformation"][: len(derive.values)]
    declared = [f"double {name}[{shape_of(value)[0]}];" for name, value in zip(outputs, derive.values, strict=True)]
    declared[1] = f"double gradient[{n}];"
    finite = ["all_finite<1>(energy)", f"all_finite<{n}>(gradient)"]
    if len(outputs) > 2:
        finite.append(f"all_finite<{shape_of(derive.values[2])[0]}>(middle)")
    return [
        f"const yasps_sink sink = {{{', '.join(name for _, name in DEVICE_FIELDS)}}};",
        f"const long thread = {THIS_THREAD};",
        f"for (long i = thread; i < count; i += {ALL_THREADS}) {{",
        *indented(text.gather_scalar("double")),
        *indented(declared),
        f"    {text.call(derive, text.names(), outputs, 'double')}",
        f"    if (!({' && '.join(finite)})) {{",
        "        report_not_finite(sink, i);",
        "        continue;",
        "    }",
        f"    const int* const kappa = sink.kappa + i * {capacity};",
        *indented(_gradient(text, slots, capacity)),
        *(
            [
                "    if (!sink.blocks) continue;",
                f"    const long* const position = sink.position + i * {capacity * (capacity + 1) // 2};",
                *indented(hessian),
            ]
            if hessian
            else []
        ),
        "}",
    ]


def _gradient(text: CudaObjectText, slots: list[Slot], capacity: int) -> list[str]:
    lines: list[str] = []
    for same in ranges_of(slots):
        slot = same.slot
        if slot.is_target:
            lines += [
                f"add_gradient<{slot.size}>(sink, kappa, i, {capacity}, {same.leaf + k}, "
                f"gradient + {same.entry + k * slot.size});"
                for k in range(same.count)
            ]
        elif slot.rows:
            begin = f"{same.leaf} + k * {slot.capacity}"
            pull = text.pull_slot(same, "k", f"gradient + {same.entry} + k * {slot.size}", "rows", "reached")
            lines += [
                f"for (long k = 0; k < {same.count}; ++k) {{",
                f"    double rows[{slot.rows}];",
                "    long reached = 0;",
                *indented(pull),
                f"    add_gradient_rows(sink, kappa, i, {capacity}, {begin}, {begin} + {slot.capacity}, rows);",
                "}",
            ]
    return lines


def _hessian(
    text: CudaObjectText,
    derivative: DerivativeOp,
    terminator: YieldDerivativeOp,
    derive: ApplyOp,
    slots: list[Slot],
) -> list[str]:
    """Projection, pull-back through linear layers, and scatter."""
    assert terminator.hessian is not None
    project = next((op for op in derivative.body.block.ops if isinstance(op, ProjectOp)), None)
    lines: list[str] = []
    packed, names = "middle", text.names()
    if project is not None:
        width, entries = project.width.value.data, shape_of(project.packed)[0]
        if project.deformation is not None:
            lines.append(f"const int changed = yasps_project_isotropic(middle, deformation, {width}, (int)mode);")
        else:
            lines += _projection(text, width, entries)
        lines += _use_of_changed()
        names[project.result] = "middle"
        pull_back = terminator.hessian.owner
        if isinstance(pull_back, ApplyOp):
            lines.append(f"double hessian[{shape_of(terminator.hessian)[0]}];")
            lines.append(text.call(pull_back, names, ["hessian"], "double"))
            packed = "hessian"
    return lines + _scatter(text, slots, packed)


def _use_of_changed() -> list[str]:
    return [
        "if (changed < 0) {",
        "    report_not_finite(sink, i);",
        "    continue;",
        "}",
        "if (changed) atomicAdd(sink.outcome + 1, 1ull);",
    ]


def _projection(text: CudaObjectText, width: int, entries: int) -> list[str]:
    """Calls the runtime's projection; what it works on is in global memory where the stack would be too large."""
    work = width * (width + 2)
    if 8 * (entries + work) <= LARGEST_STACK:
        return [f"double work[{work}];", f"const int changed = yasps_project(middle, {width}, (int)mode, work);"]
    text.workspace = work
    call = f"yasps_project_apart(middle, 1, {width}, (int)mode, sink.workspace + thread, {ALL_THREADS})"
    return [f"const int changed = {call};"]


def _scatter(text: CudaObjectText, slots: list[Slot], packed: str) -> list[str]:
    """Adds all blocks of the packed Hessian."""
    ranges = ranges_of(slots)
    n, capacity = sum(slot.size for slot in slots), sum(slot.capacity for slot in slots)
    targets = [(same, k) for same in ranges if same.slot.is_target for k in range(same.count)]
    lines: list[str] = []
    for a, (one, s) in enumerate(targets):
        for other, t in targets[a:]:
            rows, cols = one.slot.size, other.slot.size
            r0, c0 = one.entry + s * rows, other.entry + t * cols
            entries = [f"{packed}[{packed_place(n, r0 + r, c0 + c)}]" for r in range(rows) for c in range(cols)]
            place = packed_place(capacity, one.leaf + s, other.leaf + t)
            lines += [
                "{",
                f"    const double block[{rows * cols}] = {{{', '.join(entries)}}};",
                f"    add_block<{rows}, {cols}>(sink.blocks, position[{place}], block);",
                "}",
            ]

    def add(one: SlotRange, other: SlotRange) -> str:
        p = f"{one.leaf} + s * {one.slot.capacity}"
        q = f"{other.leaf} + t * {other.slot.capacity}"
        return f"add_row(sink, kappa, position, {capacity}, {p}, r, {q}, {q} + {other.slot.capacity}, row);"

    def is_wanted(one: SlotRange, other: SlotRange) -> bool:
        return not (one.slot.is_target and other.slot.is_target)

    return lines + expand(text, ranges, packed, add, is_wanted)


def _merged_hessian(
    text: CudaObjectText, slots: list[Slot], capacity: int, derive: ApplyOp, *, has_hessian: bool
) -> list[str]:
    """The local Hessian of an energy of nonlinear parameterisations: expanded to the targets in global memory, then
    projected and scattered."""
    text.preludes[DENSE_PRELUDE] = None
    ranges = ranges_of(slots)
    rows = max(1, sum(slot.rows for slot in slots))
    triangle, work = rows * (rows + 1) // 2, rows * (rows + 2)
    text.workspace = triangle + work
    lines = [
        f"int leaf[{capacity}], start[{capacity + 1}], to[{rows}];",
        f"const long leaves = merge_leaves(sink, kappa, {capacity}, leaf, start, to), width = start[leaves];",
        f"const long step = {ALL_THREADS};",
        "double* const packed = sink.workspace + thread;",
        "for (long k = 0; k < width * (width + 1) / 2; ++k) packed[k * step] = 0.0;",
        *row_starts(text, ranges),
    ]
    if has_hessian:
        lines += expand_merged(text, ranges, "middle")
    lines += curve_behind(text, ranges, "gradient")
    return [
        *lines,
        f"double* const work = packed + {triangle} * step;",
        "const int changed = yasps_project_apart(packed, step, (int)width, (int)mode, work, step);",
        *_use_of_changed(),
        f"scatter_merged(sink, position, {capacity}, leaves, leaf, start, packed, step);",
    ]
