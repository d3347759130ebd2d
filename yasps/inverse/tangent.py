"""How everything in a run moves with what it depends on, in one sweep forwards through its steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from yasps import Attribute, FloatArray
from yasps.inverse.inputs import Inputs, size_of
from yasps.inverse.linear_step import Linearizer, LinearStep
from yasps.inverse.trajectory import Frame, Trajectory

Watch = Callable[[int, Frame, FloatArray, dict[int, FloatArray]], None]
"""Of a frame, while the scene is there: changes of the variables, [variables, columns], and of velocities by part."""


class Tangent:
    """One sweep forwards.

    At the end of a step E_x(x, s) = 0 holds, so that changes of s move x by -A^-1 E_xs ds with A = E_xx.
    """

    def __init__(self, trajectory: Trajectory, linearizer: Linearizer, inputs: Inputs, watch: Watch) -> None:
        """inputs: changes of what the run depends on; watch: is told how each frame changes."""
        self.trajectory, self.linearizer, self.inputs, self.watch = trajectory, linearizer, inputs, watch
        self._positions: dict[int, dict[Attribute, FloatArray]] = {}
        """By frame: changes of attributes that later steps take constants from."""
        self._velocities: dict[int, dict[int, FloatArray]] = {}

    def run(self) -> None:
        """From the start to the last step."""
        for steps, frames in self.trajectory.segments():
            self.linearizer.forget()
            if steps.start == 0:
                self._begin(frames[0])
            for step in steps:
                self._step(step, frames)

    def _attributes(self) -> list[Attribute]:
        """That steps take their constants from."""
        stepper, contact = self.linearizer.stepper, self.linearizer.contact
        found = [part.position for part in stepper.parts] + [one.attribute for one in stepper.carried]
        return found if contact is None or contact.friction is None else [*found, contact.position]

    def _arrive(self, at: int, frame: Frame, variables: FloatArray, velocities: dict[int, FloatArray]) -> None:
        self._positions = {k: one for k, one in self._positions.items() if k >= at - 1}
        self._velocities = {k: one for k, one in self._velocities.items() if k >= at - 1}
        self._velocities[at] = velocities
        self.watch(at, frame, variables, velocities)

    def _move(self, at: int, variables: FloatArray) -> None:
        """How attributes at a frame change with its variables; the scene is there."""
        self._positions[at] = {one: np.asarray(self.linearizer.jacobian(one) @ variables) for one in self._attributes()}

    def _begin(self, frame: Frame) -> None:
        """The start."""
        linearizer, inputs = self.linearizer, self.inputs
        linearizer.show(0, frame)
        variables = inputs.zeros(linearizer.variables.size)
        for target, columns in inputs.targets.items():
            variables[linearizer.variables.slices[target]] = columns
        self._set_parameters(variables, 0)
        self._move(0, variables)
        velocities = {
            k: inputs.velocities.get(k, inputs.zeros(size_of(part.position)))
            for k, part in enumerate(linearizer.stepper.parts)
        }
        self._arrive(0, frame, variables, velocities)

    def _set_parameters(self, variables: FloatArray, step: int) -> None:
        for attribute in self.linearizer.parameters:
            variables[self.linearizer.variables.slices[attribute]] = self.inputs.of_step(attribute, step)

    def _step(self, step: int, frames: dict[int, Frame]) -> None:
        linearizer, inputs, taken = self.linearizer, self.inputs, self.trajectory.taken[step]
        linear = linearizer.step(step, taken, frames)
        origins = self._origins(step, linear)
        others = self._others(step, linear, origins)
        variables = inputs.zeros(linearizer.variables.size)
        for driven, numbers in linear.of_pins.items():
            if driven in inputs.goals:
                variables[numbers] = inputs.goals[driven][step]
        for start in linearizer.starts.values():
            variables[linearizer.variables.slices[start]] = others[linearizer.others.slices[start]]
        self._set_parameters(variables, step)
        count = linearizer.targets.size
        if linear.lag_follows is not None and linearizer.contact is not None:
            lagged = linearizer.others.slices[linearizer.contact.parts.points["lagged_position"]]
            others[lagged] = np.asarray(linear.lag_follows[:, count:] @ variables[count:])
        pull = linear.mixed @ others + linear.hessian @ variables[:count]
        variables[:count] -= linear.solve(np.asarray(pull))
        self._move(step + 1, variables)
        velocities = {
            k: (self._positions[step + 1][part.position] - origins[k]) / taken.effective
            for k, part in enumerate(linearizer.stepper.parts)
        }
        self._arrive(step + 1, frames[step + 1], variables, velocities)

    def _weighted(self, step: int, taken_weights: tuple[float, ...], attribute: Attribute) -> FloatArray:
        total = self.inputs.zeros(size_of(attribute))
        for back, weight in enumerate(taken_weights):
            total += weight * self._positions[step - back][attribute]
        return total

    def _origins(self, step: int, linear: LinearStep) -> dict[int, FloatArray]:
        """Of each part how X changes."""
        parts = self.linearizer.stepper.parts
        return {k: self._weighted(step, linear.taken.weights, part.position) for k, part in enumerate(parts)}

    def _others(self, step: int, linear: LinearStep, origins: dict[int, FloatArray]) -> FloatArray:
        """How all changes that energies read apart from targets."""
        linearizer, inputs, taken = self.linearizer, self.inputs, linear.taken
        slices, contact = linearizer.others.slices, linearizer.contact
        others = inputs.zeros(linearizer.others.size)
        for k, part in enumerate(linearizer.stepper.parts):
            speed = inputs.zeros(size_of(part.position))
            for back, weight in enumerate(taken.weights):
                speed += weight * self._velocities[step - back][k]
            others[slices[part.predicted]] = origins[k] + taken.effective * speed
        for carried in linearizer.stepper.carried:
            others[slices[carried.constant]] = self._weighted(step, taken.weights, carried.attribute)
        if contact is not None and contact.friction is not None:
            points = contact.parts.points
            others[slices[points["previous_position"]]] = self._weighted(step, taken.weights, contact.position)
            if linearizer.stepper.lagging == "once":
                others[slices[points["lagged_position"]]] = self._positions[step][contact.position]
        for surface, start in linearizer.starts.items():
            if surface in inputs.goals:
                others[slices[start]] = inputs.goals[surface][step]
        for attribute in linearizer.parameters:
            others[slices[attribute]] = inputs.of_step(attribute, step)
        return others
