"""The smallest linear cut is found by itself, however the energy is written."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from yasps import Attribute, Scene, contact
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.reference.interpreter import Interpreter

Energy = Callable[[Attribute], Attribute]


def hinge(x: Attribute) -> Attribute:
    """Normals from different corners: five differences, of which three are independent."""
    a, b, c, d = (x.row(i) for i in range(4))
    first, second = (b - a).cross(c - a), (c - b).cross(d - b)
    turn = first / first.norm() - second / second.norm()
    return turn.dot(turn) * (b - c).norm()


def three_springs(x: Attribute) -> Attribute:
    """All three edges of a triangle, of which two are independent."""
    return sum(((x.row(i) - x.row(j)).norm() - 1) ** 2 for i, j in ((0, 1), (1, 2), (2, 0)))  # type: ignore[return-value]


def neo_hookean_in_x(x: Attribute) -> Attribute:
    edges = [x.row(i) - x.row(0) for i in (1, 2, 3)]
    volume = edges[0].cross(edges[1]).dot(edges[2])
    return sum((e.dot(e) for e in edges), (volume - 1) ** 2)  # type: ignore[return-value]


CASES: dict[str, tuple[int, Energy, int]] = {
    "point-point": (2, lambda x: contact.squared_point_point(x) ** 2, 3),
    "point-edge": (3, lambda x: contact.squared_point_line(x) ** 2, 6),
    "point-triangle": (4, lambda x: contact.squared_point_plane(x) ** 2, 9),
    "edge-edge": (4, lambda x: contact.squared_line_line(x) ** 2, 9),
    "hinge": (4, hinge, 9),
    "triangle": (3, three_springs, 6),
    "tet": (4, neo_hookean_in_x, 9),
    "absolute": (2, lambda x: x.row(0).dot(x.row(1)) ** 2, 6),
}


@pytest.mark.parametrize("case", CASES)
def test_width(case: str) -> None:
    arity, energy, width = CASES[case]
    rng = np.random.default_rng(3)
    scene = Scene("widths")
    mesh = scene.add_mesh("mesh")
    points = mesh.add_primitive("points", arity)
    x = points.add_attribute("x", 3, 1, value=rng.random((arity, 3)))
    elements = mesh.add_primitive("elements", 1)
    corners = elements.add_connectivity("corners", points, list(range(arity)), arity)
    scene.add_energy(
        elements.add_attribute(
            "energy", computed_attribute=energy(elements.add_attribute("x", through=corners, source=x))
        )
    )
    scene.add_minimize_target(x)
    compiled = scene.compile()
    (derivative,) = SceneView(compiled.module).derivatives
    assert derivative.projects is not None
    assert derivative.projects.data.startswith(f"{width}x{width} of {3 * arity}x{3 * arity}")

    exact = scene.hessian(projected=False).to_scipy().toarray()
    data = compiled.data()
    rows = []
    for k in range(3 * arity):
        moved = data.storages["mesh.points.x"].astype(complex)
        moved.flat[k] += 1e-30j
        one = dataclasses.replace(data, storages={**data.storages, "mesh.points.x": moved})
        rows.append(Interpreter(compiled.module, one).gradient().imag / 1e-30)
    assert np.abs(exact - np.array(rows)).max() <= 1e-12 * np.abs(exact).max()
