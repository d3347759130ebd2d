"""What a run depends on, as numbers: small changes of it, or the derivatives of an objective by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from yasps import Attribute, FloatArray
from yasps.stepping import Driven


@dataclass
class Inputs:
    """Columns for everything that a run of `steps` steps depends on: [numbers, columns] each.

    A tangent sweep reads changes from it, one column for each direction; an adjoint sweep adds up derivatives in it.
    What is not there is 0.
    """

    steps: int
    columns: int
    constants: dict[Attribute, FloatArray] = field(default_factory=dict)
    """Of stored attributes that are the same in all steps."""
    scheduled: dict[Attribute, list[FloatArray]] = field(default_factory=dict)
    """Of stored attributes that are set before each step, an array for each."""
    targets: dict[Attribute, FloatArray] = field(default_factory=dict)
    """Of targets at the start."""
    velocities: dict[int, FloatArray] = field(default_factory=dict)
    """Of the vertices of moving bodies at the start, by the number of the body."""
    goals: dict[Driven, list[FloatArray]] = field(default_factory=dict)
    """Of the places of driven vertices at the end of each step."""

    def zeros(self, size: int) -> FloatArray:
        """So many numbers that are 0."""
        return np.zeros((size, self.columns))

    def of_step(self, attribute: Attribute, step: int) -> FloatArray:
        """The columns of a stored attribute in one step."""
        if attribute in self.scheduled:
            return self.scheduled[attribute][step]
        if attribute in self.constants:
            return self.constants[attribute]
        return self.zeros(size_of(attribute))

    def add_to_step(self, attribute: Attribute, step: int, columns: FloatArray) -> None:
        """Adds columns of a stored attribute in one step."""
        if attribute in self.scheduled:
            self.scheduled[attribute][step] += columns
        elif attribute in self.constants:
            self.constants[attribute] += columns


def size_of(attribute: Attribute) -> int:
    """How many numbers an attribute has now."""
    assert attribute.owner is not None
    return attribute.owner.num_instances * attribute.size


class Layout:
    """Stored attributes end to end: where each begins."""

    def __init__(self, attributes: Sequence[Attribute]) -> None:
        """At their present sizes."""
        self.attributes = list(attributes)
        self.slices: dict[Attribute, slice] = {}
        start = 0
        for attribute in self.attributes:
            self.slices[attribute] = slice(start, start + size_of(attribute))
            start += size_of(attribute)
        self.size = start
