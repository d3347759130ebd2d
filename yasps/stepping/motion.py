"""Targets that move, and the vertices that move with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from yasps import Attribute, FloatArray, Scene


class Motion:
    """Current values of the targets, moved along one direction at a time."""

    def __init__(self, scene: Scene) -> None:
        self.targets = scene.minimize_targets
        self.start = self.read()

    def read(self) -> list[FloatArray]:
        """Copies of all targets' values, flat."""
        return [target.value for target in self.targets]

    def write(self, values: Sequence[FloatArray]) -> None:
        """Sets all targets."""
        for target, value in zip(self.targets, values, strict=True):
            target.update_value(value)

    def move(self, directions: Sequence[FloatArray], step: float) -> None:
        """Sets all targets to start - step * direction (the solution of H x = g points uphill)."""
        moved = [np.multiply(x, step) for x in directions]
        for start, x in zip(self.start, moved, strict=True):
            np.subtract(start, x, out=x)
        self.write(moved)


def positions_of(attributes: Sequence[Attribute]) -> FloatArray:
    """Positions of the vertices of several 3x1 attributes, [n, 3]."""
    if not attributes:
        return np.empty((0, 3))
    return np.concatenate([attribute.compute().array.reshape(-1, 3) for attribute in attributes])
