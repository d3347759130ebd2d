"""Products of rows against NumPy's own."""

from __future__ import annotations

import numpy as np

from yasps.contact.rows import longest_way, row_crosses, row_dots

RNG = np.random.default_rng(0)


def test_dot_products_of_rows() -> None:
    a, b = RNG.normal(size=(2, 50, 3))
    np.testing.assert_allclose(row_dots(a, b), (a * b).sum(axis=1), rtol=1e-13)
    np.testing.assert_allclose(row_dots(a, b[0]), a @ b[0], rtol=1e-13, atol=1e-15)


def test_cross_products_of_rows() -> None:
    a, b = RNG.normal(size=(2, 50, 3))
    np.testing.assert_allclose(row_crosses(a, b), np.cross(a, b), rtol=1e-13, atol=1e-15)


def test_the_longest_way() -> None:
    a, b = RNG.normal(size=(2, 50, 3))
    np.testing.assert_allclose(longest_way(a, b), np.linalg.norm(b - a, axis=1).max(), rtol=1e-14)
    assert longest_way(np.empty((0, 3)), np.empty((0, 3))) == 0.0
