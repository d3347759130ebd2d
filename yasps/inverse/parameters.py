"""What gradients are taken by: numbers of a scene, what a run starts from, and what is prescribed for each step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, DataError, FloatArray, SceneError, ShapeMismatchError
from yasps.bodies import Body, MovingObstacle
from yasps.frontend.language.arrays import real_numbers
from yasps.inverse.inputs import Inputs, size_of
from yasps.stepping import Driven, DrivenVertices

if TYPE_CHECKING:
    from yasps.inverse.trajectory import Trajectory

AT_ONCE = 1e-9
"""Share of a row of a motion that is rounding, as in `Driven.goal`."""


class Parameter(ABC):
    """Something that a run depends on. name: what results call it."""

    name: str

    @property
    def stored(self) -> tuple[Attribute, ...]:
        """The attributes by which energies are differentiated for it."""
        return ()

    @abstractmethod
    def value(self, trajectory: Trajectory) -> FloatArray:
        """A copy of its numbers now."""

    @abstractmethod
    def set(self, trajectory: Trajectory, values: ArrayLike) -> None:
        """Other numbers for the next run, in the shape of `value`. Raises DataError."""

    @abstractmethod
    def prepare(self, inputs: Inputs, trajectory: Trajectory) -> None:
        """Makes room for its derivatives."""

    @abstractmethod
    def gradient(self, inputs: Inputs, trajectory: Trajectory) -> FloatArray:
        """Its derivatives, of one column, in the shape of `value`."""

    @abstractmethod
    def spread(self, inputs: Inputs, trajectory: Trajectory, columns: FloatArray) -> None:
        """Adds changes of its numbers, [numbers, columns], to the inputs."""

    def size(self, trajectory: Trajectory) -> int:
        """How many numbers it has."""
        return int(self.value(trajectory).size)

    def checked(self, trajectory: Trajectory, values: ArrayLike) -> FloatArray:
        """Finite numbers in the shape of `value`, from flat ones, too. Raises DataError."""
        wanted = self.value(trajectory).shape
        numbers = real_numbers(values, self.name)
        if numbers.shape != wanted and (numbers.ndim > 1 or numbers.size != int(np.prod(wanted))):
            raise ShapeMismatchError(f"{self.name} has the shape {list(wanted)}, got {list(numbers.shape)}")
        return numbers.reshape(wanted)


class Constant(Parameter):
    """A stored attribute whose numbers are the same in all steps; its values are [instances, rows, columns]."""

    def __init__(self, attribute: Attribute) -> None:
        """Of an attribute that no energy is minimised over."""
        self.attribute, self.name = attribute, attribute.path

    @property
    def stored(self) -> tuple[Attribute, ...]:
        """The attribute."""
        return (self.attribute,)

    def value(self, trajectory: Trajectory) -> FloatArray:
        """[instances, rows, columns]."""
        return self.attribute.compute().array

    def set(self, trajectory: Trajectory, values: ArrayLike) -> None:
        """Sets the attribute."""
        self.attribute.update_value(self.checked(trajectory, values))

    def prepare(self, inputs: Inputs, trajectory: Trajectory) -> None:
        """In `constants`."""
        inputs.constants[self.attribute] = inputs.zeros(size_of(self.attribute))

    def gradient(self, inputs: Inputs, trajectory: Trajectory) -> FloatArray:
        """[instances, rows, columns]."""
        return inputs.constants[self.attribute].reshape(self.value(trajectory).shape)

    def spread(self, inputs: Inputs, trajectory: Trajectory, columns: FloatArray) -> None:
        """In `constants`."""
        inputs.constants[self.attribute] += columns


class Tied(Parameter):
    """Several stored attributes of one shape and number of instances that have the same numbers in all steps, such as
    both coefficients of friction: `Tied(laws["friction"], laws["kinetic_friction"])`."""

    def __init__(self, *attributes: Attribute) -> None:
        """At least two. Raises SceneError, ShapeMismatchError."""
        if len(attributes) < 2 or not all(isinstance(one, Attribute) and one.owner for one in attributes):
            raise SceneError(f"Tied is of two or more attributes, got {attributes!r}")
        self.attributes, self.name = attributes, " and ".join(one.path for one in attributes)
        if len({(one.shape, size_of(one)) for one in attributes}) > 1:
            raise ShapeMismatchError(f"{self.name} are tied, but they have other shapes or numbers of instances")

    @property
    def stored(self) -> tuple[Attribute, ...]:
        """All of them."""
        return self.attributes

    def value(self, trajectory: Trajectory) -> FloatArray:
        """Of the first, [instances, rows, columns]."""
        return self.attributes[0].compute().array

    def set(self, trajectory: Trajectory, values: ArrayLike) -> None:
        """Sets all of them."""
        numbers = self.checked(trajectory, values)
        for one in self.attributes:
            one.update_value(numbers)

    def prepare(self, inputs: Inputs, trajectory: Trajectory) -> None:
        """In `constants`."""
        for one in self.attributes:
            inputs.constants[one] = inputs.zeros(size_of(one))

    def gradient(self, inputs: Inputs, trajectory: Trajectory) -> FloatArray:
        """The sum, [instances, rows, columns]."""
        total = sum((inputs.constants[one] for one in self.attributes), inputs.zeros(size_of(self.attributes[0])))
        return total.reshape(self.value(trajectory).shape)

    def spread(self, inputs: Inputs, trajectory: Trajectory, columns: FloatArray) -> None:
        """In `constants`."""
        for one in self.attributes:
            inputs.constants[one] += columns


class PerStep(Parameter):
    """A stored attribute that is set before each step: values [steps, instances, rows, columns], or of as many numbers.
    Give it to `Trajectory(..., schedules=[...])`."""

    def __init__(self, attribute: Attribute, values: ArrayLike) -> None:
        """Raises SceneError for what is not stored, DataError for numbers that do not fit."""
        if not isinstance(attribute, Attribute):
            raise SceneError(f"PerStep sets a stored attribute, got {attribute!r}")
        if attribute not in attribute.inputs:
            raise SceneError(f"{attribute.path} is computed; PerStep sets stored attributes")
        self.attribute, self.name = attribute, f"{attribute.path} per step"
        numbers, shape = real_numbers(values, self.name), attribute.compute().array.shape
        if numbers.ndim == 0 or numbers.size != len(numbers) * size_of(attribute):
            raise DataError(f"{self.name}: values are {['steps', *shape]}, got {list(numbers.shape)}")
        self.values = numbers.reshape(len(numbers), *shape).copy()

    @property
    def stored(self) -> tuple[Attribute, ...]:
        """The attribute."""
        return (self.attribute,)

    def value(self, trajectory: Trajectory) -> FloatArray:
        """[steps, instances, rows, columns]."""
        return self.values.copy()

    def set(self, trajectory: Trajectory, values: ArrayLike) -> None:
        """From the next run on."""
        self.values = self.checked(trajectory, values).copy()

    def prepare(self, inputs: Inputs, trajectory: Trajectory) -> None:
        """In `scheduled`."""
        inputs.scheduled[self.attribute] = [inputs.zeros(size_of(self.attribute)) for _ in range(inputs.steps)]

    def gradient(self, inputs: Inputs, trajectory: Trajectory) -> FloatArray:
        """[steps, instances, rows, columns]."""
        return np.stack(inputs.scheduled[self.attribute]).reshape(self.values.shape)

    def spread(self, inputs: Inputs, trajectory: Trajectory, columns: FloatArray) -> None:
        """In `scheduled`."""
        table, scheduled = columns.reshape(inputs.steps, -1, inputs.columns), inputs.scheduled[self.attribute]
        for step in range(inputs.steps):
            scheduled[step] += table[step]


class InitialValue(Parameter):
    """What a target is when the run starts, [instances, rows, columns]."""

    def __init__(self, target: Attribute) -> None:
        """Of one of the scene's targets."""
        self.target, self.name = target, f"{target.path} at the start"

    def value(self, trajectory: Trajectory) -> FloatArray:
        """[instances, rows, columns]."""
        return trajectory.start[f"target/{self.target.path}"].reshape(-1, *self.target.shape).copy()

    def set(self, trajectory: Trajectory, values: ArrayLike) -> None:
        """Of the start."""
        trajectory.start[f"target/{self.target.path}"] = self.checked(trajectory, values).reshape(-1).copy()

    def prepare(self, inputs: Inputs, trajectory: Trajectory) -> None:
        """In `targets`."""
        inputs.targets[self.target] = inputs.zeros(size_of(self.target))

    def gradient(self, inputs: Inputs, trajectory: Trajectory) -> FloatArray:
        """[instances, rows, columns]."""
        return inputs.targets[self.target].reshape(-1, *self.target.shape)

    def spread(self, inputs: Inputs, trajectory: Trajectory, columns: FloatArray) -> None:
        """In `targets`."""
        inputs.targets[self.target] += columns


