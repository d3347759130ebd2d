"""Pairs of every kind of contact, and their closest points in rational numbers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from exact_pairs import Exact, dot, minus
from numpy.typing import NDArray

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


def as_floats(numbers: list[Fraction] | Exact) -> Floats:
    return np.array([float(x) for x in numbers])
