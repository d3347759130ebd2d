"""Which linear solver takes a system: conjugate gradients, a factorisation, or whichever does better."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from yasps.runtime.core.library import FloatArray, Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.options import DEFAULTS, SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, PreconditionerChoice, SolveReport, StopReason

if TYPE_CHECKING:
    from yasps.runtime.solvers.direct import DirectSolver

LOGGER = logging.getLogger("yasps")

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
        self._runtime, self._deterministic = runtime, deterministic
        self._pcg = PcgSolver(runtime, deterministic=deterministic)
        self._direct: DirectSolver | None = None
        self.direct_left = 0
        """How many of the next systems "auto" gives to the direct solver."""

    @property
    def preconditioners(self) -> PreconditionerChoice:
        """What preconditioner="auto" has learned."""
        return self._pcg.choice

    def solve(
        self,
        parts: Sequence[BlockMatrix],
        g: FloatArray,
        options: SolveOptions = DEFAULTS,
        x0: FloatArray | None = None,
        *,
        threads: int | None = None,
    ) -> tuple[FloatArray, SolveReport]:
        """Solve (sum of parts) x = g by options.solver; the rest is as for `PcgSolver.solve`.

        x0, max_iterations and history are for conjugate gradients; a direct solver needs none of them. The report says
        which solver it was and why.
        """
        if options.solver == "direct":
            return self._by_direct(parts, g, options, threads, "asked for")
        patient = options
        if options.solver == "auto":
            if self.direct_left > 0:
                self.direct_left -= 1
                return self._by_direct(parts, g, options, threads, "conjugate gradients were slow not long ago")
            patient = replace(options, max_iterations=min(options.max_iterations, PATIENCE))
        x, report = self._pcg.solve(parts, g, patient, x0, threads=threads)
        if options.solver == "pcg" or report.reason is not StopReason.MAX_ITERATIONS:
            return x, report
        self.direct_left = DIRECT_SOLVES - 1
        why = f"conjugate gradients did not converge in {report.iterations} iterations"
        LOGGER.info("solver='auto': %s; a direct solver takes this system and the next %d", why, self.direct_left)
        return self._by_direct(parts, g, options, threads, why)

    def _by_direct(
        self, parts: Sequence[BlockMatrix], g: FloatArray, options: SolveOptions, threads: int | None, why: str
    ) -> tuple[FloatArray, SolveReport]:
        if self._direct is None:
            from yasps.runtime.solvers.direct import DirectSolver  # brings in SciPy's or MKL's solvers

            self._direct = DirectSolver(self._runtime, deterministic=self._deterministic)
        x, report = self._direct.solve(parts, g, options, threads=threads)
        return x, report.by(self._direct.name, why)
