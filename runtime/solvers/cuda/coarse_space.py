"""The coarse space of the two-level preconditioner on a device; `PcgSolver` says what it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from yasps.runtime.core.library import IntArray, Runtime, check_status
from yasps.runtime.device.protocol import BLOCK, Device, DeviceArray, LoadedProgram
from yasps.runtime.matrix.cuda.block_matrix import CudaBlockGroup, CudaBlockMatrix
from yasps.runtime.matrix.cuda.build import BuildScratch
from yasps.runtime.matrix.cuda.product import BlockLists, Launch

# As in coarse_space.cu.
_PANEL, _TILE, _ROWS_OF_A_BLOCK = 8, 32, BLOCK // 32


class CudaCoarseSpace:
    """The aggregates, the inverse of the coarse matrix, and the launches that apply it.

    Aggregates are found by the CPU's runtime, from the sparsity of the first matrix: once for each structure 8 bytes a
    block come to the host, and 8 an unknown go back. All else stays on the device, but for 8 bytes a system that say
    whether the coarse matrix is positive definite.
    """

    def __init__(
        self, device: Device, program: LoadedProgram, runtime: Callable[[], Runtime], scratch: BuildScratch
    ) -> None:
        """Without memory yet. runtime: gives the CPU's runtime, when it is needed. scratch: see `CudaBlockMatrix`."""
        self._device, self._program = device, program
        self._runtime, self._scratch = runtime, scratch
        self._lists = BlockLists(device)
        self._seen: list[list[CudaBlockGroup]] = []
        self._count = self._unknowns = 0
        self._aggregates = DeviceArray(device, np.int64, "table of aggregates")
        self._aggregate_of = DeviceArray(device, np.int32, "aggregates of unknowns")
        self._members = DeviceArray(device, np.int32, "dof blocks by aggregate")
        self._entries = DeviceArray(device, np.int64, "blocks by pairs of aggregates")
        self._bounds = DeviceArray(device, np.int64, "pairs of aggregates")
        self._matrices = [DeviceArray(device, np.float64, "the coarse matrix of a solver") for _ in range(2)]
        self._pivot = DeviceArray(device, np.float64, "pivots of a coarse matrix")
        self._outcome = DeviceArray(device, np.int64, "outcome of a coarse matrix")
        self._restricted = DeviceArray(device, np.float64, "restricted residual of a solver")
        self._inverse = self._matrices[0]
        self._unknown_of = DeviceArray(device, np.int32, "coarse unknowns of unknowns")
        self._solution = DeviceArray(device, np.float64, "coarse solution of a solver")
        self._partial = DeviceArray(device, np.float64, "partial sums of a coarse space")

    @property
    def results(self) -> tuple[int, int, int, int]:
        """For kernels: the coarse unknown of each unknown of H or -1, the solution, the shares of its product with the
        restricted residual, and how many these are."""
        return self._unknown_of.address, self._solution.address, self._partial.address, self._partial.size

    def make(self, parts: Sequence[CudaBlockMatrix]) -> bool:
        """Makes the inverse of P^T H P for the sum H of these matrices; False where that is not positive definite.

        Waits for the device. Raises MemoryError, DeviceMemoryError.
        """
        # A build makes a new list of groups; holding the old ones, none can be mistaken for it.
        groups = [part.groups for part in parts]
        known = [index < len(self._seen) and group is self._seen[index] for index, group in enumerate(groups)]
        if not all(known) or len(groups) != len(self._seen):
            self._seen = []
            if not known[0]:
                self._aggregate(parts[0])
            self._gather(parts)
            self._seen = groups
        stride = -(-self._unknowns // _PANEL) * _PANEL
        for matrix in self._matrices:
            matrix.resize(stride, stride)
        self._matrices[0].clear()
        self._outcome.resize(1).clear()
        for launch in self._inversion(stride):
            launch.do(self._device, self._program)
        return int(self._outcome.download()[0]) == 0

    def _aggregate(self, part: CudaBlockMatrix) -> None:
        """Finds the aggregates of this sparsity."""
        counts = np.diff(part.boundaries) // part.block_sizes
        sizes = np.repeat(part.block_sizes, counts)
        starts = (np.cumsum(sizes) - sizes).astype(np.int32)
        rows, cols = (np.searchsorted(starts, offsets).astype(np.int32) for offsets in part.download_coordinates())
        of = np.empty(sizes.size, np.int32)
        status = self._runtime().library.yasps_aggregates_of(
            sizes.size,
            sizes.ctypes.data,
            rows.size,
            rows.ctypes.data,
            cols.ctypes.data,
            part.values.size,
            of.ctypes.data,
        )
        check_status(status)
        self._send(of, sizes, starts)

    def _send(self, of: IntArray, sizes: IntArray, starts: IntArray) -> None:
        """The aggregates of dof blocks of these sizes, as the kernels read them."""
        order = np.argsort(of, kind="stable")
        order = order[np.searchsorted(of[order], 0) :]  # -1 comes first
        self._count = int(of.max(initial=-1)) + 1
        ends = np.searchsorted(of[order], np.arange(self._count), side="right")
        begins = np.concatenate([[0], ends[:-1]]).astype(np.int64) if self._count else ends
        widths = sizes[order[begins]]
        firsts = np.cumsum(widths) - widths
        self._unknowns = int(widths.sum())
        self._aggregates.upload(np.stack([firsts, widths, begins, ends], axis=1))
        self._members.upload(starts[order])
        self._aggregate_of.upload(np.repeat(of, sizes))
        within = np.arange(int(sizes.sum())) - np.repeat(starts, sizes)
        moved = np.append(firsts, 0)[of] if self._count else np.zeros_like(of)
        self._unknown_of.upload(np.where(np.repeat(of, sizes) >= 0, np.repeat(moved, sizes) + within, -1))
        self._restricted.resize(self._unknowns)
        self._solution.resize(self._unknowns)
        self._partial.resize(-(-self._unknowns // _ROWS_OF_A_BLOCK))

    def _gather(self, parts: Sequence[CudaBlockMatrix]) -> None:
        """Finds which blocks of H add to which of the coarse matrix."""
        self._lists.send(parts)
        count, blocks, scratch = self._count, self._lists.blocks, self._scratch
        self._bounds.resize(2, count * count).clear()
        self._entries.resize(blocks, 2)
        scratch.reserve(blocks)
        lists = (self._lists.table.address, self._lists.count, blocks)
        keys = (*lists, self._aggregate_of.address, count, scratch.keys.address, scratch.sources.address)
        Launch("yasps_coarse_keys", blocks, keys).do(self._device, self._program)
        scratch.sort(blocks, (count * count).bit_length())
        found = (scratch.sorted_keys.address, scratch.sorted_sources.address)
        aggregates = (self._aggregates.address, self._aggregate_of.address, count)
        entries = (*lists, *aggregates, *found, self._entries.address, self._bounds.address)
        Launch("yasps_coarse_entries", blocks, entries).do(self._device, self._program)

    def _inversion(self, stride: int) -> list[Launch]:
        """The coarse matrix and its inverse."""
        source, other = (matrix.address for matrix in self._matrices)
        count, tiles = self._count, -(-stride // _TILE)
        entries = (self._entries.address, self._bounds.address)
        matrix = (self._aggregates.address, count, *entries, stride, source)
        pivot, outcome = self._pivot.resize(_PANEL, _PANEL).address, self._outcome.address
        launches = [Launch("yasps_coarse_matrix", 32 * count * count, matrix)]
        for first in range(0, stride, _PANEL):
            launches += [
                Launch("yasps_coarse_pivot", 1, (source, self._unknowns, stride, first, pivot, outcome)),
                Launch("yasps_coarse_sweep", BLOCK * tiles * tiles, (source, stride, first, pivot, outcome, other)),
            ]
            source, other = other, source
        self._inverse = self._matrices[stride // _PANEL % 2]
        return launches

    def launches(self, r: int, reason: int) -> list[Launch]:
        """What computes solution and shares for the residual at this address; nothing unless *reason is -1 (0:
        always)."""
        aggregates = (self._aggregates.address, self._count, self._members.address)
        restricted, rows = self._restricted.address, self._partial.size
        inverse = (self._inverse.address, self._unknowns, self._inverse.shape[1])
        results = (self._solution.address, self._partial.address)
        return [
            Launch("yasps_coarse_restrict", BLOCK * self._count, (*aggregates, r, reason, restricted)),
            Launch("yasps_coarse_solve", BLOCK * rows, (*inverse, restricted, reason, *results)),
        ]
