"""Gradients of objectives through a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import fsum

from yasps import Attribute, FloatArray, SceneError
from yasps.frontend.language.arrays import real_numbers
from yasps.inverse.adjoint import Adjoint
from yasps.inverse.checks import check_dependence, checked_objectives, checked_parameters
from yasps.inverse.inputs import Inputs
from yasps.inverse.linear_step import Linearizer
from yasps.inverse.objectives import Objective
from yasps.inverse.parameters import Parameter, names_of
from yasps.inverse.trajectory import Frame, Trajectory


@dataclass(frozen=True)
class Gradient(Mapping[object, FloatArray]):
    """An objective's value, and its derivatives by parameters, in the shapes of these: `gradient[attribute]`,
    `gradient[parameter]` or `gradient["its name"]`."""

    value: float
    by_name: dict[str, FloatArray]
    warnings: list[str] = field(default_factory=list)
    """What makes it less exact than it could be, or not unique."""

    def __getitem__(self, parameter: object) -> FloatArray:
        """By a parameter, or its name."""
        for name in names_of(parameter):
            if name in self.by_name:
                return self.by_name[name]
        raise SceneError(f"the gradient is by {', '.join(self.by_name)}, not by {parameter!r}")

    def __contains__(self, parameter: object) -> bool:
        return any(name in self.by_name for name in names_of(parameter))

    def __iter__(self) -> Iterator[str]:
        return iter(self.by_name)

    def __len__(self) -> int:
        return len(self.by_name)


def value_of(trajectory: Trajectory, objective: object) -> float:
    """An objective of a run, whose steps are taken if they have not been with the present numbers."""
    objectives = checked_objectives(trajectory, objective)
    trajectory.up_to_date()
    linearizer = Linearizer(trajectory, [])
    wanted = _by_frame(objectives, trajectory.steps)
    values: list[float] = []
    for steps, frames in trajectory.segments():
        linearizer.forget()
        for at in ([0] if steps.start == 0 else []) + [step + 1 for step in steps]:
            if at in wanted:
                linearizer.show(at, frames[at])
                values += [one.value(trajectory.view(at, frames[at])) for one in wanted[at]]
    trajectory.rewind()
    return fsum(values)  # in whatever order frames come


def gradient_of(trajectory: Trajectory, objective: object, parameters: object) -> Gradient:
    """The derivatives of an objective by parameters, exact to what Newton's method left of forces in the run.

    objective: a 1x1 attribute (of the last frame), `Energy`, `Squares`, a function of a frame (`FromOutside`), or a
    list of these, whose sum it is. parameters: attributes and parameters of yasps.inverse.

    The steps are taken first, unless they have been with the present numbers. Raises what they raise, SceneError for
    parameters and objectives that can't be, NotConvergedError where a step has no unique derivative.
    """
    chosen, objectives = checked_parameters(trajectory, parameters), checked_objectives(trajectory, objective)
    check_dependence(trajectory, chosen, objectives)
    trajectory.up_to_date()
    linearizer = Linearizer(trajectory, [attribute for one in chosen for attribute in one.stored])
    wanted = _by_frame(objectives, trajectory.steps)
    values: list[float] = []

    def seed(at: int, frame: Frame) -> tuple[dict[Attribute, FloatArray], dict[int, FloatArray]]:
        of_attributes: dict[Attribute, FloatArray] = {}
        of_velocities: dict[int, FloatArray] = {}
        for one in wanted.get(at, []):
            view = trajectory.view(at, frame)
            values.append(one.value(view))
            slopes = one.slopes(view, linearizer.variables.attributes)
            for attribute, numbers in slopes.of_attributes.items():
                of_attributes[attribute] = of_attributes.get(attribute, 0.0) + numbers.reshape(-1, 1)
            for body, numbers in slopes.of_velocities.items():
                part = trajectory.number_of(body)
                of_velocities[part] = of_velocities.get(part, 0.0) + numbers.reshape(-1, 1)
        return of_attributes, of_velocities

    inputs = prepared(trajectory, chosen)
    Adjoint(trajectory, linearizer, inputs, seed).run()
    trajectory.rewind()
    return as_gradient(trajectory, chosen, inputs, fsum(values), linearizer.warnings)


def prepared(trajectory: Trajectory, parameters: list[Parameter], columns: int = 1) -> Inputs:
    """Room for derivatives by parameters, or for changes of them."""
    inputs = Inputs(trajectory.steps, columns)
    for parameter in parameters:
        parameter.prepare(inputs, trajectory)
    return inputs


def as_gradient(
    trajectory: Trajectory, chosen: list[Parameter], inputs: Inputs, value: float, warnings: list[str]
) -> Gradient:
    """What an adjoint sweep has added up."""
    found = {one.name: real_numbers(one.gradient(inputs, trajectory), one.name).copy() for one in chosen}
    return Gradient(value, found, [*trajectory.warnings(), *warnings])


def _by_frame(objectives: list[Objective], steps: int) -> dict[int, list[Objective]]:
    found: dict[int, list[Objective]] = {}
    for objective in objectives:
        for at in objective.frames(steps):
            found.setdefault(at, []).append(objective)
    return found
