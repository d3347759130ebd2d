"""Runs generated kernels over all instances: gradient and Hessian assembly, and evaluation of values."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.core.library import FloatArray, IntArray, LongArray, Projection, Runtime, check_status, piece_count
from yasps.runtime.core.sink import TILE
from yasps.runtime.core.uncopied import Uncopied
from yasps.runtime.matrix.block_matrix import BlockMatrix

# Fewer instances than this are evaluated before a second thread has woken up.
_FEW = 2048
# Each thread's work is spread over this many places, so that a region of expensive instances is shared.
_CHUNKS_PER_PIECE = 4


@dataclass(frozen=True)
class KernelCall:
    """One generated energy kernel with what it runs on.

    function: address of `long kernel(const void* const* args, long begin, long end, const yasps_sink* sink)`.
    arguments: address of its array of pointers. count: number of instances n. kappa: int32 [n, c]. position: int64
    [n, c (c + 1) / 2] from `BlockMatrix.build`, or None for the gradient alone. part: which of the matrices given to
    `assemble` receives the blocks, or None for the gradient alone. mode: what is done to negative eigenvalues.
    """

    function: int
    arguments: int
    count: int
    kappa: IntArray
    position: LongArray | None
    part: int | None = 0
    mode: Projection = Projection.CLAMP


@dataclass(frozen=True)
class KernelStatus:
    """How a kernel ended.

    first_bad: the first instance whose derivatives are not finite, None when all are. Where there is one, gradient and
    matrices are incomplete. projected: instances whose Hessian had to be projected.
    """

    first_bad: int | None
    projected: int


class _Task(ctypes.Structure):
    """As `Task` in assembly.cpp."""

    _fields_ = [
        ("kernel", ctypes.c_void_p),
        ("args", ctypes.c_void_p),
        ("instances", ctypes.c_long),
        ("capacity", ctypes.c_long),
        ("mode", ctypes.c_long),
        ("kappa", ctypes.c_void_p),
        ("position", ctypes.c_void_p),
        ("part", ctypes.c_long),
        ("marks", ctypes.c_void_p),
        ("first_bad", ctypes.c_long),
        ("projected", ctypes.c_long),
    ]


class _Part(ctypes.Structure):
    """As `Part` in assembly.cpp."""

    _fields_ = [
        ("values", ctypes.c_void_p),
        ("structure", ctypes.c_void_p),
    ]


def _c_part(part: BlockMatrix) -> _Part:
    return _Part(part.values.ctypes.data, part.handle)


@dataclass(frozen=True)
class _Marks:
    """Which tiles a call's pieces touch, and what that was found from; arrays are compared by identity.

    tiles: uint8 [pieces, tiles].
    """

    kappa: IntArray
    position: LongArray | None
    part_size: int | None
    cut: tuple[int, int, int]
    tiles: NDArray[np.uint8]


class Assembler(Uncopied):
    """Owns the memory that threads assemble into; keep one and use it for every assembly."""

    def __init__(self, runtime: Runtime, *, deterministic: bool = False) -> None:
        """Make an assembler without memory; the first assembly gets it.

        deterministic: results do not depend on the number of threads, for some more time and memory.
        """
        self._runtime = runtime
        self._deterministic = deterministic
        self._marks: list[_Marks] = []
        handle = runtime.library.yasps_assembly_new()
        if not handle:
            raise MemoryError("no memory for an assembler")
        self._handle: int = handle
        weakref.finalize(self, runtime.library.yasps_assembly_free, handle)

    def assemble(
        self,
        calls: Sequence[KernelCall],
        parts: Sequence[BlockMatrix],
        gradient: FloatArray,
        block_size_at: IntArray,
        threads: int | None = None,
    ) -> list[KernelStatus]:
        """Overwrite `gradient` and the values of all `parts` with the sum over all instances of all kernels.

        gradient: float64 [unknowns], C-contiguous. block_size_at: int32 [unknowns], `BlockMatrix.block_size_at`; here
        because a gradient can be wanted without any matrix. The result is the same bit for bit in every run with the
        same number of threads, of a deterministic assembler with any number. Returns one status per call. Raises
        ValueError for arrays that do not fit together, before anything is written; MemoryError.

        What `kappa` and `position` say is remembered for the next assembly: new indices need new arrays.
        """
        size = gradient.size
        if gradient.dtype != np.float64 or gradient.ndim != 1 or not gradient.flags.c_contiguous:
            raise ValueError("gradient must be a C-contiguous float64 vector, because it is written in place")
        if not gradient.flags.writeable:
            raise ValueError("gradient is read-only, but is written in place")
        if block_size_at.shape != (size,) or block_size_at.dtype != np.int32:
            raise ValueError(
                f"block_size_at is {block_size_at.dtype} {block_size_at.shape}, but the gradient needs int32 {(size,)}"
            )
        for index, part in enumerate(parts):
            if part.size != size:
                raise ValueError(f"parts[{index}] has {part.size} unknowns, but the gradient has {size}")
        tasks = (_Task * len(calls))(
            *(_task_of(call, index, parts) for index, call in enumerate(calls)),
        )
        c_parts = (_Part * len(parts))(*(_c_part(part) for part in parts))
        sizes = np.ascontiguousarray(block_size_at)
        count = self._runtime.thread_count(threads)
        pieces = piece_count(count, self._deterministic)
        chunks = pieces * (1 if self._deterministic or pieces == 1 else _CHUNKS_PER_PIECE)
        marks = []
        if pieces > 1:
            for index, (call, task) in enumerate(zip(calls, tasks, strict=True)):
                target = parts[task.part] if task.part >= 0 else None
                cut = (pieces, chunks, size)
                marks.append(self._marks_of(index, call, task, part=target, sizes=sizes, cut=cut, threads=count))
                task.marks = marks[-1].tiles.ctypes.data
        self._marks = marks
        status = self._runtime.library.yasps_assemble(
            self._handle,
            ctypes.addressof(tasks),
            len(calls),
            ctypes.addressof(c_parts),
            len(parts),
            gradient.ctypes.data,
            size,
            sizes.ctypes.data,
            pieces,
            chunks,
            count,
        )
        check_status(status)
        return [KernelStatus(task.first_bad if task.first_bad >= 0 else None, task.projected) for task in tasks]

    def _marks_of(
        self,
        index: int,
        call: KernelCall,
        task: _Task,
        *,
        part: BlockMatrix | None,
        sizes: IntArray,
        cut: tuple[int, int, int],
        threads: int,
    ) -> _Marks:
        """The tiles that this call touches: those of the last assembly where nothing changed since.

        cut: pieces, chunks, unknowns.
        """
        position = call.position if part is not None else None
        part_size = part.values.size if part is not None else None
        if index < len(self._marks):
            last = self._marks[index]
            if (
                last.kappa is call.kappa
                and last.position is position
                and last.part_size == part_size
                and last.cut == cut
            ):
                return last
        pieces, chunks, scalars = cut
        tiles = np.empty((pieces, -(-scalars // TILE) + -(-(part_size or 0) // TILE)), np.uint8)
        self._runtime.library.yasps_mark_tiles(
            ctypes.addressof(task),
            ctypes.byref(_c_part(part)) if part is not None else None,
            scalars,
            sizes.ctypes.data,
            pieces,
            chunks,
            tiles.ctypes.data,
            threads,
        )
        return _Marks(call.kappa, position, part_size, cut, tiles)


def evaluate(
    runtime: Runtime, function: int, arguments: int, count: int, out: FloatArray, *, threads: int | None = None
) -> None:
    """Run `void kernel(const void* const* args, long begin, long end, double* out)` over `count` instances.

    function and arguments are addresses. Every thread gets whole packs of eight instances and the same `out`, float64
    and C-contiguous: instance i writes its own part of it, out[i], out[i, :] and so on. Raises ValueError when `out`
    cannot be written so or has not `count` rows.
    """
    if out.dtype != np.float64 or not out.flags.c_contiguous or not out.flags.writeable:
        raise ValueError("out must be a writeable C-contiguous float64 array, because the kernel writes it in place")
    if out.ndim < 1 or out.shape[0] != count:
        raise ValueError(f"out has shape {out.shape}, but the kernel runs over {count} instances")
    used = runtime.thread_count(threads) if count >= _FEW else 1
    runtime.library.yasps_evaluate(function, arguments, count, out.ctypes.data, used)


def _task_of(call: KernelCall, index: int, parts: Sequence[BlockMatrix]) -> _Task:
    kappa, position = call.kappa, call.position
    if kappa.ndim != 2 or kappa.shape[0] != call.count or kappa.dtype != np.int32 or not kappa.flags.c_contiguous:
        raise ValueError(
            f"kappa of call {index} is {kappa.dtype} {kappa.shape}; C-contiguous int32 [{call.count}, slots] is needed"
        )
    capacity = kappa.shape[1]
    with_blocks = position is not None and call.part is not None
    if with_blocks:
        assert position is not None
        assert call.part is not None
        shape = (call.count, capacity * (capacity + 1) // 2)
        if position.shape != shape or position.dtype != np.int64 or not position.flags.c_contiguous:
            raise ValueError(
                f"position of call {index} is {position.dtype} {position.shape}; C-contiguous int64 {shape} is needed, "
                "as BlockMatrix.build returns it"
            )
        if not 0 <= call.part < len(parts):
            raise ValueError(f"call {index} writes to parts[{call.part}], but there are {len(parts)} parts")
    return _Task(
        call.function,
        call.arguments,
        call.count,
        capacity,
        int(call.mode),
        kappa.ctypes.data,
        position.ctypes.data if with_blocks and position is not None else None,
        call.part if with_blocks else -1,
        None,
        -1,
        0,
    )
