"""Derivatives of an objective by everything that a run depends on, in one sweep backwards through its steps."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable

import numpy as np

from yasps import Attribute, FloatArray
from yasps.inverse.inputs import Inputs
from yasps.inverse.linear_step import Linearizer, LinearStep
from yasps.inverse.trajectory import Frame, Trajectory

Seed = Callable[[int, Frame], tuple[dict[Attribute, FloatArray], dict[int, FloatArray]]]
"""Of a frame, derivatives of the objective by attributes and by velocities of parts, [numbers, columns] each."""


class Adjoint:
    """One sweep backwards.

    Where x are the targets at the end of a step, s what is stored for it and E the energy that it minimises, E_x(x, s)
    is 0. So of an objective with derivatives q by x, mu = A^-T q with A = E_xx gives those by s, -E_xs^T mu: by
    parameters, and by the frames before, from which the step took its constants.
    """

    def __init__(self, trajectory: Trajectory, linearizer: Linearizer, inputs: Inputs, seed: Seed) -> None:
        """inputs: where derivatives are added up; seed: see above."""
        self.trajectory, self.linearizer, self.inputs, self.seed = trajectory, linearizer, inputs, seed
        columns = inputs.columns
        self.of_attributes: dict[int, dict[Attribute, FloatArray]] = defaultdict(dict)
        """By frame: derivatives by attributes there, of what comes later."""
        self.of_velocities: dict[int, dict[int, FloatArray]] = defaultdict(dict)
        self._columns = columns

    def run(self) -> None:
        """From the last step to the start."""
        for steps, frames in self.trajectory.segments_backwards():
            self.linearizer.forget()
            for step in reversed(steps):
                self._step_back(step, frames)
            if steps.start == 0:
                self._begin(frames[0])

    def _add(self, at: int, attribute: Attribute, columns: FloatArray) -> None:
        found = self.of_attributes[at]
        found[attribute] = found[attribute] + columns if attribute in found else columns

    def _add_velocity(self, at: int, part: int, columns: FloatArray) -> None:
        found = self.of_velocities[at]
        found[part] = found[part] + columns if part in found else columns

    def _gather(self, at: int) -> FloatArray:
        """All that counts of a frame, by the variables, [variables, columns]; the scene is there."""
        total = np.zeros((self.linearizer.variables.size, self._columns))
        for attribute, columns in self.of_attributes.pop(at, {}).items():
            if attribute in self.linearizer.variables.slices:
                total[self.linearizer.variables.slices[attribute]] += columns
            else:
                total += np.asarray(self.linearizer.jacobian(attribute).T @ columns)
        return total

    def _seed(self, at: int, frame: Frame) -> None:
        attributes, velocities = self.seed(at, frame)
        for attribute, columns in attributes.items():
            self._add(at, attribute, columns)
        for part, columns in velocities.items():
            self._add_velocity(at, part, columns)

    def _direct(self, at: int, total: FloatArray) -> None:
        """What parameters do to a frame apart from any step."""
        for attribute in self.linearizer.parameters:
            self.inputs.add_to_step(attribute, max(at - 1, 0), total[self.linearizer.variables.slices[attribute]])

    def _step_back(self, step: int, frames: dict[int, Frame]) -> None:
        linearizer, inputs, end = self.linearizer, self.inputs, step + 1
        taken = self.trajectory.taken[step]
        linear = linearizer.step(step, taken, frames)
        self._seed(end, frames[end])
        # v = (x - X) / h
        origins: dict[int, FloatArray] = {}
        for part, columns in self.of_velocities.pop(end, {}).items():
            self._add(end, linearizer.stepper.parts[part].position, columns / taken.effective)
            origins[part] = -columns / taken.effective
        total = self._gather(end)
        q = total[: linearizer.targets.size]
        mu = linear.solve(q, transposed=True)
        of_others = -np.asarray(linear.mixed.T @ mu)
        self._lag(linear, of_others, total)
        self._direct(end, total)
        for attribute in linearizer.parameters:
            inputs.add_to_step(attribute, step, of_others[linearizer.others.slices[attribute]])
        self._goals(linear, q, mu, total, of_others)
        self._origins(step, linear, origins, of_others)

    def _lag(self, linear: LinearStep, of_others: FloatArray, total: FloatArray) -> None:
        """Friction that is lagged at the end of the step itself."""
        contact = self.linearizer.contact
        if linear.lag_follows is not None and contact is not None:
            lagged = self.linearizer.others.slices[contact.parts.points["lagged_position"]]
            follows = np.asarray(linear.lag_follows.T @ of_others[lagged])
            total[self.linearizer.targets.size :] += follows[self.linearizer.targets.size :]
            of_others[lagged] = 0.0

    def _goals(
        self, linear: LinearStep, q: FloatArray, mu: FloatArray, total: FloatArray, of_others: FloatArray
    ) -> None:
        """Places where driven vertices were put at the end of the step."""
        for driven, numbers in linear.of_pins.items():
            if driven in self.inputs.goals:
                self.inputs.goals[driven][linear.number] += q[numbers] - linear.hessian[:, numbers].T @ mu
        for surface, start in self.linearizer.starts.items():
            if surface in self.inputs.goals:
                self.inputs.goals[surface][linear.number] += (
                    total[self.linearizer.variables.slices[start]] + of_others[self.linearizer.others.slices[start]]
                )

    def _origins(self, step: int, linear: LinearStep, origins: dict[int, FloatArray], of_others: FloatArray) -> None:
        """X and V, from which the step started, and what else it took from frames."""
        linearizer, slices = self.linearizer, self.linearizer.others.slices
        stepper, contact, taken = linearizer.stepper, linearizer.contact, linear.taken
        for k, part in enumerate(stepper.parts):
            predicted = of_others[slices[part.predicted]]
            of_place = predicted + origins.get(k, 0.0)
            for back, weight in enumerate(taken.weights):
                self._add(step - back, part.position, weight * of_place)
                self._add_velocity(step - back, k, weight * taken.effective * predicted)
        for carried in stepper.carried:
            for back, weight in enumerate(taken.weights):
                self._add(step - back, carried.attribute, weight * of_others[slices[carried.constant]])
        if contact is not None and contact.friction is not None:
            points = contact.parts.points
            for back, weight in enumerate(taken.weights):
                self._add(step - back, contact.position, weight * of_others[slices[points["previous_position"]]])
            if stepper.lagging == "once":
                self._add(step, contact.position, of_others[slices[points["lagged_position"]]])

    def _begin(self, frame: Frame) -> None:
        """The start."""
        self.linearizer.show(0, frame)
        self._seed(0, frame)
        total = self._gather(0)
        self._direct(0, total)
        for target in self.inputs.targets:
            self.inputs.targets[target] += total[self.linearizer.variables.slices[target]]
        for part, columns in self.of_velocities.pop(0, {}).items():
            if part in self.inputs.velocities:
                self.inputs.velocities[part] += columns
