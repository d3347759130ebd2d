"""Preconditioned conjugate gradients for the global system H x = g."""

from __future__ import annotations

import ctypes
import logging
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import ClassVar, Protocol, TypeVar

import numpy as np

from yasps.runtime.core.library import (
    DETERMINISTIC_PIECES,
    FloatArray,
    IntArray,
    LongArray,
    Runtime,
    as_vector,
    available_processors,
    check_status,
    piece_count,
)
from yasps.runtime.core.uncopied import Uncopied
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.options import DEFAULTS, SolveOptions

LOGGER = logging.getLogger("yasps")
TOO_FEW_DIGITS = "the sweeps have too few digits for this system: block Jacobi went on"
COARSE_BROKE_DOWN = "the coarse matrix of a linear system is not positive definite: block Jacobi goes on alone"


class StopReason(Enum):
    """Why the solver stopped. Only CONVERGED means that x solves the system to the tolerance."""

    CONVERGED = 0
    MAX_ITERATIONS = 1
    NOT_POSITIVE_DEFINITE = 2
    NOT_FINITE = 3


@dataclass(frozen=True)
class SolveReport:
    """How a solve ended.

    reason: see StopReason. iterations: products with H, less one for a start vector. relative_squared_residual:
    r^T D^-1 r / g^T D^-1 g at the end, the quantity that is compared with the tolerance; NaN when the iteration did not
    start. block: scalar offset of the dof block whose diagonal block is to blame (not positive definite or not finite),
    else None. history: that quantity before each iteration and at the end, when it was asked for. solver: what solved:
    "pcg", or the name of a direct solver's library (iterations then are those that took out rounding). why: what made
    the choice, where there was one. gauss_seidel: whether symmetric Gauss-Seidel was the preconditioner to the end.
    two_level: whether the coarse space was used. coarse_broke_down: whether it was to be used but its matrix was not
    positive definite, so that block Jacobi went on alone. trial_iterations: of the other preconditioner, where "auto"
    tried it on the same system.
    """

    reason: StopReason
    iterations: int
    relative_squared_residual: float
    block: int | None
    history: tuple[float, ...] | None
    solver: str = "pcg"
    why: str = ""
    gauss_seidel: bool = False
    two_level: bool = False
    coarse_broke_down: bool = False
    trial_iterations: int = 0

    @property
    def direct(self) -> bool:
        """Whether a direct solver did it."""
        return self.solver != "pcg"

    @property
    def all_iterations(self) -> int:
        """With those of a trial."""
        return self.iterations + self.trial_iterations

    def by(self, solver: str, why: str = "") -> SolveReport:
        """The same report of another solver."""
        return replace(self, solver=solver, why=why)

    @property
    def converged(self) -> bool:
        """Whether the tolerance was reached."""
        return self.reason is StopReason.CONVERGED

    def __str__(self) -> str:
        """One line for logs."""
        where = f" (dof block at scalar {self.block})" if self.block is not None else ""
        with_what = " with two levels" if self.two_level else " with Gauss-Seidel" if self.gauss_seidel else ""
        who = f" by {self.solver}" if self.direct else with_what
        why = f" ({self.why})" if self.why else ""
        reason = self.reason.name.lower().replace("_", " ")
        return (
            f"{reason}{where} after {self.iterations} iterations{who}{why}, relative squared residual "
            f"{self.relative_squared_residual:.3g}"
        )


X = TypeVar("X")
Run = Callable[[bool, int], tuple[X, SolveReport]]
"""Solves one system: with the coarse space?, most iterations."""


