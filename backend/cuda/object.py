"""One object of a compiled scene as one file of CUDA C++: one instance for each thread (paper, section 7).

The entry points are those of cpp_object, with these differences: `X_batch(a, count, out)` and `X_derive(a, count, ...)`
are kernels; `X_pull(a, i, b, out)` takes one vector b, and without it only counts its rows; `X_curve` adds to a packed
upper triangle in which leaves with one place are merged, where row r of the source is row to[r] of the triangle and
entry k stands at packed[k * step].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import groupby
from typing import ClassVar

from xdsl.ir import SSAValue

from yasps.backend.codegen.object_text import SELF, ObjectEmitter, ObjectText, c_type
from yasps.backend.codegen.scene_view import Slot
from yasps.backend.cuda.expand import curve_body
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    DerivativeOp,
    ObjectOp,
)
from yasps.runtime.core import sink

PRELUDE = sink.TEXT + files("yasps.backend.cuda").joinpath("preludes", "kernel.cuh").read_text(encoding="utf-8")
BLOCKS_AT_ONCE = 4
"""Of a kernel on a multiprocessor, at least. The functions that kernels of other files call keep to the registers that
this leaves (_FUNCTION_FLAGS of the toolchain)."""
THIS_THREAD = "blockIdx.x * (long)blockDim.x + threadIdx.x"


class CudaEmitter(ObjectEmitter):
    """Emits CUDA C++."""

    def text_of(self, name: str, container: ObjectOp) -> CudaObjectText:
        """The text of one object."""
        return CudaObjectText(self, name, container)


@dataclass(frozen=True)
class SlotRange:
    """Neighbouring slots that differ only in which connected instance they read: code for them is a loop.

    first: number of the first slot; count: how many. entry, leaf: where the first one's entries and leaves begin.
    """

    slot: Slot
    first: int
    count: int
    entry: int
    leaf: int


def ranges_of(slots: Sequence[Slot]) -> list[SlotRange]:
    """The slots as few ranges, in order."""
    ranges: list[SlotRange] = []
    first = entry = leaf = 0
    for _, group in groupby(
        enumerate(slots), key=lambda item: (item[1].source, item[1].connectivity, item[0] - item[1].position)
    ):
        same = [slot for _, slot in group]
        ranges.append(SlotRange(same[0], first, len(same), entry, leaf))
        first += len(same)
        entry += sum(slot.size for slot in same)
        leaf += sum(slot.capacity for slot in same)
    return ranges


class CudaObjectText(ObjectText):
    """The text of one object, for one instance."""

    linkage = 'extern "C" __device__'
    local_linkage = "static __device__ inline"
    math_prefix = ""
    signatures: ClassVar[dict[str, tuple[str, str]]] = {
        "value": ("void", "{}*"),
        "pull": ("long", "const double*, double*"),
        "second": ("void", "const double*, double*"),
        "curve": ("void", "const double*, double*, long, long, const int*"),
    }

    def __init__(self, emitter: ObjectEmitter, name: str, container: ObjectOp) -> None:
        super().__init__(emitter, name, container)
        self.preludes[PRELUDE] = None

    def helpers(self) -> list[str]:
        """None: the device has all functions."""
        return []

    def kernel(self, name: str, parameters: str, body: Sequence[str], blocks: int = BLOCKS_AT_ONCE) -> None:
        """Adds an entry that the host launches. blocks: how many of them a multiprocessor has registers for."""
        signature = f"{SELF}_{name}(Arguments a, long count, {parameters})"
        bounds = f"__launch_bounds__({sink.THREADS}, {blocks})"
        self.entry(name, signature, body, f'extern "C" __global__ void {bounds}')

    def attribute(self, attribute: AttributeOp) -> None:
        scalar, size = c_type(attribute.matrix_type), self.scene.size(attribute.symbol)
        if "call" in self.wanted or "batch" in self.wanted:
            body = self.value_body(attribute, scalar)
            self.entry("value", f"void {SELF}_value(Arguments a, long i, {scalar}* out)", body)
        if "batch" in self.wanted:
            body = [
                f"const long i = {THIS_THREAD};",
                "if (i >= count) return;",
                f"{scalar} one[{size}];",
                f"{SELF}_value(a, i, one);",
                f"for (long e = 0; e < {size}; ++e) out[i * {size} + e] = one[e];",
            ]
            self.kernel("batch", f"{scalar}* out", body)
        if self.scene.is_union(attribute.symbol):
            if self.scene.reaches_target(attribute.symbol):
                signature = f"long {SELF}_pull(Arguments a, long i, const double* b, double* out)"
                body = self.in_member(attribute, lambda name: f"return {self.pull_source(name, 'j', 'b', 'out')};")
                self.entry("pull", signature, [*body, "return 0;"])
            if self.scene.is_curved(attribute.symbol):
                body = self.in_member(attribute, lambda name: f"{self.curve_source(name, 'j', 'v', 'to')} return;")
                self.entry("curve", CURVE_SIGNATURE, body)

    def pull_source(self, source: str, index: str, b: str, out: str) -> str:
        """Expression that writes the rows behind `source` and says how many they are; without b it only counts."""
        if source in self.scene.targets:
            return f"copy_rows({self.scene.size(source)}, {b}, {out})"
        if not self.scene.reaches_target(source):
            return "0"
        definition = self.scene.jacobians[source].symbol if source in self.scene.jacobians else source
        function, arguments = self.callee(definition, "pull")
        return f"{function}({arguments}, {index}, {b}, {out})"

    def curve_source(self, source: str, index: str, v: str, to: str) -> str:
        """Statement that adds the curvature behind `source`, contracted with v, to the triangle."""
        if not self.scene.is_curved(source):
            return ""
        definition = self.scene.jacobians[source].symbol if source in self.scene.jacobians else source
        function, arguments = self.callee(definition, "curve")
        return f"{function}({arguments}, {index}, {v}, packed, step, width, {to});"

    def index_in(self, slots: SlotRange, k: str) -> str:
        """Which instance slot k of the range reads."""
        if slots.slot.connectivity is None:
            return self.slot_index(slots.slot)
        indices = self.bind("indices", slots.slot.connectivity)
        return f"(long){indices}[i * {slots.slot.arity} + {slots.slot.position} + {k}]"

    def over_connected(self, slot: Slot, body: str) -> list[str]:
        """Runs `body` for every connected instance j of a slot of variable arity; `connected` counts them."""
        indices = self.bind("indices", slot.connectivity or "")
        here = f"{indices}[i * {slot.arity} + connected]"
        return [
            "long connected = 0;",
            f"for (; connected < {slot.arity} && {here} >= 0; ++connected) {{",
            f"    const long j = {here};",
            f"    {body}",
            "    (void)j;",
            "}",
        ]

    def pull_slot(self, slots: SlotRange, k: str, b: str, out: str, reached: str) -> list[str]:
        """As pull_source for what slot k of the range reads; adds to `reached`.

        Of a sum every term gets b, of a mean its share.
        """
        slot = slots.slot
        if slot.reduction is None:
            return [f"{reached} += {self.pull_source(slot.source, self.index_in(slots, k), b, out)};"]
        lines = [
            "{",
            f"    const double* const from = {b};",
            f"    double* const into = {out};",
            "    long terms = 0;",
        ]
        pull = f"terms += {self.pull_source(slot.source, 'j', 'from', 'into + terms')};"
        lines += [f"    {line}" for line in self.over_connected(slot, pull)]
        if slot.reduction == "mean":
            lines += ["    if (from)", "        for (long e = 0; e < terms; ++e) into[e] /= (double)connected;"]
        return [*lines, f"    {reached} += terms;", "}"]

    def curve_slot(self, slots: SlotRange, k: str, v: str, to: str) -> list[str]:
        """As curve_source for what slot k of the range reads."""
        slot = slots.slot
        if slot.reduction is None:
            return [self.curve_source(slot.source, self.index_in(slots, k), v, to)]
        lines = ["{", f"    double share[{slot.size}];", "    long reached = 0, terms = 1;"]
        if slot.reduction == "mean":
            lines += [
                "    {",
                *(f"        {line}" for line in self.over_connected(slot, "")),
                "        terms = connected;",
                "    }",
            ]
        lines.append(f"    for (long e = 0; e < {slot.size}; ++e) share[e] = ({v})[e] / (double)terms;")
        count = self.pull_source(slot.source, "j", "(const double*)0", "(double*)0")
        curve = self.curve_source(slot.source, "j", "share", f"{to} + reached")
        lines += [f"    {line}" for line in self.over_connected(slot, f"{curve} reached += {count};")]
        return [*lines, "}"]

    def pull(self, call: ApplyOp, cotangent: SSAValue, slots: Sequence[Slot]) -> None:
        q = sum(slot.size for slot in slots)
        direct = all(slot.is_target for slot in slots)
        target = "out" if direct else "w"
        compute = [*self.gather_scalar("double"), self.call(call, {**self.names(), cotangent: "b"}, [target], "double")]
        lines = [] if direct else [f"double w[{q}];"]
        lines += ["if (b) {", *(f"    {line}" for line in compute), "}"]
        if direct:
            lines.append(f"return {q};")
        else:
            lines.append("long rows = 0;")
            for same in ranges_of(slots):
                given = f"b ? w + {same.entry} + k * {same.slot.size} : b"
                pull = self.pull_slot(same, "k", given, "out + rows", "rows")
                lines += [f"for (long k = 0; k < {same.count}; ++k) {{", *(f"    {line}" for line in pull), "}"]
            lines.append("return rows;")
        self.entry("pull", f"long {SELF}_pull(Arguments a, long i, const double* b, double* out)", lines)

    def curve(self, slots: Sequence[Slot], second: str | None, transposed: Sequence[str]) -> None:
        self.entry("curve", CURVE_SIGNATURE, curve_body(self, ranges_of(slots), second, transposed))

    def derivative(self, derivative: DerivativeOp) -> None:
        from yasps.backend.cuda.derivative import PARAMETERS, blocks_at_once, derivative_body

        self.kernel("derive", PARAMETERS, derivative_body(self, derivative), blocks_at_once(self, derivative))


CURVE_SIGNATURE = (
    f"void {SELF}_curve(Arguments a, long i, const double* v, double* packed, long step, long width, const int* to)"
)
