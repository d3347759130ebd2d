"""Newton directions that lead through contact, led around it.

A step along a Newton direction ends where the first pair meets, for all vertices. Where surfaces fall on each other
that is a tenth of the way or less, iteration after iteration, each of which finds the next few pairs. Here the pairs
that are in the way become constraints (`LookAhead`), and the quadratic model is minimised again with them. With springs
that only push the minimum would be a descent direction for certain: where nothing moves, the convex model m and the
springs' energy are 0, so at the minimum of their sum m is at most 0, and falls all the way there. A spring that pulls
in the end may spoil that, so it is looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from yasps import FloatArray, NewtonSolution, solve_newton_system
from yasps.contact import Candidates, Constraints
from yasps.stepping.motion import Motion

if TYPE_CHECKING:
    from yasps.stepping.newton import Minimization

FREE = 0.5
"""Step bound from which on a direction is good enough."""
DETOURS = 2
"""Most linear solves for one direction beside its own: the second is for what is only in the way of the first."""
HARDNESS = 20.0
"""Energy that springs would have at the end of the direction without them, over what the energy falls by on it."""


@dataclass
class Direction:
    """A direction, and what is known of the straight way along it."""

    of_targets: list[FloatArray]
    """Uphill, of each target."""
    slope: float
    """How fast the energy falls along the way at first [J]."""
    end: FloatArray
    """Positions at its end, [n, 3]."""
    bound: float | None = None
    """The share of the way that is free of collisions; None if nobody has looked."""
    candidates: Candidates | None = None

    @property
    def worth(self) -> float:
        """About how far the energy falls by going as far as is known to be free [J]."""
        return 0.0 if self.bound is None else self.bound * (1 - 0.5 * self.bound) * self.slope


def best_direction(
    newton: Minimization, motion: Motion, gradient: FloatArray, here: FloatArray, first: Direction
) -> Direction:
    """The best of a direction and a few that lead around what is in its way.

    newton: with contact. motion: starts where the direction does, at positions here. gradient: of all energies there.
    The targets are there afterwards.
    """
    contact = newton.contact
    assert contact is not None
    motion.write(motion.start)
    best = latest = first
    constraints: Constraints | None = None
    for others in range(DETOURS + 1):
        with newton.times.stage("contact: CCD"):
            latest.bound, latest.candidates = contact.free_step(here, latest.end)
        if latest.worth > best.worth:
            best = latest
        if latest.bound >= FREE or others == DETOURS:
            break
        with newton.times.stage("contact: look ahead"):
            found = contact.ahead.constraints(here, latest.end, latest.candidates)
            if constraints is not None:
                found = constraints.and_also(found.without(constraints))
            constraints = found.chosen(found.lacking(latest.end) > 0)
        missing = constraints.lacking(first.end)
        square = float((missing * missing).sum())
        if not square > 0:
            break
        solution = _with_springs(newton, constraints, HARDNESS * first.slope / square, here, first.slope)
        slope = float((solution.x * gradient).sum())
        if not (solution.report.converged and slope > 0):
            break
        latest = direction_of(newton, motion, replace(solution, gradient=gradient))
        motion.write(motion.start)
    return best


def direction_of(newton: Minimization, motion: Motion, solution: NewtonSolution) -> Direction:
    """The direction of a solution; the targets are at its end afterwards."""
    of_targets = newton.scene.compile().split(solution.x)
    motion.move(of_targets, 1.0)
    return Direction(of_targets, solution.slope, newton.positions())


def _with_springs(
    newton: Minimization, constraints: Constraints, stiffness: float, here: FloatArray, slope: float
) -> NewtonSolution:
    """Solves the Newton system with springs, to the same error as without: their own forces cancel at the solution, but
    for what the constraints need."""
    assert newton.contact is not None
    pull = constraints.heights(here) - constraints.least
    share = slope / (slope + stiffness * float((pull * pull).sum()))
    options = newton.settings.linear
    newton.contact.ahead.show(constraints, stiffness)
    try:
        solution = solve_newton_system(
            newton.scene.compile(),
            replace(options, tolerance=share * options.tolerance),
            stages=newton.times,
            fixed=newton.fixed,
        )
    finally:
        newton.contact.ahead.hide()
    newton.report.detours += 1
    newton.report.cg_iterations += solution.report.all_iterations + solution.wasted_iterations
    return solution
