"""Closest points and tangent planes of every kind of close pair, against rational numbers.

Values come through a scene, as contact computes them, on pairs of all sizes, thin and nearly parallel ones too.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from exact_pairs import Exact, cross, dot, exact, minus
from kind_pairs import LINES, as_floats, exact_way, pairs_of
from numpy.typing import NDArray

from yasps import Scene
from yasps.contact import KINDS

Floats = NDArray[np.float64]


def computed(name: str, pairs: Floats) -> tuple[Floats, Floats, Floats]:
    """Weights [n, arity], tangents [n, 3, 2] and squared distances [n] as a scene computes them."""
    kind = KINDS[name]
    pair = Scene("pairs").add_mesh("mesh").add_primitive("pair", len(pairs))
    x = pair.add_constant("x", kind.arity, 3, value=pairs)
    one = pair.add_constant("one", 1, 1, value=np.ones(len(pairs)))  # weights of two points are numbers of no owner
    weights, tangents = one * kind.weights(x), kind.tangents(x)
    return weights.compute().array[..., 0], tangents.compute().array, kind.squared_distance(x).compute().value


def weighted(weights: list[Exact], points: list[Exact]) -> Exact:
    """Sum of the points, entry by entry times the weights."""
    x, y, z = (sum((g[k] * p[k] for g, p in zip(weights, points, strict=True)), Fraction(0)) for k in range(3))
    return x, y, z


@pytest.mark.parametrize("name", KINDS)
def test_closest_points_and_tangent_planes(name: str) -> None:
    pairs = pairs_of(name)
    weights, tangents, squared = computed(name, pairs)
    kind = KINDS[name]
    first = np.arange(kind.arity) < kind.sides[1]  # of a point, or of the first edge
    for pair, g, basis, square in zip(pairs, weights, tangents, squared, strict=True):
        true_weights, way = exact_way(name, exact(pair))
        gap, size = float(dot(way, way)) ** 0.5, float(np.linalg.norm(np.ptp(pair, axis=0)))
        assert abs(square**0.5 - gap) < 1e-13 * size or name in LINES
        assert g[first].sum() == pytest.approx(-1.0, abs=1e-15)
        assert g.sum() == pytest.approx(0.0, abs=1e-15)
        assert np.abs(g).max() <= 1.0
        error, turned = np.abs(g - as_floats(true_weights)).max(), 0.0
        if name == "mollified_edge_edge":  # where lines are nearest is lost in their angle, but not how they are apart
            ends = exact(pair)
            u, v = minus(ends[1], ends[0]), minus(ends[3], ends[2])
            n = cross(u, v)
            angle = float(dot(n, n) / (dot(u, u) * dot(v, v))) ** 0.5
            assert error < 1e-15 * (1 / angle + gap / size / angle**2)
            found = weighted(exact(g[:, None].repeat(3, 1)), ends)
            turned = angle * min(error, 1.0) * size / gap
            assert float(dot(found, found)) ** 0.5 < gap * (1 + turned) + 1e-15 * size
        else:
            assert error < 1e-13
        np.testing.assert_allclose(basis.T @ basis, np.eye(2), atol=1e-15)
        assert np.abs(basis.T @ (as_floats(way) / gap)).max() < 1e-15 * (1 + size / gap) + turned
