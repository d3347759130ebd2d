"""How far pairs may move: never to a contact, nearly to a tenth of their distance, and at once at any gap."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from exact_pairs import at_time, distance, squared_distance, touch_before
from numpy.typing import NDArray
from single_pairs import PairGeometry, crossing_edges, turned

Floats = NDArray[np.float64]
Way = tuple[Floats, Floats]

GAPS = [1e-3, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12]
KEPT = 0.1
SLACK = 2e-15
"""What rounding of positions of size 1 to 3 takes off a distance at most."""
LONGEST = 1e-3
"""Seconds a pair may take; it takes some 1e-5."""


@cache
def geometry(triangle: bool) -> PairGeometry:
    return PairGeometry(triangle)


def check(way: Way, triangle: bool) -> float:
    """Looks at start and end [4, 3] of one pair, and returns the bound."""
    start, end = way
    took = np.inf
    for _ in range(3):  # others may be using the processor
        begun = time.perf_counter()
        bound = geometry(triangle).step_bound(start, end)
        took = min(took, time.perf_counter() - begun)
        if took < LONGEST:
            break
    assert took < LONGEST
    assert 0 < bound <= 1
    gap = distance(start, triangle)
    assert not touch_before(start, end, bound, triangle), (start.tolist(), end.tolist(), bound)
    places = [start + share * bound * (end - start) for share in np.linspace(0, 1, 8)]
    least = min(geometry(triangle).distance(place)[0] for place in places)
    assert least >= KEPT * gap - SLACK, (start.tolist(), end.tolist(), bound)
    if bound < 1:
        left = float(squared_distance(at_time(start, end, bound), triangle)) ** 0.5
        assert left <= 1.015 * KEPT * gap + 10 * SLACK, (start.tolist(), end.tolist(), bound)
    return bound


def moved(points: Floats, way: Floats, rng: np.random.Generator) -> list[Way]:
    """Pairs and where they go, turned at random."""
    both = turned(np.stack([points, way], axis=1), rng)
    return [(start, start + move) for start, move in both]


def vertices_over_triangles(rng: np.random.Generator, count: int, gap: float) -> Floats:
    """[count, 4, 3]: vertices over the middle of triangles in the plane z = 0."""
    corners = rng.uniform(-1, 1, (count, 3, 3)) * [1, 1, 0]
    return np.concatenate([corners.mean(axis=1, keepdims=True) + np.array([0, 0, gap]), corners], axis=1)


def edges_across(rng: np.random.Generator, count: int, gap: float) -> Floats:
    """[count, 4, 3]: edges in z = 0 and z = gap that cross at angles from 1e-9 to 2, or are parallel."""
    angles = np.concatenate([10 ** rng.uniform(-9, 0.3, count - 2), [0.0, 0.0]])
    rows = [flat_edges(rng, angle, gap) for angle in angles]
    return np.stack(rows)


def flat_edges(rng: np.random.Generator, angle: float, gap: float) -> Floats:
    places = rng.uniform(0.1, 0.9, (2, 1))
    first, second = np.array([1.0, 0, 0]), np.array([np.cos(angle), np.sin(angle), 0])
    start, other = -places[0] * first, [0, 0, gap] - places[1] * second
    return np.stack([start, start + first, other, other + second])


def one_side(points: Floats, triangle: bool) -> Floats:
    """1 for the vertices of the second piece, else 0; for [n, 4, 3]."""
    return np.array([0.0, 1, 1, 1] if triangle else [0.0, 0, 1, 1])[None, :, None] + 0 * points


def slide(points: Floats, triangle: bool, rng: np.random.Generator) -> Floats:
    """One piece moves by some 0.3 along the other."""
    return 0.3 * rng.uniform(-1, 1, (len(points), 1, 3)) * [1, 1, 0] * one_side(points, triangle)


def in_plane(points: Floats, triangle: bool, rng: np.random.Generator) -> Floats:
    """Every vertex slides by itself."""
    return rng.standard_normal(points.shape) * [1, 1, 0]


def about_the_vertex(points: Floats, triangle: bool, rng: np.random.Generator) -> Floats:
    """One piece turns about where it nearly touches: a see-saw."""
    axis = 0.3 * rng.standard_normal((len(points), 1, 3))
    near = points[:, :1] if triangle else np.zeros((len(points), 1, 3))
    return np.cross(axis, points - near) * one_side(points, triangle)


def at_random(points: Floats, triangle: bool, rng: np.random.Generator) -> Floats:
    return 0.3 * rng.standard_normal(points.shape)


def a_little(points: Floats, triangle: bool, rng: np.random.Generator) -> Floats:
    """By a few gaps."""
    gap = abs(points[0, 0, 2] - points[0, -1, 2])
    return 3 * gap * rng.standard_normal(points.shape)


def along_and_a_little(points: Floats, triangle: bool, rng: np.random.Generator) -> Floats:
    return in_plane(points, triangle, rng) + a_little(points, triangle, rng)


MOTIONS: list[Callable[[Floats, bool, np.random.Generator], Floats]] = [
    slide,
    in_plane,
    about_the_vertex,
    at_random,
    a_little,
    along_and_a_little,
]


@pytest.mark.parametrize("triangle", [False, True], ids=["edges", "triangle"])
@pytest.mark.parametrize("gap", GAPS)
def test_pairs_at_every_gap(gap: float, triangle: bool) -> None:
    rng = np.random.default_rng(1)
    stopped = 0
    for motion in MOTIONS:
        points = vertices_over_triangles(rng, 5, gap) if triangle else edges_across(rng, 5, gap)
        bounds = [check(way, triangle) for way in moved(points, motion(points, triangle, rng), rng)]
        stopped += sum(bound < 1 for bound in bounds)
        if motion in (slide, in_plane):
            assert min(bounds) == 1.0  # sliding is no approach
    assert stopped > 3


@pytest.mark.parametrize("triangle", [False, True], ids=["edges", "triangle"])
@pytest.mark.parametrize("share", [0.5, 2.0])
def test_sliding_and_approaching_stops_where_a_tenth_is_left(share: float, triangle: bool) -> None:
    rng = np.random.default_rng(2)
    for gap in GAPS:
        points = vertices_over_triangles(rng, 3, gap) if triangle else edges_across(rng, 4, gap)
        down = share * gap * (1 if triangle else -1)
        way = 0.01 * slide(points, triangle, rng) + [0, 0, down] * one_side(points, triangle)
        for pair in moved(points, way, rng):
            bound = check(pair, triangle)
            if share < 0.9:
                assert bound == 1.0
            elif triangle:
                assert bound == pytest.approx(0.9 / share, rel=1e-2 + SLACK / gap)


def test_triangles_that_balance_on_a_vertex_turn_freely() -> None:
    """The distance of the plane grows smaller only with the cosine of the angle."""
    rng = np.random.default_rng(3)
    for gap in GAPS:
        points = vertices_over_triangles(rng, 5, gap)
        axis = 0.3 * rng.uniform(-1, 1, (5, 1, 3)) * [1, 1, 0]
        middle = points[:, 1:].mean(axis=1, keepdims=True)
        way = np.cross(axis, points - middle) * one_side(points, True)
        assert [check(pair, True) for pair in moved(points, way, rng)] == [1.0] * 5


def test_thin_and_tiny_pieces() -> None:
    rng = np.random.default_rng(4)
    for gap in (1e-6, 1e-12):
        for width in (1e-1, 1e-6, 1e-11, 0.0):
            points = vertices_over_triangles(rng, 3, gap)
            points[:, 3] = points[:, 2] + width * (points[:, 3] - points[:, 2])
            points[:, 0] = points[:, 1:].mean(axis=1) + np.array([0, 0, gap])
            edges = edges_across(rng, 3, gap)
            edges[:, 3] = edges[:, 2] + width * (edges[:, 3] - edges[:, 2])
            for motion in (in_plane, at_random):
                for pair in moved(points, motion(points, True, rng), rng):
                    check(pair, True)
                for pair in moved(edges, motion(edges, False, rng), rng):
                    check(pair, False)


def test_pairs_that_move_together_fast() -> None:
    rng = np.random.default_rng(5)
    for gap in (1e-2, 1e-6):
        points = edges_across(rng, 6, gap)
        way = a_little(points, False, rng)
        alone = [geometry(False).step_bound(start, start + move) for start, move in zip(points, way, strict=True)]
        together = [
            geometry(False).step_bound(start, start + move + [20.0, -30.0, 10.0])
            for start, move in zip(points, way, strict=True)
        ]
        assert together == pytest.approx(alone, rel=1e-12 / gap)


def test_numbers_that_overflow_do_not_make_a_way_free() -> None:
    points = crossing_edges(np.random.default_rng(6), 1, 1.0, 0.1, beyond=-0.1)[0]
    for far in (1e150, 1e300):
        end = points.copy()
        end[2:] *= -far
        assert 0 <= geometry(False).step_bound(points, end) < 1
    end[2:] = -1.7e308  # sums of two overflow
    assert geometry(False).step_bound(points, end) == 0


@pytest.mark.nightly
def test_many_pairs() -> None:
    rng = np.random.default_rng()
    for _ in range(25):
        gap = 10 ** rng.uniform(-12, -1)
        for triangle in (False, True):
            for motion in MOTIONS:
                points = vertices_over_triangles(rng, 20, gap) if triangle else edges_across(rng, 20, gap)
                for pair in moved(points, motion(points, triangle, rng), rng):
                    check(pair, triangle)
