"""Compiles the C++ runtime on first use and declares its functions to ctypes.

runtime = load_runtime(find_compiler())
matrix = BlockMatrix(runtime)                  # yasps.runtime.block_matrix
Assembler(runtime).assemble(...)               # yasps.runtime.assembly
PcgSolver(runtime).solve([matrix], g, ...)     # yasps.runtime.solver
"""

from __future__ import annotations

import ctypes
import os
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.toolchain import (
    CompiledObject,
    Compiler,
    LinkedLibrary,
    Source,
    compile_sources,
    link,
)

#: Instances a generated kernel evaluates at once.
LANES = 8

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
LongArray = NDArray[np.int64]

_OUT_OF_MEMORY = 1
_INCLUDE = '#include "runtime.h"\n'

_pointer = ctypes.c_void_p
_long = ctypes.c_long
_int = ctypes.c_int
_double = ctypes.c_double

# name: (result, arguments), as in the extern "C" parts of the C++ files.
_SIGNATURES: dict[str, tuple[type | None, tuple[type, ...]]] = {
    "yasps_structure_new": (_pointer, ()),
    "yasps_structure_free": (None, (_pointer,)),
    "yasps_structure_build": (
        _int,
        (_pointer, _long, _pointer, _pointer, _long, _pointer, _pointer, _pointer, _pointer, _int, _int, _pointer),
    ),
    "yasps_structure_sizes": (None, (_pointer, _pointer)),
    "yasps_structure_groups": (None, (_pointer, _pointer)),
    "yasps_structure_coordinates": (None, (_pointer, _pointer, _pointer)),
    "yasps_workspace_new": (_pointer, ()),
    "yasps_workspace_free": (None, (_pointer,)),
    "yasps_multiply": (_int, (_pointer, _pointer, _pointer, _pointer, _pointer, _int)),
    "yasps_solve": (
        _int,
        (
            _pointer,
            _int,
            _pointer,
            _pointer,
            _pointer,
            _pointer,
            _pointer,
            _double,
            _long,
            _pointer,
            _int,
            _pointer,
        ),
    ),
    "yasps_assembly_new": (_pointer, ()),
    "yasps_assembly_free": (None, (_pointer,)),
    "yasps_assemble": (
        _int,
        (_pointer, _pointer, _long, _pointer, _long, _pointer, _long, _pointer, _int),
    ),
    "yasps_evaluate": (None, (_pointer, _pointer, _long, _pointer, _int)),
    "yasps_sum": (_double, (_pointer, _long)),
    "yasps_project": (_long, (_pointer, _int, _int, _int)),
}


class Projection(IntEnum):
    """What becomes of the negative eigenvalues of a local Hessian."""

    CLAMP = 0
    ABS = 1
    NONE = 2


