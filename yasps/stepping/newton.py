"""Minimisation by projected Newton with an intersection-free line search (Li et al. 2020, algorithm 1).

`minimize` finds a minimum of a scene's energy; `TimeStepper` makes time steps of it. Both are short on purpose: copy
and change them when your scene needs something else. The compiler knows nothing of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import (
    Attribute,
    FloatArray,
    NewtonSolution,
    NotConvergedError,
    NotFiniteError,
    Scene,
    SceneError,
    advice_on,
    solve_newton_system,
)
from yasps.contact import BarrierContact, Candidates, crushed_gradient
from yasps.contact.rows import longest_way
from yasps.frontend.language.arrays import positive_number
from yasps.output import TimeTable
from yasps.stepping.detour import Direction, best_direction, direction_of
from yasps.stepping.forces import Arms, ForceMeasure, checked_arms
from yasps.stepping.motion import Motion, positions_of
from yasps.stepping.projection_choice import ProjectionChoice
from yasps.stepping.settings import NewtonReport, NewtonSettings

ROUNDING = 1e-15
"""Relative change of a total energy that is only rounding."""
CURVED = 1e-10
"""Relative distance from its straight way beyond which a vertex moves on a curve, not by rounding."""
INDISTINCT = 1e-10
"""Change of the energy, in shares of the sum of the sizes of all terms, below which it may be rounding: terms of
differences of positions, squared (inertia) or over small distances (barriers), lose several digits."""
STILL_DOWNHILL = 0.8
"""Share of the slope at the start that may be left, uphill, at the end of a step (1 - 2 delta of the approximate Wolfe
conditions with delta = 0.1, Hager and Zhang 2005)."""
OFF_BALANCE = 0.5
"""Share of what crushed pairs push with that no other force takes up, above which they are opened first."""
WORTHWHILE = 1.5
"""Step beyond the Newton step below which a look at the energy there costs more than it brings."""


def minimize(
    scene: Scene,
    positions: Sequence[Attribute],
    time_step: float,
    *,
    contact: BarrierContact | None = None,
    settings: NewtonSettings = NewtonSettings(),
    times: TimeTable | None = None,
    arms: Arms | None = None,
    fixed: Mapping[Attribute, ArrayLike] | None = None,
) -> NewtonReport:
    """Moves the scene's targets to a minimum of its energy, without intersections on the way.

    positions: 3x1 attributes whose movement is measured (and, with contact, bounded; they are contact.position then).
    arms: of targets that are no positions, how far at most a vertex moves for a unit of the target [m], so that their
    gradients are forces, too; 1 m where nothing is said. fixed: target -> which of its instances stay as they are,
    bool [instances].

    Each step is bounded by CCD and halved until the energy does not grow (but for rounding), or made longer where the
    energy shows that it is too short. Pairs that are crushed on the way are opened first (`crushed_gradient`). Stops
    when all tolerances of the settings hold: of velocity, when the Newton direction moves no vertex by
    settings.velocity_tolerance * time_step; of force, when no more is left of the gradient after the step. That last
    direction is still taken, in the same way, but where no step along it is found that is no error if the forces hold
    already.

    Raises IntersectionError, before anything is changed, if positions were changed from outside since the last call
    and something is in the way (see `BarrierContact.check_way`). Raises NotConvergedError after
    settings.max_iterations, or when the linear solver or the line search fails; the targets then have the last accepted
    values.
    """
    time_step = positive_number(time_step, "time_step", "s", SceneError)
    if not isinstance(settings, NewtonSettings):
        raise SceneError(f"settings are NewtonSettings, got {settings!r}")
    measured = [contact.position] if contact is not None else list(positions)
    with scene.lock:
        unknowns = scene.compile().unknowns_of(fixed) if fixed else None
        forces = ForceMeasure(scene.minimize_targets, checked_arms(arms, scene))
        times = times or TimeTable()
        return Minimization(scene, measured, time_step, contact, settings, times, forces, unknowns).run()


@dataclass
class Minimization:
    """One run of `minimize`."""

    scene: Scene
    measured: list[Attribute]
    time_step: float
    contact: BarrierContact | None
    settings: NewtonSettings
    times: TimeTable
    forces: ForceMeasure
    fixed: NDArray[np.bool_] | None = None
    report: NewtonReport = field(default_factory=NewtonReport)
    rounding: float = 0.0
    """Differences of energies that may be only rounding [J]; known where forces are asked for."""
    projections: ProjectionChoice = field(default_factory=ProjectionChoice)
    left_over: FloatArray | None = None
    """What of the last x a step did not do, if it was cut short, [unknowns]: about the next x, since H and the forces
    change little on a short way."""
    stands_still: bool = False
    """Whether the last direction moves no vertex by more than positions are rounded."""

    def positions(self) -> FloatArray:
        with self.times.stage("positions"):
            return positions_of(self.measured)

    def find_contacts(self, positions: FloatArray, candidates: Candidates | None = None) -> None:
        """Gives the scene the pairs that are close at these positions."""
        if self.contact is not None:
            with self.times.stage("contact: active set"):
                self.report.contacts = len(self.contact.update(positions, candidates))

    def energy(self) -> float:
        with self.times.stage("energy"):
            if not self.settings.asks_for_forces:
                return self.scene.total_energy()
            values = [one for one in self.scene.energy_values().values() if one.size]
            size = float(sum(np.abs(one).sum() for one in values))
            if np.isfinite(size):
                self.rounding = INDISTINCT * size
            return float(sum(one.sum() for one in values))

    def gradient(self) -> FloatArray:
        """Gradient where the targets are now."""
        with self.times.stage("residual forces"):
            return self.scene.compile().assemble(hessian=False, fixed=self.fixed)

    def run(self) -> NewtonReport:
        """Newton iterations until all tolerances hold."""
        report, settings = self.report, self.settings
        here = self.positions()
        if self.contact is not None:
            self.contact.check_way(here)
        self.find_contacts(here)
        report.energy = self.energy()
        while True:
            if not np.isfinite(report.energy):
                raise NotConvergedError(
                    f"the energy is {report.energy} at the start of Newton iteration {report.iterations + 1}"
                )
            here, solution = self.direction(here)
            motion = Motion(self.scene)
            direction = direction_of(self, motion, solution)
            longest = longest_way(here, direction.end)
            report.largest_velocity = longest / self.time_step
            self.stands_still = bool(longest <= 4 * np.finfo(np.float64).eps * np.abs(here).max(initial=0.0))
            is_short = settings.velocity_tolerance is None or report.largest_velocity < settings.velocity_tolerance
            if self.contact is not None and not is_short:
                direction = best_direction(self, motion, solution.gradient, here, direction)
            taken = len(report.step_lengths)
            here, report.energy = _LineSearch(self, motion, direction, here).run(is_short)
            if len(report.step_lengths) > taken:
                self.left_over = self.left_by(solution, direction, report.step_lengths[-1])
            if self.contact is not None:
                self.contact.accept(here)
            if is_short and self.forces_hold():
                return report
            if report.iterations >= settings.max_iterations:
                raise NotConvergedError(
                    f"no convergence in {settings.max_iterations} Newton iterations: the last direction still moved a "
                    f"vertex at {report.largest_velocity:.3g} m/s (tolerance {settings.velocity_tolerance}). "
                    + self.forces_left()
                )

    def forces_hold(self) -> bool:
        """Measures what is left of the forces where the targets are now; whether that is little enough."""
        report, settings = self.report, self.settings
        with self.times.stage("residual forces"):
            of_energies = self.scene.compile().gradients().values()
            if self.fixed is not None:
                for one in of_energies:
                    one[self.fixed] = 0.0
            report.largest_force = max((self.forces.largest(one) for one in of_energies), default=0.0)
            report.residual_force = self.forces.largest(sum(of_energies, start=np.zeros(1)))
        return (settings.force_tolerance is None or report.residual_force <= settings.force_tolerance) and (
            settings.relative_force_tolerance is None
            or report.relative_residual_force <= settings.relative_force_tolerance
            or self.stands_still  # where nothing acts but rounding, forces are no share of any
        )

    def forces_left(self) -> str:
        """What is left of the forces where the targets are now, for messages."""
        gradient = self.gradient()
        largest, place = self.forces.largest(gradient), self.forces.place_of_largest(gradient)
        tolerances = [
            f"{name} {value:.3g}"
            for name in ("force_tolerance", "relative_force_tolerance")
            if (value := getattr(self.settings, name)) is not None
        ]
        return f"The largest force left is {largest:.3g} N on {place} ({', '.join(tolerances) or 'not asked for'})"

    def _least_distance(self) -> str:
        if self.contact is None or len(self.contact.active) == 0:
            return ""
        least, reach = self.contact.active.minimum_distance, self.contact.geometry.activation_distance
        return f" The smallest distance in contact is {least:.3g} m, the activation distance {reach:.3g} m."

    def direction(self, here: FloatArray) -> tuple[FloatArray, NewtonSolution]:
        """x of H x = g; and before it where the vertices are, since crushed pairs are opened first."""
        while True:
            crushed = None if self.contact is None else crushed_gradient(self.contact)
            solution = self.solve()
            opened = None if crushed is None else self.open(solution, crushed, here)
            if opened is None:
                return here, solution
            here = opened

    def solve(self) -> NewtonSolution:
        """Newton's direction where the targets are now."""
        compiled, settings = self.scene.compile(), self.settings
        linear = self.projections.options(settings.linear, self.report.step_lengths)
        guess, self.left_over = self.left_over, None
        solution = solve_newton_system(compiled, linear, stages=self.times, fixed=self.fixed, guess=guess)
        self.projections.learn(linear, solution)
        solved = solution.report
        self.report.cg_iterations += solved.all_iterations + solution.wasted_iterations
        self.report.projected += solution.projected
        self.report.direct_solves += solved.direct
        self.report.two_level_solves += solved.two_level
        self.report.coarse_breakdowns += solved.coarse_broke_down
        self.report.iterations += 1
        if not solved.converged:
            raise NotConvergedError(
                f"Newton iteration {self.report.iterations}: the linear solver stopped: {solved}. "
                + advice_on(solved, compiled, "linear_")
                + self._least_distance()
            )
        return solution

    def left_by(self, solution: NewtonSolution, direction: Direction, step: float) -> FloatArray | None:
        """What is left of x after so much of a direction; None after a whole step."""
        if step >= 1.0:
            return None
        moved = np.concatenate([one.reshape(-1) for one in direction.of_targets])
        return solution.x - step * moved

    def open(self, solution: NewtonSolution, crushed: FloatArray, here: FloatArray) -> FloatArray | None:
        """Opens crushed pairs, along H^-1 of their gradient; where the vertices are then. None, and nothing moves, if
        other forces hold them where they are, or if no iterations are left."""
        assert self.contact is not None
        if self.report.iterations >= self.settings.max_iterations:
            return None
        if self.fixed is not None:
            crushed[self.fixed] = 0.0
        compiled = self.scene.compile()
        with self.times.stage("linear solver"):
            x, solved = compiled.solve_linear(crushed, self.settings.linear)
        self.report.cg_iterations += solved.all_iterations
        if not solved.converged or not (x * solution.gradient).sum() > OFF_BALANCE * (x * crushed).sum() > 0:
            return None
        motion = Motion(self.scene)
        direction = direction_of(self, motion, replace(solution, x=x))
        found = _LineSearch(self, motion, direction, here).expand()
        if found is None:
            return None
        here, self.report.energy = found
        self.contact.accept(here)
        return here


