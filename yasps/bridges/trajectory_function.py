"""A run of a simulation as a function of arrays, with derivatives backwards."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, DataError, FloatArray, SceneError, ShapeMismatchError
from yasps.frontend.language.arrays import real_numbers
from yasps.inverse import FrameView, FromOutside, Parameter, Trajectory

Frames: TypeAlias = str | int | Sequence[int]


class TrajectoryFunction:
    """Some attributes at the end of some steps of a run, as a function of the run's parameters.

    parameters: attributes and parameters of `yasps.inverse`, one argument each, of the shape that `Trajectory.value`
    has, or flat. outputs: attributes of any kind (`body.position`), one result each, [frames, instances, rows,
    columns]. frames: "last", "all", or numbers of frames, as objectives have them; of "last" or one number results are
    [instances, rows, columns].

    A call takes the steps, unless the last run was with the same numbers, within the scene's lock. It puts the
    parameters back; the simulation stays at the end of that run. Calls raise what `Trajectory` raises, DataError for an
    argument that is not finite or of another size, ShapeMismatchError for another number of arguments.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        parameters: Attribute | Parameter | Sequence[Attribute | Parameter],
        outputs: Attribute | Sequence[Attribute],
        *,
        frames: Frames = "last",
    ) -> None:
        """Checks parameters and outputs."""
        self.trajectory = trajectory
        self.parameters = [parameters] if isinstance(parameters, Attribute | Parameter) else list(parameters)
        self.outputs = [outputs] if isinstance(outputs, Attribute) else list(outputs)
        if not self.parameters or not self.outputs:
            raise SceneError("a run as a function needs at least one parameter and one output")
        for output in self.outputs:
            if output.owner is None or output.owner.scene is not trajectory.scene:
                raise SceneError(f"{output.path} is no attribute of {trajectory.scene.label}, which runs")
        self._frames = frames
        self._numbers = self._observed(lambda frame: {}).frames(trajectory.steps)
        self._is_one = frames == "last" or isinstance(frames, int | np.integer)
        for parameter in self.parameters:
            trajectory.value(parameter)

    def __repr__(self) -> str:
        return f"<run of {self.trajectory.steps} steps in {self.trajectory.scene.label}>"

    @property
    def shapes(self) -> list[tuple[int, ...]]:
        """Of the results."""
        leading = () if self._is_one else (len(self._numbers),)
        owners = [output.owner for output in self.outputs]
        return [
            (*leading, owner.num_instances, *output.shape)
            for owner, output in zip(owners, self.outputs, strict=True)
            if owner is not None
        ]

    def values(self, *arrays: ArrayLike) -> list[FloatArray]:
        """The results, one for each output."""
        seen: dict[int, list[FloatArray]] = {}

        def look(frame: FrameView) -> dict[Any, FloatArray]:
            seen[frame.number] = [output.compute().array for output in self.outputs]
            return {}

        with self._set_to(arrays):
            self.trajectory.objective(self._observed(look))
        stacked = [np.stack(parts) for parts in zip(*(seen[number] for number in self._numbers), strict=True)]
        return [array.reshape(shape) for array, shape in zip(stacked, self.shapes, strict=True)]

    def pull_back(self, arrays: Sequence[ArrayLike], slopes: Sequence[ArrayLike]) -> list[FloatArray]:
        """What results' slopes, in their shapes, say of the arguments: one array for each, in its shape."""
        if [np.shape(slope) for slope in slopes] != self.shapes:
            raise DataError(f"slopes of {self!r} are of shapes {self.shapes}, got {[np.shape(s) for s in slopes]}")
        by_frame = [
            real_numbers(slope, "a slope").reshape(len(self._numbers), *shape[-3:])
            for slope, shape in zip(slopes, self.shapes, strict=True)
        ]

        def look(frame: FrameView) -> dict[Any, FloatArray]:
            k, found = self._numbers.index(frame.number), dict[Any, FloatArray]()
            for output, slope in zip(self.outputs, by_frame, strict=True):
                found[output] = found.get(output, 0.0) + slope[k]
            return found

        with self._set_to(arrays):
            gradient = self.trajectory.gradient(self._observed(look), self.parameters)
            found = [gradient[parameter] for parameter in self.parameters]
        return [part.reshape(np.shape(array)) for part, array in zip(found, arrays, strict=True)]

    def check_shapes(self, shapes: Sequence[tuple[int, ...]]) -> None:
        """Raises ShapeMismatchError for another number of arguments, or one of another shape than its parameter's."""
        if len(shapes) != len(self.parameters):
            raise ShapeMismatchError(f"{self!r} has {len(self.parameters)} arguments, got {len(shapes)}")
        for k, (shape, parameter) in enumerate(zip(shapes, self.parameters, strict=True)):
            wanted = self.trajectory.value(parameter).shape
            if shape not in (wanted, (int(np.prod(wanted)),)):
                raise ShapeMismatchError(f"argument {k} of {self!r} has the shape {list(wanted)}, got {list(shape)}")

    def _observed(self, look: Callable[[FrameView], Mapping[Any, FloatArray]]) -> FromOutside:
        """An objective that is 0, looks at frames, and has the slopes that it is told there."""
        return FromOutside(lambda frame: (0.0, look(frame)), self._frames)

    @contextmanager
    def _set_to(self, arrays: Sequence[ArrayLike]) -> Iterator[None]:
        """Within the scene's lock, parameters are these arrays."""
        self.check_shapes([np.shape(array) for array in arrays])
        with self.trajectory.scene.lock:
            before = [self.trajectory.value(parameter) for parameter in self.parameters]
            try:
                for parameter, array in zip(self.parameters, arrays, strict=True):
                    self.trajectory.set(parameter, array)
                yield
            finally:
                for parameter, array in zip(self.parameters, before, strict=True):
                    self.trajectory.set(parameter, array)
