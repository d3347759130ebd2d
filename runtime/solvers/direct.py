"""Direct solution of H x = g by sparse factorisation, for systems that conjugate gradients take thousands of
iterations for."""

from __future__ import annotations

import importlib.util
import logging
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeAlias

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from yasps.runtime.core.library import FloatArray, IntArray, LongArray, Runtime, as_vector
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.options import DEFAULTS, SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, SolveReport, StopReason, check_parts

LOGGER = logging.getLogger("yasps")
LIBRARIES = {"pardiso": "MKL PARDISO", "superlu": "SciPy's SuperLU"}
"""What can factorise, best first, and its name for people."""
Blocks: TypeAlias = tuple[IntArray, IntArray, int, int]
"""First rows and columns of blocks of one shape, and that shape."""
_REPRODUCIBLE = {1: 1, 2: 2, 8: 2, 10: 8, 18: -1, 34: 16}
"""Entries of PARDISO's iparm, counted from 1: its defaults but for 34, the threads for reproducible sums, which needs
the ordering in 2. Without it the last bits differ from run to run, and it costs nothing that can be measured."""
_REFINEMENTS = 10
"""Most PCG iterations that take rounding out of a direct solution."""
_ROUNDING = 1e-20
"""A relative squared residual that is nothing but rounding."""
_MOST_ENTRIES = 2**31 - 1
"""Both libraries index the entries of a matrix, of which SuperLU gets both triangles, with 32 bits."""


class NotPositiveDefiniteError(ArithmeticError):
    """A factorisation met a pivot that is not positive. row: where, in the matrix, or None if the library doesn't
    tell."""

    def __init__(self, row: int | None) -> None:
        super().__init__("the matrix is not positive definite" + (f" (row {row})" if row is not None else ""))
        self.row = row


class Factorization(Protocol):
    """One library behind `DirectSolver`. `matrix` is the upper triangle in CSR with sorted columns and a full
    diagonal."""

    def analyse(self, matrix: sparse.csr_array[np.float64], threads: int) -> None:
        """Looks at the sparsity; values don't matter."""

    def solve(self, matrix: sparse.csr_array[np.float64], g: FloatArray, threads: int) -> FloatArray:
        """Factorises a matrix with the analysed sparsity and solves. Raises NotPositiveDefiniteError, MemoryError."""


class Pardiso:
    """MKL PARDISO through pypardiso: Cholesky (matrix type 2), in parallel."""

    def __init__(self) -> None:
        from pypardiso import PyPardisoSolver

        self._solver: Any = PyPardisoSolver(mtype=2)
        for number, value in _REPRODUCIBLE.items():
            self._solver.set_iparm(number, value)
        weakref.finalize(self, self._solver.free_memory, everything=True)

    def analyse(self, matrix: sparse.csr_array[np.float64], threads: int) -> None:
        self._call(-1, sparse.csr_array((0, 0)), np.zeros(0), threads)
        self._call(11, matrix, np.zeros(matrix.shape[0]), threads)

    def solve(self, matrix: sparse.csr_array[np.float64], g: FloatArray, threads: int) -> FloatArray:
        return self._call(23, matrix, g, threads)

    def _call(self, phase: int, matrix: Any, g: FloatArray, threads: int) -> FloatArray:
        from pypardiso.pardiso_wrapper import PyPardisoError

        self._solver.set_phase(phase)
        before = self._solver.libmkl.MKL_Set_Num_Threads_Local(threads)
        try:
            # pypardiso's public functions analyse anew for every matrix; this is the one that they all call.
            return np.asarray(self._solver._call_pardiso(matrix, g), np.float64)
        except PyPardisoError as error:
            if error.value == -4:
                row = int(self._solver.get_iparm(30)) - 1
                raise NotPositiveDefiniteError(row if 0 <= row < matrix.shape[0] else None) from error
            if error.value in (-2, -9):
                raise MemoryError("no memory to factorise the matrix") from error
            raise RuntimeError(f"MKL PARDISO failed in phase {phase}: {error}") from error
        finally:
            self._solver.libmkl.MKL_Set_Num_Threads_Local(before)


