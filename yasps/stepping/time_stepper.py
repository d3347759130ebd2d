"""Time steps, each by `minimize`: backward Euler, or BDF2."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, FloatArray, Scene, SceneError
from yasps.contact import BarrierContact, ContactPast
from yasps.frontend.language.arrays import in_instances, positive_number, real_numbers
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.scene_lock import SceneLock, one_thread_at_a_time
from yasps.output import TimeTable
from yasps.stepping.arrival import Arrival
from yasps.stepping.driven import Driven
from yasps.stepping.forces import Arms, ForceMeasure, checked_arms
from yasps.stepping.integrators import (
    BACKWARD_EULER,
    Carried,
    Integrator,
    Moment,
    Past,
    Transfer,
    checked_integrator,
    weighted,
)
from yasps.stepping.motion import Motion, positions_of
from yasps.stepping.newton import minimize
from yasps.stepping.settings import NewtonReport, NewtonSettings

LOGGER = logging.getLogger("yasps")

LAGGING = ("once", "converged")
"""How friction is lagged in a step."""
LAGGING_PASSES = 30
"""Passes after the first before the stepper gives up on friction that settles."""


@dataclass(frozen=True)
class MovingPart:
    """Vertices with inertia: `predicted` is the constant X + h V of their inertia energy (see `Integrator`), for
    backward Euler x_n + dt v_n; both 3x1; mass [kg]."""

    position: Attribute
    predicted: Attribute
    mass: Attribute


@dataclass(frozen=True)
class StepperState:
    """What a step of `TimeStepper` changes: values of targets, velocities of parts and targets, what driven
    vertices say of themselves, what contact remembers, the effective step, the step before, and the time."""

    targets: list[FloatArray]
    velocities: list[FloatArray]
    target_velocities: list[FloatArray]
    driven: list[tuple[Any, ...]]
    contact: ContactPast | None
    effective_step: FloatArray | None
    carried: list[FloatArray]
    past: Past | None
    time: float


def _sizes_of(arrays: Sequence[FloatArray]) -> list[int]:
    return [array.size for array in arrays]


def _of_one_instance(acceleration: ArrayLike | Attribute, target: Attribute) -> FloatArray:
    """The acceleration of a target now, flat."""
    what = f"the acceleration of {target.path}"
    if isinstance(acceleration, Attribute):
        acceleration = acceleration.value
    return in_instances(real_numbers(acceleration, what), 1, target.shape, what).reshape(-1)


def _check_effective_step(integrator: Integrator, effective_step: Attribute | None) -> None:
    """Raises SceneError unless inertia can read the integrator's effective step."""
    if effective_step is None and integrator.share != 1.0:
        raise SceneError(
            f"{integrator.name} changes the step that inertia counts in: add a constant 1x1 to the scene, let"
            " materials.inertia read it, and give it as effective_step"
        )
    if effective_step is not None and not (isinstance(effective_step, Attribute) and effective_step.shape == (1, 1)):
        raise SceneError(f"effective_step is a constant of the scene, 1x1 [s], got {effective_step!r}")


