"""Checks of parameters and objectives, with advice."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from yasps import Attribute, SceneError
from yasps.inverse.objectives import Energy, FromOutside, Objective
from yasps.inverse.parameters import Constant, InitialValue, InitialVelocity, MotionOf, Parameter, PerStep, Tied

if TYPE_CHECKING:
    from yasps.inverse.trajectory import Trajectory


def checked_parameters(trajectory: Trajectory, given: object) -> list[Parameter]:
    """Parameters, attributes as what they stand for. Raises SceneError for what can't be one, or twice."""
    listed = [given] if isinstance(given, Attribute | Parameter) else given
    if not isinstance(listed, Iterable) or isinstance(listed, str | Mapping):
        raise SceneError(f"parameters are a list of attributes and of parameters of yasps.inverse, got {given!r}")
    chosen = [_checked(trajectory, one) for one in listed]
    if not chosen:
        raise SceneError("gradients need at least one parameter")
    names = [parameter.name for parameter in chosen]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"{name} is named twice")
    stored = [attribute for parameter in chosen for attribute in parameter.stored]
    for attribute in stored:
        if stored.count(attribute) > 1:
            raise SceneError(f"{attribute.path} is in two of the parameters")
    return chosen


def _checked(trajectory: Trajectory, given: object) -> Parameter:
    if isinstance(given, Attribute):
        return _checked_attribute(trajectory, given)
    if isinstance(given, InitialVelocity):
        trajectory.number_of(given.body)
    elif isinstance(given, MotionOf):
        trajectory.driven_of(given.driven)
    elif isinstance(given, PerStep):
        if given not in trajectory.schedules:
            raise SceneError(f"{given.name} is no schedule of this trajectory: Trajectory(..., schedules=[...])")
    elif isinstance(given, Tied):
        for attribute in given.attributes:
            if not isinstance(_checked_attribute(trajectory, attribute), Constant):
                raise SceneError(f"{attribute.path} is no constant of the run, so that it can't be tied to others")
    elif isinstance(given, InitialValue | Constant):
        return _checked_attribute(trajectory, given.target if isinstance(given, InitialValue) else given.attribute)
    elif not isinstance(given, Parameter):
        raise SceneError(
            f"{given!r} is no parameter: give stored attributes, InitialVelocity(body), PerStep(...) or MotionOf(...)"
        )
    return given


def _checked_attribute(trajectory: Trajectory, attribute: Attribute) -> Parameter:
    scene = trajectory.scene
    if attribute.owner is None or attribute.owner.scene is not scene:
        raise SceneError(f"{attribute.path} is no attribute of {scene.label}, which the run is of")
    if attribute not in attribute.inputs:
        names = ", ".join(one.path for one in attribute.inputs)
        raise SceneError(
            f"{attribute.path} is computed; gradients are by stored attributes. It is computed from {names}"
        )
    if attribute is trajectory.simulation.time_step:
        raise SceneError("gradients by the time step are not built: it is no number that only energies read")
    if attribute in trajectory.set_in_steps():
        raise SceneError(
            f"{attribute.path} is set in every step and is no parameter; motions of obstacles and pins are"
            " MotionOf(...)"
        )
    if attribute in scene.minimize_targets:
        return InitialValue(attribute)
    if any(attribute is schedule.attribute for schedule in trajectory.schedules):
        raise SceneError(f"{attribute.path} is set before each step: name its PerStep instead")
    return Constant(attribute)


def checked_objectives(trajectory: Trajectory, given: object) -> list[Objective]:
    """Objectives, 1x1 attributes as energies of the last frame. Raises SceneError for those of another scene, and for
    what steps set."""
    listed = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    chosen: list[Objective] = []
    for one in listed:
        if isinstance(one, Attribute):
            chosen.append(Energy(one))
        elif isinstance(one, Objective):
            chosen.append(one)
        elif callable(one):
            chosen.append(FromOutside(one))
        else:
            raise SceneError(
                f"an objective is a 1x1 attribute, Energy(...), Squares(...) or a function of a frame, got {one!r}"
            )
    if not chosen:
        raise SceneError("there is no objective: give at least one")
    hidden = {*trajectory.constants_of_steps(), trajectory.simulation.effective_step}
    for objective in chosen:
        objective.check(trajectory.scene)
        objective.frames(trajectory.steps)
        for attribute in objective.inputs:
            if attribute in hidden:
                raise SceneError(
                    f"an objective reads {attribute.path}, which belongs to a step and not to a frame: take positions,"
                    " or a function that is given velocities"
                )
    return chosen


def check_dependence(trajectory: Trajectory, parameters: Sequence[Parameter], objectives: Sequence[Objective]) -> None:
    """Raises SceneError for an attribute that nothing reads."""
    read = {attribute for energy in trajectory.scene.energies for attribute in energy.inputs}
    read |= {attribute for part in trajectory.simulation.stepper.parts for attribute in part.position.inputs}
    read |= {attribute for objective in objectives for attribute in objective.inputs}
    if any(isinstance(objective, FromOutside) for objective in objectives):
        return
    for parameter in parameters:
        if parameter.stored and not read.intersection(parameter.stored):
            raise SceneError(f"no energy, position or objective reads {parameter.name}: its gradient would be 0")
