"""The energies of `energies` in SymPy, and SymPy's derivatives of them: what a user without yasps would write."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import sympy as sp

from benchmarks.energies import ENERGIES as SHAPES
from benchmarks.energies import Shapes
from yasps.contact import KINDS

# SymPy has no types; its expressions and matrices are `Any` here.
Values = Mapping[str, Any]


def symbols_of(shapes: Shapes) -> dict[str, Any]:
    """One real symbol for each entry; 1x1 ones as numbers."""
    made = {
        name: sp.Matrix(rows, cols, lambda i, j, name=name: sp.Symbol(f"{name}_{i}_{j}", real=True))
        for name, (rows, cols) in shapes.items()
    }
    return {name: matrix[0, 0] if matrix.shape == (1, 1) else matrix for name, matrix in made.items()}


def derivatives(name: str) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """Gradient and upper Hessian of the energy of this name as cse gives them: temporaries, and expressions in them."""
    energy = SHAPES[name]
    values = symbols_of(energy.variables | energy.constants)
    unknowns = [symbol for variable in energy.variables for symbol in values[variable]]
    replacements, reduced = sp.cse(gradient_and_upper_hessian(ENERGIES[name](values), unknowns))
    return list(replacements), list(reduced)


def gradient_and_upper_hessian(energy: Any, unknowns: Sequence[Any]) -> list[Any]:
    """First derivatives, then the upper triangle of the second, row by row."""
    gradient = [sp.diff(energy, x) for x in unknowns]
    return gradient + [sp.diff(g, x) for i, g in enumerate(gradient) for x in unknowns[i:]]


def _edges(v: Values) -> Any:
    x = v["x"]
    return sp.Matrix.hstack(*[(x[i, :] - x[0, :]).T for i in range(1, x.rows)])


def _stable_neo_hookean(f: Any, v: Values, dilation: Any) -> Any:
    mu, lam = v["mu"], v["lam"]
    stretch = sum(entry**2 for entry in f)
    strain = mu / 2 * (stretch - 3 - sp.log(stretch + 1))
    return v["volume"] * (strain + lam / 2 * (dilation - 1 - sp.Rational(3, 4) * mu / lam) ** 2)


def _baraff_witkin(f: Any, v: Values) -> Any:
    u, w = f[:, 0], f[:, 1]
    stretch = (sp.sqrt(u.dot(u)) - 1) ** 2 + (sp.sqrt(w.dot(w)) - 1) ** 2
    return v["area"] * (v["stretch"] * stretch + v["shear"] * u.dot(w) ** 2)


def _hinge(v: Values) -> Any:
    e = _edges(v)
    edge, left, right = e[:, 0], e[:, 1], e[:, 2]
    first, second = edge.cross(left), right.cross(edge)
    difference = first / sp.sqrt(first.dot(first)) - second / sp.sqrt(second.dot(second))
    return difference.dot(difference)


def _affine_orthogonality(v: Values) -> Any:
    strain = v["a"].T * v["a"] - sp.eye(3)
    return v["stiffness"] / 2 * sum(entry**2 for entry in strain)


def _point_point(x: Any) -> Any:
    d = x[1, :] - x[0, :]
    return d.dot(d)


def _point_line(x: Any) -> Any:
    first, second = x[1, :] - x[0, :], x[2, :] - x[0, :]
    area, edge = first.cross(second), second - first
    return area.dot(area) / edge.dot(edge)


def _height(offset: Any, first: Any, second: Any) -> Any:
    normal = first.cross(second)
    return offset.dot(normal) ** 2 / normal.dot(normal)


def _point_plane(x: Any) -> Any:
    return _height(x[0, :] - x[1, :], x[2, :] - x[1, :], x[3, :] - x[1, :])


def _line_line(x: Any) -> Any:
    return _height(x[2, :] - x[0, :], x[1, :] - x[0, :], x[3, :] - x[2, :])


DISTANCES = {
    "point_point": _point_point,
    "point_edge": _point_line,
    "point_triangle": _point_plane,
    "edge_edge": _line_line,
    "mollified_edge_edge": _line_line,
    "mollified_point_edge": _point_line,
    "mollified_point_point": _point_point,
}


def _barrier(kind: str) -> Callable[[Values], Any]:
    def energy(v: Values) -> Any:
        x = v["x"]
        d, reach = DISTANCES[kind](x), v["reach"]
        value = v["weight"] * v["stiffness"] * (d - reach) ** 2 * sp.log(d / reach) ** 2
        edges = KINDS[kind].edges
        if edges is not None:
            (a, b), (c, e) = edges
            normal = (x[b, :] - x[a, :]).cross(x[e, :] - x[c, :])
            ratio = normal.dot(normal) / v["threshold"]
            value *= ratio * (2 - ratio)
        return value

    return energy


ENERGIES: dict[str, Callable[[Values], Any]] = {
    "stable Neo-Hookean, x": lambda v: _stable_neo_hookean(f := _edges(v) * v["inverse"], v, f.det()),
    "stable Neo-Hookean, F": lambda v: _stable_neo_hookean(v["f"], v, v["f"].det()),
    "with sum for det, x": lambda v: _stable_neo_hookean(f := _edges(v) * v["inverse"], v, sum(f)),
    "with sum for det, F": lambda v: _stable_neo_hookean(v["f"], v, sum(v["f"])),
    "Baraff-Witkin, x": lambda v: _baraff_witkin(_edges(v) * v["inverse"], v),
    "Baraff-Witkin, F": lambda v: _baraff_witkin(v["f"], v),
    "hinge, l |N1 - N2|": lambda v: v["length"] * sp.sqrt(_hinge(v)),
    "hinge, k |N1 - N2|^2": lambda v: v["stiffness"] * _hinge(v),
    "affine orthogonality": _affine_orthogonality,
    **{kind: _barrier(kind) for kind in DISTANCES},
}
