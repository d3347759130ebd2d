"""Steps of scenes with driven vertices: these arrive where they shall be, and all else follows.

What can be put there is put there before Newton's method and stays fixed in it, if continuous collision detection
allows the way; else what is in the way is pushed aside in rounds of an augmented Lagrangian, until it does (Li et al.
2020, supplement). What can't be put, the vertices of an affine body, is pulled, and multipliers bring it to its place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from yasps import (
    Attribute,
    FloatArray,
    IntersectionError,
    NotConvergedError,
    NotFiniteError,
    PrimitiveBase,
    PrimitiveUnion,
)
from yasps.stepping.driven import Driven
from yasps.stepping.motion import Motion
from yasps.stepping.settings import NewtonReport

if TYPE_CHECKING:
    from yasps.stepping.time_stepper import TimeStepper

STIFFER = 10.0
"""Factor of the stiffness after a round that left more than half of the way."""
STIFFEST = 1e6
"""Most that stiffness grows by."""
ROUNDS = 40
STUCK = 0.9
"""Share of the way that a round leaves, with the greatest stiffness, of what can't be moved."""


class Arrival:
    """One step of a stepper whose scene has driven vertices."""

    def __init__(self, stepper: TimeStepper, old_targets: list[FloatArray], until: float) -> None:
        """old_targets: values of all targets at the beginning, before anything moved."""
        self.stepper = stepper
        self.old_targets = old_targets
        self.time = stepper.time + stepper.time_step
        driven = [one for one in stepper.driven if not one.is_released]
        self.goals = {one: one.goal(stepper.time, self.time, until) for one in driven}
        self.starts = {one: one.positions() for one in driven}
        for one, goal in self.goals.items():
            one.begin(goal)
        self.put_ones = [one for one in driven if one.is_exact]
        self.held_ones = [one for one in driven if not one.is_exact]
        mass = sum(float(part.mass.value.sum()) for part in stepper.parts) / stepper.time_step**2
        self.stiffness = {one: one.stiffness(goal, mass) for one, goal in self.goals.items()}
        self.stiffest = {one: STIFFEST * stiffness for one, stiffness in self.stiffness.items()}
        self.is_there = False

    def run(self) -> NewtonReport:
        """Moves the targets to the end of the step.

        Raises IntersectionError, with vertex and pair, if something that can't yield is in the way; NotConvergedError,
        NotFiniteError. The targets are somewhere in between then.
        """
        self.is_there = self.go(self.put_ones) or self.go_with_the_rest()
        if self.is_there:
            self.stepper.take_first_guess(self.old_targets, self.fixed())
        elif (blocked := self.collision(of_rigid=True)) is not None:
            raise self.refusal(0, blocked) from blocked
        report: NewtonReport | None = None
        left = {one: one.distance(goal) if one.is_exact else np.inf for one, goal in self.goals.items()}
        rounds = 0
        while rounds < ROUNDS:
            rounds += 1
            for one in self.held_ones if self.is_there else self.goals:
                one.pull(self.goals[one], self.stiffness[one])
            new = self.minimize()
            report = new if report is None else report.followed_by(new)
            late = self.late()
            if not late:
                for one, start in self.starts.items():
                    one.velocity = (one.positions() - start) / self.stepper.time_step
                return report
            stuck = [self.is_stuck(one, left) for one in late]
            if not self.is_there and (self.go(self.put_ones) or self.go_near()):
                self.is_there = True
                for one in self.put_ones:
                    one.let_go()
            elif all(stuck):
                break
        blocked = self.collision()
        raise self.refusal(rounds, blocked) from blocked

    def late(self) -> list[Driven]:
        """Those who are not yet where they shall be."""
        held = [one for one in self.held_ones if one.distance(self.goals[one]) > self.stepper.driven_tolerance]
        return held if self.is_there else [*self.put_ones, *held]

    def fixed(self) -> dict[Attribute, NDArray[np.bool_]]:
        """Which instances of targets stay where they were put."""
        masks: dict[Attribute, NDArray[np.bool_]] = {}
        for one in self.put_ones:
            if (stays := one.fixed()) is not None:
                target, instances = stays
                assert target.owner is not None
                masks.setdefault(target, np.zeros(target.owner.num_instances, np.bool_))[instances] = True
        return masks

    # -- ways to go ----------------------------------------------------------------------------------------

    def go(self, ones: list[Driven], others: list[FloatArray] | None = None, *, looks: bool = True) -> bool:
        """Puts these where they shall be, and gives all targets other values if there are some, if the straight way
        there is free of collisions and the energy finite. looks: whether the way is looked at."""
        if others is None and all(np.array_equal(one.positions(), self.goals[one]) for one in ones):
            for one in ones:
                one.put(self.goals[one])
            return True
        stepper, contact = self.stepper, self.stepper.contact
        motion, states = Motion(stepper.scene), [one.save() for one in ones]
        before = None if contact is None else contact.positions()
        if others is not None:
            motion.write(others)
        for one in ones:
            one.put(self.goals[one])
        is_free = True
        if contact is not None and before is not None:
            after = contact.positions()
            candidates = None
            if looks:
                step, candidates = contact.free_step(before, after)
                is_free = step == 1.0
            if is_free:
                contact.update(after, candidates)
        if is_free and np.isfinite(stepper.scene.total_energy()):
            if contact is not None:
                contact.accept(after)
            return True
        motion.write(motion.start)
        for one, state in zip(ones, states, strict=True):
            one.load(state)
        if contact is not None:
            contact.update(before)
        return False

    def go_with_the_rest(self) -> bool:
        """The same, while all others go on as in the last step: what lies on a lift rises with it."""
        stepper = self.stepper
        velocities = zip(self.old_targets, stepper.target_velocities, strict=True)
        return self.go(self.put_ones, [old + stepper.time_step * velocity for old, velocity in velocities])

    def go_near(self) -> bool:
        """The same where surfaces come nearer to each other than a step bound lets them, but do not meet."""
        return self.collision() is None and self.go(self.put_ones, looks=False)

    # -- rounds --------------------------------------------------------------------------------------------

    def minimize(self) -> NewtonReport:
        try:
            if self.is_there:
                return self.stepper.minimize(self.fixed())
            return self.stepper.minimize_once()
        except (NotConvergedError, NotFiniteError) as error:
            if self.is_there:
                raise
            names = ", ".join(one.name for one in self.put_ones)
            raise type(error)(f"while {names} was pushed to its place: {error}") from error

    def is_stuck(self, one: Driven, left: dict[Driven, float]) -> bool:
        """After a round: the multiplier learns, and what brought little gets stiffer. Whether that is to no avail."""
        one.learn(self.goals[one], self.stiffness[one])
        before, now = left[one], one.distance(self.goals[one])
        left[one] = now
        if now <= 0.5 * before:
            return False
        if self.stiffness[one] >= self.stiffest[one]:
            return now > STUCK * before
        self.stiffness[one] *= STIFFER
        return False

    # -- refusal -------------------------------------------------------------------------------------------

    def collision(self, *, of_rigid: bool = False) -> IntersectionError | None:
        """What the straight way to the goals meets; of_rigid: of what is fixed or driven itself."""
        contact = self.stepper.contact
        if contact is None:
            return None
        union, start = contact.position.owner, contact.positions()
        assert isinstance(union, PrimitiveUnion)
        end, rigid = start.copy(), self.stepper.immovable.copy()
        for one, goal in self.goals.items():
            assert isinstance(one.position.owner, PrimitiveBase)
            rows = union.offset_of(one.position.owner) + one.vertices
            end[rows], rigid[rows] = goal, one.is_exact
        try:
            contact.check_free_way(start, end, only=rigid if of_rigid else None)
        except IntersectionError as error:
            return error
        return None

    def refusal(self, rounds: int, blocked: IntersectionError | None) -> IntersectionError | NotConvergedError:
        """Says who does not arrive, how far it got and what is in the way."""
        late = max(self.goals, key=lambda one: one.distance(self.goals[one]))
        here, goal, start = late.positions(), self.goals[late], self.starts[late]
        row = int(np.linalg.norm(here - goal, axis=1).argmax())
        far, way = np.linalg.norm(here[row] - goal[row]), np.linalg.norm(goal[row] - start[row])
        what = (
            f"{late.name} can't get to where it shall be at t = {self.time:.6g} s: after {rounds} rounds of pushing "
            f"its vertex {late.vertices[row]} is still {far:.3g} m away, of {way:.3g} m at first"
        )
        if blocked is None:
            return NotConvergedError(f"{what}; something holds it")
        return IntersectionError(f"{what}. In the way, which can't yield: {blocked}. Nothing was moved")