class InitialVelocity(Parameter):
    """Velocities of a body's vertices when the run starts [m/s]: one for all of them, [3], or, with `each`, [n, 3]."""

    def __init__(self, body: Body, *, each: bool = False) -> None:
        """Raises SceneError for what is no body, or a fixed one."""
        if not isinstance(body, Body) or body.is_fixed:
            raise SceneError(f"InitialVelocity is of a body that moves, got {getattr(body, 'name', body)!r}")
        self.body, self.each, self.name = body, each, f"velocity of {body.name} at the start"

    def value(self, trajectory: Trajectory) -> FloatArray:
        """[3] (the mean, where vertices have several), or [n, 3]."""
        values = trajectory.start[f"velocity/{self.body.name}"]
        return values.copy() if self.each else values.mean(axis=0)

    def set(self, trajectory: Trajectory, values: ArrayLike) -> None:
        """Of the start."""
        shape = trajectory.start[f"velocity/{self.body.name}"].shape
        numbers = np.broadcast_to(self.checked(trajectory, values), shape).copy()
        trajectory.start[f"velocity/{self.body.name}"] = numbers

    def prepare(self, inputs: Inputs, trajectory: Trajectory) -> None:
        """In `velocities`."""
        inputs.velocities[trajectory.number_of(self.body)] = inputs.zeros(3 * len(self.body.rest))

    def gradient(self, inputs: Inputs, trajectory: Trajectory) -> FloatArray:
        """[3] or [n, 3]."""
        values = inputs.velocities[trajectory.number_of(self.body)].reshape(-1, 3)
        return values if self.each else values.sum(axis=0)

    def spread(self, inputs: Inputs, trajectory: Trajectory, columns: FloatArray) -> None:
        """In `velocities`."""
        all_of_them = columns if self.each else np.tile(columns, (len(self.body.rest), 1))
        inputs.velocities[trajectory.number_of(self.body)] += all_of_them


