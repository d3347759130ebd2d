"""What is to become small: energies of frames, squares of attributes, or what a function says of a frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from yasps import Attribute, DataError, FloatArray, Scene, SceneError, ShapeMismatchError
from yasps.bodies import Body
from yasps.frontend.language.arrays import plain_array, real_numbers

Frames: TypeAlias = str | int | Sequence[int]
"""Which frames count: "last", "all" (all but the start), or numbers from 0, the start, to the number of steps; negative
ones count from the end."""


@dataclass
class Slopes:
    """Derivatives of an objective at one frame, by attributes of the scene, and by velocities of bodies."""

    of_attributes: dict[Attribute, FloatArray] = field(default_factory=dict)
    """Flat."""
    of_velocities: dict[Body, FloatArray] = field(default_factory=dict)
    """[n, 3]"""


class Objective(ABC):
    """A number for each of some frames; their sum is what gradients are of."""

    def __init__(self, frames: Frames, weight: float) -> None:
        """weight: a factor of it. Raises DataError."""
        self._frames = frames
        self.weight = float(real_numbers(weight, "the weight of an objective"))

    def frames(self, steps: int) -> list[int]:
        """Which frames of a run of so many steps it looks at. Raises DataError."""
        if isinstance(self._frames, str):
            if self._frames not in {"last", "all"}:
                raise DataError(f'frames are "last", "all" or a list of numbers, got {self._frames!r}')
            return [steps] if self._frames == "last" else list(range(1, steps + 1))
        given = np.atleast_1d(plain_array(self._frames, "the frames of an objective"))
        if given.dtype.kind not in "iu" or given.ndim != 1:
            raise DataError(f'frames are "last", "all" or a list of numbers, got {self._frames!r}')
        chosen = [int(frame) + steps + 1 if frame < 0 else int(frame) for frame in given]
        for frame, asked in zip(chosen, given, strict=True):
            if not 0 <= frame <= steps:
                raise DataError(f"the run has the frames 0 to {steps}, but an objective looks at {asked}")
        return sorted(set(chosen))

    @abstractmethod
    def check(self, scene: Scene) -> None:
        """Raises SceneError unless it is of this scene."""

    @property
    @abstractmethod
    def inputs(self) -> tuple[Attribute, ...]:
        """Stored attributes that it reads, as far as that is known."""

    @abstractmethod
    def value(self, frame: FrameView) -> float:
        """At the frame that the scene is at."""

    @abstractmethod
    def slopes(self, frame: FrameView, variables: Sequence[Attribute]) -> Slopes:
        """Its derivatives there; by these stored attributes, or by attributes that are computed from them."""


@dataclass(frozen=True)
class FrameView:
    """A frame, while the scene's numbers are those at its end. number: from 0, the start; time [s]."""

    number: int
    time: float
    scene: Scene
    velocities: Mapping[Body, FloatArray]
    """Of the vertices of each moving body [m/s], [n, 3]."""


class _OfAttribute(Objective):
    """An objective that reads one attribute."""

    def __init__(self, attribute: Attribute, frames: Frames, weight: float) -> None:
        """Raises SceneError for what is no attribute of a scene."""
        super().__init__(frames, weight)
        _check_attribute(attribute)
        self.attribute = attribute

    def check(self, scene: Scene) -> None:
        """Of its own scene."""
        _check_scene(self.attribute, scene)

    @property
    def inputs(self) -> tuple[Attribute, ...]:
        """Of its attribute."""
        return self.attribute.inputs


class Energy(_OfAttribute):
    """A 1x1 attribute, the sum over its instances: any formula of positions, targets and constants."""

    def __init__(self, attribute: Attribute, frames: Frames = "last", weight: float = 1.0) -> None:
        """Raises ShapeMismatchError unless it is 1x1, SceneError for what is no attribute of a scene."""
        super().__init__(attribute, frames, weight)
        if attribute.shape != (1, 1):
            raise ShapeMismatchError(
                f"an objective is 1x1 on every instance, but {attribute.path} is {attribute.shape}; reduce it, or take"
                " Squares"
            )

    def value(self, frame: FrameView) -> float:
        """Of all instances."""
        return self.weight * float(self.attribute.compute().array.sum())

    def slopes(self, frame: FrameView, variables: Sequence[Attribute]) -> Slopes:
        """By stored attributes."""
        read = [variable for variable in variables if variable in self.inputs]
        if not read:
            return Slopes()
        compiled = frame.scene.compile_for(read, energies=[self.attribute])
        gradients = compiled.split(self.weight * compiled.assemble(hessian=False))
        return Slopes(dict(zip(read, gradients, strict=True)))


