"""Second derivatives where building them looks through operations: through a transpose, a concatenation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yasps import Attribute, Scene, concat_rows


def _turned(x: Attribute, b: Attribute) -> Attribute:
    """The cut has a transpose; the gradient by it reads what was transposed."""
    product = concat_rows([x.row(1) - x.row(0), x.row(2) - x.row(0)]).T * b.block(0, 0, 2, 3)
    return product.dot(product)


def _joined(x: Attribute, b: Attribute) -> Attribute:
    """The cut has a concatenation; it is the gradient by one of squares, and so parts of it are taken."""
    u, v = x.row(0) + b.row(0), x.row(1) + b.row(1)
    return concat_rows([x.row(2) + b.row(2), x.row(2) - b.row(0)]).dot(concat_rows([u.hadamard(u), v.hadamard(v)]))


ENERGIES: dict[str, Callable[[Attribute, Attribute], Attribute]] = {"transpose": _turned, "concatenation": _joined}


@pytest.mark.parametrize("name", ENERGIES)
def test_hessian_against_differences_of_the_gradient(name: str) -> None:
    """Both factors are variables: what is exact is a polynomial of degree 4 at most, so a step of 1e-3 loses little."""
    random = np.random.default_rng(5)
    scene = Scene("cut", threads=1)
    points = scene.add_mesh("m").add_primitive("points", 1)
    x = points.add_attribute("x", 3, 3, value=random.normal(size=(3, 3)))
    b = points.add_attribute("b", 3, 3, value=random.normal(size=(3, 3)))
    scene.add_energy(points.add_attribute("energy", computed_attribute=ENERGIES[name](x, b)), projection="none")
    scene.add_minimize_target([x, b])
    found, step = scene.hessian().to_scipy().toarray(), 1e-3
    for k in range(18):
        attribute, at = (x, b)[k // 9], k % 9
        start, slope = attribute.value, np.zeros(18)
        for factor, weight in ((1, 2 / 3), (2, -1 / 12)):
            for sign in (1, -1):
                moved = start.copy()
                moved[at] += sign * factor * step
                attribute.update_value(moved)
                slope += sign * weight / step * np.concatenate(scene.gradient())
        attribute.update_value(start)
        np.testing.assert_allclose(found[k], slope, rtol=0, atol=1e-9 * np.abs(found).max())
