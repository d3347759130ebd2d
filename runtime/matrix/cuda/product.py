"""Products with the global Hessian on a device: which kernels to launch for y = H x.

H is the sum of some matrices with the same unknowns. `ScatteredProduct` reads every stored block once and adds to rows
and columns with atomic operations, so its last bits differ from run to run; `GatheredProduct` reads the blocks above
the diagonal twice and always adds in the same order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from yasps.runtime.device.protocol import BLOCK, Device, DeviceArray, LoadedProgram
from yasps.runtime.matrix.cuda.block_matrix import CudaBlockGroup, CudaBlockMatrix
from yasps.runtime.matrix.cuda.build import MOST_SOURCES, BuildScratch

# What a warp takes at once: 32 small blocks, or one after another in each of some teams of lanes.
_SMALL_SHAPES = {(1, 1), (1, 3), (3, 1), (2, 2), (3, 3)}
_TEAMS = {(3, 12): 2, (12, 3): 2, (6, 6): 2, (9, 9): 1, (12, 12): 1}
# Blocks a team takes one after another, so that it can add up a row: some, once there is work for a whole device.
_MOST_IN_TURN, _ENOUGH_TEAMS = 16, 8192
# Dof blocks of at most so many scalars are gathered by 8 lanes, larger ones by a block of threads.
_LARGEST_SMALL, _LANES_OF_SMALL = 3, 8


@dataclass(frozen=True)
class Launch:
    """A launch of a kernel of the solver, to be done now or recorded."""

    kernel: str
    threads: int
    arguments: tuple[int | float, ...]

    def do(self, device: Device, program: LoadedProgram) -> None:
        """Asks the device for it."""
        device.launch(program.kernel(self.kernel), self.threads, self.arguments)


class Product(Protocol):
    """How to multiply."""

    def prepare(self, parts: Sequence[CudaBlockMatrix]) -> None:
        """Takes note of the matrices; to be called again whenever one was built."""

    def launches(self, x: int, y: int, reason: int) -> list[Launch]:
        """What computes y = H x at these addresses, for y that is zero; nothing unless *reason is -1 (0: always)."""


@dataclass(frozen=True)
class _Shape:
    """The lists of blocks of one shape: where in the table, how many, and what all warps together take in turn."""

    r: int
    c: int
    first: int
    count: int
    chunks: int


class BlockLists:
    """The blocks of some matrices as a table on the device, `yasps_block_list` in block_list.cuh, ordered by shape.

    count: lists. blocks: of all lists.
    """

    def __init__(self, device: Device) -> None:
        self._sent: list[list[int]] = []
        self.table = DeviceArray(device, np.int64, "table of the Hessian's blocks")
        self.shapes: list[_Shape] = []
        self.count = 0
        self.blocks = 0

    def send(self, parts: Sequence[CudaBlockMatrix]) -> None:
        """Writes the table, where it changed; to be called again whenever a matrix was built."""
        by_shape: dict[tuple[int, int], list[tuple[CudaBlockGroup, int]]] = {}
        for part in parts:
            for group in part.groups:
                by_shape.setdefault((group.r, group.c), []).append((group, part.values.address))
        rows: list[list[int]] = []
        shapes: list[_Shape] = []
        before = 0
        for (r, c), groups in sorted(by_shape.items()):
            total = 0
            for group, values in groups:
                chunk = _chunk(r, c, group.count)
                chunks = -(-group.count // chunk)
                address = values + 8 * group.first_value
                rows.append([address, group.rows, group.cols, group.count, chunk, chunks, before, 0])
                before += group.count
                total += chunks
            shapes.append(_Shape(r, c, len(rows) - len(groups), len(groups), total))
        self.shapes, self.count, self.blocks = shapes, len(rows), before
        if rows and rows != self._sent:
            self._sent = []
            self.table.upload(np.array(rows, np.int64))
            self._sent = rows

    def address_of(self, first: int) -> int:
        """Of one list."""
        return self.table.address + 64 * first


class ScatteredProduct:
    """One kernel for each shape of blocks that occurs (multiply.cu)."""

    def __init__(self, device: Device) -> None:
        """Without memory yet."""
        self._lists = BlockLists(device)

    def prepare(self, parts: Sequence[CudaBlockMatrix]) -> None:
        """See `Product`."""
        self._lists.send(parts)

    def launches(self, x: int, y: int, reason: int) -> list[Launch]:
        """See `Product`."""
        launches = []
        for shape in self._lists.shapes:
            special = (shape.r, shape.c) in _SMALL_SHAPES or (shape.r, shape.c) in _TEAMS
            name = f"yasps_multiply_{shape.r}x{shape.c}" if special else "yasps_multiply_any"
            arguments = [self._lists.address_of(shape.first), shape.count, x, y, reason]
            if not special:
                arguments += [shape.r, shape.c]
            launches.append(Launch(name, 32 * _rounded(shape.chunks), tuple(arguments)))
        return launches


class GatheredProduct:
    """Each dof block adds up its row of the full matrix in a fixed order (gathered_multiply.cu).

    Which blocks those are is found anew, on the device, whenever a matrix was built: 32 bytes for each block in a row,
    and what sorting needs in passing.
    """

    def __init__(self, device: Device, program: LoadedProgram, scratch: BuildScratch | None = None) -> None:
        """Without memory yet. `scratch`: see `CudaBlockMatrix`."""
        self._device, self._program = device, program
        self._scratch = scratch if scratch is not None else BuildScratch(device)
        self._lists = BlockLists(device)
        self._seen: list[list[CudaBlockGroup]] = []
        self._entries = DeviceArray(device, np.int64, "blocks by row")
        self._bounds = DeviceArray(device, np.int64, "rows of blocks")
        self._starts = DeviceArray(device, np.int32, "offsets of dof blocks by size")
        self._counts = (0, 0)
        self._size = self._block_size_at = 0

    def prepare(self, parts: Sequence[CudaBlockMatrix]) -> None:
        """See `Product`. Raises ValueError for more than 2^31 - 1 blocks."""
        # A build makes a new list of groups; holding the old ones, none can be mistaken for it.
        groups = [part.groups for part in parts]
        if len(groups) == len(self._seen) and all(a is b for a, b in zip(groups, self._seen, strict=True)):
            return
        self._seen = []
        if 2 * sum(part.block_count for part in parts) > MOST_SOURCES:
            raise ValueError("more than 2^31 - 1 blocks have no room in one sort: leave out deterministic=True")
        self._lists.send(parts)
        self._send_starts(parts[0])
        self._gather()
        self._seen = groups

    def _send_starts(self, part: CudaBlockMatrix) -> None:
        small: list[np.ndarray[tuple[int], np.dtype[np.int32]]] = [np.zeros(0, np.int32)]
        large = small.copy()
        for begin, end, q in zip(part.boundaries[:-1], part.boundaries[1:], part.block_sizes, strict=True):
            (small if q <= _LARGEST_SMALL else large).append(np.arange(begin, end, q, dtype=np.int32))
        first, second = np.concatenate(small), np.concatenate(large)
        self._starts.upload(np.concatenate([first, second]))
        self._counts = first.size, second.size
        self._size, self._block_size_at = part.size, part.block_size_at.address

    def _gather(self) -> None:
        blocks, size = self._lists.blocks, self._size
        self._bounds.resize(2, size).clear()
        self._entries.resize(2 * blocks, 2)
        if blocks == 0:
            return
        scratch = self._scratch
        scratch.reserve(2 * blocks)
        lists = (self._lists.table.address, self._lists.count, blocks, size)
        keys = Launch("yasps_gather_keys", blocks, (*lists, scratch.keys.address, scratch.sources.address))
        keys.do(self._device, self._program)
        scratch.sort(2 * blocks, size.bit_length())
        found = (scratch.sorted_keys.address, scratch.sorted_sources.address, self._block_size_at)
        entries = (*lists, *found, self._entries.address, self._bounds.address)
        Launch("yasps_gather_entries", 2 * blocks, entries).do(self._device, self._program)

    def launches(self, x: int, y: int, reason: int) -> list[Launch]:
        """See `Product`. Whether y is zero before makes no difference."""
        small, large = self._counts
        data = (self._block_size_at, self._entries.address, self._bounds.address, self._size, x, y, reason)
        starts = self._starts.address
        launches = []
        if small:
            launches.append(Launch("yasps_gather_small", _LANES_OF_SMALL * small, (starts, small, *data)))
        if large:
            launches.append(Launch("yasps_gather_large", BLOCK * large, (starts + 4 * small, large, *data)))
        return launches


def _chunk(r: int, c: int, count: int) -> int:
    """Blocks that a warp takes at once."""
    if (r, c) in _SMALL_SHAPES:
        return 32
    return _TEAMS.get((r, c), 1) * max(1, min(_MOST_IN_TURN, count // _ENOUGH_TEAMS))


def _rounded(count: int) -> int:
    """A little more, so that a few more blocks do not change what is launched (a recorded graph then still fits)."""
    step = 1 << max(0, count.bit_length() - 3)
    return -(-count // step) * step
