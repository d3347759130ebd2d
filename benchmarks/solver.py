"""Linear solvers on one Newton system each of a soft, a stiff, a quasi-static and a contact-dominated scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from benchmarks.kernel_problem import on_cpu
from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.solver_problems import PROBLEMS, SolverProblem
from yasps.frontend.commands.environment_report import cpu_model
from yasps.runtime.core.library import available_processors
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.direct import LIBRARIES, DirectSolver, available_libraries
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, SolveReport

DESCRIPTION = "linear solvers on soft, stiff, quasi-static and contact-dominated systems: seconds and iterations"
DEFAULT_SIZE = 30_000
TOLERANCE = 1e-4
MAX_ITERATIONS = 100_000
MOST_FOR_SUPERLU = 10_000
REPEATS_PER_ROUND = 3
NOTES = (
    f"--size: unknowns, about; --repeats R: R / {REPEATS_PER_ROUND} rounds. PCG: r^T D^-1 r <= {TOLERANCE:g} g^T D^-1 "
    "g with the diagonal blocks D, or to an error in the energy norm, in shares of the solution's. SciPy's cg: block "
    "Jacobi, to the plain residual that PCG's result has with it.",
    "analyse: sparsity and all that depends on it, ordering and symbolic factorisation; solve: values, factorisation "
    "and solution, with the analysis kept from before, to a relative squared residual of 1e-16.",
)


PRECONDITIONERS = ("jacobi", "gauss-seidel", "two-level")
ERRORS = (1e-1, 1e-2, 1e-3)
EXACT = 1e-20


class SystemNotSolvedError(ArithmeticError):
    """A solver did not solve what it is timed for: a time of that means nothing."""


def run(settings: Settings) -> Report:
    """All solvers on all problems, on one thread and on all that were asked for."""
    notes = []
    rows: list[Row] = []
    for make in PROBLEMS:
        problem = make(settings.size, settings.threads)
        matrix = sum((part.to_scipy() for part in problem.parts[1:]), problem.parts[0].to_scipy())
        counts = f"{problem.gradient.size:,} unknowns, {matrix.nnz:,} entries, {problem.contacts:,} contacts"
        notes.append(f"{problem.name}: {counts}.")
        rows += _rows_of(problem, sparse.csr_array(matrix), settings)
    left_out = [
        f"{LIBRARIES[name]} is left out: {why}."
        for name, why in (
            ("pardiso", "" if find_spec("pypardiso") else "pypardiso is not installed (pip install 'yasps[direct]')"),
            ("superlu", "" if settings.size <= MOST_FOR_SUPERLU else f"more than {MOST_FOR_SUPERLU:,} unknowns"),
        )
        if why
    ]
    return Report(rows, [f"{cpu_model()}, {available_processors()} processors.", *notes, *NOTES, *left_out])


def _rows_of(problem: SolverProblem, matrix: sparse.csr_array[np.float64], settings: Settings) -> list[Row]:
    parts, g = problem.parts, problem.gradient
    runtime = on_cpu(problem.compiled).runtime
    pcg = PcgSolver(runtime)
    threads_of_rows = sorted({1, settings.threads})
    exact = _Exact(matrix, _solved(pcg, problem, SolveOptions(EXACT, MAX_ITERATIONS, preconditioner="two-level"))[0])
    rows: list[Row] = []
    peers: list[Peer] = []
    for preconditioner in PRECONDITIONERS:
        options = SolveOptions(TOLERANCE, MAX_ITERATIONS, preconditioner=preconditioner)
        x, report = _solved(pcg, problem, options)
        cases = [(f"yasps PCG, {preconditioner}", options, report.iterations)]
        for error in ERRORS:
            count = _iterations_to(error, pcg, problem, exact, replace(options, tolerance=0.0))
            stopped = replace(options, tolerance=0.0, max_iterations=count)
            cases.append((f"yasps PCG, {preconditioner}, error {error:g}", stopped, count))
        for name, chosen, count in cases:
            rows.append(Row(problem.name, name, settings.threads, count, "iterations"))
            peers += [Peer(problem.name, name, k, _pcg_run(pcg, problem, chosen, k), 1.0, "s") for k in threads_of_rows]
        rows.append(
            Row(problem.name, f"yasps PCG, {preconditioner}", settings.threads, exact.error(x), "error in energy norm")
        )
        if preconditioner == "jacobi":
            residual = float(np.linalg.norm(matrix @ x - g) / np.linalg.norm(g))
    for name in available_libraries():
        if name == "superlu" and settings.size > MOST_FOR_SUPERLU:
            continue
        direct = DirectSolver(runtime, name)
        for threads in threads_of_rows if name == "pardiso" else (1,):
            solve = _direct_run(direct, problem, threads)
            if name == "pardiso":
                analyse = _analysis_run(direct, problem, threads)
                peers.append(Peer(problem.name, f"{direct.name}, analyse", threads, analyse, 1.0, "s"))
            peers.append(Peer(problem.name, f"{direct.name}, solve", threads, solve, 1.0, "s"))
    scipy_cg = _ScipyCg(matrix, parts, g, residual)
    peers.append(Peer(problem.name, "SciPy cg", 1, scipy_cg, 1.0, "s"))
    rows += measure(peers, max(1, settings.repeats // REPEATS_PER_ROUND))
    rows.append(Row(problem.name, "SciPy cg", 1, scipy_cg.iterations, "iterations"))
    return rows


def _solved(pcg: PcgSolver, problem: SolverProblem, options: SolveOptions) -> tuple[NDArray[np.float64], SolveReport]:
    x, report = pcg.solve(problem.parts, problem.gradient, options)
    if not report.converged:
        raise SystemNotSolvedError(f"{problem.name}: conjugate gradients ended with: {report}")
    return x, report


@dataclass(frozen=True)
class _Exact:
    """The solution, to measure errors in the energy norm against."""

    matrix: sparse.csr_array[np.float64]
    x: NDArray[np.float64]

    def error(self, x: NDArray[np.float64]) -> float:
        """sqrt(e^T H e) of x, in shares of the solution's."""
        off = x - self.x
        return float(np.sqrt(off @ (self.matrix @ off) / (self.x @ (self.matrix @ self.x))))


