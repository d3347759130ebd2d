"""What the host, as a device, says of races of a kernel that it ran (race_hooks.cpp)."""

from __future__ import annotations

import ctypes
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from yasps.runtime.build.toolchain import CompiledObject, Compiler, Source, compile_sources

HOOKS = Path(__file__).resolve().with_name("race_hooks.cpp")
FLAGS = ("-O0", "-g1", "-DFIND_RACES", "-fvisibility=hidden", "-fsanitize=thread")
"""Every load and store is one of the source; a variable that blocks share is of its own library."""
_KINDS = ("reads", "writes", "adds to")


class DataRaceError(Exception):
    """Two threads of a launch touch the same memory in no order, and not both only read it or by atomic functions."""


@dataclass(frozen=True)
class Barrier:
    """A __syncthreads or __syncwarp: its file, and the line there, from 1."""

    file: str
    line: int


class _Access(ctypes.Structure):
    """As in race_hooks.cpp."""

    _fields_ = [(name, ctypes.c_uint) for name in ("code", "block", "thread", "kind", "blocks_met", "warps_met")]
    code: int
    block: int
    thread: int
    kind: int


class _Race(ctypes.Structure):
    """As in race_hooks.cpp."""

    _fields_ = [
        ("address", ctypes.c_uint64),
        ("shared", ctypes.c_uint32),
        ("found", ctypes.c_uint32),
        ("first", _Access),
        ("second", _Access),
    ]
    address: int
    shared: int
    found: int
    first: _Access
    second: _Access


def compile_hooks(compiler: Compiler) -> list[CompiledObject]:
    """What the instrumented objects call; `compiler` does not instrument."""
    return compile_sources([Source("race_hooks", HOOKS.read_text(encoding="utf-8"))], compiler)


def begin(library: ctypes.CDLL, left_out: Barrier | None) -> None:
    """Before a launch, which is without this barrier."""
    library.races_begin(left_out.file.encode() if left_out else b"", left_out.line if left_out else 0)


def end(library: ctypes.CDLL, kernel: str, allocations: Mapping[int, tuple[int, str]]) -> None:
    """After the launch. allocations: size and purpose by address. Raises DataRaceError."""
    race = _Race()
    if not library.races_end(ctypes.byref(race)):
        return
    accesses = "\n".join(f"  {_describe(access, library)}" for access in (race.first, race.second))
    raise DataRaceError(
        f"{kernel} has a race in {_where(race, allocations)}, the first of {race.found} found:\n{accesses}"
    )


def _where(race: _Race, allocations: Mapping[int, tuple[int, str]]) -> str:
    if race.shared:
        return "shared memory"
    for address, (size, purpose) in allocations.items():
        if address <= race.address < address + size:
            return f"byte {race.address - address} of {purpose}"
    return f"memory at {race.address:#x} that this device did not allocate"


def _describe(access: _Access, library: ctypes.CDLL) -> str:
    place = _line_of(library, access.code)
    return f"thread {access.thread} of block {access.block} {_KINDS[access.kind]} it at {place}"


def _line_of(library: ctypes.CDLL, code: int) -> str:
    """Function, file and line, of the instruction before this one."""
    command = ["addr2line", "-C", "-f", "-e", library._name, hex(code - 1)]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    except (OSError, subprocess.CalledProcessError):
        return f"{code - 1:#x} of {library._name}"  # without binutils
    function = re.sub(r"\(anonymous namespace\)::|\w+::|^void ", "", found[0]).split("(")[0]
    return f"{Path(found[1].split(' ')[0]).name} ({function})"
