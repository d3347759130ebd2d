"""Closest points of small pieces by brute force, in the words of their definition."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ids = tuple[int, ...]


def nearest(p: Floats, corners: Ids, x: Floats) -> tuple[float, Ids, Floats]:
    """Distance of a point and a vertex, an edge or a triangle; which of its corners the closest point is between; and
    the weights of these. Of all subsets of corners, the nearest whose own closest point is inside it."""
    best: tuple[float, Ids, Floats] = (np.inf, (), np.empty(0))
    for n in range(1, len(corners) + 1):
        for own in combinations(sorted(corners), n):
            base, *others = x[list(own)]
            spans = np.array([other - base for other in others]).reshape(-1, 3)
            weights = np.linalg.solve(spans @ spans.T, spans @ (p - base)) if n > 1 else np.empty(0)
            if n > 1 and (weights.min() <= 0 or weights.sum() >= 1):
                continue
            distance = float(np.linalg.norm(p - base - weights @ spans))
            if distance < best[0] - 1e-14:
                best = (distance, own, np.array([1 - weights.sum(), *weights]))
    return best


def nearest_of_edges(a: Ids, b: Ids, x: Floats) -> tuple[float, Floats, Floats]:
    """Distance of two edges, and the weights of the ends of each at the closest points."""
    u, v, w = x[a[1]] - x[a[0]], x[b[1]] - x[b[0]], x[b[0]] - x[a[0]]
    s, t = np.linalg.lstsq(np.column_stack([u, -v]), w, rcond=None)[0]
    if 0 < s < 1 and 0 < t < 1:
        return float(np.linalg.norm(w - s * u + t * v)), np.array([1 - s, s]), np.array([1 - t, t])
    best: tuple[float, Floats, Floats] = (np.inf, np.empty(0), np.empty(0))
    for first, second, swapped in ((a, b, False), (b, a, True)):
        for k in range(2):
            distance, own, weights = nearest(x[first[k]], second, x)
            end = np.eye(2)[k]
            other = np.zeros(2)
            other[[second.index(corner) for corner in own]] = weights
            if distance < best[0]:
                best = (distance, other, end) if swapped else (distance, end, other)
    return best
