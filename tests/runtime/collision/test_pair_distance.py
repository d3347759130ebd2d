"""Distances of edges, vertices and triangles against rational numbers: nearly parallel, thin, tiny, far away."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from exact_pairs import distance
from numpy.typing import NDArray
from single_pairs import PairGeometry, crossing_edges, turned, vertices_over_thin_triangles

Floats = NDArray[np.float64]

ROUNDING = 6e-16
"""Largest error of a distance whose pieces are of size 1."""
FORMULA = 1.5e-15
"""The same of a formula, over the sine of the angle that its normal comes from."""

NORMALS = {"point_triangle", "edge_edge", "mollified_edge_edge"}
ANGLES = [0.0, 1e-16, 1e-14, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0]
GAPS = [0.248, 1e-3, 1e-6, 1e-9]


@cache
def geometry(triangle: bool) -> PairGeometry:
    return PairGeometry(triangle)


def size_of(points: Floats) -> float:
    return float(np.abs(points - points[0]).max())


def check(pairs: Floats, triangle: bool) -> set[str]:
    """Compares every pair [n, 4, 3]; returns the kinds that occurred."""
    kinds = set()
    for points in pairs:
        found, kind, formula = geometry(triangle).distance(points)
        true, size, sine = distance(points, triangle), size_of(points), sine_of(points, triangle)
        # Edges within 0.01 of parallel, and thin triangles, are measured without their normal.
        allowed = ROUNDING * size * (1 if sine < 0.01 else 1 / sine)
        assert abs(found - true) <= allowed, (points.tolist(), kind, found, true)
        # A formula with a normal is off by rounding over the sine, and taken only where that is less than the distance;
        # one of ends or sides leaves out a place that is not wider than the sine, and is taken where it is the better.
        off, normal = abs(formula - true), FORMULA * size / max(sine, 1e-17)
        if kind in NORMALS:
            assert off <= FORMULA * size + min(normal, true), (points.tolist(), kind, formula, true)
        elif off > FORMULA * size:
            assert off <= 2 * sine * size, (points.tolist(), kind, formula, true)
            assert off * true <= normal * formula, (points.tolist(), kind, formula, true)
        kinds.add(kind)
    return kinds


def sine_of(points: Floats, triangle: bool) -> float:
    """Of the angle between the two edges whose cross product is the normal; 0 if one has no length."""
    first = points[2] - points[1] if triangle else points[1] - points[0]
    second = points[3] - points[1] if triangle else points[3] - points[2]
    lengths = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.linalg.norm(np.cross(first, second))) / lengths if lengths > 0 else 0.0


@pytest.mark.parametrize("angle", ANGLES)
def test_edges_at_every_angle(angle: float) -> None:
    rng = np.random.default_rng(1)
    for gap in GAPS:
        for length in (1.0, 1e-3, 1e3):
            check(crossing_edges(rng, 8, angle, gap, length=length), triangle=False)
            far = 1e3 * rng.uniform(-1, 1, (4, 1, 3))
            check(crossing_edges(rng, 4, angle, gap, length=length) + far, triangle=False)


@pytest.mark.parametrize("width", [0.0, 1e-300, 1e-16, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1.0])
def test_triangles_of_every_width(width: float) -> None:
    rng = np.random.default_rng(2)
    for gap in GAPS:
        check(vertices_over_thin_triangles(rng, 24, width, gap), triangle=True)
        far = 1e3 * rng.uniform(-1, 1, (8, 1, 3))
        check(vertices_over_thin_triangles(rng, 8, width, gap) + far, triangle=True)


@pytest.mark.parametrize("triangle", [False, True], ids=["edges", "triangle"])
@pytest.mark.parametrize("length", [1e-3, 1e-8, 1e-12, 1e-16, 1e-30, 0.0])
def test_edges_that_are_nearly_points(length: float, triangle: bool) -> None:
    rng = np.random.default_rng(3)
    pairs = rng.standard_normal((40, 4, 3))
    pairs[:, 3] = pairs[:, 2] + length * (pairs[:, 3] - pairs[:, 2])
    both = pairs.copy()
    if triangle:
        both[:, 1] = both[:, 2] + length * (both[:, 1] - both[:, 2])
    else:
        both[:, 1] = both[:, 0] + length * (both[:, 1] - both[:, 0])
    check(pairs, triangle)
    check(both, triangle)


def test_ordinary_pairs_have_every_kind() -> None:
    rng = np.random.default_rng(4)
    pairs = rng.standard_normal((150, 4, 3))
    assert check(pairs, triangle=True) == {"point_point", "point_edge", "point_triangle"}
    assert {"point_point", "point_edge", "edge_edge"} <= check(pairs, triangle=False)


def test_edges_end_behind_end_on_nearly_one_line() -> None:
    """They are 0.25 apart; their lines cross somewhere, or seem to."""
    rng = np.random.default_rng(5)
    for exponent in np.linspace(-10, -6, 9):
        across = 10.0**exponent * rng.standard_normal((20, 4, 3)) * [0, 1, 1]
        along = np.array([0.0, 1.0, 1.25, 2.5])[None, :, None] * [1, 0, 0]
        check(turned(along + across, rng), triangle=False)


@pytest.mark.nightly
def test_many_pairs() -> None:
    rng = np.random.default_rng()
    for _ in range(100):
        gap, angle = 10 ** rng.uniform(-12, 0), 10 ** rng.uniform(-17, 0.4)
        far = rng.choice([0.0, 1.0, 1e4]) * rng.uniform(-1, 1, (100, 1, 3))
        check(crossing_edges(rng, 100, angle, gap, length=10 ** rng.uniform(-6, 6)) + far, triangle=False)
        check(vertices_over_thin_triangles(rng, 100, angle, gap) + far, triangle=True)
        scales = 10 ** rng.uniform(-8, 0, (100, 4, 1))
        pairs = np.cumsum(scales * rng.standard_normal((100, 4, 3)), axis=1)
        check(pairs, triangle=False)
        check(pairs, triangle=True)
