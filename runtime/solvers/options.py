"""What a user may ask of the solution of a linear system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SOLVERS = ("pcg", "direct", "auto")
"""Names of the linear solvers."""
PRECONDITIONERS = ("auto", "jacobi", "gauss-seidel", "two-level")
"""Names of the preconditioners of conjugate gradients."""
WHEN_TO_PROJECT = ("always", "on-demand", "auto")
"""When a Newton system's Hessian loses its negative eigenvalues."""
_MOST_ITERATIONS = 2**31
"""What fits the runtime's counter."""


@dataclass(frozen=True)
class SolveOptions:
    """How the system H x = g of a Newton step is made and solved.

    tolerance: relative, on the squared norm of the residual, r^T D^-1 r <= tolerance g^T D^-1 g, with the diagonal
    blocks D of H, whatever the preconditioner is. max_iterations: of conjugate gradients. solver: "pcg", conjugate
    gradients; "direct", a sparse factorisation; "auto", the one that did better (see `LinearSolver`). projection:
    "always"; "on-demand", only where H turns out not to be positive definite; "auto", always that of energies whose
    instances change, else on demand; a solver that is given H does not look at it. history: keep the residual of every
    iteration of conjugate gradients in the report. preconditioner: of conjugate gradients, "jacobi", which is D;
    "gauss-seidel", symmetric Gauss-Seidel, on the CPU; "two-level", D and a coarse space; "auto", of the last two (of D
    and the last on a GPU) the one that was cheaper for earlier systems (see `PcgSolver`, `PreconditionerChoice`).

    Raises ValueError for what can't limit a solver and for names that don't exist.
    """

    tolerance: float = 1e-4
    max_iterations: int = 10_000
    solver: str = "pcg"
    projection: str = "always"
    history: bool = False
    preconditioner: str = "auto"

    def __post_init__(self) -> None:
        """Checks the options, for all that take them."""
        tolerance, most = self.tolerance, self.max_iterations
        number = isinstance(tolerance, float | int | np.floating) and not isinstance(tolerance, bool)
        if not number or not 0 <= tolerance < np.inf:
            raise ValueError(f"tolerance of the linear solver must be a finite number >= 0, got {tolerance!r}")
        integer = isinstance(most, int | np.integer) and not isinstance(most, bool)
        if not integer or not 0 <= most < _MOST_ITERATIONS:
            raise ValueError(f"max_iterations of the linear solver must be an integer >= 0, got {most!r}")
        if self.solver not in SOLVERS:
            raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, got {self.solver!r}")
        if self.preconditioner not in PRECONDITIONERS:
            known = ", ".join(PRECONDITIONERS)
            raise ValueError(f"preconditioner must be one of {known}, got {self.preconditioner!r}")
        if self.projection not in WHEN_TO_PROJECT:
            raise ValueError(f"projection must be one of {', '.join(WHEN_TO_PROJECT)}, got {self.projection!r}")


DEFAULTS = SolveOptions()
