"""An order of an energy's instances that only the assembly sees: neighbours in it share unknowns or parameterisations.

The kernel then finds what it reads and writes in the cache, and does the same for all instances of a pack. Generated
code knows nothing of it: the kernel's pointers to numbers and indices of its own primitive lead to copies of them in
that order.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from yasps.backend.codegen.object_text import Binding
from yasps.backend.codegen.program import Program
from yasps.frontend.execution.emit import SceneEmitter
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.nodes import Stored
from yasps.frontend.language.primitive import Primitive, PrimitiveBase, PrimitiveUnion

Number = TypeVar("Number", np.float64, np.int32, np.int64)
OwnReads = tuple[dict[Binding, Stored], dict[Binding, Connectivity]]


def rows_of(array: NDArray[Number], order: NDArray[np.int64]) -> NDArray[Number]:
    """A copy of the array with row order[k] as the k-th; several times faster than `array[order]`."""
    copy = np.empty_like(array)
    np.take(array, order, axis=0, out=copy, mode="clip")
    return copy


def grouped(branches: NDArray[np.int64], order: NDArray[np.int64] | None) -> NDArray[np.int64] | None:
    """The order, or that of the instances, with equal `branches` [n] put together; None for that of the instances."""
    if branches.size == 0 or branches.min() == branches.max():
        return order
    if branches.max() < 1 << 16 and branches.min() >= 0:
        branches = branches.astype(np.uint16)  # which is sorted in linear time
    if order is not None:
        return order[np.argsort(branches[order], kind="stable")]
    found = np.argsort(branches, kind="stable")
    return None if (found[1:] > found[:-1]).all() else found


class OrderedReads:
    """What the kernel of one energy reads of its own primitive, instance `order[k]` as the k-th."""

    def __init__(
        self,
        program: Program,
        derivative: str,
        order: NDArray[np.int64],
        numbers: Mapping[Binding, Stored],
        indices: Mapping[Binding, Connectivity],
    ) -> None:
        """Copies everything and points the program to the copies."""
        self.order = order
        self._program = program
        self._derivative = derivative
        self._numbers = numbers
        self._copies = {binding: rows_of(stored.array, order) for binding, stored in numbers.items()}
        self._versions = {binding: (stored.array, stored.version) for binding, stored in numbers.items()}
        self._indices = {binding: rows_of(c.indices, order) for binding, c in indices.items()}
        self._addresses = {binding: copy.ctypes.data for binding, copy in (self._copies | self._indices).items()}
        self.point()

    def point(self) -> None:
        """Points the program to the copies; again after each `Program.bind`."""
        for binding, address in self._addresses.items():
            self._program.point(self._derivative, binding, address)

    def refresh(self) -> None:
        """Copies numbers that were set since. New indices need a new object, since the best order is another one."""
        for binding, stored in self._numbers.items():
            array, version = self._versions[binding]
            if array is not stored.array or version != stored.version:
                np.take(stored.array, self.order, axis=0, out=self._copies[binding], mode="clip")
                self._versions[binding] = (stored.array, stored.version)


def own_reads(program: Program, derivative: str, owner: Primitive, emitter: SceneEmitter) -> OwnReads | None:
    """What the kernel's pointers lead to whose rows are the instances of `owner`; None where they must stay in order.

    That is where the kernel hands the number of an instance on to another object, or reaches numbers of `owner` through
    a JOIN from `owner` to itself or to a union with it as well.
    """
    numbers: dict[Binding, Stored] = {}
    indices: dict[Binding, Connectivity] = {}
    for binding in program.codes[derivative].bindings:
        if binding.kind == "storage":
            attribute = emitter.stored.get(binding.name)
            if attribute is None or attribute.owner is not owner:  # numbers of formulas are the scene's
                continue
            assert isinstance(attribute.node, Stored)
            numbers[binding] = attribute.node
        elif binding.kind == "indices":
            connectivity = emitter.connected[binding.name]
            if _contains(connectivity.target, owner):
                return None
            if connectivity.source is owner:
                indices[binding] = connectivity
        elif binding.kind == "arguments" and binding.name.startswith(f"{owner.path}."):
            return None
    return numbers, indices


def _contains(primitive: PrimitiveBase, owner: Primitive) -> bool:
    """Is it `owner`, or a union with `owner` in it?"""
    if isinstance(primitive, PrimitiveUnion):
        return any(_contains(member, owner) for member in primitive.members)
    return primitive is owner
