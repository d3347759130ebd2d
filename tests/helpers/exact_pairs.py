"""Two edges, or a vertex and a triangle, in rational numbers: distances and times of contact without rounding.

Points are arrays [4, 3]: edge by edge, or the vertex first. Every float is a rational number, and is taken as that.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import comb

import mpmath
import numpy as np
from numpy.typing import NDArray

Exact = tuple[Fraction, Fraction, Fraction]
Floats = NDArray[np.float64]

_DIGITS = 60
_CONTACT = Fraction(1, 10**40)
"""Squared distance below which pieces touch at a time that is known to 60 digits."""


def exact(points: Floats) -> list[Exact]:
    """The points as rational numbers."""
    return [(Fraction(x), Fraction(y), Fraction(z)) for x, y, z in points.tolist()]


def minus(a: Exact, b: Exact) -> Exact:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def dot(a: Exact, b: Exact) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Exact, b: Exact) -> Exact:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def squared_to_edge(p: Exact, a: Exact, b: Exact) -> Fraction:
    edge, offset = minus(b, a), minus(p, a)
    along, length = dot(edge, offset), dot(edge, edge)
    if along <= 0:
        return dot(offset, offset)
    if along >= length:
        rest = minus(p, b)
        return dot(rest, rest)
    area = cross(offset, edge)
    return dot(area, area) / length


def squared_of_edges(p: Sequence[Exact]) -> Fraction:
    """Squared distance of edges 0 1 and 2 3."""
    ends = [(p[0], p[2], p[3]), (p[1], p[2], p[3]), (p[2], p[0], p[1]), (p[3], p[0], p[1])]
    best = min(squared_to_edge(*part) for part in ends)
    u, v, w = minus(p[1], p[0]), minus(p[3], p[2]), minus(p[0], p[2])
    normal = cross(u, v)
    size = dot(normal, normal)
    if 0 < dot(normal, cross(v, w)) < size and 0 < dot(normal, cross(u, w)) < size:
        best = min(best, dot(normal, w) ** 2 / size)
    return best


def squared_of_triangle(p: Sequence[Exact]) -> Fraction:
    """Squared distance of vertex 0 and triangle 1 2 3."""
    sides = [(p[1], p[2]), (p[2], p[3]), (p[3], p[1])]
    best = min(squared_to_edge(p[0], a, b) for a, b in sides)
    normal = cross(minus(p[2], p[1]), minus(p[3], p[1]))
    size = dot(normal, normal)
    if size > 0 and all(dot(cross(normal, minus(b, a)), minus(p[0], a)) > 0 for a, b in sides):
        best = min(best, dot(normal, minus(p[0], p[1])) ** 2 / size)
    return best


def squared_distance(points: Sequence[Exact], triangle: bool) -> Fraction:
    return squared_of_triangle(points) if triangle else squared_of_edges(points)


def distance(points: Floats, triangle: bool) -> float:
    """The exact distance, rounded once."""
    with mpmath.workdps(_DIGITS):
        square = squared_distance(exact(points), triangle)
        return float(mpmath.sqrt(mpmath.mpf(square.numerator) / square.denominator))


def at_time(start: Floats, end: Floats, time: float | Fraction) -> list[Exact]:
    """Where points are that move straight from start at 0 to end at 1."""
    t = Fraction(time)
    return [
        (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]))
        for a, b in zip(exact(start), exact(end), strict=True)
    ]


def touch_before(start: Floats, end: Floats, time: float, triangle: bool) -> bool:
    """Whether the pieces meet at a time up to `time`, when all four points are in one plane.

    If they are so all the time, forty times are looked at.
    """
    first, last = exact(start), exact(end)
    sides = [minus(p, first[0]) for p in first[1:]]
    ways = [minus(minus(q, last[0]), side) for q, side in zip(last[1:], sides, strict=True)]
    volume = [Fraction(0)] * 4  # of the box of the three sides, a cubic of time
    for moved in range(8):
        columns = [ways[k] if moved >> k & 1 else sides[k] for k in range(3)]
        volume[moved.bit_count()] += dot(columns[0], cross(columns[1], columns[2]))
    if not any(volume):
        times = [Fraction(time) * k / 40 for k in range(41)]
    elif _has_one_sign(volume, Fraction(time)):
        return False
    else:
        times = [root for root in _roots(volume) if 0 <= root <= Fraction(time)]
    return any(squared_distance(at_time(start, end, t), triangle) < _CONTACT for t in times)


def _has_one_sign(cubic: Sequence[Fraction], end: Fraction) -> bool:
    """Whether all Bezier coefficients on [0, end] have, so that there is no root."""
    scaled = [c * end**k for k, c in enumerate(cubic)]
    points = [sum(scaled[k] * Fraction(comb(i, k), comb(3, k)) for k in range(i + 1)) for i in range(4)]
    return all(b > 0 for b in points) or all(b < 0 for b in points)


def _roots(polynomial: Sequence[Fraction]) -> list[Fraction]:
    """Real roots to many digits."""
    coefficients = list(polynomial)
    while coefficients[-1] == 0:
        coefficients.pop()
    with mpmath.workdps(_DIGITS):
        largest = max(map(abs, coefficients))
        scaled = [mpmath.mpf((c / largest).numerator) / (c / largest).denominator for c in reversed(coefficients)]
        roots = mpmath.polyroots(scaled, maxsteps=500, extraprec=400) if len(scaled) > 1 else []
        real = [mpmath.re(root) for root in roots if abs(mpmath.im(root)) < mpmath.mpf(10) ** -25]
        return [_fraction(root) for root in real]


def _fraction(value: mpmath.mpf) -> Fraction:
    sign, mantissa, exponent, _ = value._mpf_
    return (-1 if sign else 1) * int(mantissa) * Fraction(2) ** exponent
