"""When Newton's method stops, and what it says afterwards."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from yasps import DataError, SolveOptions, solve_options
from yasps.frontend.language.arrays import checked_count, positive_number


@dataclass(frozen=True)
class NewtonSettings:
    """When to stop and how hard to try. All tolerances that are given must hold; one of the first two is needed.

    velocity_tolerance [m/s]: stop when the Newton direction moves no vertex by more than this times dt.
    force_tolerance [N]: stop when no vertex (or other instance of a target, see `minimize`) is pulled by more than
    this, all energies together. relative_force_tolerance: the same in shares of the largest force of any one energy.
    linear_tolerance: of the conjugate gradients, on the squared norm of the residual (see Scene.minimize_energy).
    longest_step: how far beyond the Newton step the line search may look, in its lengths; 1 to never do that.
    solver, projection, preconditioner: see `SolveOptions`.
    """

    velocity_tolerance: float | None = 1e-2
    max_iterations: int = 200
    linear_tolerance: float = 1e-4
    linear_max_iterations: int = 20_000
    shortest_step: float = 2.0**-40
    longest_step: float = 4.0
    solver: str = "pcg"
    projection: str = "always"
    force_tolerance: float | None = None
    relative_force_tolerance: float | None = None
    preconditioner: str = "auto"

    def __post_init__(self) -> None:
        """Raises DataError for numbers and options of the linear solver that can't be, and for no tolerance at all."""
        _ = self.linear
        checked_count(self.max_iterations, "max_iterations", 1)
        units = {"velocity_tolerance": "m/s", "force_tolerance": "N", "relative_force_tolerance": ""}
        for name, unit in units.items():
            if getattr(self, name) is not None:
                positive_number(getattr(self, name), f"{name} (None if it is not asked for)", unit)
        if not positive_number(self.shortest_step, "shortest_step", "") <= 1:
            raise DataError(f"shortest_step is a share of the Newton step, got {self.shortest_step}")
        if not positive_number(self.longest_step, "longest_step", "") >= 1:
            raise DataError(f"longest_step is 1 or more Newton steps, got {self.longest_step}")
        if self.velocity_tolerance is None and not self.asks_for_forces:
            raise DataError("Newton's method needs a tolerance: velocity_tolerance, force_tolerance or both")

    @property
    def asks_for_forces(self) -> bool:
        """Whether forces decide when to stop."""
        return self.force_tolerance is not None or self.relative_force_tolerance is not None

    @property
    def linear(self) -> SolveOptions:
        """The options of every linear solve."""
        return solve_options(
            self.linear_tolerance,
            self.linear_max_iterations,
            solver=self.solver,
            projection=self.projection,
            preconditioner=self.preconditioner,
        )


@dataclass
class NewtonReport:
    """What one minimisation took, or one time step."""

    iterations: int = 0
    cg_iterations: int = 0
    """All of them, trials of preconditioner="auto" included."""
    contacts: int = 0
    energy: float = np.nan
    largest_velocity: float = np.inf
    """Largest vertex displacement of the last Newton direction over dt [m/s]."""
    step_lengths: list[float] = field(default_factory=list)
    projected: int = 0
    """Iterations with the Hessians of all energies projected."""
    detours: int = 0
    """Linear systems more, for directions around what is in the way of the first ones."""
    direct_solves: int = 0
    """Iterations whose system a direct solver took."""
    two_level_solves: int = 0
    """Iterations whose system had the two-level preconditioner."""
    coarse_breakdowns: int = 0
    """Iterations in which that one broke down and block Jacobi went on alone."""
    residual_force: float = np.nan
    """Largest force on a vertex, or other instance of a target, that was left at the end [N]: the gradient of all
    energies at the accepted state. It bounds what any force read there can be wrong by."""
    largest_force: float = np.nan
    """Largest force of any one energy on any one vertex there [N]."""
    lagging_passes: int = 1
    """How often the energy was minimised, with the normal forces of friction taken from where the last time ended."""
    lag_converged: bool | None = None
    """Whether friction is balanced by normal forces of the end itself; None where nobody asked."""
    substeps: int = 1
    """Into how many parts the time step was cut (see `Simulation`)."""

    @property
    def relative_residual_force(self) -> float:
        """`residual_force` over `largest_force`; 0 where nothing acts."""
        return self.residual_force / self.largest_force if self.residual_force else 0.0

    def followed_by(self, other: NewtonReport) -> NewtonReport:
        """Of both together: work adds up, the end is that of the other."""
        return replace(
            other,
            iterations=self.iterations + other.iterations,
            cg_iterations=self.cg_iterations + other.cg_iterations,
            step_lengths=[*self.step_lengths, *other.step_lengths],
            projected=self.projected + other.projected,
            detours=self.detours + other.detours,
            direct_solves=self.direct_solves + other.direct_solves,
            two_level_solves=self.two_level_solves + other.two_level_solves,
            coarse_breakdowns=self.coarse_breakdowns + other.coarse_breakdowns,
            lagging_passes=max(self.lagging_passes, other.lagging_passes),
            lag_converged=False if self.lag_converged is False else other.lag_converged,
        )
