"""The global Hessian on a device: a symmetric matrix of dense blocks, upper triangle only (paper, appendix B).

Built on the device from index arrays that lie there: a key (shape, row, col) for every local block, one radix sort, one
prefix sum. One small download tells the host how many blocks there are of each shape; nothing else comes back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from yasps.runtime.core.library import IntArray, LongArray
from yasps.runtime.device.protocol import Device, DeviceArray, LoadedProgram
from yasps.runtime.matrix.block_matrix import BlockGroup, check_layout, describe_layout
from yasps.runtime.matrix.cuda.build import (
    MOST_SOURCES,
    BuildScratch,
    bad_source,
    check_kappas,
    describe_slot,
    find_first_sources,
)

__all__ = ["BuildScratch", "CudaBlockGroup", "CudaBlockMatrix"]

# The two highest bits of a key carry the flags of a position.
_KEY_BITS = 62
_NO_BOUNDARIES = np.zeros(1, np.int64)
_NO_SIZES = np.zeros(0, np.int32)


@dataclass(frozen=True)
class CudaBlockGroup:
    """All blocks of one shape, sorted by (row, col).

    rows, cols: addresses of int32 [count], the scalar offsets of each block's first row and column. first_block: how
    many blocks there are in the groups before. first_value: offset of the first block in `values`, float64
    [count, r, c] from there.
    """

    r: int
    c: int
    count: int
    rows: int
    cols: int
    first_block: int
    first_value: int


@dataclass(frozen=True)
class _Sum:
    """What `finish` does for one group: values of the group and of a block, offsets of the first block and value.

    base: offset of the first entry of all, had all entries this shape.
    """

    count: int
    block_values: int
    first_block: int
    first_value: int
    base: int


class _Layout:
    """Where the dof blocks lie: host arrays as given, and what kernels ask for, on the device."""

    def __init__(
        self, device: Device, program: LoadedProgram, boundaries: LongArray, block_sizes: IntArray, extra_sources: int
    ) -> None:
        """Checks that all can be indexed before asking for memory; `extra_sources` per dof block."""
        self.boundaries, self.block_sizes = boundaries, block_sizes
        self.size = int(boundaries[-1])
        self.classes: list[int] = sorted(set(block_sizes.tolist()))
        counts: list[int] = (np.diff(boundaries) // block_sizes).tolist()
        self.block_count = sum(counts)
        self.extra = extra_sources * self.block_count
        #: Bits of a dof block's number, and of a whole key.
        self.bits = max(self.block_count - 1, 0).bit_length()
        self.key_bits = max(1, 2 * self.bits + (len(self.classes) ** 2).bit_length())
        if self.key_bits > _KEY_BITS:
            raise ValueError(
                f"{self.block_count} dof blocks of {len(self.classes)} sizes need keys of {self.key_bits} bits, but a "
                f"device sorts by at most {_KEY_BITS}: use fewer unknowns or fewer sizes of targets"
            )
        self.names = DeviceArray(device, np.int64, "names of dof blocks").resize(self.size)
        self.block_size_at = DeviceArray(device, np.int32, "sizes of dof blocks").resize(self.size)
        self.block_start = DeviceArray(device, np.int32, "offsets of dof blocks").resize(self.block_count)
        self.block_size = DeviceArray(device, np.int32, "sizes of dof blocks").resize(self.block_count)
        first = find_first_sources(counts)
        rows = zip(boundaries[1:].tolist(), block_sizes.tolist(), first, strict=False)
        table = np.array([(end, q, self.classes.index(q), block) for end, q, block in rows], np.int64)
        targets = DeviceArray(device, np.int64, "table of targets").upload(table)
        results = (self.names, self.block_size_at, self.block_start, self.block_size)
        kernel = program.kernel("yasps_structure_layout")
        device.launch(kernel, self.size, [self.size, targets.address, *(array.address for array in results)])

    def is_of(self, boundaries: LongArray, block_sizes: IntArray) -> bool:
        """Whether it was made from these."""
        return np.array_equal(boundaries, self.boundaries) and np.array_equal(block_sizes, self.block_sizes)

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """All shapes that blocks could have, in their order."""
        return list(product(self.classes, self.classes))


class CudaBlockMatrix:
    """A block-sparse symmetric matrix on a device; `BlockMatrix` says what is stored and in which order.

    The dof blocks keep the order of the scalars. Without any unknowns until `build`; `build` can be called again and
    reuses memory, so what earlier ones returned is overwritten.
    """

    def __init__(
        self,
        device: Device,
        program: LoadedProgram,
        *,
        with_diagonal: bool = True,
        deterministic: bool = False,
        scratch: BuildScratch | None = None,
    ) -> None:
        """An empty matrix. `program` holds the kernels of structure.cu.

        with_diagonal: every dof block gets a diagonal block, whether an energy touches it or not. deterministic:
        kernels add each local block to zeros of its own and `finish` sums them in the order of energies, instances and
        pairs, for as much memory as all local blocks need. scratch: shares memory with other builds on this device.
        """
        self.device = device
        self.deterministic = deterministic
        self._program = program
        self._with_diagonal = with_diagonal
        self._scratch = scratch if scratch is not None else BuildScratch(device)
        self._layout = self._new_layout(_NO_BOUNDARIES, _NO_SIZES)
        self._positions: list[DeviceArray] = []
        self._sums: list[_Sum] = []
        self._rows = DeviceArray(device, np.int32, "rows of blocks")
        self._cols = DeviceArray(device, np.int32, "columns of blocks")
        self._first_entry = DeviceArray(device, np.uint32, "contributions of blocks")
        self._contributions = DeviceArray(device, np.float64, "contributions to the Hessian")
        #: The blocks by shape, ordered by (r, c); shapes that do not occur are left out.
        self.groups: list[CudaBlockGroup] = []
        self.block_count = 0
        #: float64, all blocks one after another, each row-major.
        self.values = DeviceArray(device, np.float64, "values of the Hessian")
        #: int64 [dof blocks]: offset of the diagonal block in `values`, or -1.
        self.diagonal = DeviceArray(device, np.int64, "diagonal blocks")

    @property
    def size(self) -> int:
        """The number of scalar unknowns: the matrix is size x size."""
        return self._layout.size

    @property
    def boundaries(self) -> LongArray:
        """int64 [T + 1], as given to `build`."""
        return self._layout.boundaries

    @property
    def block_sizes(self) -> IntArray:
        """int32 [T], as given to `build`."""
        return self._layout.block_sizes

    @property
    def block_size_at(self) -> DeviceArray:
        """int32 [size]: the size of the dof block that starts at this scalar offset, 0 where none does."""
        return self._layout.block_size_at

    @property
    def block_start(self) -> DeviceArray:
        """int32 [dof blocks]: scalar offsets, ascending."""
        return self._layout.block_start

    @property
    def block_size(self) -> DeviceArray:
        """int32 [dof blocks]: scalars."""
        return self._layout.block_size

    @property
    def target(self) -> DeviceArray:
        """What kernels add to, at the offsets that positions say; float64, cleared with `clear` before."""
        return self._contributions if self.deterministic else self.values

    def clear(self) -> None:
        """Makes `target` zero, before an assembly."""
        self.target.clear()

    def finish(self) -> None:
        """After an assembly, makes `values` what was added to `target`."""
        kernel = self._program.kernel("yasps_structure_sum")
        for part in self._sums:
            arguments = [
                part.count,
                part.block_values,
                self._first_entry.address + 4 * part.first_block,
                self._contributions.address + 8 * part.base,
                self.values.address + 8 * part.first_value,
            ]
            self.device.launch(kernel, part.count, arguments)

    def build(self, boundaries: LongArray, block_sizes: IntArray, kappas: Sequence[DeviceArray]) -> list[DeviceArray]:
        """Derive the sparsity from the index arrays of all energies; values become zero.

        boundaries: int64 [T + 1], block_sizes: int32 [T], both on the host, kappas: for each energy int32 [n, c] on the
        device; all as for `BlockMatrix.build`. Returns PositionInData of each energy, int64 [n, c (c + 1) / 2] on the
        device: the same numbers as there, except that a deterministic matrix gives each local block an offset of its
        own in `target`. Waits once for the device.

        Raises ValueError for arrays that contradict each other or name no dof block; the matrix is then as before.
        DeviceMemoryError leaves it as before or empty.
        """
        boundaries, block_sizes = check_layout(boundaries, block_sizes)
        check_kappas(kappas)
        shapes = [kappa.shape for kappa in kappas]
        first_sources = find_first_sources([n * (c * (c + 1) // 2) for n, c in shapes])
        same = self._layout.is_of(boundaries, block_sizes)
        block_count = int((np.diff(boundaries) // block_sizes).sum()) if self._with_diagonal else 0
        if first_sources[-1] + block_count > MOST_SOURCES:
            raise ValueError("more than 2^32 local blocks: split the energies over several matrices")
        layout = self._layout if same else self._new_layout(boundaries, block_sizes)
        found = self._find_groups(layout, kappas, first_sources)
        try:
            return self._place(layout, found, shapes, first_sources)
        except MemoryError:
            self._forget()
            raise

    def _new_layout(self, boundaries: LongArray, block_sizes: IntArray) -> _Layout:
        return _Layout(self.device, self._program, boundaries, block_sizes, 1 if self._with_diagonal else 0)

    def _find_groups(self, layout: _Layout, kappas: Sequence[DeviceArray], first_sources: list[int]) -> LongArray:
        """Sorts all local blocks. For every shape, and the end: how many of them, and of global blocks, lie before."""
        pairs, shapes = first_sources[-1], len(layout.shapes)
        entries = pairs + layout.extra
        if entries == 0:
            return np.zeros((shapes + 1, 2), np.int64)
        scratch, launch, kernel = self._scratch, self.device.launch, self._program.kernel
        scratch.reserve(entries)
        scratch.send(kappas, first_sources)
        scratch.answer.resize(1 + 2 * (shapes + 1))
        keys, sorted_keys, bad = scratch.keys.address, scratch.sorted_keys.address, scratch.request.address
        arguments = [entries, pairs, scratch.table, len(kappas), layout.names.address, layout.size]
        arguments += [layout.block_start.address, layout.bits, len(layout.classes), keys, scratch.sources.address, bad]
        launch(kernel("yasps_structure_keys"), entries, arguments)
        scratch.sort(entries, layout.key_bits)
        launch(kernel("yasps_structure_heads"), entries, [entries, sorted_keys, layout.bits, shapes, keys])
        before = scratch.sum(entries)
        arguments = [entries, sorted_keys, before, layout.bits, shapes, bad, scratch.answer.address]
        launch(kernel("yasps_structure_groups"), shapes + 1, arguments)
        answer = scratch.answer.download()
        source = bad_source(int(answer[0]))
        if source is not None:
            raise ValueError(_describe_bad_slot(layout, kappas, first_sources, source))
        return answer[1:].reshape(-1, 2)

    def _place(
        self, layout: _Layout, found: LongArray, shapes: Sequence[tuple[int, ...]], first_sources: list[int]
    ) -> list[DeviceArray]:
        """Takes the new structure over: memory, groups, positions."""
        scratch, pairs = self._scratch, first_sources[-1]
        used, block_count = (int(number) for number in found[-1])
        positions = self._resize_positions(shapes)
        self._rows.resize(block_count)
        self._cols.resize(block_count)
        self.diagonal.resize(layout.block_count)
        places, groups, sums = [], [], []
        first_value = first_place = 0
        for (r, c), (entry, block), (next_entry, next_block) in zip(
            layout.shapes, found.tolist(), found[1:].tolist(), strict=False
        ):
            count, block_values = next_block - block, r * c
            base = first_place - entry * block_values
            places += [block_values, first_value - block * block_values, base]
            if count == 0:
                continue
            rows, cols = self._rows.address + 4 * block, self._cols.address + 4 * block
            groups.append(CudaBlockGroup(r, c, count, rows, cols, block, first_value))
            sums.append(_Sum(count * block_values, block_values, block, first_value, base))
            first_value += count * block_values
            first_place += (next_entry - entry) * block_values
        self.values.resize(first_value).clear()
        if self.deterministic:
            self._contributions.resize(first_place)
            self._first_entry.resize(block_count + 1)
        scratch.places.upload(np.array(places + [position.address for position in positions], np.int64))
        if not self._with_diagonal:
            arguments = [layout.block_count, -1, self.diagonal.address]
            self.device.launch(self._program.kernel("yasps_structure_fill"), layout.block_count, arguments)
        entries = pairs + layout.extra
        arguments = [entries, pairs, scratch.sorted_keys.address, scratch.sorted_sources.address, scratch.keys.address]
        arguments += [scratch.table, len(positions), scratch.places.address, layout.bits, len(layout.shapes), used]
        arguments += [block_count, layout.block_start.address, self._rows.address, self._cols.address]
        arguments += [self.diagonal.address, self._first_entry.address if self.deterministic else 0]
        self.device.launch(self._program.kernel("yasps_structure_place"), entries, arguments)
        self._layout, self.groups, self.block_count = layout, groups, block_count
        self._sums = sums if self.deterministic else []
        return positions

    def _resize_positions(self, shapes: Sequence[tuple[int, ...]]) -> list[DeviceArray]:
        while len(self._positions) < len(shapes):
            self._positions.append(DeviceArray(self.device, np.int64, "positions of local blocks"))
        return [array.resize(n, c * (c + 1) // 2) for array, (n, c) in zip(self._positions, shapes, strict=False)]

    def _forget(self) -> None:
        """Become empty after a build that ran out of memory."""
        self._layout = self._new_layout(_NO_BOUNDARIES, _NO_SIZES)
        self._sums, self.groups, self.block_count = [], [], 0
        for array in (self._rows, self._cols, self.diagonal, self.values, self._contributions, self._first_entry):
            array.resize(0)

    def download_coordinates(self) -> tuple[IntArray, IntArray]:
        """Scalar offsets of each block's first row and column on the host, int32 [block_count] each."""
        return self._rows.download(), self._cols.download()

    def download_groups(self) -> list[BlockGroup]:
        """The blocks on the host: a copy, after all work asked for before."""
        (rows, cols), values = self.download_coordinates(), self.values.download()
        groups = []
        for group in self.groups:
            part = slice(group.first_block, group.first_block + group.count)
            shape = (group.count, group.r, group.c)
            blocks = values[group.first_value :][: group.count * group.r * group.c].reshape(shape)
            groups.append(BlockGroup(group.r, group.c, rows[part], cols[part], blocks))
        return groups

    def __repr__(self) -> str:
        """Size, number of blocks and their shapes."""
        shapes = ", ".join(f"{group.count} of {group.r}x{group.c}" for group in self.groups)
        return f"CudaBlockMatrix({self.size} x {self.size}, blocks: {shapes or 'none'})"


def _describe_bad_slot(layout: _Layout, kappas: Sequence[DeviceArray], first_sources: list[int], source: int) -> str:
    energy = int(np.searchsorted(first_sources, source, side="right")) - 1
    capacity = kappas[energy].shape[1]
    instance, pair = divmod(source - first_sources[energy], capacity * (capacity + 1) // 2)
    # The kernel notes pairs of a slot with itself.
    own = np.flatnonzero(np.equal(*np.triu_indices(capacity)))
    slot = int(np.searchsorted(own, pair))
    return (
        f"{describe_slot(kappas, energy, instance, slot)} is not the 1-based offset of a dof block; blocks start at "
        f"{describe_layout(layout.boundaries, layout.block_sizes)}; 0 means no contribution"
    )
