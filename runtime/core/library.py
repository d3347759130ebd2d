"""Compiles the C++ runtime on first use and declares its functions to ctypes.

runtime = load_runtime(find_compiler())
matrix = BlockMatrix(runtime)                  # yasps.runtime.matrix.block_matrix
Assembler(runtime).assemble(...)               # yasps.runtime.assembly.assembler
PcgSolver(runtime).solve([matrix], g, ...)     # yasps.runtime.solvers.pcg
"""

from __future__ import annotations

import ctypes
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.build.toolchain import (
    RUNTIME,
    CompiledObject,
    Compiler,
    LinkedLibrary,
    Source,
    compile_sources,
    link,
)
from yasps.runtime.core import sink
from yasps.runtime.core.uncopied import Uncopied

#: Instances a generated kernel evaluates at once.
LANES = sink.LANES

#: Pieces that work is cut into for results that do not depend on the number of threads; more threads have no work.
DETERMINISTIC_PIECES = 16

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
BoolArray = NDArray[np.bool_]
LongArray = NDArray[np.int64]

_OUT_OF_MEMORY = 1
_INCLUDE = re.compile(r'#include "([\w/]+\.h)"\n')

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
        (
            _pointer,
            _long,
            _pointer,
            _pointer,
            _pointer,
            _long,
            _pointer,
            _pointer,
            _pointer,
            _pointer,
            _int,
            _int,
            _pointer,
        ),
    ),
    "yasps_structure_sizes": (None, (_pointer, _pointer)),
    "yasps_structure_groups": (None, (_pointer, _pointer)),
    "yasps_structure_coordinates": (None, (_pointer, _pointer, _pointer)),
    "yasps_aggregates": (_int, (_pointer, _pointer)),
    "yasps_aggregates_of": (_int, (_long, _pointer, _long, _pointer, _pointer, _long, _pointer)),
    "yasps_workspace_new": (_pointer, ()),
    "yasps_workspace_free": (None, (_pointer,)),
    "yasps_multiply": (_int, (_pointer, _pointer, _pointer, _pointer, _pointer, _int, _int)),
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
            _int,
            _pointer,
            _int,
            _int,
            _pointer,
        ),
    ),
    "yasps_assembly_new": (_pointer, ()),
    "yasps_assembly_free": (None, (_pointer,)),
    "yasps_assemble": (
        _int,
        (_pointer, _pointer, _long, _pointer, _long, _pointer, _long, _pointer, _long, _long, _int),
    ),
    "yasps_mark_tiles": (None, (_pointer, _pointer, _long, _pointer, _long, _long, _pointer, _int)),
    "yasps_evaluate": (None, (_pointer, _pointer, _long, _pointer, _int)),
    "yasps_surface_new": (_pointer, (_pointer, _pointer, _pointer, _pointer, _pointer, _pointer, _long)),
    "yasps_surface_free": (None, (_pointer,)),
    "yasps_surface_find": (
        _int,
        (
            *(_pointer, _pointer, _pointer, _long, _double, _int),
            *(_pointer, _pointer, _long, _pointer, _long),
            *(_pointer, _int),
        ),
    ),
    "yasps_surface_pairs": (None, (_pointer, _pointer, _pointer, _int)),
    "yasps_close_set_new": (_pointer, (_pointer, _long, _long, _pointer, _pointer, _double)),
    "yasps_close_set_free": (None, (_pointer,)),
    "yasps_close_set_find": (
        _int,
        (
            _pointer,
            _pointer,
            _pointer,
            _double,
            _int,
            _pointer,
            _long,
            _pointer,
            _long,
            _int,
            _pointer,
            _pointer,
        ),
    ),
    "yasps_close_set_copy": (_int, (_pointer, _int, _pointer, _pointer, _pointer, _pointer, _pointer)),
    "yasps_step_bound_new": (_pointer, ()),
    "yasps_step_bound_free": (None, (_pointer,)),
    "yasps_step_bound": (
        _int,
        (
            *(_pointer, _pointer, _pointer, _long, _pointer, _pointer, _pointer, _double, _double),
            *(_pointer, _long, _pointer, _long, _int, _pointer),
        ),
    ),
    "yasps_meetings": (
        _int,
        (
            *(_pointer, _pointer, _long, _pointer, _pointer, _pointer, _double, _pointer, _long, _int, _int),
            *(_pointer, _pointer, _pointer, _pointer, _pointer),
        ),
    ),
    "yasps_distance_to_way": (None, (_pointer, _pointer, _pointer, _pointer, _long, _double, _pointer)),
    "yasps_part_of_way": (None, (_pointer, _pointer, _pointer, _long, _double, _pointer, _pointer, _pointer)),
    "yasps_sum": (_double, (_pointer, _long)),
    "yasps_project": (_long, (_pointer, _int, _int, _int)),
    "yasps_project_isotropic": (_long, (_pointer, _pointer, _int, _int, _int)),
    "yasps_project_two_vectors": (_long, (_pointer, _pointer, _int, _int, _int)),
}


class Projection(IntEnum):
    """What becomes of the negative eigenvalues of a local Hessian."""

    CLAMP = 0
    ABS = 1
    NONE = 2


class _OpenMp:
    """A forked process has none of the threads that OpenMP started before, but GNU OpenMP waits for them to work."""

    is_loaded = False
    lost_threads = False

    @classmethod
    def after_fork_in_child(cls) -> None:
        cls.lost_threads = cls.lost_threads or cls.is_loaded


os.register_at_fork(after_in_child=_OpenMp.after_fork_in_child)


