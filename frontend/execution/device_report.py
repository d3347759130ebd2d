"""What compiling a scene for a GPU takes, where there need not be one."""

from __future__ import annotations

import time
from dataclasses import dataclass

from yasps.backend.cuda.object import CudaEmitter
from yasps.backend.cuda.program import modules_of
from yasps.frontend.execution.scene_source import CompileRequest, SceneSource
from yasps.runtime.build.cuda.report import ModuleRow, largest_stack
from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.build.cuda.toolchain import build_program, find_cuda
from yasps.runtime.device.gpu import cub_source
from yasps.runtime.device.residency import TYPICAL, Residency

CUDA_KEY = ("cuda",)
"""What device code depends on apart from the scene."""


@dataclass(frozen=True)
class DeviceCompileReport:
    """Compiled and linked, not run.

    rows: one for each module and the runtime's files, and the last for the link, whose functions are the kernels with
    all they call. symbolic_seconds: from the frontend's description to text; native_seconds: from text to a program.
    """

    architecture: str
    rows: tuple[ModuleRow, ...]
    symbolic_seconds: float
    native_seconds: float

    @property
    def compiled(self) -> int:
        """Files and links that were made, not found in the cache."""
        return sum(not row.cached for row in self.rows)

    @property
    def stack_bytes(self) -> int:
        """The largest stack of a kernel, with all that it calls, in bytes a thread."""
        return largest_stack(self.rows)

    def stack_memory(self, residency: Residency) -> int:
        """Bytes of its memory that such a GPU keeps for stacks, whatever the scene's size."""
        return residency.stack_memory(self.stack_bytes)

    def __str__(self) -> str:
        width = max(len(row.name) for row in self.rows)
        head = f"{'module':{width}}  seconds          registers  stack B  spill B  lines"
        lines = [
            f"{row.name:{width}}  {row.seconds:7.2f} {'cached' if row.cached else '':8} {row.registers:9}  "
            f"{row.stack_bytes:7}  {row.spill_bytes:7}  {row.lines:5}"
            for row in self.rows
        ]
        if self.architecture in TYPICAL:
            name, residency = TYPICAL[self.architecture]
            lines.append(f"On a GPU like {name}, {residency.describe_stacks(self.stack_bytes)}.")
        return "\n".join([f"{self.architecture}: compiled, not run", head, *lines])


def compile_for_device(request: CompileRequest, architecture: str) -> DeviceCompileReport:
    """Compiles and links all device code of a scene; needs the CUDA toolkit but no GPU.

    Raises CudaNotFoundError, CompilationError, UnsupportedSceneError.
    """
    toolchain = find_cuda(architecture)
    start = time.perf_counter()
    source = SceneSource(request, CudaEmitter, CUDA_KEY)
    symbolic = time.perf_counter()
    program = build_program(toolchain, modules_of(source.code), runtime_sources(), [cub_source()])
    return DeviceCompileReport(architecture, program.rows, symbolic - start, time.perf_counter() - symbolic)