class Squares(_OfAttribute):
    """Half of the sum of squares of all numbers of an attribute of any shape: of what should be 0."""

    def __init__(self, attribute: Attribute, frames: Frames = "last", weight: float = 1.0) -> None:
        """Raises SceneError for what is no attribute of a scene, DataError for a negative weight."""
        super().__init__(attribute, frames, weight)
        if self.weight < 0:
            raise DataError(f"squares have a weight >= 0, got {weight}")

    def value(self, frame: FrameView) -> float:
        """Of all instances."""
        return 0.5 * self.weight * float((self.attribute.value**2).sum())

    def slopes(self, frame: FrameView, variables: Sequence[Attribute]) -> Slopes:
        """By the attribute itself."""
        return Slopes({self.attribute: self.weight * self.attribute.value})


class FromOutside(Objective):
    """What a function of yours says of a frame: its value, and its gradient by attributes (of any kind, such as a
    body's `position`, [instances, rows, columns] or flat) and by bodies, which stand for the velocities of their
    vertices, [n, 3]."""

    def __init__(
        self,
        function: Callable[[FrameView], tuple[float, Mapping[Attribute | Body, FloatArray]]],
        frames: Frames = "last",
        weight: float = 1.0,
    ) -> None:
        """Raises SceneError for what can't be called."""
        super().__init__(frames, weight)
        if not callable(function):
            raise SceneError(f"an objective is an attribute or a function of a frame, got {function!r}")
        self.function = function

    def check(self, scene: Scene) -> None:
        """Nobody can know before it is called."""

    @property
    def inputs(self) -> tuple[Attribute, ...]:
        """None are known."""
        return ()

    def _ask(self, frame: FrameView) -> tuple[float, Mapping[Attribute | Body, FloatArray]]:
        try:
            value, slopes = self.function(frame)
        except Exception as error:
            error.add_note(f"an objective raised this at frame {frame.number}")
            raise
        return float(real_numbers(value, f"an objective at frame {frame.number}")), slopes

    def value(self, frame: FrameView) -> float:
        """What it says."""
        return self.weight * self._ask(frame)[0]

    def slopes(self, frame: FrameView, variables: Sequence[Attribute]) -> Slopes:
        """What it says; checked. Raises SceneError, DataError."""
        found = Slopes()
        for key, given in self._ask(frame)[1].items():
            label = getattr(key, "path", getattr(key, "name", key))
            numbers = self.weight * real_numbers(given, f"the gradient of an objective by {label}")
            if isinstance(key, Body):
                if key not in frame.velocities:
                    raise SceneError(f"an objective has a gradient by the velocity of {label!r}, which does not move")
                size = frame.velocities[key].size
            elif isinstance(key, Attribute):
                _check_scene(key, frame.scene)
                assert key.owner is not None
                size = key.owner.num_instances * key.size
            else:
                raise SceneError(f"gradients of an objective are by attributes and bodies, got {key!r}")
            if numbers.size != size:
                raise DataError(f"the gradient of an objective by {label} has {size} numbers, got {numbers.size}")
            if isinstance(key, Body):
                found.of_velocities[key] = numbers.reshape(-1, 3)
            else:
                found.of_attributes[key] = numbers.reshape(-1)
        return found


def _check_attribute(attribute: object) -> None:
    if not isinstance(attribute, Attribute) or attribute.owner is None:
        raise SceneError(f"an objective is an attribute of a scene, got {attribute!r}")


def _check_scene(attribute: Attribute, scene: Scene) -> None:
    assert attribute.owner is not None
    if attribute.owner.scene is not scene:
        raise SceneError(
            f"{attribute.path} belongs to scene {attribute.owner.scene.name!r}, but what runs is scene {scene.name!r}"
        )
