"""Time steps of backward Euler, each by `minimize`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, FloatArray, Scene, SceneError
from yasps.contact import BarrierContact
from yasps.frontend.language.arrays import in_instances, positive_number, real_numbers
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.scene_lock import SceneLock, one_thread_at_a_time
from yasps.output import TimeTable
from yasps.stepping.forces import Arms, checked_arms
from yasps.stepping.motion import Motion, positions_of
from yasps.stepping.newton import minimize
from yasps.stepping.settings import NewtonReport, NewtonSettings


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
    energy is lower than at x_n. arms: see `minimize`.
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
        arms: Arms | None = None,
    ) -> None:
        time_step = positive_number(time_step, "time_step", "s", SceneError)
        self.scene = scene
        self.parts = list(parts)
        self.time_step = time_step
        self.contact = contact
        self.settings = settings
        self.times = times or TimeTable()
        self.arms = checked_arms(arms, scene)
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
        report = minimize(
            self.scene,
            moving,
            dt,
            contact=self.contact,
            settings=self.settings,
            times=self.times,
            arms=self.arms,
        )
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
