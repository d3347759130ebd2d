"""Time stepping by projected Newton with an intersection-free line search (Li et al. 2020, algorithm 1).

`minimize` finds a minimum of a scene's energy; `BackwardEuler` makes time steps of it. Both are short on purpose: copy
and change them when your scene needs something else. The compiler knows nothing of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from yasps import (
    Attribute,
    FloatArray,
    NotConvergedError,
    Scene,
    SceneError,
    SolveOptions,
    advice_on,
    solve_newton_system,
    solve_options,
)
from yasps.contact import BarrierContact, Candidates
from yasps.frontend.language.arrays import in_instances, positive_number, real_numbers
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.scene_lock import SceneLock, one_thread_at_a_time
from yasps.output import TimeTable

ROUNDING = 1e-15
"""Relative change of a total energy that is only rounding."""
CURVED = 1e-10
"""Relative distance from its straight way beyond which a vertex moves on a curve, not by rounding."""
WORTHWHILE = 1.5
"""Step beyond the Newton step below which a look at the energy there costs more than it brings."""


@dataclass(frozen=True)
class NewtonSettings:
    """When to stop and how hard to try.

    velocity_tolerance [m/s]: stop when the Newton direction moves no vertex by more than this times dt.
    linear_tolerance: of the conjugate gradients, on the squared preconditioned norm (see Scene.minimize_energy).
    longest_step: how far beyond the Newton step the line search may look, in its lengths; 1 to never do that.
    solver, projection: see `SolveOptions`.
    """

    velocity_tolerance: float = 1e-2
    max_iterations: int = 200
    linear_tolerance: float = 1e-4
    linear_max_iterations: int = 20_000
    shortest_step: float = 2.0**-40
    longest_step: float = 4.0
    solver: str = "pcg"
    projection: str = "always"

    def __post_init__(self) -> None:
        """Raises DataError for options of the linear solver that can't be."""
        _ = self.linear

    @property
    def linear(self) -> SolveOptions:
        """The options of every linear solve."""
        return solve_options(
            self.linear_tolerance, self.linear_max_iterations, solver=self.solver, projection=self.projection
        )


@dataclass
class NewtonReport:
    """What one minimisation took."""

    iterations: int = 0
    cg_iterations: int = 0
    contacts: int = 0
    energy: float = np.nan
    largest_velocity: float = np.inf
    """Largest vertex displacement of the last Newton direction over dt [m/s]."""
    step_lengths: list[float] = field(default_factory=list)
    projected: int = 0
    """Iterations whose Hessian was projected."""
    direct_solves: int = 0
    """Iterations whose system a direct solver took."""


class Motion:
    """Current values of the targets, moved along one direction at a time."""

    def __init__(self, scene: Scene) -> None:
        self.targets = scene.minimize_targets
        self.start = self.read()

    def read(self) -> list[FloatArray]:
        """Copies of all targets' values, flat."""
        return [target.value for target in self.targets]

    def write(self, values: Sequence[FloatArray]) -> None:
        """Sets all targets."""
        for target, value in zip(self.targets, values, strict=True):
            target.update_value(value)

    def move(self, directions: Sequence[FloatArray], step: float) -> None:
        """Sets all targets to start - step * direction (the solution of H x = g points uphill)."""
        self.write([start - step * x for start, x in zip(self.start, directions, strict=True)])


def positions_of(attributes: Sequence[Attribute]) -> FloatArray:
    """Positions of the vertices of several 3x1 attributes, [n, 3]."""
    return np.concatenate([attribute.compute().array.reshape(-1, 3) for attribute in attributes])


def minimize(
    scene: Scene,
    positions: Sequence[Attribute],
    time_step: float,
    *,
    contact: BarrierContact | None = None,
    settings: NewtonSettings = NewtonSettings(),
    times: TimeTable | None = None,
) -> NewtonReport:
    """Moves the scene's targets to a minimum of its energy, without intersections on the way.

    positions: 3x1 attributes whose movement is measured (and, with contact, bounded; they are contact.position then).
    Each step is bounded by CCD and halved until the energy does not grow (but for rounding), or made longer where the
    energy shows that it is too short. Stops when the Newton direction moves no vertex by settings.velocity_tolerance *
    time_step; that last direction is still taken, in the same way, but where no step along it is found that is no
    error.

    Raises IntersectionError, before anything is changed, if positions were changed from outside since the last call
    and something is in the way (see `BarrierContact.check_way`). Raises NotConvergedError after
    settings.max_iterations, or when the linear solver or the line search fails; the targets then have the last accepted
    values.
    """
    time_step = positive_number(time_step, "time_step", "s", SceneError)
    measured = [contact.position] if contact is not None else list(positions)
    with scene.lock:
        return _Minimization(scene, measured, time_step, contact, settings, times or TimeTable()).run()


