"""One object of a compiled scene as one file of CUDA C++: one instance for each thread (paper, section 7).

The entry points are those of cpp/object.py, with these differences: `X_batch(a, count, out)` and
`X_derive(a, count, ...)` are kernels; `X_pull(a, i, b, out)` takes one vector b, and without it only counts its rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from xdsl.ir import SSAValue

from yasps.backend.codegen.branches import branch_number
from yasps.backend.codegen.expanding_text import SIGNATURES, ExpandingText, LocalDerivative
from yasps.backend.codegen.object_text import SELF, ObjectEmitter
from yasps.backend.codegen.scene_view import Slot
from yasps.backend.codegen.slots import SlotRange, block, ranges_of
from yasps.backend.cuda.expand import expand
from yasps.dialects.rel import ApplyOp, AttributeOp, DerivativeOp, ObjectOp
from yasps.runtime.core.sink import THREADS

BLOCKS_AT_ONCE = 4
"""Of a kernel on a multiprocessor, at least. The functions that kernels of other files call keep to the registers that
this leaves (_FUNCTION_FLAGS of the toolchain)."""
THIS_THREAD = "blockIdx.x * (long)blockDim.x + threadIdx.x"
ALL_THREADS = "(long)gridDim.x * blockDim.x"


class CudaEmitter(ObjectEmitter):
    """Emits CUDA C++."""

    def text_of(self, name: str, container: ObjectOp) -> CudaObjectText:
        """The text of one object."""
        return CudaObjectText(self, name, container)


class CudaObjectText(ExpandingText):
    """The text of one object, for one instance."""

    linkage = 'extern "C" __device__'
    local_linkage = "static __device__ inline"
    math_prefix = ""
    longest_function = None
    column = "double"
    signatures: ClassVar = {**SIGNATURES, "pull": ("long", "const double* b, double* out")}

    def __init__(self, emitter: ObjectEmitter, name: str, container: ObjectOp) -> None:
        super().__init__(emitter, name, container)
        self.begin_with("runtime/core/sink.h", "backend/cuda/preludes/kernel.cuh")

    def helpers(self) -> list[str]:
        """None: the device has all functions."""
        return []

    def kernel(self, name: str, parameters: str, body: Sequence[str], blocks: int = BLOCKS_AT_ONCE) -> None:
        """Adds an entry that the host launches. blocks: how many of them a multiprocessor has registers for."""
        signature = f"{SELF}_{name}(Arguments a, long count, {parameters})"
        bounds = f"__launch_bounds__({THREADS}, {blocks})"
        self.entry(name, signature, body, f'extern "C" __global__ void {bounds}')

    def part_of_w(self, entry: str) -> str:
        return f"b ? w + {entry} : b"

    def transposed(self, call: ApplyOp, cotangent: SSAValue, q: int, *, is_direct: bool) -> list[str]:
        compute = self.call(call, {**self.names(), cotangent: "b"}, ["out" if is_direct else "w"], "double")
        lines = [] if is_direct else [f"double w[{q}];"]
        return [*lines, *block("if (b)", [*self.gather_scalar("double"), compute])]

    def add_to_target(self, local: LocalDerivative, leaf: int, entry: int, size: int) -> str:
        return f"add_gradient<{size}>(sink, kappa, i, {local.capacity}, {leaf}, gradient + {entry});"

    def expand_merged(self, slots: Sequence[Slot], triangle: str) -> list[str]:
        def add(one: SlotRange, other: SlotRange) -> str:
            p, q = f"at[{one.first} + s]", f"at[{other.first} + t]"
            return f"add_merged_row(packed, step, width, to, {p}, r, {q}, breadth, row);"

        return expand(self, ranges_of(slots), triangle, add)

    def declare_merged(self, rows: int) -> list[str]:
        triangle = rows * (rows + 1) // 2
        self.workspace = triangle + rows * (rows + 2)
        return [
            f"const long step = {ALL_THREADS};",
            "double* const packed = sink.workspace + thread;",
            f"double* const work = packed + {triangle} * step;",
            "for (long k = 0; k < width * (width + 1) / 2; ++k) packed[k * step] = 0.0;",
        ]

    def project_merged(self) -> str:
        return "const int changed = yasps_project_apart(packed, step, (int)width, (int)mode, work, step);"

    def use_of_changed(self) -> list[str]:
        report = block("if (changed < 0)", ["report_not_finite(sink, i);", "continue;"])
        return [*report, "if (changed) atomicAdd(sink.outcome + 1, 1ull);"]

    def batch(self, attribute: AttributeOp, scalar: str) -> None:
        size = self.scene.size(attribute.symbol)
        body = [
            f"const long i = {THIS_THREAD};",
            "if (i >= count) return;",
            f"{scalar} one[{size}];",
            f"{SELF}_value(a, i, one);",
            f"for (long e = 0; e < {size}; ++e) out[i * {size} + e] = one[e];",
        ]
        self.kernel("batch", f"{scalar}* out", body)

    def derivative(self, derivative: DerivativeOp) -> None:
        from yasps.backend.cuda.derivative import PARAMETERS, blocks_at_once, derivative_body

        local = LocalDerivative.of(self.scene, derivative)
        number, branches = branch_number(self, local.slots)
        is_sorted = branches > 1
        self.kernel("derive", PARAMETERS, derivative_body(self, local, is_sorted=is_sorted), blocks_at_once(local))
        if is_sorted:
            self.branches = branches
            body = [
                f"const long i = {THIS_THREAD};",
                "if (i >= count) return;",
                *number,
                "keys[i] = number;",
                "ids[i] = (unsigned)i;",
            ]
            self.kernel("branches", "unsigned long* keys, unsigned* ids", body)
