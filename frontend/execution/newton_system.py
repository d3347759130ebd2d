"""The linear system of one Newton step: projection on demand and the choice of solver, in one place."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from yasps.frontend.errors import DataError
from yasps.frontend.execution.compiled_scene import CompiledScene, ToProject
from yasps.frontend.language.nodes import FloatArray
from yasps.runtime.solvers.options import PRECONDITIONERS, SOLVERS, WHEN_TO_PROJECT, SolveOptions
from yasps.runtime.solvers.pcg import SolveReport, StopReason

__all__ = [
    "PRECONDITIONERS",
    "SOLVERS",
    "WHEN_TO_PROJECT",
    "NewtonSolution",
    "SolveOptions",
    "Stages",
    "advice_on",
    "solve_newton_system",
    "solve_options",
]

ATTEMPTS: dict[str, tuple[ToProject, ...]] = {
    "always": (True,),
    "on-demand": (False, True),
    "auto": ("dynamic", True),
}
"""What is projected at first, and what if that fails."""


class Stages(Protocol):
    """What times parts of the work; `TimeTable` is one."""

    def stage(self, name: str) -> AbstractContextManager[object]:
        """Times what is done inside."""


class _NoStages:
    def stage(self, name: str) -> AbstractContextManager[object]:
        return nullcontext()


@dataclass(frozen=True)
class NewtonSolution:
    """x of H x = gradient. projected: whether all of H's energies had their negative eigenvalues removed."""

    x: FloatArray
    gradient: FloatArray
    report: SolveReport
    projected: bool
    wasted_iterations: int = 0
    """Iterations of conjugate gradients on an H, not or only partly projected, that was given up."""

    @property
    def slope(self) -> float:
        """How fast the energy falls along -x at first: g . x."""
        # Not by BLAS, whose threads add up in another order in every run, and spin for a while afterwards: that doubled
        # the processor time of whole time steps.
        return float((self.x * self.gradient).sum())


def solve_options(
    tolerance: float = 1e-4,
    max_iterations: int = 10_000,
    *,
    solver: str = "pcg",
    projection: str = "always",
    history: bool = False,
    preconditioner: str = "auto",
) -> SolveOptions:
    """What a user asks for. Raises DataError for what can't limit a solver and for names that don't exist."""
    try:
        return SolveOptions(tolerance, max_iterations, solver, projection, history, preconditioner)
    except ValueError as error:
        raise DataError(str(error)) from None


def solve_newton_system(
    compiled: CompiledScene,
    options: SolveOptions,
    *,
    stages: Stages | None = None,
    fixed: NDArray[np.bool_] | None = None,
    guess: FloatArray | None = None,
) -> NewtonSolution:
    """Assembles gradient and Hessian at the current values and solves H x = g.

    options.projection: "always" removes the negative eigenvalues of every energy's local Hessians, as the energy was
    registered. "on-demand" tries H as it is, and does so only where that fails: when conjugate gradients meet negative
    curvature, a factorisation a pivot that isn't positive, or -x does not go downhill. At a minimum H needs no
    projection and Newton's method converges quadratically there. "auto" does the same, but for energies whose instances
    change, which it always projects: a barrier is so stiff where it is concave that other energies seldom outweigh it,
    while elasticity is seldom so concave that H were not positive definite.

    fixed: unknowns that stay as they are, see `CompiledScene.assemble` and `CompiledScene.unknowns_of`; x is 0 there.
    guess: an estimate of x, 0 where something is fixed; conjugate gradients start from the best multiple of it.

    The report tells how the solve ended; nothing is raised for it. Raises NotFiniteError.
    """
    stages = stages or _NoStages()
    wasted = 0
    for project in ATTEMPTS[options.projection]:
        with stages.stage("derivatives and assembly"):
            gradient = compiled.assemble(project=project, fixed=fixed)
        with stages.stage("linear solver"):
            start = None
            if guess is not None and options.solver != "direct":
                start = _best_multiple(compiled, guess, gradient)
            x, report = compiled.solve_linear(gradient, options, start)
        solution = NewtonSolution(x, gradient, report, project is True, wasted)
        if project is True or not _needs_projection(solution):
            break
        wasted += report.iterations
    return solution


def _best_multiple(compiled: CompiledScene, guess: FloatArray, gradient: FloatArray) -> FloatArray | None:
    """Where the quadratic model x^T H x / 2 - g^T x is least along a guess; None where it has no least place.

    It is at most 0 there, and conjugate gradients lower it in each iteration: at their result g^T x > 0, as from 0.
    """
    slope, curvature = float((guess * gradient).sum()), float((guess * compiled.multiply(guess)).sum())
    if not (curvature > 0 and np.isfinite(slope / curvature)):
        return None
    return slope / curvature * guess


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
