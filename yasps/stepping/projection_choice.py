"""When Newton's method with projection="auto" takes energies as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace

from yasps import NewtonSolution, SolveOptions

LONGEST_PAUSE = 16
"""Most systems that are projected after a failure, before another one is tried."""


@dataclass
class ProjectionChoice:
    """Which systems of one minimisation are tried with static energies as they are (see `solve_newton_system`).

    All, until one is not positive definite. The next one is projected then, and if the try after it fails, too, the
    next 2, 4, ...; and a new try also takes a last step beyond 1: the projected Hessian was stiffer than the energy.
    """

    tries: bool = True
    pause: int = 0
    """Systems to be projected before the next try."""
    next_pause: int = 1

    def options(self, linear: SolveOptions, steps: list[float]) -> SolveOptions:
        """The options of the next system, after steps of these lengths."""
        if linear.projection != "auto":
            return linear
        if self.pause:
            self.pause -= 1
            return replace(linear, projection="always")
        self.tries = self.tries or bool(steps and steps[-1] > 1.0)
        return linear if self.tries else replace(linear, projection="always")

    def learn(self, asked: SolveOptions, solution: NewtonSolution) -> None:
        """Takes note of how the system with these options ended."""
        if asked.projection != "auto":
            return
        self.tries = not solution.projected
        if self.tries:
            self.next_pause = 1
        else:
            self.pause, self.next_pause = self.next_pause, min(2 * self.next_pause, LONGEST_PAUSE)