@dataclass
class _Minimization:
    """One run of `minimize`."""

    scene: Scene
    measured: list[Attribute]
    time_step: float
    contact: BarrierContact | None
    settings: NewtonSettings
    times: TimeTable
    report: NewtonReport = field(default_factory=NewtonReport)

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
            return self.scene.total_energy()

    def run(self) -> NewtonReport:
        """Newton iterations until the direction is short."""
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
            directions, slope = self.direction()
            motion = Motion(self.scene)
            motion.move(directions, 1.0)
            there = self.positions()
            way = there - here
            longest = float(np.sqrt(np.einsum("ij,ij->i", way, way).max(initial=0.0)))
            report.largest_velocity = longest / self.time_step
            is_last = report.largest_velocity < settings.velocity_tolerance
            here, report.energy = _LineSearch(self, motion, directions, here, there).run(slope, is_last)
            if self.contact is not None:
                self.contact.accept(here)
            if is_last:
                return report
            if report.iterations >= settings.max_iterations:
                raise NotConvergedError(
                    f"no convergence in {settings.max_iterations} Newton iterations: the last direction still moved a "
                    f"vertex at {report.largest_velocity:.3g} m/s (tolerance {settings.velocity_tolerance:.3g})"
                )

    def _least_distance(self) -> str:
        if self.contact is None or len(self.contact.active) == 0:
            return ""
        least, reach = self.contact.active.minimum_distance, self.contact.geometry.activation_distance
        return f" The smallest distance in contact is {least:.3g} m, the activation distance {reach:.3g} m."

    def direction(self) -> tuple[list[FloatArray], float]:
        """x of H x = g for every target, and how fast the energy falls along -x at first, g . x."""
        compiled, settings = self.scene.compile(), self.settings
        solution = solve_newton_system(compiled, settings.linear, stages=self.times)
        solved = solution.report
        self.report.cg_iterations += solved.iterations + solution.wasted_iterations
        self.report.projected += solution.projected
        self.report.direct_solves += solved.direct
        self.report.iterations += 1
        if not solved.converged:
            raise NotConvergedError(
                f"Newton iteration {self.report.iterations}: the linear solver stopped: {solved}. "
                + advice_on(solved, compiled, "linear_")
                + self._least_distance()
            )
        return compiled.split(solution.x), solution.slope


@dataclass
class _LineSearch:
    """One step along a Newton direction: free of collisions, and not upwards."""

    newton: _Minimization
    motion: Motion
    directions: Sequence[FloatArray]
    before: FloatArray
    full: FloatArray
    """Positions after the whole Newton step."""
    candidates: Candidates | None = None
    now: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    def run(self, slope: float, is_last: bool) -> tuple[FloatArray, float]:
        """Takes the longest step of 1, 1/2, 1/4, ... times the collision-free bound that does not raise the energy; or
        a longer one than 1, see `go_further`. Returns positions and energy after it.

        is_last: the direction is short enough to stop; where no step along it is found, nothing moves. For any other
        direction that raises NotConvergedError.
        """
        report, settings = self.newton.report, self.newton.settings
        start = report.energy
        step = self.free_step(1.0)
        while step > settings.shortest_step:
            energy = self.energy_after(step)
            if energy <= start + ROUNDING * abs(start):
                if step == 1.0 and not is_last:
                    step, energy = self.go_further(energy, slope)
                report.step_lengths.append(step)
                return self.now, energy
            step /= 2
        self.motion.write(self.motion.start)
        self.newton.find_contacts(self.before)
        if is_last:
            return self.before, start
        raise NotConvergedError(
            f"Newton iteration {report.iterations}: no step along the Newton direction lowers the energy "
            f"{start:.6g} J (the direction moves a vertex at {report.largest_velocity:.3g} m/s); a smaller "
            "linear_tolerance or a larger velocity_tolerance may help"
        )

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
        self.motion.move(self.directions, 1.0)
        self.now = now
        self.newton.find_contacts(now, candidates)
        return 1.0, energy

    def free_step(self, step: float) -> float:
        """The step, or the part of it that is free of collisions on the straight way."""
        if self.newton.contact is None:
            return step
        return step * self.bound(self.before + step * (self.full - self.before))

    def bound(self, end: FloatArray) -> float:
        assert self.newton.contact is not None
        with self.newton.times.stage("contact: CCD"):
            step, self.candidates = self.newton.contact.free_step(self.before, end)
        return step

    def energy_after(self, step: float) -> float:
        """Moves the targets; the energy there, infinite if a collision is on the way."""
        self.motion.move(self.directions, step)
        self.now = self.full if step == 1.0 else self.newton.positions()
        if self.newton.contact is not None:
            way = self.before + step * (self.full - self.before)
            # With a nonlinear parameterisation the vertices are elsewhere than the bound was made for.
            curved = np.abs(self.now - way).max(initial=0.0) > CURVED * np.abs(way).max(initial=0.0)
            if curved and self.bound(self.now) < 1.0:
                return np.inf
            self.newton.find_contacts(self.now, self.candidates)
        return self.newton.energy()