@dataclass(frozen=True)
class Runtime:
    """The loaded runtime library.

    library: for calls into the C interface. threads: how many OpenMP threads functions use when not told otherwise.
    objects and linked: what was compiled or found in the cache, and how long that took.
    """

    library: ctypes.CDLL
    threads: int
    compiler: Compiler
    objects: tuple[CompiledObject, ...]
    linked: LinkedLibrary

    def thread_count(self, threads: int | None) -> int:
        """The number of threads to use: `threads`, or the runtime's own where that is None.

        Raises ValueError for fewer than one.
        """
        count = self.threads if threads is None else threads
        if count < 1:
            raise ValueError(f"threads is {count}; at least one thread has to do the work")
        return count

    def sum(self, values: FloatArray) -> float:
        """The sum of float64 `values` in a fixed order with compensation for rounding.

        The error is that of one rounding, whatever the number of values, unless they cancel to 1e-16 of their size. An
        infinite or NaN value gives what plain addition gives.
        """
        flat = np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
        return float(self.library.yasps_sum(flat.ctypes.data, flat.size))

    def project(self, packed: FloatArray, lanes: int, mode: Projection = Projection.CLAMP) -> int:
        """Project `lanes` symmetric matrices of width w onto the positive semidefinite cone, in place.

        packed: float64 [packs, w (w + 1) / 2, 8], C-contiguous: eight interleaved upper triangles, row by row, in each
        pack; places after the first `lanes` are not looked at. A matrix without an eigenvalue below -1e-13 times the
        sum of its absolute diagonal keeps every bit. Returns the number of matrices changed, or -(1 + lane) for a
        matrix with an entry that is not finite; those before it may then be projected already. Raises ValueError for a
        wrong shape, MemoryError.
        """
        shape = packed.shape
        width = int((np.sqrt(8 * shape[1] + 1) - 1) / 2) if packed.ndim == 3 else 0
        if packed.ndim != 3 or shape[1:] != (width * (width + 1) // 2, LANES):
            raise ValueError(
                f"packed has shape {shape}; upper triangles of width w need shape (packs, w (w + 1) / 2, {LANES})"
            )
        if packed.dtype != np.float64 or not packed.flags.c_contiguous or not packed.flags.writeable:
            raise ValueError("packed must be a writeable C-contiguous float64 array, because it is changed in place")
        if not 0 <= lanes <= shape[0] * LANES:
            raise ValueError(f"lanes is {lanes}; {shape[0]} packs hold between 0 and {shape[0] * LANES} matrices")
        changed = int(self.library.yasps_project(packed.ctypes.data, width, lanes, int(mode)))
        if changed < -packed.size:
            raise MemoryError(f"no memory to project matrices of width {width}")
        return changed


def load_runtime(compiler: Compiler, threads: int | None = None) -> Runtime:
    """Compile the runtime (or find it in the cache) and load it.

    threads: the default number of OpenMP threads; None means one per processor that this process may use. Without
    OpenMP there is one. Raises CompilationError, CacheFolderError (see toolchain), ValueError for threads < 1.
    """
    if threads is not None and threads < 1:
        raise ValueError(f"threads is {threads}; at least one thread has to do the work")
    parallel = compiler.with_flags("-fopenmp") if compiler.has_openmp else compiler
    objects = compile_sources(runtime_sources(), parallel)
    linked = link(objects, parallel, ("-lm",))
    # Waiting threads of GNU OpenMP spin before they sleep. On a machine with other work a spinning thread keeps the one
    # it waits for off the processor: products became 15 times slower. libgomp reads this when it is loaded.
    os.environ.setdefault("GOMP_SPINCOUNT", "300")
    library = ctypes.CDLL(str(linked.path))
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype = result
        function.argtypes = arguments
    count = (threads or available_processors()) if compiler.has_openmp else 1
    return Runtime(library, count, compiler, tuple(objects), linked)


def runtime_sources() -> list[Source]:
    """The C++ files of the runtime, each with the common header in place of its #include.

    So each text is complete and its digest changes whenever the header does.
    """
    folder = Path(__file__).parent
    header = (folder / "runtime.h").read_text(encoding="utf-8").replace("#pragma once\n", "")
    sources = []
    for path in sorted(folder.glob("*.cpp")):
        text = path.read_text(encoding="utf-8")
        before, include, after = text.partition(_INCLUDE)
        if not include:
            raise RuntimeError(f"{path} does not include runtime.h, which every file of the runtime must")
        resume = before.count("\n") + 2
        text = f'{before}#line 1 "runtime.h"\n{header}#line {resume} "{path.name}"\n{after}'
        sources.append(Source(f"runtime.{path.stem}", text))
    return sources


def available_processors() -> int:
    """Processors that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_status(status: int) -> None:
    """Raise MemoryError when a runtime function reported that memory ran out."""
    if status == _OUT_OF_MEMORY:
        raise MemoryError("the solver runtime ran out of memory")


def as_vector(values: FloatArray, length: int, name: str) -> FloatArray:
    """`values` as a contiguous float64 vector; ValueError unless its shape is (length,)."""
    vector = np.ascontiguousarray(values, dtype=np.float64)
    if vector.shape != (length,):
        raise ValueError(f"{name} has shape {vector.shape}; the system has {length} unknowns, so ({length},) is needed")
    return vector
