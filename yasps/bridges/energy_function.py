"""Energies of a scene as a function of arrays, with exact first and second derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, DataError, FloatArray, Scene, ShapeMismatchError
from yasps.frontend.language.arrays import in_instances, real_numbers

if TYPE_CHECKING:
    from scipy import sparse


@dataclass(frozen=True)
class _Assembled:
    """The Hessian that was asked for last, and all that it was computed from."""

    arrays: list[FloatArray]
    read: list[tuple[object, int]]
    """The compiled code, and the numbers of the scene beside the arrays."""
    hessian: sparse.csr_array[np.float64]

    def is_of(self, arrays: Sequence[FloatArray], read: Sequence[tuple[object, int]]) -> bool:
        """Would it be the same today?"""
        return (
            len(read) == len(self.read)
            and all(a is b and k == m for (a, k), (b, m) in zip(read, self.read, strict=True))
            and all(np.array_equal(a, b) for a, b in zip(arrays, self.arrays, strict=True))
        )


class EnergyFunction:
    """The sum of energies over all their instances [J] as a function of the numbers of some stored attributes.

    inputs: stored attributes, of `add_attribute` or `add_constant`: targets and parameters alike, of any primitive,
    mesh or the scene. The function has one argument for each, in this order. energies: 1x1 attributes of the scene,
    registered or not; default all that are registered at each call.

    An argument is float64, [instances, rows, columns], and may be flat or leave axes of length 1 out, as
    `Attribute.update_value` takes it; derivatives come in the shapes of the arguments. Everything that is no input is
    as it is in the scene at the call. A call holds the scene's lock, sets the inputs, and puts them back at its end,
    also after an error: no call changes the scene.

    Raises SceneError for inputs and energies that are computed, foreign or repeated. Calls raise DataError for an
    argument of another count, shape or kind, or that is not finite; NotFiniteError for derivatives where the energy has
    none (its value is infinite or NaN there, without an error).
    """

    def __init__(
        self,
        scene: Scene,
        inputs: Attribute | Sequence[Attribute],
        *,
        energies: Attribute | Sequence[Attribute] | None = None,
    ) -> None:
        """Compiles the energies for these inputs, and checks both."""
        self.scene = scene
        self.inputs = (inputs,) if isinstance(inputs, Attribute) else tuple(inputs)
        self.energies = (
            (energies,) if isinstance(energies, Attribute) else None if energies is None else tuple(energies)
        )
        self._assembled: dict[bool, _Assembled] = {}
        scene.compile_for(self.inputs, energies=self.energies)

    def __repr__(self) -> str:
        names = ", ".join(attribute.path for attribute in self.inputs)
        return f"<function of {names} in {self.scene.label}>"

    @property
    def shapes(self) -> list[tuple[int, int, int]]:
        """[instances, rows, columns] of each input now."""
        owners = [attribute.owner for attribute in self.inputs]
        return [
            (owner.num_instances, *attribute.shape)
            for owner, attribute in zip(owners, self.inputs, strict=True)
            if owner is not None
        ]

    def numbers(self) -> list[FloatArray]:
        """The inputs' numbers in the scene now, [instances, rows, columns] each: where to evaluate first."""
        return [attribute.compute().array for attribute in self.inputs]

    def store(self, *arrays: ArrayLike) -> None:
        """Sets the inputs' numbers in the scene."""
        with self.scene.lock:
            for attribute, array in zip(self.inputs, self._checked(arrays), strict=True):
                attribute.update_value(array)

    def value(self, *arrays: ArrayLike) -> float:
        """The energy [J]; infinite or NaN where it is."""
        with self._set_to(arrays):
            return self.scene.compile_for(self.inputs, energies=self.energies).total_energy()

    def gradient(self, *arrays: ArrayLike) -> list[FloatArray]:
        """First derivatives, one array for each argument, in its shape."""
        with self._set_to(arrays):
            compiled = self.scene.compile_for(self.inputs, energies=self.energies)
            parts = compiled.split(compiled.assemble(hessian=False))
        return [part.reshape(np.shape(array)) for part, array in zip(parts, arrays, strict=True)]

    def hessian(self, *arrays: ArrayLike, projected: bool = False) -> sparse.csr_array[np.float64]:
        """Second derivatives with respect to all entries of all arguments, in their order, with the mixed ones.

        projected: the local Hessians made positive semi-definite as the energies were registered; else exact.
        """
        return self._hessian(arrays, projected).copy()

    def hessian_product(
        self, arrays: Sequence[ArrayLike], directions: Sequence[ArrayLike], *, projected: bool = False
    ) -> list[FloatArray]:
        """The Hessian times one direction for each argument; one array for each argument, in its shape.

        The Hessian is kept until the arguments or other numbers of the scene change: further products cost no more than
        a sparse matrix times a vector.
        """
        flat = np.concatenate([array.ravel() for array in self._checked(directions, "direction")])
        product = self._hessian(arrays, projected) @ flat
        ends = np.cumsum([np.size(array) for array in arrays])[:-1]
        return [part.reshape(np.shape(a)) for part, a in zip(np.split(product, ends), arrays, strict=True)]

    def _hessian(self, arrays: Sequence[ArrayLike], projected: bool) -> sparse.csr_array[np.float64]:
        with self._set_to(arrays) as given:
            compiled = self.scene.compile_for(self.inputs, energies=self.energies, projected=projected)
            read = [(compiled, 0), *compiled.read_beside_targets()]
            known = self._assembled.get(projected)
            if known is None or not known.is_of(given, read):
                compiled.assemble()
                known = _Assembled([array.copy() for array in given], read, compiled.hessian().to_scipy())
                self._assembled[projected] = known
            return known.hessian

    def pattern(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Row and column of each entry that `hessian` stores, in its order: whatever the arguments are, as long as the
        scene's connections and numbers of instances stay."""
        with self.scene.lock:
            compiled = self.scene.compile_for(self.inputs, energies=self.energies)
            compiled.update_structure()
            return _places(compiled.hessian().to_scipy())

    def hessian_entries(
        self, pattern: tuple[NDArray[np.int32], NDArray[np.int32]], arrays: Sequence[ArrayLike]
    ) -> FloatArray:
        """Entries of the exact Hessian at the places of a pattern. Raises DataError if it has others now."""
        found = self._hessian(arrays, projected=False)
        if not all(np.array_equal(now, then) for now, then in zip(_places(found), pattern, strict=True)):
            raise DataError(
                f"{self!r}: its second derivatives have other entries than when the function was traced, since "
                "connections in the scene have changed; trace it again (make a new jax.jit of it)"
            )
        return np.array(found.data)

    @contextmanager
    def _set_to(self, arrays: Sequence[ArrayLike]) -> Iterator[list[FloatArray]]:
        """Within the scene's lock, the inputs are these arrays, which it gives as [instances, rows, columns]."""
        with self.scene.lock:
            given = self._checked(arrays)
            before = self.numbers()
            try:
                for attribute, array in zip(self.inputs, given, strict=True):
                    attribute.update_value(array)
                yield given
            finally:
                for attribute, array in zip(self.inputs, before, strict=True):
                    attribute.update_value(array)

    def _checked(self, arrays: Sequence[ArrayLike], what: str = "argument") -> list[FloatArray]:
        self.check_shapes([np.shape(array) for array in arrays], what)
        checked = []
        for k, (array, attribute) in enumerate(zip(arrays, self.inputs, strict=True)):
            numbers = real_numbers(array, f"{what} {k} ({attribute.path})")
            checked.append(numbers.reshape(-1, *attribute.shape))
        return checked

    def check_shapes(self, shapes: Sequence[tuple[int, ...]], what: str = "argument") -> None:
        """Raises ShapeMismatchError for another number of arguments than inputs, DataError for a shape that does not
        hold an input's numbers."""
        if len(shapes) != len(self.inputs):
            names = ", ".join(attribute.path for attribute in self.inputs)
            raise ShapeMismatchError(f"one {what} for each of {names}, in this order; got {len(shapes)}")
        for k, (shape, attribute, (count, *_)) in enumerate(zip(shapes, self.inputs, self.shapes, strict=True)):
            stand_in = np.broadcast_to(np.float64(0), shape)  # of no memory
            in_instances(stand_in, count, attribute.shape, f"{what} {k} ({attribute.path})")


def _places(matrix: sparse.csr_array[np.float64]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Row and column of each stored entry."""
    rows = np.repeat(np.arange(matrix.shape[0], dtype=np.int32), np.diff(matrix.indptr))
    return rows, matrix.indices.astype(np.int32)