@dataclass(frozen=True)
class MovingPart:
    """Vertices with inertia: `predicted` is the constant x_n + dt v_n of their inertia energy; both 3x1; mass [kg]."""

    position: Attribute
    predicted: Attribute
    mass: Attribute


def _of_one_instance(acceleration: ArrayLike, target: Attribute) -> FloatArray:
    """The acceleration of a target, flat."""
    what = f"the acceleration of {target.path}"
    return in_instances(real_numbers(acceleration, what), 1, target.shape, what).reshape(-1)


class BackwardEuler(InScene):
    """Steps a scene through time; the scene's energies must include `materials.inertia` of every part.

    accelerations: target -> uniform acceleration [m/s^2] of that target in free flight (gravity for positions and
    translations; nothing for matrices). The first guess of a step, x_n + dt v_n + dt^2 a, is then the exact solution
    for bodies that fly freely. It is only taken where no pair is close at x_n, no collision is on the way and the
    energy is lower than at x_n.
    """

    def __init__(
        self,
        scene: Scene,
        parts: Sequence[MovingPart],
        time_step: float,
        contact: BarrierContact | None = None,
        *,
        accelerations: Mapping[Attribute, ArrayLike] | None = None,
        settings: NewtonSettings = NewtonSettings(),
        times: TimeTable | None = None,
    ) -> None:
        time_step = positive_number(time_step, "time_step", "s", SceneError)
        self.scene = scene
        self.parts = list(parts)
        self.time_step = time_step
        self.contact = contact
        self.settings = settings
        self.times = times or TimeTable()
        self.time = 0.0
        self.velocities = [np.zeros((part.position.owner.num_instances, 3)) for part in parts if part.position.owner]
        self._accelerations = {
            target: _of_one_instance(acceleration, target) for target, acceleration in (accelerations or {}).items()
        }
        self._target_velocities = [np.zeros_like(target.value) for target in scene.minimize_targets]

    @property
    def _lock(self) -> SceneLock:
        return self.scene.lock

    @one_thread_at_a_time
    def step(self) -> NewtonReport:
        """One time step.

        Raises IntersectionError, before anything is changed, if positions were changed from outside since the last step
        and something is in the way; after a deliberate jump, call contact.reset(). Raises NotConvergedError; the
        targets then have the last accepted values.
        """
        dt = self.time_step
        if self.contact is not None:
            self.contact.check_way()
        old_targets = Motion(self.scene).start
        old_positions = [positions_of([part.position]) for part in self.parts]
        for part, x, v in zip(self.parts, old_positions, self.velocities, strict=True):
            part.predicted.update_value(x + dt * v)
        self._take_first_guess(old_targets)
        moving = [part.position for part in self.parts]
        report = minimize(self.scene, moving, dt, contact=self.contact, settings=self.settings, times=self.times)
        for k, (part, x) in enumerate(zip(self.parts, old_positions, strict=True)):
            self.velocities[k] = (positions_of([part.position]) - x) / dt
        new_targets = Motion(self.scene).start
        self._target_velocities = [(new - old) / dt for new, old in zip(new_targets, old_targets, strict=True)]
        self.time += dt
        return report

    def _take_first_guess(self, old_targets: list[FloatArray]) -> None:
        """Moves the targets along free flight if nothing is close, nothing collides and the energy gets lower."""
        dt = self.time_step
        guess = []
        for target, old, velocity in zip(
            self.scene.minimize_targets, old_targets, self._target_velocities, strict=True
        ):
            acceleration = self._accelerations.get(target)
            flight = old + dt * velocity
            if acceleration is not None:
                flight = flight + dt * dt * np.tile(acceleration, old.size // acceleration.size)
            guess.append(flight)
        motion = Motion(self.scene)
        with self.times.stage("first guess"):
            if self.contact is not None:
                before = self.contact.positions()
                if len(self.contact.update(before)) > 0:
                    return  # resting on something, it would fall into it: of 94 such guesses in a drop none was taken
            energy = self.scene.total_energy()
            motion.write(guess)
            free = True
            if self.contact is not None:
                after = self.contact.positions()
                step, candidates = self.contact.free_step(before, after)
                free = step == 1.0
                if free:
                    self.contact.update(after, candidates)
            if not (free and self.scene.total_energy() < energy):
                motion.write(old_targets)
            elif self.contact is not None:
                self.contact.accept(after)

    def kinetic_energy(self) -> float:
        """Sum of m v^2 / 2 over all parts [J]."""
        total = 0.0
        for part, v in zip(self.parts, self.velocities, strict=True):
            total += 0.5 * float(part.mass.value @ (v * v).sum(axis=1))
        return total

    def momentum(self) -> FloatArray:
        """Sum of m v over all parts [kg m/s], [3]."""
        total = np.zeros(3)
        for part, v in zip(self.parts, self.velocities, strict=True):
            total += part.mass.value @ v
        return total