def _iterations_to(error: float, pcg: PcgSolver, problem: SolverProblem, exact: _Exact, options: SolveOptions) -> int:
    """The fewest iterations after which the error in the energy norm, which falls in each, is at most this."""

    def reached(count: int) -> bool:
        x, _ = pcg.solve(problem.parts, problem.gradient, replace(options, max_iterations=count))
        return exact.error(x) <= error

    few, many = 0, 1
    while not reached(many):
        few, many = many, 2 * many
        if many > options.max_iterations:
            raise SystemNotSolvedError(f"{problem.name}: no error of {error:g} in {few} iterations")
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (few, middle) if reached(middle) else (middle, many)
    return many


def _pcg_run(pcg: PcgSolver, problem: SolverProblem, options: SolveOptions, threads: int) -> Callable[[], object]:
    return lambda: pcg.solve(problem.parts, problem.gradient, options, threads=threads)


def _direct_run(direct: DirectSolver, problem: SolverProblem, threads: int) -> Callable[[], object]:
    def solve() -> None:
        report = direct.solve(problem.parts, problem.gradient, SolveOptions(1e-16), threads=threads)[1]
        if not report.converged:
            raise SystemNotSolvedError(f"{problem.name}: {report}")

    return solve


def _analysis_run(direct: DirectSolver, problem: SolverProblem, threads: int) -> Callable[[], object]:
    return lambda: direct.analyse_anew(problem.parts, threads=threads)


class _ScipyCg:
    """SciPy's cg with the inverse diagonal blocks as preconditioner; counts its iterations."""

    def __init__(
        self,
        matrix: sparse.csr_array[np.float64],
        parts: list[BlockMatrix],
        g: NDArray[np.float64],
        tolerance: float,
    ) -> None:
        size = parts[0].size
        starts = np.flatnonzero(parts[0].block_size_at)
        block = np.repeat(np.arange(len(starts)), parts[0].block_size_at[starts])
        entries = matrix.tocoo()
        inside = block[entries.row] == block[entries.col]
        blocks = sparse.csr_array(
            (entries.data[inside], (entries.row[inside], entries.col[inside])), shape=(size, size)
        )
        # All blocks here are 3x3: their entries lie row by row, three to a row.
        inverses = np.linalg.inv(blocks.data.reshape(-1, 3, 3))
        self._preconditioner = sparse.bsr_array(
            (inverses, np.arange(len(starts)), np.arange(len(starts) + 1)), shape=(size, size)
        ).tocsr()
        self._matrix, self._g, self._tolerance = matrix, g, tolerance
        self.iterations = 0

    def __call__(self) -> None:
        self.iterations = 0
        _, info = linalg.cg(
            self._matrix,
            self._g,
            rtol=self._tolerance,
            maxiter=MAX_ITERATIONS,
            M=self._preconditioner,
            callback=self._count,
        )
        if info != 0:
            raise SystemNotSolvedError(f"SciPy's cg stopped with {info}")

    def _count(self, x: NDArray[np.float64]) -> None:
        self.iterations += 1
