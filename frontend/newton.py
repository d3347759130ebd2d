"""Time stepping by projected Newton with an intersection-free line search (Li et al. 2020, algorithm 1).

`minimize` finds a minimum of a scene's energy; `BackwardEuler` makes time steps of it. Both are short on purpose: copy
and change them when your scene needs something else. The compiler knows nothing of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from yasps.frontend.attribute import Attribute, FloatArray
from yasps.frontend.collision_geometry import Candidates
from yasps.frontend.contact import BarrierContact
from yasps.frontend.errors import NotConvergedError, SceneError
from yasps.frontend.progress import TimeTable
from yasps.frontend.scene import Scene

ROUNDING = 1e-15
"""Relative change of a total energy that is only rounding."""
CURVED = 1e-10
"""Relative distance from its straight way beyond which a vertex moves on a curve, not by rounding."""


@dataclass(frozen=True)
class NewtonSettings:
    """When to stop and how hard to try.

    velocity_tolerance [m/s]: stop when the Newton direction moves no vertex by more than this times dt.
    linear_tolerance: of the conjugate gradients, on the squared preconditioned norm (see Scene.minimize_energy).
    """

    velocity_tolerance: float = 1e-2
    max_iterations: int = 200
    linear_tolerance: float = 1e-4
    linear_max_iterations: int = 20_000
    shortest_step: float = 2.0**-40


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
    Stops when the Newton direction moves no vertex by settings.velocity_tolerance * time_step; that last direction is
    not taken. Each step is bounded by CCD and halved until the energy does not grow (but for rounding).

    Raises NotConvergedError after settings.max_iterations, or when the linear solver or the line search fails; the
    targets then have the last accepted values.
    """
    measured = [contact.position] if contact is not None else list(positions)
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
        while True:
            before = self.positions()
            self.find_contacts(before)
            report.energy = self.energy()
            if not np.isfinite(report.energy):
                raise NotConvergedError(
                    f"the energy is {report.energy} at the start of Newton iteration {report.iterations + 1}"
                )
            directions = self.direction()
            motion = Motion(self.scene)
            motion.move(directions, 1.0)
            after = self.positions()
            report.largest_velocity = float(np.linalg.norm(after - before, axis=1).max(initial=0.0)) / self.time_step
            if report.largest_velocity < settings.velocity_tolerance:
                motion.write(motion.start)
                return report
            self.line_search(motion, directions, before, after)
            if report.iterations >= settings.max_iterations:
                raise NotConvergedError(
                    f"no convergence in {settings.max_iterations} Newton iterations: the last direction still moved a "
                    f"vertex at {report.largest_velocity:.3g} m/s (tolerance {settings.velocity_tolerance:.3g})"
                )

    def direction(self) -> list[FloatArray]:
        """x of H x = g for every target."""
        compiled = self.scene.compile()
        with self.times.stage("derivatives and assembly"):
            gradient = compiled.assemble()
        with self.times.stage("linear solver"):
            settings = self.settings
            x, solved = compiled.solve_linear(gradient, settings.linear_tolerance, settings.linear_max_iterations)
        self.report.cg_iterations += solved.iterations
        self.report.iterations += 1
        if not solved.converged:
            raise NotConvergedError(f"Newton iteration {self.report.iterations}: the linear solver stopped: {solved}")
        return compiled.split(x)

    def line_search(
        self, motion: Motion, directions: Sequence[FloatArray], before: FloatArray, after: FloatArray
    ) -> None:
        """Takes the longest step of 1, 1/2, 1/4, ... times the collision-free bound that does not raise the energy."""
        step, candidates, energy = 1.0, None, self.report.energy
        if self.contact is not None:
            with self.times.stage("contact: candidates"):
                candidates = self.contact.geometry.candidates(before, after)
            with self.times.stage("contact: CCD"):
                step = self.contact.geometry.step_bound(before, after, candidates, start_is_free=True)
        while step > self.settings.shortest_step:
            motion.move(directions, step)
            if self.contact is not None:
                now = self.positions()
                way = before + step * (after - before)
                if np.abs(now - way).max(initial=0.0) > CURVED * np.abs(way).max(initial=0.0):
                    # A nonlinear parameterisation: the vertices are elsewhere than the bound was made for.
                    with self.times.stage("contact: CCD"):
                        candidates = self.contact.geometry.candidates(before, now)
                        bound = self.contact.geometry.step_bound(before, now, candidates, start_is_free=True)
                    if bound < 1.0:
                        step /= 2
                        continue
                self.find_contacts(now, candidates)
            if self.energy() <= energy + ROUNDING * abs(energy):
                self.report.step_lengths.append(step)
                return
            step /= 2
        motion.write(motion.start)
        self.find_contacts(before)
        raise NotConvergedError(
            f"Newton iteration {self.report.iterations}: no step along the Newton direction lowers the energy "
            f"{energy:.6g} J (the direction moves a vertex at {self.report.largest_velocity:.3g} m/s); a smaller "
            "linear_tolerance or a larger velocity_tolerance may help"
        )


@dataclass(frozen=True)
class MovingPart:
    """Vertices with inertia: `predicted` is the constant x_n + dt v_n of their inertia energy; both 3x1; mass [kg]."""

    position: Attribute
    predicted: Attribute
    mass: Attribute


class BackwardEuler:
    """Steps a scene through time; the scene's energies must include `materials.inertia` of every part.

    accelerations: target -> uniform acceleration [m/s^2] of that target in free flight (gravity for positions and
    translations; nothing for matrices). The first guess of a step, x_n + dt v_n + dt^2 a, is then the exact solution
    for bodies that fly freely. It is only taken where no collision is on the way and the energy is lower than at x_n.
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
        if not time_step > 0:
            raise SceneError(f"time_step must be positive, got {time_step} s")
        self.scene = scene
        self.parts = list(parts)
        self.time_step = time_step
        self.contact = contact
        self.settings = settings
        self.times = times or TimeTable()
        self.time = 0.0
        self.velocities = [np.zeros((part.position.owner.num_instances, 3)) for part in parts if part.position.owner]
        self._accelerations = dict(accelerations or {})
        self._target_velocities = [np.zeros_like(target.value) for target in scene.minimize_targets]

    def step(self) -> NewtonReport:
        """One time step. Raises NotConvergedError; the targets then have the last accepted values."""
        dt = self.time_step
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
        """Moves the targets along free flight if that is free of collisions and lowers the energy."""
        dt = self.time_step
        guess = []
        for target, old, velocity in zip(
            self.scene.minimize_targets, old_targets, self._target_velocities, strict=True
        ):
            acceleration = self._accelerations.get(target)
            flight = old + dt * velocity
            if acceleration is not None:
                flight = flight + dt * dt * np.resize(np.asarray(acceleration, dtype=np.float64), old.shape)
            guess.append(flight)
        motion = Motion(self.scene)
        with self.times.stage("first guess"):
            if self.contact is not None:
                before = self.contact.positions()
                self.contact.update(before)
            energy = self.scene.total_energy()
            motion.write(guess)
            free = True
            if self.contact is not None:
                after = self.contact.positions()
                candidates = self.contact.geometry.candidates(before, after)
                free = self.contact.geometry.step_bound(before, after, candidates, start_is_free=True) == 1.0
                if free:
                    self.contact.update(after, candidates)
            if not (free and self.scene.total_energy() < energy):
                motion.write(old_targets)

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
