"""A run of a simulation that is kept, so that derivatives can be taken through it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, FloatArray, SceneError, UnsupportedSceneError
from yasps.bodies import Body, MovingObstacle
from yasps.frontend.language.arrays import checked_count
from yasps.inverse.objectives import Frames, FrameView, Squares
from yasps.inverse.parameters import PerStep
from yasps.simulation import Simulation
from yasps.simulation.fingerprint import own_numbers
from yasps.simulation.state import PAST, set_state, state_of
from yasps.stepping import BACKWARD_EULER, Driven, DrivenSurface, DrivenVertices, NewtonReport, NewtonSettings
from yasps.stepping.time_stepper import StepperState

if TYPE_CHECKING:
    from yasps.inverse.gradients import Gradient

PRECISE = NewtonSettings(
    velocity_tolerance=None,
    relative_force_tolerance=1e-10,
    linear_tolerance=1e-20,
    solver="direct",
    projection="on-demand",
)
"""Settings of Newton's method for runs that are differentiated: steps end where forces balance, near rounding. What is
left of the forces is what gradients are wrong by."""
UNBALANCED = 1e-6
"""Share of the largest force that may be left after a step before a result warns of it."""


@dataclass(frozen=True)
class Frame:
    """The end of a step, or the start: numbers of everything that moves."""

    values: tuple[FloatArray, ...]
    """Flat, of `Trajectory.moving_attributes`."""
    velocities: tuple[FloatArray, ...]
    """Of the vertices of moving bodies [m/s], [n, 3]."""

    @property
    def nbytes(self) -> int:
        """Bytes of memory."""
        return sum(one.nbytes for one in (*self.values, *self.velocities))

    def same_as(self, other: Frame) -> bool:
        """Whether the other is the same to the last bit."""
        pairs = zip((*self.values, *self.velocities), (*other.values, *other.velocities), strict=True)
        return all(np.array_equal(one, two) for one, two in pairs)


@dataclass(frozen=True)
class StepTaken:
    """What a step was: weights of the present and of one step ago, and the effective step [s] (see `Integrator`)."""

    weights: tuple[float, ...]
    effective: float
    report: NewtonReport


class Trajectory:
    """So many steps of a simulation from where it is now, again and again with other numbers.

    keep: "all" keeps every frame; "checkpoints" keeps about the square root of as many states, and repeats the steps in
    between when gradients are asked for: less memory, one more run. schedules: what is set before each step.

    `start` is the state that each run begins with; `reports` are those of the steps; `memory` [bytes] is what frames
    and checkpoints take. `settings` of the simulation's Newton method decide how exact gradients are: take `PRECISE`.

    A run with BDF2 begins with a step of backward Euler, whatever came before.

    Raises SceneError for functions in `before_step`, `after_step` and fields of forces, which nobody can differentiate,
    UnsupportedSceneError for GPUs, rigid bodies and exact pins of affine bodies.
    """

    def __init__(
        self, simulation: Simulation, steps: int, *, keep: str = "all", schedules: Sequence[PerStep] = ()
    ) -> None:
        if not isinstance(simulation, Simulation):
            raise SceneError(f"a trajectory is one of a Simulation (yasps.simulation), got {simulation!r}")
        if keep not in {"all", "checkpoints"}:
            raise SceneError(f'keep is "all" or "checkpoints", got {keep!r}')
        self.simulation, self.scene = simulation, simulation.scene
        self.steps = checked_count(steps, "steps", 1, SceneError)
        self.keep = keep
        self.schedules = list(schedules)
        self._check()
        self.start = {name: np.array(x) for name, x in state_of(simulation).items() if not name.startswith(PAST)}
        self.taken: list[StepTaken] = []
        self._frames: dict[int, Frame] = {}
        self._checkpoints: dict[int, dict[str, FloatArray]] = {}
        self._end: dict[str, FloatArray] = {}
        self._end_of_stepper: StepperState | None = None
        self._predicted: list[FloatArray] = []
        self._digest = ""

    # -- what there is -------------------------------------------------------------------------------------

    @property
    def obstacles(self) -> list[MovingObstacle]:
        """Those that move."""
        return [body for body in self.simulation.bodies if isinstance(body, MovingObstacle)]

    @property
    def _surfaces(self) -> list[DrivenSurface]:
        return [one for one in self.simulation.stepper.driven if isinstance(one, DrivenSurface)]

    @property
    def starts(self) -> dict[DrivenSurface, Attribute]:
        """Of each moving obstacle the stored positions of its vertices."""
        return {one: one.obstacle.vertices["start"] for one in self._surfaces}

    @property
    def moving_attributes(self) -> list[Attribute]:
        """Stored attributes that a frame consists of: targets, positions of moving obstacles, from where joints count
        their angles."""
        return [*self.scene.minimize_targets, *self.starts.values(), *self.simulation.history()]

    @property
    def reports(self) -> list[NewtonReport]:
        """Of the steps of the last run."""
        return [one.report for one in self.taken]

    @property
    def memory(self) -> int:
        """Bytes that frames and checkpoints of the last run take."""
        states = [array for state in self._checkpoints.values() for array in state.values()]
        return sum(frame.nbytes for frame in self._frames.values()) + sum(array.nbytes for array in states)

    def number_of(self, body: Body) -> int:
        """Of a moving body among all of them. Raises SceneError."""
        if body not in self.simulation.moving:
            raise SceneError(f"{body.name} is no moving body of this simulation")
        return self.simulation.moving.index(body)

    def driven_of(self, what: MovingObstacle | DrivenVertices) -> Driven:
        """What drives an obstacle, or the pins themselves. Raises SceneError for those of another simulation."""
        for one in self.simulation.stepper.driven:
            if one is what or (isinstance(one, DrivenSurface) and one.obstacle is what):
                return one
        raise SceneError(f"{what.name} is not driven by this simulation")

    def time_at(self, frame: int) -> float:
        """Of a frame [s]."""
        return float(self.start["time"]) + frame * float(self.simulation.time_step.value[0])

    def _check(self) -> None:
        simulation = self.simulation
        if self.scene.is_on_device:
            raise UnsupportedSceneError(
                f"{self.scene.label} runs on a GPU, where there are no gradients through steps yet: take device='cpu'"
            )
        for what in ("before_step", "after_step"):
            if getattr(simulation, what):
                raise SceneError(
                    f"the simulation has functions in {what}, through which nobody can differentiate: give numbers that"
                    " change from step to step as schedules, PerStep(attribute, values), or as motions"
                )
        if simulation.has_force_fields:
            raise SceneError(
                "the simulation has forces that are functions of positions and velocities, through which nobody can"
                " differentiate: write them as an energy on the body's vertices"
            )
        for body in simulation.bodies:
            if body.history:
                raise UnsupportedSceneError(
                    f"{body.name} ({type(body).__name__}) counts from {body.history[0].path}, which changes in every"
                    " step; gradients do not go through that yet: take an AffineBody"
                )
        for one in simulation.stepper.driven:
            if not one.is_exact and not one.is_released:
                raise UnsupportedSceneError(
                    f"{one.name}: exact pins of a body whose vertices are no unknowns have multipliers, through which"
                    " gradients do not go yet: pin it with a stiffness"
                )
        for schedule in self.schedules:
            if not isinstance(schedule, PerStep):
                raise SceneError(f"schedules are a list of PerStep, got {schedule!r}")
            moved = [part.position for part in simulation.stepper.parts]
            moved += [one.attribute for one in simulation.stepper.carried]
            if any(schedule.attribute in attribute.inputs for attribute in moved):
                raise SceneError(
                    f"{schedule.attribute.path} moves vertices by itself, between the end of a step and the"
                    " beginning of the next: PerStep is for what energies read; motions are those of obstacles and pins"
                )
            if len(schedule.values) != self.steps:
                raise SceneError(
                    f"{schedule.name} has values for {len(schedule.values)} steps, but the run has {self.steps}"
                )

    # -- running -------------------------------------------------------------------------------------------

    def run(self) -> list[NewtonReport]:
        """All steps from the start, with the numbers that the scene has now; returns their reports.

        Raises what `Simulation.step` raises, and SceneError for steps that were cut into parts or whose friction did
        not settle.
        """
        self._check()
        self.taken, self._frames, self._checkpoints = [], {}, {}
        self.restart()
        digest = self._digest_now()
        spacing = self.steps if self.keep == "all" else ceil(sqrt(self.steps))
        self._note(0)
        for step in range(self.steps):
            if self.keep == "checkpoints" and step % spacing == 0:
                self._keep_checkpoint(step)
            self.taken.append(self._step(step))
            self._note(step + 1)
        self._end = {name: np.array(x) for name, x in state_of(self.simulation).items()}
        stepper = self.simulation.stepper
        self._end_of_stepper, self._predicted = stepper.save(), [part.predicted.value for part in stepper.parts]
        self._digest = digest
        return self.reports

    def _keep_checkpoint(self, step: int) -> None:
        """The state before a step, with the frames that the step reads; frames before these are dropped."""
        self._checkpoints[step] = {name: np.array(x) for name, x in state_of(self.simulation).items()}
        kept = {at for first in self._checkpoints for at in (first, first - 1)}
        self._frames = {at: frame for at, frame in self._frames.items() if at in kept}

    def _note(self, at: int) -> None:
        values = tuple(attribute.value for attribute in self.moving_attributes)
        self._frames[at] = Frame(values, tuple(v.copy() for v in self.simulation.stepper.velocities))

    def set_schedules(self, step: int) -> None:
        """Sets what is scheduled to its numbers in a step; at the start to those of the first."""
        for schedule in self.schedules:
            schedule.attribute.update_value(schedule.values[max(step, 0)])

    def _step(self, step: int) -> StepTaken:
        self.set_schedules(step)
        simulation = self.simulation
        report = simulation.step()
        if report.substeps > 1:
            raise SceneError(
                f"step {step + 1} was cut into {report.substeps} parts, and gradients do not go through that: take a"
                " smaller time step, or rescue=0 to see what is wrong with the whole one"
            )
        if report.lag_converged is False:
            raise SceneError(
                f"friction of step {step + 1} did not settle, so its end is no solution that could be differentiated:"
                " take a smaller time step, or lagging='once'"
            )
        seconds = float(simulation.time_step.value[0])
        effective = float(simulation.effective_step.value[0])
        integrator = simulation.stepper.integrator
        is_first = effective == BACKWARD_EULER.share * seconds
        return StepTaken((BACKWARD_EULER if is_first else integrator).weights, effective, report)

    def _digest_now(self) -> str:
        """Of all numbers that a run depends on, as they are at the start."""
        digest = hashlib.blake2b(digest_size=16)
        numbers: Mapping[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]] = own_numbers(self.simulation)
        set_in_steps = {one.path for one in (*self.moving_attributes, *self.set_in_steps())}
        set_in_steps.discard(self.simulation.time_step.path)
        for path, values in numbers.items():
            if path not in set_in_steps:
                digest.update(path.encode())
                digest.update(np.ascontiguousarray(values).data)
        for name, state in self.start.items():
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(state).data)
        for schedule in self.schedules:
            digest.update(np.ascontiguousarray(schedule.values).data)
        for one in self.simulation.stepper.driven:
            if isinstance(one.motion, np.ndarray):
                digest.update(np.ascontiguousarray(one.motion).data)
        return digest.hexdigest()

    def constants_of_steps(self) -> list[Attribute]:
        """Stored constants that every step sets: they follow from frames."""
        stepper, contact = self.simulation.stepper, self.simulation.contact
        found = [part.predicted for part in stepper.parts] + [one.constant for one in stepper.carried]
        if contact is not None and contact.friction is not None:
            found += [contact.parts.points[name] for name in ("previous_position", "lagged_position")]
        return found

    def set_in_steps(self) -> set[Attribute]:
        """All stored attributes that steps set, and that are therefore no parameters."""
        found = {*self.constants_of_steps(), *self.simulation.history()}
        found |= {self.simulation.time_step, self.simulation.effective_step}
        for obstacle in self.obstacles:
            found |= {obstacle.vertices["start"], obstacle.vertices["way"], obstacle.progress}
            found |= {obstacle.course["pull"], obstacle.course["aim"]}
        return found

    def up_to_date(self) -> None:
        """Runs, unless the last run was of the numbers that the scene has now."""
        if len(self.taken) < self.steps:
            self.run()
            return
        self.set_schedules(0)
        if self._digest_now() != self._digest:
            self.run()
        self.set_schedules(self.steps - 1)

    # -- frames again --------------------------------------------------------------------------------------

    def segments_backwards(self) -> Iterator[tuple[range, dict[int, Frame]]]:
        """Steps, the last ones first, with the frames at both of their ends and those before that the steps read; in
        each range they go forwards. Repeats what was not kept. Raises SceneError where that gives other numbers."""
        if self.keep == "all":
            yield range(self.steps), self._frames
            return
        firsts = sorted(self._checkpoints)
        for k in reversed(range(len(firsts))):
            first, end = firsts[k], firsts[k + 1] if k + 1 < len(firsts) else self.steps
            yield range(first, end), self._frames_between(first, end)

    def segments(self) -> Iterator[tuple[range, dict[int, Frame]]]:
        """The same, the first steps first."""
        if self.keep == "all":
            yield range(self.steps), self._frames
            return
        firsts = sorted(self._checkpoints)
        for first, end in zip(firsts, [*firsts[1:], self.steps], strict=True):
            yield range(first, end), self._frames_between(first, end)

    def _frames_between(self, first: int, end: int) -> dict[int, Frame]:
        found = {at: self._frames[at] for at in range(first - 1, end + 1) if at in self._frames}
        if all(at in found for at in range(first, end + 1)):
            return found
        kept = self._frames
        try:
            self._frames = {}
            set_state(self.simulation, self._checkpoints[first])
            for step in range(first, end):
                self._step(step)
                self._note(step + 1)
            found |= {at: frame for at, frame in self._frames.items() if at not in found}
            repeated = self._frames[end]
        finally:
            self._frames = kept
        if end in kept and not repeated.same_as(kept[end]):
            raise SceneError(
                f"steps {first + 1} to {end} gave other numbers when they were repeated: make the scene with"
                " deterministic=True"
            )
        return found

    def rewind(self) -> None:
        """Puts the simulation back to the end of the last run, with what its last step was taken from: forces that are
        read there are those of the run."""
        self.set_schedules(self.steps - 1)
        set_state(self.simulation, self._end)
        stepper = self.simulation.stepper
        if self._end_of_stepper is not None:
            stepper.load(self._end_of_stepper)
        for part, value in zip(stepper.parts, self._predicted, strict=True):
            part.predicted.update_value(value)

    def restart(self) -> None:
        """Puts the simulation at the start, as `run` does."""
        set_state(self.simulation, self.start)
        if self.simulation.contact is not None:  # another start is no way that anything went
            self.simulation.contact.accept(self.simulation.contact.positions())
        self.set_schedules(0)

    def view(self, at: int, frame: Frame) -> FrameView:
        """A frame that the scene is at, for objectives."""
        velocities = dict(zip(self.simulation.moving, frame.velocities, strict=True))
        return FrameView(at, self.time_at(at), self.scene, velocities)

    def warnings(self) -> list[str]:
        """What makes gradients through the last run less exact, in words."""
        worst = max(range(self.steps), key=lambda step: self.reports[step].relative_residual_force)
        left = self.reports[worst].relative_residual_force
        if left <= UNBALANCED:
            return []
        return [
            f"after step {worst + 1} {left:.2g} of the largest force was left: gradients are wrong by about as much;"
            " give the simulation settings=PRECISE of yasps.inverse, or a smaller force tolerance"
        ]

    def gradient(self, objective: object, parameters: object) -> Gradient:
        """See `gradient_of`."""
        from yasps.inverse.gradients import gradient_of

        return gradient_of(self, objective, parameters)

    def objective(self, objective: object) -> float:
        """See `value_of`."""
        from yasps.inverse.gradients import value_of

        return value_of(self, objective)

    def sensitivities(self, attribute: Attribute, parameters: object, frames: Frames = "last") -> FloatArray:
        """See `sensitivities_of`."""
        from yasps.inverse.sensitivities import sensitivities_of

        return sensitivities_of(self, attribute, parameters, frames)

    def gauss_newton_product(
        self, squares: Squares | Sequence[Squares], direction: Mapping[Any, ArrayLike]
    ) -> dict[str, FloatArray]:
        """See `gauss_newton_product` of yasps.inverse."""
        from yasps.inverse.sensitivities import gauss_newton_product

        return gauss_newton_product(self, squares, direction)

    def set(self, parameter: object, values: ArrayLike) -> None:
        """Other numbers of a parameter for the next run. Raises SceneError, DataError."""
        from yasps.inverse.checks import checked_parameters

        (chosen,) = checked_parameters(self, [parameter])
        chosen.set(self, values)

    def value(self, parameter: object) -> FloatArray:
        """The numbers of a parameter now. Raises SceneError."""
        from yasps.inverse.checks import checked_parameters

        (chosen,) = checked_parameters(self, [parameter])
        return chosen.value(self)
