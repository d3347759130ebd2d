"""Closest points and tangent planes of every kind of close pair, against rational numbers.

Values come through a scene, as contact computes them, on pairs of all sizes, thin and nearly parallel ones too.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from exact_pairs import Exact, cross, dot, exact, minus
from numpy.typing import NDArray

from yasps import Scene
from yasps.contact import KINDS

Floats = NDArray[np.float64]
LINES = ("edge_edge", "mollified_edge_edge")


def pairs_of(name: str) -> Floats:
    """Pairs of a kind, [n, arity, 3]: its closest features are those of the kind, nearly parallel edges where they may
    be, near each other in some and at many places."""
    rng = np.random.default_rng(list(KINDS).index(name))
    pairs = []
    for number in range(60):
        height, size, place = 10.0 ** rng.uniform(-6, 0), 10.0 ** rng.uniform(-2, 1), rng.uniform(-1, 1, 3)
        angle = rng.uniform(0.1, 3.0) if name == "edge_edge" else 10.0 ** rng.uniform(-9, -2)
        s, t = rng.uniform(0.1, 0.9, 2)
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        u, v = np.array([1.0, 0.0, 0.0]), np.array([np.cos(angle), np.sin(angle), 0.0])
        up = np.array([0.0, 0.0, height])
        if name in LINES:
            pair = np.array([-s * u, (1 - s) * u, up - t * v, up + (1 - t) * v])
        elif "point_edge" in name:
            pair = np.array([up, -t * u, (1 - t) * u, up + v])
        elif name == "point_triangle":
            pair = np.array([up + 0.3 * u, 0 * u, u, np.array([0.2, rng.uniform(0.01, 1), 0.0])])
        else:
            pair = np.array([0 * u, up, u, up + v])
        pairs.append(size * pair[: KINDS[name].arity] @ turn + (number % 3) * place)
    return np.array(pairs)


def computed(name: str, pairs: Floats) -> tuple[Floats, Floats, Floats]:
    """Weights [n, arity], tangents [n, 3, 2] and squared distances [n] as a scene computes them."""
    kind = KINDS[name]
    pair = Scene("pairs").add_mesh("mesh").add_primitive("pair", len(pairs))
    x = pair.add_constant("x", kind.arity, 3, value=pairs)
    one = pair.add_constant("one", 1, 1, value=np.ones(len(pairs)))  # weights of two points are numbers of no owner
    weights, tangents = one * kind.weights(x), kind.tangents(x)
    return weights.compute().array[..., 0], tangents.compute().array, kind.squared_distance(x).compute().value


def solved(gram: list[list[Fraction]], right: list[Fraction]) -> list[Fraction]:
    """A 1x1 or 2x2 system by Cramer's rule."""
    if len(right) == 1:
        return [right[0] / gram[0][0]]
    (a, b), (c, d) = gram
    return [(right[0] * d - b * right[1]) / (a * d - b * c), (a * right[1] - right[0] * c) / (a * d - b * c)]


def exact_way(name: str, points: list[Exact]) -> tuple[list[Fraction], Exact]:
    """Weights, and the way from the closest point of the first piece to that of the second."""
    kind = KINDS[name]
    base = {1: points[1]}
    if name in LINES:
        directions = [minus(points[0], points[1]), minus(points[3], points[2])]
        offset = minus(points[2], points[0])
    else:
        ends = {"point_edge": [2], "mollified_point_edge": [2], "point_triangle": [2, 3]}.get(name, [])
        directions, offset = [minus(points[k], points[1]) for k in ends], minus(base[1], points[0])
    gram = [[dot(a, b) for b in directions] for a in directions]
    shares = solved(gram, [-dot(offset, a) for a in directions]) if directions else []
    way = offset
    for share, direction in zip(shares, directions, strict=True):
        way = (way[0] + share * direction[0], way[1] + share * direction[1], way[2] + share * direction[2])
    if name in LINES:
        return [shares[0] - 1, -shares[0], 1 - shares[1], shares[1]], way
    weights = [Fraction(-1), 1 - sum(shares, Fraction(0)), *shares]
    return weights + [Fraction(0)] * (kind.arity - len(weights)), way


def weighted(weights: list[Exact], points: list[Exact]) -> Exact:
    """Sum of the points, entry by entry times the weights."""
    x, y, z = (sum((g[k] * p[k] for g, p in zip(weights, points, strict=True)), Fraction(0)) for k in range(3))
    return x, y, z


def as_floats(numbers: list[Fraction] | Exact) -> Floats:
    return np.array([float(x) for x in numbers])


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