class MotionOf(Parameter):
    """The places of what is driven [m], a `MovingObstacle` or the pins of `Simulation.pin`, in the shape in which its
    motion was given: [rows, n, 3], or [n, 3], where it goes in the first step and stays."""

    def __init__(self, driven: MovingObstacle | DrivenVertices) -> None:
        """Raises SceneError for motions that are functions, and for pins that are springs."""
        if not isinstance(driven, MovingObstacle | DrivenVertices):
            raise SceneError(
                f"MotionOf is of a MovingObstacle, or of pins without a stiffness, got {driven!r}; the places of"
                " springs are the stored attribute pins.primitive['place']"
            )
        if driven.motion is None or callable(driven.motion):
            raise SceneError(
                f"the motion of {driven.name} is {'a function' if driven.motion else 'not given'}: give a table of"
                " positions, [steps + 1, n, 3]"
            )
        self.driven, self.name = driven, f"motion of {driven.name}"

    def value(self, trajectory: Trajectory) -> FloatArray:
        """As the motion was given."""
        return np.array(self.driven.motion, np.float64)

    def set(self, trajectory: Trajectory, values: ArrayLike) -> None:
        """From the next run on."""
        self.driven.motion = self.checked(trajectory, values).copy()

    def _in_stepper(self, trajectory: Trajectory) -> Driven:
        return trajectory.driven_of(self.driven)

    def prepare(self, inputs: Inputs, trajectory: Trajectory) -> None:
        """In `goals`."""
        size = 3 * self.value(trajectory).shape[-2]
        inputs.goals[self._in_stepper(trajectory)] = [inputs.zeros(size) for _ in range(inputs.steps)]

    def _rows(self, trajectory: Trajectory, step: int) -> list[tuple[int, float]]:
        """Which rows of the table the places at the end of a step are of, and how much of each; see `Driven.goal`."""
        values = self.value(trajectory)
        if values.ndim == 2:
            return [(0, 1.0)]
        end = trajectory.time_at(step + 1)
        row = min(end / self._in_stepper(trajectory).spacing, len(values) - 1.0)
        low = int(row + AT_ONCE * max(row, 1.0))
        share = max(row - low, 0.0)
        return [(low, 1.0)] if share <= AT_ONCE * max(row, 1.0) else [(low, 1 - share), (low + 1, share)]

    def gradient(self, inputs: Inputs, trajectory: Trajectory) -> FloatArray:
        """In the shape of the motion."""
        found = np.zeros_like(self.value(trajectory))
        rows = found.reshape(-1, *found.shape[-2:])
        for step, goal in enumerate(inputs.goals[self._in_stepper(trajectory)]):
            for row, share in self._rows(trajectory, step):
                rows[row] += share * goal.reshape(-1, 3)
        return found

    def spread(self, inputs: Inputs, trajectory: Trajectory, columns: FloatArray) -> None:
        """In `goals`."""
        size = 3 * self.value(trajectory).shape[-2]
        table = columns.reshape(-1, size, inputs.columns)
        goals = inputs.goals[self._in_stepper(trajectory)]
        for step in range(inputs.steps):
            for row, share in self._rows(trajectory, step):
                goals[step] += share * table[row]


AnyParameter: TypeAlias = Parameter | Attribute
"""An attribute stands for its value at the start if it is a target, else for its numbers in all steps."""


def names_of(parameter: object) -> tuple[str, ...]:
    """What results may call a parameter, or an attribute that stands for one; a name is itself."""
    if isinstance(parameter, Attribute):
        return (Constant(parameter).name, InitialValue(parameter).name)
    return (parameter.name,) if isinstance(parameter, Parameter) else (str(parameter),)
