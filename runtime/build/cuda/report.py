"""Registers, stack and spills of device code, read from what the compiler's assembler and the device linker say.

ptxas (`-v`) reports each module alone, the linker (`nvlink -v`) each kernel with all it calls in other modules. Neither
knows everything: spills are ptxas's, the stack and the registers of a whole kernel the linker's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

_ENTRY = re.compile(r"Compiling entry function '([^']+)'")
_FUNCTION = re.compile(r"Function properties for '?([^'\s]+?)'?:?$")
_FRAME = re.compile(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads")
_REGISTERS = re.compile(r"\bused (\d+) registers", re.IGNORECASE)
_SHARED = re.compile(r"(\d+) bytes smem")
_STACK = re.compile(r"(\d+) stack\b")


class ReportFormatError(RuntimeError):
    """The compiler or the linker reported in words that this version of yasps does not know."""


@dataclass(frozen=True)
class FunctionResources:
    """What one kernel, or one device function that was not inlined, takes per thread.

    registers: 32-bit registers; 0 for a device function, whose registers count in the kernels that call it.
    stack_bytes: local memory; of a kernel after the link, with that of the functions it calls.
    spill_bytes: bytes that spilling instructions store and load, as ptxas counts them: once each, loops or not.
    shared_bytes: static shared memory of a block.
    """

    name: str
    is_kernel: bool
    registers: int
    stack_bytes: int
    spill_bytes: int
    shared_bytes: int


@dataclass(frozen=True)
class ModuleRow:
    """One line of the compile report: a module, or the link of all.

    seconds: what it took now, about 0 where `cached`. registers, stack_bytes, spill_bytes: the largest among the
    module's `functions` (see FunctionResources), those of kernels after the link. lines: of its source.
    """

    name: str
    seconds: float
    cached: bool
    registers: int
    stack_bytes: int
    spill_bytes: int
    lines: int
    functions: tuple[FunctionResources, ...]


def largest_stack(rows: Iterable[ModuleRow]) -> int:
    """Bytes a thread, of all kernels."""
    return max((item.stack_bytes for row in rows for item in row.functions if item.is_kernel), default=0)


def functions_of_module(log: str) -> dict[str, FunctionResources]:
    """The functions of one module by their (mangled) names, from the log of `ptxas -v`.

    Raises ReportFormatError when the log names a function and not its stack, or a kernel and not its registers.
    """
    functions: dict[str, FunctionResources] = {}
    kernels: set[str] = set()
    name = ""
    for line in log.splitlines():
        if entry := _ENTRY.search(line):
            kernels.add(entry[1])
        elif function := _FUNCTION.search(line):
            name = function[1]
        elif frame := _FRAME.search(line):
            stack, stores, loads = (int(number) for number in frame.groups())
            functions[name] = FunctionResources(name, name in kernels, 0, stack, stores + loads, 0)
        elif (registers := _REGISTERS.search(line)) and name in functions:
            shared = _SHARED.search(line)
            functions[name] = replace(
                functions[name], registers=int(registers[1]), shared_bytes=int(shared[1]) if shared else 0
            )
    unknown = [kernel for kernel in sorted(kernels) if kernel not in functions or functions[kernel].registers == 0]
    if unknown or "" in functions:
        raise ReportFormatError(_unreadable("ptxas -v", unknown, log))
    return functions


def kernels_of_program(log: str) -> dict[str, FunctionResources]:
    """Registers, stack and shared memory of the kernels of a linked program, from the log of the device linker.

    `spill_bytes` are 0, because the linker does not know them. Raises ReportFormatError when it cannot be read.
    """
    kernels: dict[str, FunctionResources] = {}
    name = ""
    for line in log.splitlines():
        if function := _FUNCTION.search(line):
            name = function[1]
        elif registers := _REGISTERS.search(line):
            stack, shared = _STACK.search(line), _SHARED.search(line)
            if not name or stack is None or shared is None:
                raise ReportFormatError(_unreadable("nvlink -v", [name], log))
            kernels[name] = FunctionResources(name, True, int(registers[1]), int(stack[1]), 0, int(shared[1]))
    return kernels


def linked_functions(log: str, kernels: Mapping[str, FunctionResources]) -> tuple[FunctionResources, ...]:
    """The functions of a module (from the log of its compile), kernels with what the linker says of them.

    Raises ReportFormatError when the linker says nothing of a kernel.
    """
    functions = functions_of_module(log)
    missing = [name for name, function in functions.items() if function.is_kernel and name not in kernels]
    if missing:
        raise ReportFormatError(_unreadable("nvlink -v", missing, log))
    return tuple(
        replace(kernels[name], spill_bytes=function.spill_bytes) if function.is_kernel else function
        for name, function in functions.items()
    )


def _unreadable(origin: str, names: list[str], log: str) -> str:
    what = f" of {', '.join(names)}" if any(names) else ""
    return f"no registers or stack{what} in what `{origin}` of this CUDA toolkit reports:\n{log.strip()[:2000]}"
