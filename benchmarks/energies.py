"""Energies whose derivatives the benchmarks count, in yasps' language: those of the paper's figures 25 and 26, bending,
affine bodies, and every kind of contact. `sympy_energies` has them once more in SymPy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, Scene, contact, materials

Values = Mapping[str, Attribute]
Shapes = dict[str, tuple[int, int]]
Numbers = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Energy:
    """One energy on one element.

    variables: shapes of what it is differentiated by, in order; constants: shapes of what it reads besides;
    expression: the 1x1 energy of both.
    """

    variables: Shapes
    constants: Shapes
    expression: Callable[[Values], Attribute]

    def numbers(self, seed: int = 0, count: int | None = None) -> Numbers:
        """Random values at which everything is regular, [rows, cols] each, or [count, rows, cols] of many elements."""
        random = np.random.default_rng(seed)
        many = () if count is None else (count,)
        shapes = self.variables | self.constants
        return {name: random.uniform(0.5, 1.5, (*many, *shape)) for name, shape in shapes.items()}

    def scene(self, numbers: Numbers, projection: str = "clamp") -> Scene:
        """A scene of one element with this energy."""
        scene = Scene("energy", threads=1)
        element = scene.add_mesh("mesh").add_primitive("element", num_instances=1)
        variables = {
            name: element.add_attribute(name, *shape, value=numbers[name]) for name, shape in self.variables.items()
        }
        constants = {
            name: element.add_constant(name, *shape, value=numbers[name]) for name, shape in self.constants.items()
        }
        energy = element.add_attribute("energy", computed_attribute=self.expression(variables | constants))
        scene.add_energy(energy, projection=projection)
        scene.add_minimize_target(list(variables.values()))
        return scene


def stable_neo_hookean(f: Attribute, v: Values) -> Attribute:
    """Paper, eq. 10."""
    return materials.stable_neo_hookean(f, v["mu"], v["lam"], v["volume"])


def neo_hookean_of_sum(f: Attribute, v: Values) -> Attribute:
    """The same with the sum of F's entries for its determinant (paper, fig. 26)."""
    stretch, dilation = f.dot(f), f.sum() - (1 + 0.75 * v["mu"] / v["lam"])
    strain = 0.5 * v["mu"] * (stretch - 3 - (stretch + 1).log())
    return v["volume"] * (strain + 0.5 * v["lam"] * dilation * dilation)


def sharp_hinge(x: Attribute, v: Values) -> Attribute:
    """l |N_1 - N_2| (paper, 9.2)."""
    edge, left, right = (x.row(i) - x.row(0) for i in (1, 2, 3))
    first, second = edge.cross(left), right.cross(edge)
    return v["length"] * (first / first.norm() - second / second.norm()).norm()


def contact_energy(kind: str) -> Energy:
    """Barrier of one kind of close pair."""
    what = contact.KINDS[kind]

    def expression(v: Values) -> Attribute:
        x = v["x"]
        energy = v["weight"] * contact.paper_barrier(what.squared_distance(x), v["reach"], v["stiffness"])
        if what.edges is None:
            return energy
        (a, b), (c, d) = what.edges
        return energy * contact.mollifier(x.row(b) - x.row(a), x.row(d) - x.row(c), v["threshold"])

    constants = dict.fromkeys(("weight", "reach", "stiffness"), (1, 1))
    return Energy({"x": (what.arity, 3)}, constants | ({} if what.edges is None else {"threshold": (1, 1)}), expression)


_SOLID: Shapes = {"mu": (1, 1), "lam": (1, 1), "volume": (1, 1)}
_CLOTH: Shapes = {"stretch": (1, 1), "shear": (1, 1), "area": (1, 1)}


def _cloth(f: Attribute, v: Values) -> Attribute:
    return materials.baraff_witkin(f, v["stretch"], v["shear"], v["area"])


def _of_tet(density: Callable[[Attribute, Values], Attribute]) -> Energy:
    return Energy(
        {"x": (4, 3)},
        {"inverse": (3, 3), **_SOLID},
        lambda v: density(materials.deformation_gradient(v["x"], v["inverse"]), v),
    )


def _of_gradient(density: Callable[[Attribute, Values], Attribute]) -> Energy:
    return Energy({"f": (3, 3)}, _SOLID, lambda v: density(v["f"], v))


ENERGIES: dict[str, Energy] = {
    "stable Neo-Hookean, x": _of_tet(stable_neo_hookean),
    "stable Neo-Hookean, F": _of_gradient(stable_neo_hookean),
    "with sum for det, x": _of_tet(neo_hookean_of_sum),
    "with sum for det, F": _of_gradient(neo_hookean_of_sum),
    "Baraff-Witkin, x": Energy(
        {"x": (3, 3)},
        {"inverse": (2, 2), **_CLOTH},
        lambda v: _cloth(materials.triangle_deformation(v["x"], v["inverse"]), v),
    ),
    "Baraff-Witkin, F": Energy({"f": (3, 2)}, _CLOTH, lambda v: _cloth(v["f"], v)),
    "hinge, l |N1 - N2|": Energy({"x": (4, 3)}, {"length": (1, 1)}, lambda v: sharp_hinge(v["x"], v)),
    "hinge, k |N1 - N2|^2": Energy(
        {"x": (4, 3)}, {"stiffness": (1, 1)}, lambda v: materials.hinge_bending(v["x"], v["stiffness"])
    ),
    "affine orthogonality": Energy(
        {"a": (3, 3)}, {"stiffness": (1, 1)}, lambda v: materials.affine_orthogonality(v["a"], v["stiffness"])
    ),
    **{kind: contact_energy(kind) for kind in contact.KINDS},
}
"""By name; "x" is over positions, "F" over the deformation gradient."""