@dataclass
class PreconditionerChoice:
    """What preconditioner="auto" has learned of a scene. It counts iterations, not seconds, so that it decides the same
    in every run.

    Gauss-Seidel begins, block Jacobi on a GPU; where it is not done in PATIENCE iterations, the coarse space solves
    that system and the next ones. Now and then a system is solved with the other preconditioner, too, and the next
    systems get the one that was cheaper in the latest of these trials. Trials become rare while they change
    nothing.
    """

    two_level: bool = False
    """Whether the next system has the coarse space."""
    lead: float = 0.0
    """By how much the coarse space was cheaper in the trials, in iterations without it; late ones count most."""
    solved: int = 0
    """Systems since the last trial."""
    wait: int = 0
    """How many there are at least between two trials; 0 before the first."""

    ITERATION: ClassVar[float] = 1.2
    """What an iteration with the coarse space costs, in iterations without it (docs/performance.md)."""
    SETUP: ClassVar[float] = 10.0
    """What the coarse matrix and its inverse cost, in the same unit."""
    SLOW: ClassVar[int] = 40
    """Systems that take fewer iterations without the coarse space are not worth a trial."""
    PATIENCE: ClassVar[int] = 300
    """Iterations without the coarse space before the first trial."""
    FEWEST_BLOCKS: ClassVar[int] = 5000
    """Scenes with fewer dof blocks do not get faster: fewer, but as much dearer iterations."""
    SHORTEST_WAIT: ClassVar[int] = 8
    LONGEST_WAIT: ClassVar[int] = 64
    """Bounds of `wait`: a trial costs about a solve, so that rare ones do not count."""
    DEARER: ClassVar[float] = 1.25
    """A trial ends at so many times the cost of the first solve."""
    MEMORY: ClassVar[float] = 0.25
    """What is left of `lead` in the next trial."""

    def solve(self, options: SolveOptions, part: Part, run: Run[X]) -> tuple[X, SolveReport]:
        """Solves a system with the preconditioner of these options, and learns from it.

        part: a matrix of the system. run: solves it, with the coarse space or without, in at most so many iterations;
        the x that it converged to is still needed when it is called again.
        """
        if options.preconditioner != "auto" or _block_count(part) < self.FEWEST_BLOCKS:
            return run(options.preconditioner == "two-level", options.max_iterations)
        is_new = self.wait == 0
        most = min(options.max_iterations, self.PATIENCE) if is_new else options.max_iterations
        x, report = run(self.two_level, most)
        if is_new and report.reason is StopReason.MAX_ITERATIONS and most < options.max_iterations:
            self.two_level, self.wait = True, self.SHORTEST_WAIT
            x, report = run(True, options.max_iterations)
            return x, replace(report, trial_iterations=most)
        self.solved += 1
        if report.converged and self.solved > self.wait and (self.two_level or report.iterations >= self.SLOW):
            report = replace(report, trial_iterations=self._try_other(options, report, run))
        return x, report

    def _try_other(self, options: SolveOptions, report: SolveReport, run: Run[X]) -> int:
        """Solves the same system with the other preconditioner, and chooses for the next ones. Returns iterations."""
        cost = self._cost(report)
        dear = self.DEARER * cost
        most = dear if self.two_level else (dear - self.SETUP) / self.ITERATION
        _, other = run(not self.two_level, min(int(most), options.max_iterations))
        of_other = self._cost(other) if other.converged else dear
        self.lead = self.MEMORY * self.lead + (of_other - cost if self.two_level else cost - of_other)
        before, self.two_level = self.two_level, self.lead > 0
        longer = min(max(2 * self.wait, self.SHORTEST_WAIT), self.LONGEST_WAIT)
        self.wait = longer if self.two_level == before else self.SHORTEST_WAIT
        self.solved = 0
        return other.iterations

    def _cost(self, report: SolveReport) -> float:
        """In iterations without the coarse space."""
        if report.coarse_broke_down:
            return self.SETUP + report.iterations
        return self.SETUP + self.ITERATION * report.iterations if report.two_level else float(report.iterations)

    def numbers(self) -> FloatArray:
        """What was learned, for a state that goes on elsewhere, [4]."""
        return np.array([self.two_level, self.lead, self.solved, self.wait], dtype=np.float64)

    def set_numbers(self, numbers: FloatArray) -> None:
        """Goes on from what `numbers` gave."""
        two_level, lead, solved, wait = numbers.tolist()
        self.two_level, self.lead, self.solved, self.wait = bool(two_level), lead, int(solved), int(wait)


