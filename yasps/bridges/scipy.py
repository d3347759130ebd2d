"""Energies as objectives of `scipy.optimize`: value, gradient, sparse Hessian and its products of one flat vector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, DataError, FloatArray, Scene
from yasps.bridges.energy_function import EnergyFunction
from yasps.frontend.language.arrays import real_numbers

if TYPE_CHECKING:
    from scipy import sparse


class Objective:
    """What `scipy.optimize.minimize` takes of energies: `minimize(o.fun, o.x0, jac=o.jac, hess=o.hess, method=...)`.

    The unknown is one vector: all entries of all inputs, in their order. inputs, energies: see `EnergyFunction`.
    projected: of `hess` and `hessp`, see `EnergyFunction.hessian`.

    Methods that take a matrix want `hess` ("trust-constr"; "Newton-CG"; "trust-exact" and "dogleg" a dense one, of
    `.toarray()`), the others with second derivatives `hessp` ("trust-ncg", "trust-krylov", "trust-constr"). `fun` is
    infinite outside the domain of the energy and `jac` raises NotFiniteError there: a trust region just gets smaller,
    but "L-BFGS-B" and "BFGS" ask for the gradient wherever they step, and need bounds.
    """

    def __init__(
        self,
        scene: Scene,
        inputs: Attribute | Sequence[Attribute],
        *,
        energies: Attribute | Sequence[Attribute] | None = None,
        projected: bool = False,
    ) -> None:
        """Compiles the energies for these inputs, and checks both."""
        self.function = EnergyFunction(scene, inputs, energies=energies)
        self._projected = projected

    def __repr__(self) -> str:
        return f"<objective, {self.function!r}>"

    @property
    def x0(self) -> FloatArray:
        """The inputs' numbers in the scene now."""
        return np.concatenate([array.ravel() for array in self.function.numbers()])

    def fun(self, x: ArrayLike) -> float:
        """The energy [J]; infinite also where it is NaN, which methods would not turn back from."""
        value = self.function.value(*self.split(x))
        return np.inf if np.isnan(value) else value

    def jac(self, x: ArrayLike) -> FloatArray:
        """Its gradient, in the order of x."""
        return np.concatenate([part.ravel() for part in self.function.gradient(*self.split(x))])

    def hess(self, x: ArrayLike) -> sparse.csr_array[np.float64]:
        """Its Hessian, rows and columns in the order of x."""
        return self.function.hessian(*self.split(x), projected=self._projected)

    def hessp(self, x: ArrayLike, direction: ArrayLike) -> FloatArray:
        """Its Hessian times a vector. The matrix is kept until x or other numbers of the scene change."""
        parts = self.function.hessian_product(self.split(x), self.split(direction), projected=self._projected)
        return np.concatenate([part.ravel() for part in parts])

    def split(self, x: ArrayLike) -> list[FloatArray]:
        """The parts of a vector, [instances, rows, columns] of each input. Raises DataError for another length."""
        vector, shapes = real_numbers(x, "x"), self.function.shapes
        sizes = [int(np.prod(shape)) for shape in shapes]
        if vector.shape != (sum(sizes),):
            names = ", ".join(
                f"{size} of {attribute.path}" for size, attribute in zip(sizes, self.function.inputs, strict=True)
            )
            raise DataError(f"x is one vector of {sum(sizes)} numbers ({names}), got shape {vector.shape}")
        parts = np.split(vector, np.cumsum(sizes)[:-1])
        return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]

    def store(self, x: ArrayLike) -> None:
        """Sets the inputs' numbers in the scene, for example to a minimum that was found."""
        self.function.store(*self.split(x))