@dataclass(frozen=True)
class Runtime(Uncopied):
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
        """The number of threads to use: `threads`, or the runtime's own where that is None; one in a process that was
        forked after the runtime was loaded.

        Raises ValueError for fewer than one.
        """
        count = self.threads if threads is None else threads
        if count < 1:
            raise ValueError(f"threads is {count}; at least one thread has to do the work")
        return 1 if _OpenMp.lost_threads else count

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
        width = _width_of(packed, lanes)
        changed = int(self.library.yasps_project(packed.ctypes.data, width, lanes, int(mode)))
        if changed < -packed.size:
            raise MemoryError(f"no memory to project matrices of width {width}")
        return changed

    def project_isotropic(
        self, packed: FloatArray, deformation: FloatArray, lanes: int, mode: Projection = Projection.CLAMP
    ) -> int:
        """As `project`, faster, for Hessians with respect to F of energies that see only the singular values of F.

        deformation: float64 [packs, w, 8], C-contiguous: F, row by row, 3x3 for w = 9 and 3x2 for w = 6. Raises
        ValueError for a wrong shape.
        """
        width = _width_beside(packed, lanes, "deformation", deformation, {9: "3x3", 6: "3x2"})
        return int(
            self.library.yasps_project_isotropic(packed.ctypes.data, deformation.ctypes.data, width, lanes, int(mode))
        )

    def project_two_vectors(
        self, packed: FloatArray, vectors: FloatArray, lanes: int, mode: Projection = Projection.CLAMP
    ) -> int:
        """As `project`, faster, for 6x6 Hessians with respect to two vectors of energies that rotations of both leave
        alone.

        vectors: float64 [packs, 6, 8], C-contiguous: one vector after the other. Raises ValueError for a wrong shape.
        """
        width = _width_beside(packed, lanes, "vectors", vectors, {6: "two vectors"})
        return int(
            self.library.yasps_project_two_vectors(packed.ctypes.data, vectors.ctypes.data, width, lanes, int(mode))
        )


def _width_beside(packed: FloatArray, lanes: int, name: str, beside: FloatArray, of_widths: Mapping[int, str]) -> int:
    """The same, one of `of_widths`, where the array `name` has as many numbers for each matrix; ValueError unless."""
    width = _width_of(packed, lanes)
    if width not in of_widths or beside.shape != (len(packed), width, LANES):
        widths = " or ".join(f"{w} ({what})" for w, what in of_widths.items())
        raise ValueError(
            f"{name} of shape {beside.shape} beside packed of shape {packed.shape}; needed are (packs, w, {LANES}) and "
            f"(packs, w (w + 1) / 2, {LANES}) with w = {widths}"
        )
    if beside.dtype != np.float64 or not beside.flags.c_contiguous:
        raise ValueError(f"{name} must be a C-contiguous float64 array")
    return width


def _width_of(packed: FloatArray, lanes: int) -> int:
    """Width of the packed matrices; ValueError unless they can be projected in place."""
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
    return width


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
    # Waiting threads of GNU OpenMP spin before they sleep (those of the solver have a barrier of their own). On a
    # machine with other work a spinning thread keeps the one it waits for off the processor: products became 15 times
    # slower. libgomp reads this when it is loaded.
    os.environ.setdefault("GOMP_SPINCOUNT", "300")
    library = ctypes.CDLL(str(linked.path))
    _OpenMp.is_loaded = True
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype = result
        function.argtypes = arguments
    count = (threads or available_processors()) if compiler.has_openmp else 1
    return Runtime(library, count, compiler, tuple(objects), linked)


def runtime_sources() -> list[Source]:
    """The C++ files of the runtime, each with the runtime's headers in place of their #include.

    So each text is complete and its digest changes whenever a header does.
    """
    files = sorted(RUNTIME.rglob("*.cpp"), key=lambda path: path.stem)
    return [Source(f"runtime.{path.stem}", _with_headers(path)) for path in files]


def _with_headers(path: Path) -> str:
    """The text of a file with the headers it includes, and those they include, each once."""
    if '#include "core/runtime.h"\n' not in path.read_text(encoding="utf-8"):
        raise RuntimeError(f"{path} does not include runtime.h, which every file of the runtime must")
    inserted: set[str] = set()

    def complete(file: Path) -> str:
        text = file.read_text(encoding="utf-8")

        def contents(include: re.Match[str]) -> str:
            if include[1] in inserted:
                return "\n"
            inserted.add(include[1])
            resume = text.count("\n", 0, include.end()) + 1
            header = RUNTIME / include[1]
            return f'#line 1 "{header.name}"\n{complete(header)}#line {resume} "{file.name}"\n'

        return _INCLUDE.sub(contents, text).replace("#pragma once\n", "\n")

    return complete(path)


def available_processors() -> int:
    """Processors that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_status(status: int) -> None:
    """Raise MemoryError when a runtime function reported that memory ran out."""
    if status == _OUT_OF_MEMORY:
        raise MemoryError("the solver runtime ran out of memory")


def piece_count(threads: int, deterministic: bool) -> int:
    """Into how many pieces to cut work whose parts are added in order.

    One for each thread is fastest; a number that does not depend on the threads gives the same bits for any of them.
    """
    return DETERMINISTIC_PIECES if deterministic else threads


def as_vector(values: FloatArray, length: int, name: str) -> FloatArray:
    """`values` as a contiguous float64 vector; ValueError unless its shape is (length,)."""
    vector = np.ascontiguousarray(values, dtype=np.float64)
    if vector.shape != (length,):
        raise ValueError(f"{name} has shape {vector.shape}; the system has {length} unknowns, so ({length},) is needed")
    return vector