_FEWEST_ROWS = 1024
"""Dof blocks of a piece that is swept; smaller ones would make the preconditioner worse."""


def _pieces_to_sweep(part: Part) -> int:
    """How many pieces rows are cut into: as many as processors can use, and as many for any number of threads."""
    most, blocks, pieces = min(DETERMINISTIC_PIECES, available_processors()), _block_count(part), 1
    while pieces < most and 2 * pieces * _FEWEST_ROWS <= blocks:
        pieces *= 2
    return pieces


def _block_count(part: Part) -> int:
    return int((np.diff(part.boundaries) // part.block_sizes).sum())


class _Result(ctypes.Structure):
    """As `SolveResult` in pcg.cpp."""

    _fields_ = [
        ("iterations", ctypes.c_long),
        ("relative_residual", ctypes.c_double),
        ("reason", ctypes.c_long),
        ("block", ctypes.c_long),
        ("coarse", ctypes.c_long),
        ("sweeps", ctypes.c_long),
    ]


_KINDS = {"jacobi": 0, "two-level": 1, "gauss-seidel": 2}
"""As `Preconditioner` in workspace.h."""


class PcgSolver(Uncopied):
    """Conjugate gradients (paper, section 8 and appendix D), with block Jacobi, Gauss-Seidel or two levels.

    Owns the solver's vectors; keep one and use it for every solve. choice: what preconditioner="auto" has learned.
    """

    def __init__(self, runtime: Runtime, *, deterministic: bool = False) -> None:
        """Make a solver without memory; the first solve gets it.

        deterministic: results do not depend on the number of threads, for some more time.
        """
        self._runtime = runtime
        self._deterministic = deterministic
        handle = runtime.library.yasps_workspace_new()
        if not handle:
            raise MemoryError("no memory for a solver")
        self._handle: int = handle
        self.choice = PreconditionerChoice()
        weakref.finalize(self, runtime.library.yasps_workspace_free, handle)

    def solve(
        self,
        parts: Sequence[BlockMatrix],
        g: FloatArray,
        options: SolveOptions = DEFAULTS,
        x0: FloatArray | None = None,
        *,
        threads: int | None = None,
    ) -> tuple[FloatArray, SolveReport]:
        """Solve (sum of parts) x = g; the Newton step of an energy with gradient g is -x.

        parts: matrices with the same targets; every dof block needs a diagonal block in at least one. g: float64
        [unknowns]. x0: where to start, default 0.

        The solver stops when r^T D^-1 r <= options.tolerance * g^T D^-1 g, with r = g - H x by recurrence and D the
        diagonal blocks of H. That is a *squared* norm: tolerance 1e-4 asks for 1e-2 in the norm. It is the same norm
        whatever the preconditioner is. The reference is g also with a start vector. g = 0 gives x = 0.

        Gauss-Seidel is (D + L) D^-1 (D + L)^T, L what lies below D in an order of the dof blocks (Eisenstat 1981; see
        gauss_seidel.h). It sweeps over the 3x3 blocks of the first two parts; others have a part in D alone, and where
        the first part couples few 3x3 blocks, block Jacobi solves. Rows are cut into pieces, as many as a power of two
        can be for the processors, up to 16, and one for less than 2,048 dof blocks; what couples a pair of pieces with
        another is not in L. The products are of float32 numbers, scaled to unit diagonal blocks, which take 1.4 times
        the memory of H; residuals are checked with H itself, and where float32 is not enough, block Jacobi goes on, and
        `report.why` says so.

        The two-level preconditioner is D^-1 + P (P^T H P)^-1 P^T, where P moves the dof blocks of an aggregate
        together, blocks of one size that are coupled in parts[0]. Aggregates are so large that the square of the coarse
        space's unknowns is about 0.15 of the numbers in parts[0], and they are at most 1,000. Aggregates are kept while
        parts[0] has its structure; numbers are those of this system. Where P^T H P is not positive definite, block
        Jacobi goes on alone, and report and log say so.

        Returns x and the report; always look at `report.reason`. x is the last iterate (x0 when the iteration could
        not start). The result is the same bit for bit in every run with the same number of threads, of a deterministic
        solver with any number; with Gauss-Seidel, on machines with as many processors. Raises ValueError for arguments
        that do not fit together, MemoryError.
        """
        check_parts(parts)
        size = parts[0].size
        g = as_vector(g, size, "g")
        start = as_vector(x0, size, "x0") if x0 is not None else None
        count = self._runtime.thread_count(threads)

        def run(two_level: bool, max_iterations: int) -> tuple[FloatArray, SolveReport]:
            alone = "jacobi" if options.preconditioner == "jacobi" else "gauss-seidel"
            kind = "two-level" if two_level else alone
            sweeps = kind == "gauss-seidel"
            x = np.empty(size)
            history = np.full(max_iterations + 1, np.nan) if options.history else None
            result = _Result()
            status = self._runtime.library.yasps_solve(
                self._handle,
                len(parts),
                (ctypes.c_void_p * len(parts))(*(part.handle for part in parts)),
                (ctypes.c_void_p * len(parts))(*(part.values.ctypes.data for part in parts)),
                g.ctypes.data,
                start.ctypes.data if start is not None else None,
                x.ctypes.data,
                options.tolerance,
                max_iterations,
                _KINDS[kind],
                history.ctypes.data if history is not None else None,
                count,
                _pieces_to_sweep(parts[0]) if sweeps else piece_count(count, self._deterministic),
                ctypes.addressof(result),
            )
            check_status(status)
            report = report_of(result.reason, result.iterations, result.relative_residual, result.block, history)
            report = replace(report, two_level=result.coarse > 0, coarse_broke_down=result.coarse < 0)
            report = replace(report, gauss_seidel=result.sweeps > 0, why=TOO_FEW_DIGITS if result.sweeps < 0 else "")
            if report.coarse_broke_down:
                LOGGER.warning(COARSE_BROKE_DOWN)
            return x, report

        return self.choice.solve(options, parts[0], run)


def report_of(
    reason: int, iterations: int, relative_squared_residual: float, block: int, history: FloatArray | None
) -> SolveReport:
    """What conjugate gradients left behind as a report.

    block: negative for none. history: an entry for each iteration that was allowed, NaN where none was recorded.
    """
    trace: tuple[float, ...] | None = None
    if history is not None:
        recorded = history[: iterations + 1]
        trace = tuple(recorded[~np.isnan(recorded)].tolist())
    return SolveReport(StopReason(reason), iterations, relative_squared_residual, block if block >= 0 else None, trace)


class Part(Protocol):
    """A matrix of which several may be added: for which targets it was built."""

    @property
    def boundaries(self) -> LongArray:
        """Scalar offsets of the targets."""

    @property
    def block_sizes(self) -> IntArray:
        """Scalars of one instance of each."""


def check_targets(parts: Sequence[Part]) -> None:
    """Raises ValueError unless there are matrices and all were built for the same targets."""
    if not parts:
        raise ValueError("there is no matrix to solve with: parts is empty")
    for index, part in enumerate(parts[1:], start=1):
        same = np.array_equal(part.boundaries, parts[0].boundaries)
        if not (same and np.array_equal(part.block_sizes, parts[0].block_sizes)):
            raise ValueError(f"parts[{index}] was built for other targets than parts[0]: {part} and {parts[0]}")


def check_parts(parts: Sequence[BlockMatrix]) -> None:
    """Raises ValueError unless these matrices can be added."""
    check_targets(parts)
    for index, part in enumerate(parts[1:], start=1):
        if not part.has_order_of(parts[0]):
            raise ValueError(
                f"parts[{index}] has another order of dof blocks than parts[0]: build it with the same one"
            )