class TimeStepper(InScene):
    """Steps a scene through time; the scene's energies must include `materials.inertia` of every part.

    accelerations: target -> uniform acceleration [m/s^2] of that target in free flight (gravity for positions and
    translations; nothing for matrices), numbers or a constant of the scene, whose numbers are those of each step. The
    first guess of a step, x_n + dt v_n + dt^2 a, is then the exact solution for bodies that fly freely. It is only
    taken where no pair is close at x_n, no collision is on the way and the energy is lower than at x_n. arms: see
    `minimize`.

    lagging: normal forces, closest points and tangent planes of friction are those at the beginning of the step
    ("once"); or, in passes, those of where the last pass ended, until they change nothing any more ("converged"). That
    is not sure to happen; the report says whether it did.

    integrator: `BACKWARD_EULER` or `BDF2`. BDF2 takes a step of backward Euler first, and after every change: of the
    time step, of positions or velocities from outside, of a state without the step before it. effective_step: a
    constant 1x1 that energies of inertia and damping read for the time step, and that is set in each step: with BDF2 to
    2/3 of it. It may be left out for backward Euler, if the time step never changes.

    `driven`: vertices that are prescribed (see `Driven`); `immovable`: of all vertices of the contact, which no target
    moves, [n]; `driven_tolerance` [m]: how near vertices that can't be set must come to their places.
    """

    def __init__(
        self,
        scene: Scene,
        parts: Sequence[MovingPart],
        time_step: float,
        contact: BarrierContact | None = None,
        *,
        accelerations: Mapping[Attribute, ArrayLike | Attribute] | None = None,
        settings: NewtonSettings = NewtonSettings(),
        times: TimeTable | None = None,
        arms: Arms | None = None,
        lagging: str = "once",
        integrator: Integrator = BACKWARD_EULER,
        effective_step: Attribute | None = None,
    ) -> None:
        if lagging not in LAGGING:
            raise SceneError(f"lagging is one of {', '.join(map(repr, LAGGING))}, got {lagging!r}")
        time_step = positive_number(time_step, "time_step", "s", SceneError)
        _check_effective_step(checked_integrator(integrator), effective_step)
        self.scene = scene
        self.parts = list(parts)
        self.time_step = time_step
        self.contact = contact
        self.settings = settings
        self.times = times or TimeTable()
        self.arms = checked_arms(arms, scene)
        self.lagging = lagging
        self.integrator = integrator
        self.effective_step = effective_step
        self.past: Past | None = None
        self.carried: list[Carried] = []
        self.time = 0.0
        self.driven: list[Driven] = []
        self.driven_tolerance = 1e-9
        self.immovable = np.zeros(0 if contact is None else len(contact.positions()), np.bool_)
        self.velocities = [np.zeros((part.position.owner.num_instances, 3)) for part in parts if part.position.owner]
        self._accelerations = dict(accelerations or {})
        for target, acceleration in self._accelerations.items():
            _of_one_instance(acceleration, target)
        self._targets: list[Attribute] = []
        self.target_velocities: list[FloatArray] = []
        """Of the scene's targets, flat: those of the last step [1/s of the target's unit]."""
        self._follow_targets()

    @property
    def _lock(self) -> SceneLock:
        return self.scene.lock

    @one_thread_at_a_time
    def step(self, until: float | None = None) -> NewtonReport:
        """One time step. until: if it is a part of one that ends later, when that does [s].

        Raises IntersectionError, before anything is changed, if positions were changed from outside since the last step
        and something is in the way; after a deliberate jump, call contact.reset(). Raises NotConvergedError; the
        targets then have the last accepted values. Where vertices are driven, nothing has moved after any error.
        """
        dt = self.time_step
        self._follow_targets()
        self._check_sizes()
        here = self._moment(None if self.contact is None else self.contact.start_step())
        origin, effective = self._origin(here)
        self.set_constants(origin, effective)
        old_targets = Motion(self.scene).start
        report = self._solve(old_targets, self.time + dt if until is None else until)
        for k, (part, x) in enumerate(zip(self.parts, origin.positions, strict=True)):
            self.velocities[k] = (positions_of([part.position]) - x) / effective
        new_targets = Motion(self.scene).start
        self.target_velocities = [(new - old) / dt for new, old in zip(new_targets, old_targets, strict=True)]
        if len(self.integrator.weights) > 1:
            end = self._moment(None if self.contact is None else self.contact.positions())
            self.past = Past(here, end, dt)
        self.time += dt
        return report

    def set_constants(self, origin: Moment, effective: float) -> None:
        """Sets what energies of a step read that is the same all through it: of a step that starts from X and V, the
        origin, and whose effective step is this [s]."""
        if self.effective_step is not None and self.effective_step.value[0] != effective:
            self.effective_step.update_value(effective)
        if self.contact is not None and origin.surface is not None:
            self.contact.count_slips_from(origin.surface)
        for part, x, v in zip(self.parts, origin.positions, origin.velocities, strict=True):
            part.predicted.update_value(x + effective * v)
        for carried, value in zip(self.carried, origin.carried, strict=True):
            carried.constant.update_value(value)

    def _check_sizes(self) -> None:
        for part, velocity in zip(self.parts, self.velocities, strict=True):
            assert part.position.owner is not None
            if (count := part.position.owner.num_instances) != len(velocity):
                raise SceneError(
                    f"{part.position.path} has {count} instances by now, but velocities are known of {len(velocity)}: "
                    "say what becomes of them by follow_resize, or let Simulation.remesh do all of it"
                )

    @one_thread_at_a_time
    def follow_resize(
        self,
        position: Attribute,
        transfer: Transfer,
        velocity: FloatArray | None = None,
        *,
        immovable: NDArray[np.bool_] | None = None,
        of_surface: Transfer | None = None,
    ) -> None:
        """After the scene was resized: what becomes of velocities, and of the step before, of a part.

        transfer: from numbers of the part's vertices before, [n, 3], to those after. velocity [m/s]: of the vertices
        now; by default the transferred one. immovable: as the attribute. of_surface: as transfer, of all vertices of
        the contact. With BDF2 the next step goes on from the step before, if positions and velocities now are the
        transferred ones; else it is one of backward Euler. Raises SceneError for a position that is of no part.
        """
        places = [k for k, part in enumerate(self.parts) if part.position is position]
        if not places:
            raise SceneError(f"{position.path} is of no part of this stepper")
        (k,) = places
        old = self.velocities[k]
        new = transfer(old) if velocity is None else np.array(velocity, np.float64)
        self.velocities[k] = new
        if position in self._targets:
            self.target_velocities[self._targets.index(position)] = new.reshape(-1).copy()
        if immovable is not None:
            self.immovable = immovable
        if self.past is not None:
            start, end = (moment.resized(k, transfer, of_surface) for moment in (self.past.start, self.past.end))
            self.past = replace(self.past, start=start, end=end)

    def _moment(self, surface: FloatArray | None) -> Moment:
        """Positions and velocities as they are now."""
        return Moment(
            [positions_of([part.position]) for part in self.parts],
            [v.copy() for v in self.velocities],
            surface,
            [one.attribute.value for one in self.carried],
        )

    def remember(self, numbers: Mapping[str, FloatArray]) -> None:
        """Takes the step before the present state from `Past.start_numbers`, or forgets it if there are none."""
        end = self._moment(None if self.contact is None else self.contact.positions())
        self.past = Past.of_numbers(numbers, end) if len(self.integrator.weights) > 1 else None

    def _origin(self, here: Moment) -> tuple[Moment, float]:
        """X and V of the step that begins here, and its effective step [s]; those of backward Euler where nobody can
        tell what was before: at first, and after a change."""
        past, dt = self.past, self.time_step
        known = past is not None and past.time_step == dt and _sizes_of(past.start.carried) == _sizes_of(here.carried)
        if past is None or not known or not here.continues(past.end):
            return here, BACKWARD_EULER.share * dt
        return weighted(self.integrator.weights, [here, past.start]), self.integrator.share * dt

    def _follow_targets(self) -> None:
        """Targets may come and go between steps; new ones are at rest."""
        targets = self.scene.minimize_targets
        known = dict(zip(self._targets, self.target_velocities, strict=True))
        self.target_velocities = [
            known[target]
            if target in known and known[target].size == target.value.size
            else np.zeros_like(target.value)
            for target in targets
        ]
        self._targets = list(targets)

    def velocities_of_targets(self) -> Iterator[tuple[Attribute, FloatArray]]:
        """The scene's targets and their velocities in the last step, flat."""
        self._follow_targets()
        return zip(self._targets, self.target_velocities, strict=True)

    def _solve(self, old_targets: list[FloatArray], until: float) -> NewtonReport:
        """Moves the targets to the end of the step."""
        if not self.driven:
            self.take_first_guess(old_targets)
            return self.minimize()
        before = self.save()
        try:
            return Arrival(self, old_targets, until).run()
        except BaseException:  # also of a motion that is the user's own
            self.load(before)
            raise

    def minimize(self, fixed: Mapping[Attribute, ArrayLike] | None = None) -> NewtonReport:
        """One minimisation, with these instances of targets fixed; with lagging="converged" as many as that takes."""
        report = self.minimize_once(fixed)
        if self.contact is None or self.contact.friction is None or self.lagging == "once":
            return report
        for passes in range(1, LAGGING_PASSES + 1):
            self.contact.lag()
            # That nothing is left to do with the new lag, the forces say, or a direction that moves nothing any more.
            if self.settings.asks_for_forces and self._forces_hold(report, fixed):
                return replace(report, lagging_passes=passes, lag_converged=True)
            again = self.minimize_once(fixed)
            report = report.followed_by(again)
            if not self.settings.asks_for_forces and again.iterations == 1:
                return replace(report, lagging_passes=passes + 1, lag_converged=True)
        LOGGER.warning(
            "friction at t = %.6g s is not settled after %d lagging passes: normal forces still change; the step is"
            " that of the last pass",
            self.time + self.time_step,
            LAGGING_PASSES + 1,
        )
        return replace(report, lagging_passes=LAGGING_PASSES + 1, lag_converged=False)

    def minimize_once(self, fixed: Mapping[Attribute, ArrayLike] | None = None) -> NewtonReport:
        """One minimisation, with these instances of targets fixed."""
        return minimize(
            self.scene,
            [part.position for part in self.parts],
            self.time_step,
            contact=self.contact,
            settings=self.settings,
            times=self.times,
            arms=self.arms,
            fixed=fixed,
        )

    def _forces_hold(self, report: NewtonReport, fixed: Mapping[Attribute, ArrayLike] | None) -> bool:
        """Whether the forces that are left now are within the tolerances of force."""
        compiled, settings = self.scene.compile(), self.settings
        gradient = compiled.assemble(hessian=False, fixed=compiled.unknowns_of(fixed) if fixed else None)
        left = ForceMeasure(self.scene.minimize_targets, self.arms).largest(gradient)
        relative = settings.relative_force_tolerance
        return left <= min(
            np.inf if settings.force_tolerance is None else settings.force_tolerance,
            np.inf if relative is None else relative * report.largest_force,
        )

    def take_first_guess(
        self, old_targets: list[FloatArray], fixed: Mapping[Attribute, NDArray[np.bool_]] | None = None
    ) -> None:
        """Moves the targets, but for fixed instances, along free flight if nothing collides and the energy gets lower.
        Where something is close, only with friction, and as if there were no gravity."""
        with self.times.stage("first guess"):
            touches = self.contact is not None and len(self.contact.update()) > 0
            if touches and (self.contact is None or self.contact.friction is None):
                return  # resting on something, it would fall into it: of 94 such guesses in a drop none was taken
            motion = Motion(self.scene)
            # What touches something goes on sliding. From rest, friction would be as stiff as that of things which
            # stick, and Newton's steps too short to tell by them how far the end is.
            guess = self._flight(old_targets, falls=not touches)
            for target, start, flight in zip(motion.targets, motion.start, guess, strict=True):
                if fixed and target in fixed:
                    stays = np.repeat(fixed[target], target.shape[0] * target.shape[1])
                    flight[stays] = start[stays]
            before = None if self.contact is None else self.contact.positions()
            energy = self.scene.total_energy()
            motion.write(guess)
            free = True
            if self.contact is not None and before is not None:
                after = self.contact.positions()
                step, candidates = self.contact.free_step(before, after)
                free = step == 1.0 and not self.contact.update(after, candidates).overlaps
            if not (free and self.scene.total_energy() < energy):
                motion.write(motion.start)
            elif self.contact is not None:
                self.contact.accept(after)

    def _flight(self, old_targets: list[FloatArray], *, falls: bool) -> list[FloatArray]:
        """The targets after a step with the velocities that they have; falls: also with their accelerations."""
        dt, flights = self.time_step, []
        for target, old, velocity in zip(self.scene.minimize_targets, old_targets, self.target_velocities, strict=True):
            flight = old + dt * velocity
            if falls and target in self._accelerations:
                acceleration = _of_one_instance(self._accelerations[target], target)
                flight = flight + dt * dt * np.tile(acceleration, old.size // acceleration.size)
            flights.append(flight)
        return flights

    def save(self) -> StepperState:
        """All that a step changes."""
        return StepperState(
            Motion(self.scene).start,
            [velocity.copy() for velocity in self.velocities],
            [velocity.copy() for velocity in self.target_velocities],
            [one.save() for one in self.driven],
            None if self.contact is None else self.contact.save(),
            None if self.effective_step is None else self.effective_step.value,
            [one.constant.value for one in self.carried],
            self.past,
            self.time,
        )

    def load(self, state: StepperState) -> None:
        """Puts everything back."""
        Motion(self.scene).write(state.targets)
        self.velocities = [velocity.copy() for velocity in state.velocities]
        self.target_velocities = [velocity.copy() for velocity in state.target_velocities]
        for one, saved in zip(self.driven, state.driven, strict=True):
            one.load(saved)
        if self.effective_step is not None and state.effective_step is not None:
            self.effective_step.update_value(state.effective_step)
        for one_carried, value in zip(self.carried, state.carried, strict=True):
            one_carried.constant.update_value(value)
        self.past, self.time = state.past, state.time
        if self.contact is not None and state.contact is not None:
            self.contact.load(state.contact)

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
