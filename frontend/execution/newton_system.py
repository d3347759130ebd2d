"""The linear system of one Newton step: projection on demand and the choice of solver, in one place."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from yasps.frontend.errors import DataError
from yasps.frontend.execution.compiled_scene import CompiledScene
from yasps.frontend.language.nodes import FloatArray
from yasps.runtime.solvers import choice as solver_choice
from yasps.runtime.solvers.pcg import SolveReport, StopReason

SOLVERS = solver_choice.SOLVERS
"""Names of the linear solvers."""
_MOST_ITERATIONS = 2**31
"""What fits the runtime's counter."""
WHEN_TO_PROJECT = ("always", "on-demand")


class Stages(Protocol):
    """What times parts of the work; `TimeTable` is one."""

    def stage(self, name: str) -> AbstractContextManager[object]:
        """Times what is done inside."""


class _NoStages:
    def stage(self, name: str) -> AbstractContextManager[object]:
        return nullcontext()


@dataclass(frozen=True)
class NewtonSolution:
    """x of H x = gradient. projected: whether H's energies had their negative eigenvalues removed."""

    x: FloatArray
    gradient: FloatArray
    report: SolveReport
    projected: bool
    wasted_iterations: int = 0
    """Iterations of conjugate gradients on an unprojected H that was given up."""

    @property
    def slope(self) -> float:
        """How fast the energy falls along -x at first: g . x."""
        # Not by BLAS, whose threads add up in another order in every run, and spin for a while afterwards: that doubled
        # the processor time of whole time steps.
        return float((self.x * self.gradient).sum())


def check_limits(tolerance: float, max_iterations: int) -> None:
    """Raises DataError for what can't limit a solver."""
    number = isinstance(tolerance, float | int | np.floating) and not isinstance(tolerance, bool)
    if not number or not 0 <= tolerance < np.inf:
        raise DataError(f"tolerance must be a finite number >= 0, got {tolerance!r}")
    if (
        not isinstance(max_iterations, int | np.integer)
        or isinstance(max_iterations, bool)
        or not 0 <= max_iterations < _MOST_ITERATIONS
    ):
        raise DataError(f"max_iterations must be an integer >= 0, got {max_iterations!r}")


def check_choices(solver: str, projection: str) -> None:
    """Raises DataError for a name that doesn't exist."""
    if solver not in SOLVERS:
        raise DataError(f"solver must be one of {', '.join(SOLVERS)}, got {solver!r}")
    if projection not in WHEN_TO_PROJECT:
        raise DataError(f"projection must be one of {', '.join(WHEN_TO_PROJECT)}, got {projection!r}")


def solve_newton_system(
    compiled: CompiledScene,
    tolerance: float,
    max_iterations: int,
    *,
    solver: str = "pcg",
    projection: str = "always",
    history: bool = False,
    stages: Stages | None = None,
) -> NewtonSolution:
    """Assembles gradient and Hessian at the current values and solves H x = g.

    solver: "pcg", "direct" or "auto" (see `LinearSolver`). projection: "always" removes the negative eigenvalues of
    every energy's local Hessians, as the energy was registered. "on-demand" tries H as it is, and does so only where
    that fails: when conjugate gradients meet negative curvature, a factorisation a pivot that isn't positive, or -x
    does not go downhill. At a minimum H needs no projection and Newton's method converges quadratically there.

    The arguments must be checked already. The report tells how the solve ended; nothing is raised for it. Raises
    NotFiniteError.
    """
    stages = stages or _NoStages()
    wasted = 0
    for project in (True,) if projection == "always" else (False, True):
        with stages.stage("derivatives and assembly"):
            gradient = compiled.assemble(project=project)
        with stages.stage("linear solver"):
            x, report = compiled.solve_linear(gradient, tolerance, max_iterations, solver=solver, history=history)
        solution = NewtonSolution(x, gradient, report, project, wasted)
        if project or not _needs_projection(solution):
            break
        wasted += report.iterations
    return solution


def _needs_projection(solution: NewtonSolution) -> bool:
    if solution.report.reason is StopReason.NOT_POSITIVE_DEFINITE:
        return True
    return bool(solution.gradient.any()) and not solution.slope > 0


def advice_on(report: SolveReport, compiled: CompiledScene, prefix: str = "") -> str:
    """What to do about a solve that did not converge; prefix: of the names of its limits."""
    if report.reason is StopReason.MAX_ITERATIONS:
        if report.direct:
            return f"Raise {prefix}tolerance."
        return f"Raise {prefix}max_iterations or {prefix}tolerance, or take solver='direct'."
    if report.reason is StopReason.NOT_FINITE:
        where = f" at {compiled.place_of(report.block)}" if report.block is not None else ""
        return f"Look for infinite or NaN numbers in the scene{where}."
    if report.block is None:
        return "The Hessian is not positive definite; add e.g. an inertia energy, or use another projection."
    place = compiled.place_of(report.block)
    if acting := compiled.changing_energies_at(report.block):
        return (
            f"The Hessian's diagonal block of {place} is not positive definite in double precision. There acts "
            f"{', '.join(acting)}: near distance 0 a barrier is so stiff in one direction that nothing else counts "
            "beside it. Start with a larger gap between the surfaces; and see that other energies, e.g. inertia, hold "
            "this target, too."
        )
    if report.direct:
        return (
            f"The Hessian is not positive definite: elimination broke down at {place}. Is everything held by an "
            "energy? Otherwise add e.g. an inertia energy, or use another projection."
        )
    return (
        f"The Hessian's diagonal block of {place} is not positive definite: does every target instance take part in an "
        "energy?"
    )
