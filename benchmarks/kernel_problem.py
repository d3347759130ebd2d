"""What can be said of a compiled scene with one energy: how much it projects, and the floor under its assembly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.arithmetic import peak_arithmetic
from benchmarks.bandwidth import memory_bandwidth
from benchmarks.measure import Row
from benchmarks.opcounts import operations
from yasps.frontend.execution.compiled_scene import CompiledScene
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.frontend.language.nodes import Stored
from yasps.runtime.assembly.assembler import Assembler, KernelCall
from yasps.runtime.build.toolchain import Compiler

UNIT = "ns/element"


def on_cpu(compiled: CompiledScene) -> CpuScene:
    """What was made without a device."""
    assert isinstance(compiled, CpuScene)
    return compiled


def projected_share(compiled: CpuScene) -> float:
    """Share of the instances of the scene's only energy whose Hessian the assembler has to project now."""
    compiled.assemble()
    (term,) = compiled._terms
    assert term.derivative is not None
    placement = compiled.placements[term.symbol]
    call = KernelCall(
        compiled.program.function(term.derivative, "derive"),
        compiled.program.arguments(term.derivative),
        term.count,
        placement.kappas,
        placement.positions,
    )
    matrix = compiled.static_matrix
    (status,) = Assembler(compiled.runtime).assemble([call], [matrix], np.zeros(matrix.size), matrix.block_size_at)
    return status.projected / term.count


def bytes_per_element(compiled: CpuScene) -> float:
    """Bytes that an assembly must move for each instance of the scene's only energy, nothing twice: everything that is
    read (numbers, connectivities, placement) and everything that is written (gradient, matrix)."""
    (term,) = compiled._terms
    placement = compiled.placements[term.symbol]
    numbers = [a.node.array for a in compiled.emitter.stored.values() if isinstance(a.node, Stored)]
    indices = [connectivity.indices for connectivity in compiled.emitter.connected.values()]
    matrix = compiled.static_matrix
    moved: list[NDArray[Any]] = [*numbers, *indices, placement.kappas, placement.positions, matrix.values]
    return (sum(array.nbytes for array in moved) + 8 * matrix.size) / term.count


@dataclass(frozen=True)
class Machine:
    """What this machine can do: rows of copy bandwidth (GB/s; one for each number of threads) and of arithmetic."""

    bandwidths: list[Row]
    arithmetic: Row

    @property
    def rows(self) -> list[Row]:
        """As measured."""
        return [*self.bandwidths, self.arithmetic]

    def floor(self, compiled: CpuScene, threads: int) -> tuple[float, str]:
        """Least ns for each instance of the scene's only energy, and what binds: "bytes" or "arithmetic"."""
        copy = next(row.value for row in self.bandwidths if row.threads == threads)
        moving = bytes_per_element(compiled) / copy
        counting = operations(compiled.module).total() / (self.arithmetic.value * threads)
        return (moving, "bytes") if moving >= counting else (counting, "arithmetic")


def measure_machine(compiler: Compiler, threads: Sequence[int], repeats: int) -> Machine:
    """Copies memory and adds numbers; the compiler is for the latter."""
    bandwidths = [memory_bandwidth(count, repeats) for count in threads]
    return Machine(bandwidths, peak_arithmetic(compiler, repeats))


def floor_rows(name: str, compiled: CpuScene, machine: Machine, rows: Sequence[Row], unit: str = UNIT) -> list[Row]:
    """The floor of one energy, and how far each of the rows (assemblies of it) stands above it."""
    found = [
        Row(f"{name}, moved", "bytes", 1, bytes_per_element(compiled), unit.replace("ns", "B")),
        Row(f"{name}, operations", "count", 1, float(operations(compiled.module).total()), unit.replace("ns/", "1/")),
    ]
    for threads in sorted({row.threads for row in rows}):
        floor, binds = machine.floor(compiled, threads)
        found.append(Row(f"{name}, floor", binds, threads, floor, unit))
        found += [
            Row(f"{row.case}: above floor", row.implementation, threads, row.value / floor, "times")
            for row in rows
            if row.threads == threads
        ]
    return found


FLOOR_NOTES = (
    "floor: the larger of two. bytes: every input byte read once and every result byte written once, at the measured "
    "copy bandwidth. arithmetic: the operations of gradient and Hessian (as `opcounts` counts them; a division or a "
    "log counts as one) at the measured rate of additions and multiplications, 8 lanes. Eigenvalues are not in it.",
    "above floor: time over floor, on as many threads.",
)