@dataclass
class _LineSearch:
    """One step along a Newton direction: free of collisions, and not upwards."""

    newton: Minimization
    motion: Motion
    direction: Direction
    before: FloatArray
    candidates: Candidates | None = None
    now: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    def run(self, is_last: bool) -> tuple[FloatArray, float]:
        """Takes the longest step of 1, 1/2, 1/4, ... times the collision-free bound that does not raise the energy; or
        a longer one than 1, see `go_further`. Returns positions and energy after it.

        is_last: the direction is short enough to stop; where no step along it is found, nothing moves. For any other
        direction that raises NotConvergedError.
        """
        report, settings = self.newton.report, self.newton.settings
        start, slope = report.energy, self.direction.slope
        step = self.first_step()
        while step > settings.shortest_step:
            energy = self.energy_after(step)
            if self.is_lower(start, energy, slope):
                if step == 1.0 and not is_last and not self.is_below_rounding(slope):
                    step, energy = self.go_further(energy, slope)
                report.step_lengths.append(step)
                return self.now, energy
            step /= 2
        self.motion.write(self.motion.start)
        self.newton.find_contacts(self.before)
        if is_last and self.newton.forces_hold():
            return self.before, start
        raise NotConvergedError(
            f"Newton iteration {report.iterations}: no step along the Newton direction lowers the energy "
            f"{start:.6g} J (the direction moves a vertex at {report.largest_velocity:.3g} m/s); a smaller "
            f"linear_tolerance or a larger tolerance may help. {self.newton.forces_left()}"
        )

    def expand(self) -> tuple[FloatArray, float] | None:
        """Takes that one of the free steps 1, 2, 4, ... after which the energy is lowest. Returns positions and energy
        after it; None, and nothing moves, if the first does not lower it."""
        lowest, length, longest = self.newton.report.energy, 0.0, 1.0
        while True:
            step = self.free_step(longest)
            energy = self.energy_after(step)
            if not energy < lowest:
                break
            lowest, length = energy, step
            if step < longest:
                break
            longest *= 2
        if length == 0.0:
            self.motion.write(self.motion.start)
            self.newton.find_contacts(self.before)
            return None
        self.free_step(length)  # known to be free; for the candidates
        self.energy_after(length)
        self.newton.report.step_lengths.append(length)
        return self.now, lowest

    def is_below_rounding(self, fall: float) -> bool:
        """Whether the energy can't tell. Where nobody asks for forces that does not matter."""
        return self.newton.settings.asks_for_forces and abs(fall) <= self.newton.rounding

    def is_lower(self, start: float, energy: float, slope: float) -> bool:
        """Whether the targets, moved along the direction, have no more energy than at the start.

        Where the difference is rounding and forces are asked for, the slope decides (approximate Wolfe conditions,
        Hager and Zhang 2005, eq. 4.2): of a convex energy it says the same, to more digits.
        """
        if not self.is_below_rounding(energy - start):
            return energy <= start + (0.0 if self.newton.settings.asks_for_forces else ROUNDING * abs(start))
        try:
            there = float((np.concatenate(self.direction.of_targets) * self.newton.gradient()).sum())
        except NotFiniteError:
            return False
        return there >= -STILL_DOWNHILL * slope

    def go_further(self, energy: float, slope: float) -> tuple[float, float]:
        """Step and energy after trying one step beyond 1.

        Projection makes the Hessian stiffer than the energy is, and steps too short by a factor that stays the same
        from iteration to iteration. The parabola through the energies at 0 and 1, with the slope at 0, tells where the
        lowest point is; with an exact Hessian that is near 1.
        """
        curvature = 1.0 - (self.newton.report.energy - energy) / slope if slope > 0 else 1.0
        lowest = 0.5 / curvature if curvature > 0 else np.inf
        longest = self.newton.settings.longest_step
        if lowest < WORTHWHILE or longest < WORTHWHILE:
            return 1.0, energy
        candidates, now = self.candidates, self.now
        step = self.free_step(float(min(lowest, longest)))
        if step >= WORTHWHILE:
            further = self.energy_after(step)
            if further < energy:
                return step, further
        self.motion.move(self.direction.of_targets, 1.0)
        self.now = now
        self.newton.find_contacts(now, candidates)
        return 1.0, energy

    def first_step(self) -> float:
        """The whole step, or as much of it as is free."""
        if self.direction.bound is None:
            return self.free_step(1.0)
        self.candidates = self.direction.candidates
        return self.direction.bound

    def free_step(self, step: float) -> float:
        """The step, or the part of it that is free of collisions on the straight way."""
        if self.newton.contact is None:
            return step
        return step * self.bound(self.before + step * (self.direction.end - self.before))

    def bound(self, end: FloatArray) -> float:
        assert self.newton.contact is not None
        with self.newton.times.stage("contact: CCD"):
            step, self.candidates = self.newton.contact.free_step(self.before, end)
        return step

    def energy_after(self, step: float) -> float:
        """Moves the targets; the energy there, infinite if a collision is on the way."""
        self.motion.move(self.direction.of_targets, step)
        self.now = self.direction.end if step == 1.0 else self.newton.positions()
        if self.newton.contact is not None:
            if step != 1.0 and self.leaves_way(step) and self.bound(self.now) < 1.0:
                return np.inf
            self.newton.find_contacts(self.now, self.candidates)
            if self.newton.contact.active.overlaps:
                return np.inf
        return self.newton.energy()

    def leaves_way(self, step: float) -> bool:
        """Whether the vertices are elsewhere than the bound was made for, with a nonlinear parameterisation."""
        way = self.before + step * (self.direction.end - self.before)
        return bool(np.abs(self.now - way).max(initial=0.0) > CURVED * np.abs(way).max(initial=0.0))
