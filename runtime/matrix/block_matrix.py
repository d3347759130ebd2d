"""The global Hessian: a symmetric matrix of dense blocks, upper triangle only (paper, appendix B)."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.core.library import FloatArray, IntArray, LongArray, Runtime, as_vector, check_status, piece_count
from yasps.runtime.core.uncopied import Uncopied
from yasps.runtime.matrix.ordering import FEWEST_BLOCKS, bandwidth_reducing_order

if TYPE_CHECKING:
    from scipy import sparse

_BAD_SLOT = 2
# Padded vectors are indexed with 32-bit integers; padding makes a vector at most four times as long.
MOST_SCALARS = 2**29 - 1
# Local blocks of all energies of a matrix are numbered with 32 bits.
MOST_LOCAL_BLOCKS = 2**32 - 2
# Fewer instances than this, such as contacts, are sorted before a second thread has woken up.
_FEW = 2048
# The product reads whole vectors and so up to three doubles past the last block.
_READ_AHEAD = 4


@dataclass(frozen=True)
class BlockGroup:
    """All blocks of one shape, sorted by (row, col) in the order of the matrix.

    rows, cols: int32 [count], the scalar offsets of each block's first row and column. values: float64
    [count, r, c], a view into the matrix, so writing it changes the matrix. Of the blocks (i, j) and (j, i) only one is
    stored: where the dof blocks were not reordered the one above the diagonal, else any of the two.
    """

    r: int
    c: int
    rows: IntArray
    cols: IntArray
    values: FloatArray


class BlockMatrix(Uncopied):
    """A block-sparse symmetric matrix whose sparsity follows from index arrays.

    A matrix without any unknowns until `build`; `build` can be called again and reuses memory. Diagonal blocks are
    stored in full, of the others only those above the diagonal. Blocks lie in groups of equal shape (r, c), ordered by
    r, then c; within a group by (row, col).

    Inside, dof blocks can have another order than that of the scalars, in which products are faster. It decides which
    of two symmetric blocks is stored, and where; vectors and offsets that come in or go out are those of the scalars.

    with_diagonal: every dof block gets a diagonal block, whether an energy touches it or not. The static part of a
    Hessian needs that, since the preconditioner inverts these blocks.
    """

    def __init__(self, runtime: Runtime, with_diagonal: bool = True) -> None:
        """Make an empty matrix."""
        library = runtime.library
        handle = library.yasps_structure_new()
        workspace = library.yasps_workspace_new()
        if not handle or not workspace:
            raise MemoryError("no memory for a block matrix")
        self.handle: int = handle
        self._workspace: int = workspace
        weakref.finalize(self, library.yasps_structure_free, handle)
        weakref.finalize(self, library.yasps_workspace_free, workspace)
        self._runtime = runtime
        self._with_diagonal = with_diagonal
        self._storage: FloatArray = np.zeros(_READ_AHEAD)
        self._groups: list[BlockGroup] | None = None
        self._touched: tuple[NDArray[np.bool_], list[tuple[LongArray, LongArray]]] | None = None
        """Fixed scalars, and of each group the blocks in their rows and columns, and those of them on the diagonal."""
        self._is_built = False
        self._chose_order = False
        #: int32 [dof blocks]: the place of each dof block inside, None where that is the order of the scalars.
        self.order: IntArray | None = None
        self.boundaries: LongArray = np.zeros(1, np.int64)
        self.block_sizes: IntArray = np.zeros(0, np.int32)
        #: int32 [size]: the size of the dof block that starts at this scalar offset, 0 where none does.
        self.block_size_at: IntArray = np.zeros(0, np.int32)
        #: float64, all blocks one after another, each row-major. A view: writing it changes the matrix.
        self.values: FloatArray = self._storage[:0]
        #: How many blocks are stored.
        self.block_count = 0
        self.build(self.boundaries, self.block_sizes, [])

    @property
    def size(self) -> int:
        """The number of scalar unknowns: the matrix is size x size."""
        return int(self.boundaries[-1])

    def build(
        self,
        boundaries: LongArray,
        block_sizes: IntArray,
        kappas: Sequence[IntArray],
        threads: int | None = None,
        *,
        order: IntArray | None = None,
        reorder: bool = False,
    ) -> list[LongArray]:
        """Derive the sparsity from the index arrays of all energies; values become zero.

        boundaries: int64 [T + 1], scalar offset of each target, from 0 to the number of unknowns. block_sizes: int32
        [T], scalars per instance of each target. kappas: for each energy int32 [n, c]: 1-based scalar offsets of the
        dof blocks that its slots contribute to, 0 = no contribution. order: the place of each dof block inside, a
        permutation of 0 .. dof blocks - 1; matrices to be solved together need the same one, so give the one that the
        static part chose to the dynamic one. reorder: instead choose an order with small bandwidth, where that is worth
        it; chosen once and kept while boundaries and block_sizes stay.

        Returns PositionInData of each energy, int64 [n, c (c + 1) / 2]. Column k is the k-th pair (a <= b) of slots,
        row by row; the entry is -1 where a slot does not contribute, else 4 * (offset of the global block in `values`)
        + flags. Flag 1: add the transpose of the local block. Flag 2: two slots name the same dof block, so the local
        block and its transpose are both added.

        Raises ValueError for arrays that contradict each other or name no dof block; the matrix is then as before.
        MemoryError leaves it empty.
        """
        boundaries, block_sizes = check_layout(boundaries, block_sizes)
        check_local_blocks([np.shape(kappa) for kappa in kappas], MOST_LOCAL_BLOCKS)
        kappas = [_check_kappa(kappa, energy) for energy, kappa in enumerate(kappas)]
        if not reorder:
            if order is not None and order is not self.order:
                order = _check_order(order, boundaries, block_sizes)
            positions = self._build(boundaries, block_sizes, order, kappas, threads)
            self._chose_order = False
            return positions
        if order is not None:
            raise ValueError("either give an order or have one chosen with reorder=True, not both")
        if self._chose_order and self._has_layout(boundaries, block_sizes):
            return self._build(boundaries, block_sizes, self.order, kappas, threads)
        positions = self._build(boundaries, block_sizes, None, kappas, threads)
        order = self._better_order()
        if order is not None:
            positions = self._build(boundaries, block_sizes, order, kappas, threads)
        self._chose_order = True
        return positions

    def has_order_of(self, other: BlockMatrix) -> bool:
        """Whether both have the same order of dof blocks inside."""
        if self.order is None or other.order is None:
            return self.order is other.order
        return self.order is other.order or np.array_equal(self.order, other.order)

    def _has_layout(self, boundaries: LongArray, block_sizes: IntArray) -> bool:
        same = np.array_equal(boundaries, self.boundaries) and np.array_equal(block_sizes, self.block_sizes)
        return self._is_built and same

    def _better_order(self) -> IntArray | None:
        numbers = np.cumsum(self.block_size_at > 0, dtype=np.int32) - 1
        count = int(numbers[-1]) + 1 if numbers.size else 0
        if count < FEWEST_BLOCKS:
            return None
        rows, cols = self._coordinates()
        return bandwidth_reducing_order(numbers[rows], numbers[cols], count)

    def _build(
        self,
        boundaries: LongArray,
        block_sizes: IntArray,
        order: IntArray | None,
        kappas: list[IntArray],
        threads: int | None,
    ) -> list[LongArray]:
        same_order = order is self.order or (
            order is not None and self.order is not None and np.array_equal(order, self.order)
        )
        same_layout = same_order and self._has_layout(boundaries, block_sizes)
        capacities = np.array([kappa.shape[1] for kappa in kappas], np.int32)
        instances = np.array([kappa.shape[0] for kappa in kappas], np.int64)
        positions: list[LongArray] = [
            np.empty((kappa.shape[0], kappa.shape[1] * (kappa.shape[1] + 1) // 2), np.int64) for kappa in kappas
        ]
        count = len(kappas)
        kappa_pointers = (ctypes.c_void_p * count)(*(kappa.ctypes.data for kappa in kappas))
        position_pointers = (ctypes.c_void_p * count)(*(position.ctypes.data for position in positions))
        where = np.zeros(3, np.int64)
        library = self._runtime.library
        status = library.yasps_structure_build(
            self.handle,
            len(block_sizes),
            None if same_layout else boundaries.ctypes.data,
            block_sizes.ctypes.data,
            order.ctypes.data if order is not None else None,
            count,
            instances.ctypes.data,
            capacities.ctypes.data,
            kappa_pointers,
            position_pointers,
            int(self._with_diagonal),
            self._runtime.thread_count(threads) if instances.sum() >= _FEW else 1,
            where.ctypes.data,
        )
        if status == _BAD_SLOT:
            energy, instance, slot = (int(i) for i in where)
            raise ValueError(
                f"index {kappas[energy][instance, slot]} in kappas[{energy}][{instance}, {slot}] is not the 1-based "
                f"offset of a dof block; blocks start at {describe_layout(boundaries, block_sizes)}; 0 means no "
                "contribution"
            )
        if status != 0 and self._is_built:
            self._forget()
        check_status(status)
        self._is_built = True
        if not same_layout:
            self.boundaries = boundaries
            self.block_sizes = block_sizes
            self.order = order
            self.block_size_at = _block_sizes_at(boundaries, block_sizes)
        self._read_structure()
        return positions

    @property
    def groups(self) -> list[BlockGroup]:
        """The blocks by shape, ordered by (r, c); shapes that do not occur are left out."""
        if self._groups is None:
            rows, cols = self._coordinates()
            self._groups = []
            for r, c, first, count, value in self._group_table().tolist():
                blocks = self.values[value : value + count * r * c].reshape(count, r, c)
                part = slice(first, first + count)
                self._groups.append(BlockGroup(r, c, rows[part], cols[part], blocks))
        return self._groups

    def _coordinates(self) -> tuple[IntArray, IntArray]:
        rows = np.empty(self.block_count, np.int32)
        cols = np.empty(self.block_count, np.int32)
        self._runtime.library.yasps_structure_coordinates(self.handle, rows.ctypes.data, cols.ctypes.data)
        return rows, cols

    def fix(self, fixed: NDArray[np.bool_]) -> None:
        """Makes rows and columns of fixed scalars zero and, of a matrix with all diagonal blocks, the diagonal there
        one.

        fixed: [size], the same for all scalars of a dof block. Of a sum of matrices fix all: only the one with the
        diagonal gets ones. Raises ValueError for another shape.
        """
        if fixed.shape != (self.size,):
            raise ValueError(f"fixed has shape {fixed.shape}, but the matrix {self.size} rows")
        if self._touched is None or not np.array_equal(self._touched[0], fixed):
            self._touched = fixed.copy(), [_touched_by(fixed, group) for group in self.groups]
        for group, (touched, on_diagonal) in zip(self.groups, self._touched[1], strict=True):
            group.values[touched] = 0.0
            if self._with_diagonal:
                group.values[on_diagonal] = np.eye(group.r, group.c)

    def multiply(self, x: FloatArray, threads: int | None = None, *, deterministic: bool = False) -> FloatArray:
        """H x for float64 [size] x, with the full symmetric matrix. Raises ValueError for another shape.

        The result is the same bit for bit for the same number of threads; with `deterministic` for any number.
        """
        vector = as_vector(x, self.size, "x")
        count = self._runtime.thread_count(threads)
        result = np.empty(self.size)
        status = self._runtime.library.yasps_multiply(
            self._workspace,
            self.handle,
            self.values.ctypes.data,
            vector.ctypes.data,
            result.ctypes.data,
            count,
            piece_count(count, deterministic),
        )
        check_status(status)
        return result

    def aggregates(self) -> IntArray:
        """Of each scalar the number of the aggregate that its dof block moves with in the coarse space of the two-level
        preconditioner, int32 [size]; -1 for blocks that take no part. They follow from the sparsity alone."""
        numbers = np.empty(self.size, np.int32)
        check_status(self._runtime.library.yasps_aggregates(self.handle, numbers.ctypes.data))
        return numbers

    def to_scipy(self) -> sparse.csr_array[np.float64]:
        """The full symmetric matrix (both triangles) as a SciPy array in CSR format."""
        from scipy import sparse

        parts: list[tuple[FloatArray, LongArray, LongArray]] = []
        for group in self.groups:
            shape = group.values.shape
            rows = np.broadcast_to(group.rows[:, None, None] + np.arange(group.r)[:, None], shape)
            cols = np.broadcast_to(group.cols[:, None, None] + np.arange(group.c), shape)
            parts.append((group.values.reshape(-1), rows.reshape(-1), cols.reshape(-1)))
            off_diagonal = group.rows != group.cols
            parts.append(
                (
                    group.values[off_diagonal].reshape(-1),
                    cols[off_diagonal].reshape(-1),
                    rows[off_diagonal].reshape(-1),
                )
            )
        values = np.concatenate([part[0] for part in parts]) if parts else np.zeros(0)
        rows = np.concatenate([part[1] for part in parts]) if parts else np.zeros(0, np.int64)
        cols = np.concatenate([part[2] for part in parts]) if parts else np.zeros(0, np.int64)
        return sparse.coo_array((values, (rows, cols)), shape=(self.size, self.size)).tocsr()

    def __repr__(self) -> str:
        """Size, number of blocks and their shapes."""
        shapes = ", ".join(f"{count} of {r}x{c}" for r, c, _, count, _ in self._group_table().tolist())
        return f"BlockMatrix({self.size} x {self.size}, blocks: {shapes or 'none'})"

    def _group_table(self) -> LongArray:
        sizes = np.zeros(5, np.int64)
        self._runtime.library.yasps_structure_sizes(self.handle, sizes.ctypes.data)
        table = np.zeros((int(sizes[4]), 5), np.int64)
        self._runtime.library.yasps_structure_groups(self.handle, table.ctypes.data)
        return table

    def _read_structure(self) -> None:
        sizes = np.zeros(5, np.int64)
        self._runtime.library.yasps_structure_sizes(self.handle, sizes.ctypes.data)
        needed = int(sizes[3])
        if needed + _READ_AHEAD > self._storage.size:
            # Some room to grow, since the contacts of a dynamic part change all the time.
            self._storage = np.zeros(needed + needed // 4 + _READ_AHEAD)
        else:
            self._storage[: needed + _READ_AHEAD] = 0.0
        self.values = self._storage[:needed]
        self.block_count = int(sizes[2])
        self._groups = self._touched = None

    def _forget(self) -> None:
        """Become empty after a build that ran out of memory."""
        self._is_built = self._chose_order = False
        self._storage = np.zeros(_READ_AHEAD)
        self.build(np.zeros(1, np.int64), np.zeros(0, np.int32), [])


def _touched_by(fixed: NDArray[np.bool_], group: BlockGroup) -> tuple[LongArray, LongArray]:
    """The blocks in rows and columns of these scalars, and those of them on the diagonal."""
    touched = np.flatnonzero(fixed.take(group.rows) | fixed.take(group.cols))
    return touched, touched[group.rows[touched] == group.cols[touched]]


def check_layout(boundaries: LongArray, block_sizes: IntArray) -> tuple[LongArray, IntArray]:
    """Copies of both, int64 and int32. Raises ValueError unless they describe targets, as for `BlockMatrix.build`."""
    bounds = np.ascontiguousarray(boundaries, dtype=np.int64)
    sizes = np.ascontiguousarray(block_sizes, dtype=np.int32)
    if bounds.ndim != 1 or sizes.ndim != 1 or len(bounds) != len(sizes) + 1:
        raise ValueError(
            f"boundaries has shape {bounds.shape} and block_sizes {sizes.shape}; T targets need (T + 1,) and (T,)"
        )
    lengths = np.diff(bounds)
    if bounds[0] != 0 or (lengths < 0).any():
        raise ValueError(f"boundaries must start at 0 and never fall, but are {bounds.tolist()}")
    if (sizes < 1).any():
        raise ValueError(f"every target needs at least one scalar per instance; block_sizes are {sizes.tolist()}")
    for target in np.flatnonzero(lengths % sizes).tolist():
        raise ValueError(
            f"target {target} has {lengths[target]} scalars, which is not a whole number of blocks of {sizes[target]}"
        )
    if bounds[-1] > MOST_SCALARS:
        raise ValueError(f"{bounds[-1]} unknowns; the runtime can index at most {MOST_SCALARS}")
    return bounds.copy(), sizes.copy()


def check_local_blocks(shapes: Sequence[tuple[int, ...]], most: int) -> None:
    """Before there is memory for any: raises ValueError if energies with kappas of these shapes, [n, c] each, have more
    local blocks together than can be told apart. Other shapes are somebody else's complaint."""
    count = sum(n * c * (c + 1) // 2 for n, c in (shape for shape in shapes if len(shape) == 2))
    if count > most:
        raise ValueError(
            f"{count} local blocks, but at most {most} are numbered: split the energies over several matrices"
        )


def _check_order(order: IntArray, boundaries: LongArray, block_sizes: IntArray) -> IntArray:
    count = int((np.diff(boundaries) // block_sizes).sum())
    places = np.ascontiguousarray(order, dtype=np.int32)
    if places.shape != (count,):
        raise ValueError(f"order has shape {places.shape}; there are {count} dof blocks, so ({count},) is needed")
    if count and (places.min() < 0 or (np.bincount(places, minlength=count) != 1).any()):
        raise ValueError(f"order is not a permutation: each of 0 .. {count - 1} must occur once")
    return places


def _block_sizes_at(boundaries: LongArray, block_sizes: IntArray) -> IntArray:
    sizes = np.zeros(int(boundaries[-1]), np.int32)
    for target, q in enumerate(block_sizes.tolist()):
        sizes[boundaries[target] : boundaries[target + 1] : q] = q
    return sizes


def _check_kappa(kappa: IntArray, energy: int) -> IntArray:
    if kappa.ndim != 2 or not np.issubdtype(kappa.dtype, np.integer):
        raise ValueError(
            f"kappas[{energy}] has shape {kappa.shape} and type {kappa.dtype}; integers of shape [instances, slots] "
            "are needed"
        )
    return np.ascontiguousarray(kappa, dtype=np.int32)


def describe_layout(boundaries: LongArray, block_sizes: IntArray) -> str:
    """Where dof blocks start, counted from 1, for messages."""
    runs = [
        f"{int(boundaries[t]) + 1}, {int(boundaries[t]) + 1 + q}, ... below {int(boundaries[t + 1]) + 1} (target {t})"
        for t, q in enumerate(block_sizes.tolist())
    ]
    return "; ".join(runs) or "nowhere, for there are no targets"