class SuperLu:
    """SciPy's own: LU with the symmetric ordering and diagonal pivots, so all of them are positive just where the
    matrix is positive definite. One thread, no reuse of the analysis."""

    def analyse(self, matrix: sparse.csr_array[np.float64], threads: int) -> None:
        """SuperLU does that in every factorisation."""

    def solve(self, matrix: sparse.csr_array[np.float64], g: FloatArray, threads: int) -> FloatArray:
        whole = sparse.csc_matrix(matrix + sparse.triu(matrix, 1).T)
        options = {"SymmetricMode": True, "DiagPivotThresh": 0.0}
        try:
            factors = linalg.splu(whole, permc_spec="MMD_AT_PLUS_A", options=options)
        except RuntimeError as error:  # "Factor is exactly singular"
            raise NotPositiveDefiniteError(None) from error
        order, pivots = factors.perm_c, factors.U.diagonal()
        bad = np.flatnonzero((factors.perm_r != order) | ~(pivots[order] > 0))
        if len(bad):
            raise NotPositiveDefiniteError(int(bad[np.argmin(order[bad])]))
        return np.asarray(factors.solve(g), np.float64)


def available_libraries() -> list[str]:
    """Names of the libraries that this installation can factorise with, best first."""
    return [name for name in LIBRARIES if name != "pardiso" or importlib.util.find_spec("pypardiso") is not None]


def load_library(name: str) -> Factorization:
    """A library by its name. Raises ValueError, ImportError."""
    if name not in LIBRARIES:
        raise ValueError(f"there is no factorisation {name!r}; known are {', '.join(LIBRARIES)}")
    return Pardiso() if name == "pardiso" else SuperLu()


class DirectSolver:
    """Sparse factorisation of the sum of block matrices.

    library: a key of LIBRARIES; default the best that is installed. deterministic: of the refinement, see `PcgSolver`;
    factorisations give the same bits for any number of threads anyway. The analysis of the sparsity is kept while the
    sparsity stays the same.
    """

    def __init__(self, runtime: Runtime, library: str | None = None, *, deterministic: bool = False) -> None:
        name = library or available_libraries()[0]
        self.library = load_library(name)
        self.name = LIBRARIES[name]
        self.analyses = 0
        self._runtime = runtime
        self._check = PcgSolver(runtime, deterministic=deterministic)
        self._sum = UpperSum()
        if library is None and name == "superlu":
            LOGGER.warning(
                "direct solutions come from SciPy's SuperLU, which is slow for large systems; "
                "pip install 'yasps[direct]' brings MKL PARDISO"
            )

    def solve(
        self,
        parts: Sequence[BlockMatrix],
        g: FloatArray,
        options: SolveOptions = DEFAULTS,
        *,
        threads: int | None = None,
    ) -> tuple[FloatArray, SolveReport]:
        """Solve (sum of parts) x = g.

        parts, g: as for `PcgSolver.solve`. The report's residual has the meaning it has there. Where rounding leaves
        more than options.tolerance, up to ten iterations of conjugate gradients, which the report counts, take it out.

        Look at `report.reason`: for a matrix that is not positive definite or not finite x is zero.
        """
        check_parts(parts)
        g = as_vector(g, parts[0].size, "g")
        if not (np.isfinite(g).all() and all(np.isfinite(part.values).all() for part in parts)):
            return np.zeros_like(g), self._failed(StopReason.NOT_FINITE, None)
        if g.size == 0:
            return self._check.solve(parts, g, replace(options, max_iterations=0), threads=threads)
        count = self._runtime.thread_count(threads)
        if not self._sum.describes(parts):
            self.analyse_anew(parts, threads=threads)
        try:
            x = self.library.solve(self._sum.add(parts), g, count)
        except NotPositiveDefiniteError as error:
            block = None if error.row is None else _block_of(parts[0], error.row)
            return np.zeros_like(g), self._failed(StopReason.NOT_POSITIVE_DEFINITE, block)
        if not np.isfinite(x).all():
            return np.zeros_like(g), self._failed(StopReason.NOT_POSITIVE_DEFINITE, None)
        refined = replace(
            options, tolerance=max(options.tolerance, _ROUNDING), max_iterations=_REFINEMENTS, preconditioner="jacobi"
        )
        x, report = self._check.solve(parts, g, refined, x, threads=threads)
        return x, report.by(self.name)

    def analyse_anew(self, parts: Sequence[BlockMatrix], *, threads: int | None = None) -> None:
        """Looks at the sparsity even if it is the one of the last solve. Nobody needs that but who wants to time it."""
        check_parts(parts)
        self._sum = UpperSum()
        self._sum.follow(parts)
        self.analyses += 1
        self.library.analyse(self._sum.matrix(), self._runtime.thread_count(threads))

    def _failed(self, reason: StopReason, block: int | None) -> SolveReport:
        return SolveReport(reason, 0, np.nan, block, None, self.name)


