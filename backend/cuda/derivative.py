"""The kernel of an energy's derivatives on a device: one thread gathers, derives, projects, pulls back and scatters.

Blocks between targets go from registers to the global matrix; any other is expanded a row at a time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from yasps.backend.codegen.expanding_text import LocalDerivative
from yasps.backend.codegen.object_text import size_of
from yasps.backend.codegen.slots import SlotRange, block, packed_place, ranges_of
from yasps.backend.cuda.expand import expand
from yasps.backend.cuda.object import ALL_THREADS, BLOCKS_AT_ONCE, THIS_THREAD
from yasps.dialects.rel import ApplyOp, ProjectOp
from yasps.runtime.core.sink import DEVICE_FIELDS

if TYPE_CHECKING:
    from yasps.backend.cuda.object import CudaObjectText

LARGEST_STACK = 2560
"""Bytes of a thread's stack that a Hessian and its projection may take; larger ones go to global memory."""

LARGEST_SMALL_WIDTH = 6
"""Of a local Hessian whose kernel needs few registers."""

PARAMETERS = ", ".join(f"{type_} {name}" for type_, name in DEVICE_FIELDS)
"""Of the entry `derive`, after the number of instances; sink.h says what they are."""


def blocks_at_once(local: LocalDerivative) -> int:
    """Of the entry `derive` on a multiprocessor: as many as cost next to no spills (docs/gpu.md)."""
    if local.curved:
        return BLOCKS_AT_ONCE - 2
    return BLOCKS_AT_ONCE if local.n <= LARGEST_SMALL_WIDTH else BLOCKS_AT_ONCE - 1


def derivative_body(text: CudaObjectText, local: LocalDerivative, *, is_sorted: bool) -> list[str]:
    """Statements of the entry point `derive`. is_sorted: threads take the instances in the order they are given."""
    hessian: list[str] = []
    if local.curved:
        hessian = text.merged_hessian(local, "middle" if local.hessian is not None else None, "gradient")
    elif local.hessian is not None:
        hessian = _hessian(text, local)
    if hessian:
        position = f"const long* const position = sink.position + i * {local.pairs};"
        hessian = ["if (!sink.blocks) continue;", position, *hessian]
    finite = [f"all_finite<{size}>({name})" for name, size in local.outputs.items() if name != "deformation"]
    instance = [
        *text.gather_scalar("double"),
        *(f"double {name}[{size}];" for name, size in local.outputs.items()),
        text.call(local.derive, text.names(), list(local.outputs), "double"),
        *block(f"if (!({' && '.join(finite)}))", ["report_not_finite(sink, i);", "continue;"]),
        f"const int* const kappa = sink.kappa + i * {local.capacity};",
        *text.scatter_gradient(local),
        *hessian,
    ]
    turn = "turn" if is_sorted else "i"
    if is_sorted:
        instance.insert(0, "const long i = sink.order ? sink.order[turn] : turn;")
    return [
        f"const yasps_sink sink = {{{', '.join(name for _, name in DEVICE_FIELDS)}}};",
        f"const long thread = {THIS_THREAD};",
        *block(f"for (long {turn} = thread; {turn} < count; {turn} += {ALL_THREADS})", instance),
    ]


def _hessian(text: CudaObjectText, local: LocalDerivative) -> list[str]:
    """Projection, pull-back through linear layers, and scatter."""
    if local.project is None:
        return _scatter(text, local, "middle")
    assert local.hessian is not None
    lines = [*_projection(text, local.project), *text.use_of_changed()]
    pull_back = local.hessian.owner
    if not isinstance(pull_back, ApplyOp):
        return lines + _scatter(text, local, "middle")
    names = {**text.names(), local.project.result: "middle"}
    lines += [f"double hessian[{size_of(local.hessian)}];", text.call(pull_back, names, ["hessian"], "double")]
    return lines + _scatter(text, local, "hessian")


def _projection(text: CudaObjectText, project: ProjectOp) -> list[str]:
    """Calls the runtime's projection; what it works on is in global memory where the stack would be too large."""
    width = project.width.value.data
    if project.deformation is not None and project.vectors is None:
        return [f"const int changed = yasps_project_isotropic(middle, deformation, {width}, (int)mode);"]
    work = width * (width + 2)
    if 8 * (size_of(project.packed) + work) <= LARGEST_STACK:
        return [f"double work[{work}];", f"const int changed = yasps_project(middle, {width}, (int)mode, work);"]
    text.workspace = work
    call = f"yasps_project_apart(middle, 1, {width}, (int)mode, sink.workspace + thread, {ALL_THREADS})"
    return [f"const int changed = {call};"]


def _scatter(text: CudaObjectText, local: LocalDerivative, packed: str) -> list[str]:
    """Adds all blocks of the packed Hessian."""
    ranges = ranges_of(local.slots)
    direct = [(same, k) for same in ranges if same.slot.is_direct for k in range(same.count)]
    lines: list[str] = []
    for a, (one, s) in enumerate(direct):
        for other, t in direct[a:]:
            rows, cols = one.slot.size, other.slot.size
            r0, c0 = one.entry + s * rows, other.entry + t * cols
            entries = [f"{packed}[{packed_place(local.n, r0 + r, c0 + c)}]" for r in range(rows) for c in range(cols)]
            place = packed_place(local.capacity, one.leaf + s, other.leaf + t)
            add = f"add_block<{rows}, {cols}>(sink, position[{place}], block);"
            lines += block("", [f"const double block[{rows * cols}] = {{{', '.join(entries)}}};", add])

    def add_row(one: SlotRange, other: SlotRange) -> str:
        p = f"{one.leaf} + s * {one.slot.capacity}"
        q = f"{other.leaf} + t * {other.slot.capacity}"
        return f"add_row(sink, kappa, position, {local.capacity}, {p}, r, {q}, {q} + {other.slot.capacity}, row);"

    def is_wanted(one: SlotRange, other: SlotRange) -> bool:
        return not (one.slot.is_direct and other.slot.is_direct)

    return lines + expand(text, ranges, packed, add_row, is_wanted)
