"""Which linear solver takes a system: conjugate gradients, a factorisation, or whichever does better."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

from yasps.runtime.core.library import FloatArray, Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.pcg import PcgSolver, SolveReport, StopReason

if TYPE_CHECKING:
    from yasps.runtime.solvers.direct import DirectSolver

LOGGER = logging.getLogger("yasps")

SOLVERS = ("pcg", "direct", "auto")
PATIENCE = 2000
"""Iterations of conjugate gradients after which "auto" takes a direct solver instead: about what a factorisation of
50,000 unknowns in three dimensions costs (docs/contact-and-stepping.md)."""
DIRECT_SOLVES = 10
"""How many systems "auto" gives to the direct solver before it tries conjugate gradients again."""


class LinearSolver:
    """All solvers of one scene, with their memory, and what "auto" has learned.

    "auto" counts iterations, not seconds, so that it decides the same in every run: conjugate gradients get PATIENCE
    iterations. Where these are not enough, a direct solver takes this system and the next DIRECT_SOLVES - 1.
    """

    def __init__(self, runtime: Runtime, *, deterministic: bool = False) -> None:
        self._runtime = runtime
        self._pcg = PcgSolver(runtime, deterministic=deterministic)
        self._direct: DirectSolver | None = None
        self._direct_left = 0

    def solve(
        self,
        parts: Sequence[BlockMatrix],
        g: FloatArray,
        tolerance: float = 1e-4,
        max_iterations: int = 10_000,
        x0: FloatArray | None = None,
        *,
        solver: str = "pcg",
        with_history: bool = False,
        threads: int | None = None,
    ) -> tuple[FloatArray, SolveReport]:
        """Solve (sum of parts) x = g by one of SOLVERS; the rest is as for `PcgSolver.solve`.

        x0, max_iterations and with_history are for conjugate gradients; a direct solver needs none of them. The report
        says which solver it was and why. Raises ValueError for another name.
        """
        if solver not in SOLVERS:
            raise ValueError(f"there is no solver {solver!r}; choose one of {', '.join(SOLVERS)}")
        if solver == "direct":
            return self._by_direct(parts, g, tolerance, threads, "asked for")
        if solver == "auto" and self._direct_left > 0:
            self._direct_left -= 1
            return self._by_direct(parts, g, tolerance, threads, "conjugate gradients were slow not long ago")
        most = min(max_iterations, PATIENCE) if solver == "auto" else max_iterations
        x, report = self._pcg.solve(parts, g, tolerance, most, x0, with_history=with_history, threads=threads)
        if solver == "pcg" or report.reason is not StopReason.MAX_ITERATIONS:
            return x, report
        self._direct_left = DIRECT_SOLVES - 1
        why = f"conjugate gradients did not converge in {report.iterations} iterations"
        LOGGER.info("solver='auto': %s; a direct solver takes this system and the next %d", why, self._direct_left)
        return self._by_direct(parts, g, tolerance, threads, why)

    def _by_direct(
        self, parts: Sequence[BlockMatrix], g: FloatArray, tolerance: float, threads: int | None, why: str
    ) -> tuple[FloatArray, SolveReport]:
        if self._direct is None:
            from yasps.runtime.solvers.direct import DirectSolver  # brings in SciPy's or MKL's solvers

            self._direct = DirectSolver(self._runtime)
        x, report = self._direct.solve(parts, g, tolerance, threads=threads)
        return x, report.by(self._direct.name, why)