@dataclass
class UpperSum:
    """The upper triangle of a sum of block matrices in CSR, and where each stored number goes."""

    _blocks: list[Blocks] | None = None
    _size: int = -1
    _taken: LongArray | None = None
    _place: LongArray | None = None
    _matrix: sparse.csr_array[np.float64] | None = None

    def describes(self, parts: Sequence[BlockMatrix]) -> bool:
        """Whether these parts have the sparsity that was followed last."""
        return self._blocks is not None and self._size == parts[0].size and _same(self._blocks, _blocks_of(parts))

    def follow(self, parts: Sequence[BlockMatrix]) -> None:
        """Makes itself ready for parts of this sparsity. Raises ValueError where no library could index the matrix."""
        blocks = _blocks_of(parts)
        n = parts[0].size
        entries = n + sum(2 * len(first_row) * r * c for first_row, _, r, c in blocks)
        if entries > _MOST_ENTRIES:
            raise ValueError(
                f"a direct solver indexes at most {_MOST_ENTRIES} entries of a matrix, and this one has about"
                f" {entries}: use solver='pcg'"
            )
        rows, cols = [np.arange(n)], [np.arange(n)]  # PARDISO wants the whole diagonal
        for first_row, first_col, r, c in blocks:
            shape = (len(first_row), r, c)
            rows.append(np.broadcast_to(first_row[:, None, None] + np.arange(r)[:, None], shape).reshape(-1))
            cols.append(np.broadcast_to(first_col[:, None, None] + np.arange(c), shape).reshape(-1))
        row, col = np.concatenate(rows).astype(np.int64), np.concatenate(cols).astype(np.int64)
        # Of two symmetric blocks any can be the stored one; a diagonal block is stored in full.
        one_of_two = np.concatenate([np.ones(n, bool), *(np.repeat(i != j, r * c) for i, j, r, c in blocks)])
        taken = np.flatnonzero((row <= col) | one_of_two)
        key, place = np.unique(np.minimum(row, col)[taken] * n + np.maximum(row, col)[taken], return_inverse=True)
        starts = np.searchsorted(key, np.arange(n + 1) * n)
        self._matrix = sparse.csr_array((np.zeros(len(key)), key % n, starts), shape=(n, n))
        self._taken, self._place = taken[n:] - n, place[n:]
        self._blocks, self._size = blocks, n

    def matrix(self) -> sparse.csr_array[np.float64]:
        """The matrix with the values of the last `add`; its own arrays, not copies."""
        assert self._matrix is not None
        return self._matrix

    def add(self, parts: Sequence[BlockMatrix]) -> sparse.csr_array[np.float64]:
        """The sum of parts that `follow` has seen."""
        matrix = self.matrix()
        assert self._taken is not None
        assert self._place is not None
        values = np.concatenate([part.values for part in parts])[self._taken]
        matrix.data = np.bincount(self._place, values, minlength=matrix.nnz).astype(np.float64, copy=False)
        return matrix


def _blocks_of(parts: Sequence[BlockMatrix]) -> list[Blocks]:
    return [(group.rows, group.cols, group.r, group.c) for part in parts for group in part.groups]


def _same(old: list[Blocks], new: list[Blocks]) -> bool:
    return len(old) == len(new) and all(
        a[2:] == b[2:] and np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
        for a, b in zip(old, new, strict=True)
    )


def _block_of(part: BlockMatrix, row: int) -> int:
    """Scalar offset of the dof block that this row is in."""
    starts = np.flatnonzero(part.block_size_at)
    return int(starts[np.searchsorted(starts, row, side="right") - 1])
