"""Points and solids: winding numbers, nearest points of surfaces, and shortest ways out of a crossing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yasps.contact.active_set import Floats

_EDGE = 1e-9
"""A ray that passes a triangle this near, in its own coordinates, hits it: none slips between two."""
_AT_ONCE = 2_000_000
"""Pairs of a point and a triangle that are looked at together, for memory."""


def winding_numbers(points: Floats, corners: Floats) -> Floats:
    """How often a closed surface of triangles [m, 3, 3] goes round each point, [k]: 0 outside, 1 or -1 inside.

    The sum of solid angles over 4 pi (Van Oosterom and Strackee 1983, eq. 8).
    """
    found = np.zeros(len(points))
    for chosen in _chunks(len(points), len(corners)):
        a, b, c = (corners[None, :, k] - points[chosen, None] for k in range(3))
        la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
        volume = np.einsum("kmd,kmd->km", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("kmd,kmd->km", x, y) for x, y in ((a, b), (b, c), (c, a)))
        found[chosen] = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum(axis=1) / (2 * np.pi)
    return found


def closest_on_triangles(points: Floats, corners: Floats) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Of each point [k, 3] the distance to the nearest of the triangles [m, 3, 3], [k]; that triangle's number, [k];
    and the weights of its corners in the nearest place, [k, 3]."""
    distance, number, weights = (
        np.full(len(points), np.inf),
        np.zeros(len(points), np.int64),
        np.zeros((len(points), 3)),
    )
    for chosen in _chunks(len(points), len(corners)):
        best = np.full((len(points[chosen]), len(corners)), np.inf)
        shares = np.zeros((*best.shape, 3))
        for candidate in _places(points[chosen, None], corners[None]):
            gap = points[chosen, None] - np.einsum("kmc,mcd->kmd", candidate, corners)
            squared = np.einsum("kmd,kmd->km", gap, gap)
            better = squared < best
            best[better], shares[better] = squared[better], candidate[better]
        nearest = best.argmin(axis=1)
        rows = np.arange(len(nearest))
        distance[chosen], number[chosen] = np.sqrt(best[rows, nearest]), nearest
        weights[chosen] = shares[rows, nearest]
    return distance, number, weights


def _places(point: Floats, corners: Floats) -> list[Floats]:
    """Weights of the foot of the perpendicular, where it is inside the triangle, and of the nearest places of its
    sides: the nearest of the triangle is one of these."""
    found = []
    a, b, c = (corners[:, :, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.einsum("kmd,kmd->km", normal, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = [
            np.einsum("kmd,kmd->km", np.cross(q - p, point - p), np.broadcast_to(normal, np.shape(point - p))) / squared
            for p, q in ((b, c), (c, a), (a, b))
        ]
        foot = np.stack(inside, axis=-1)
        outside = ~(foot >= 0).all(axis=-1)
        foot[outside] = [1.0, 0.0, 0.0]
        found.append(foot)
        for first, second in ((0, 1), (1, 2), (2, 0)):
            start, side = corners[:, :, first], corners[:, :, second] - corners[:, :, first]
            along = np.einsum("kmd,kmd->km", point - start, np.broadcast_to(side, np.shape(point - start)))
            share = np.nan_to_num(np.clip(along / np.einsum("kmd,kmd->km", side, side), 0.0, 1.0))
            place = np.zeros((*share.shape, 3))
            place[..., first], place[..., second] = 1 - share, share
            found.append(place)
    return found


def ray_lengths(points: Floats, directions: Floats, corners: Floats) -> Floats:
    """How far it is from each point [k, 3] along each unit direction [n, 3] to the first triangle [m, 3, 3], [k, n];
    infinite where there is none (Moller and Trumbore 1997)."""
    found = np.full((len(points), len(directions)), np.inf)
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    for j, direction in enumerate(directions):
        p = np.cross(direction, v)
        with np.errstate(divide="ignore"):
            inverse = 1.0 / np.einsum("md,md->m", u, p)
        for chosen in _chunks(len(points), len(corners)):
            s = points[chosen, None] - a
            q = np.cross(s, u)
            with np.errstate(invalid="ignore"):
                x = np.einsum("kmd,md->km", s, p) * inverse
                y = (q @ direction) * inverse
                length = np.einsum("kmd,md->km", q, v) * inverse
                hit = (x >= -_EDGE) & (y >= -_EDGE) & (x + y <= 1 + _EDGE) & (length >= 0) & np.isfinite(length)
            found[chosen, j] = np.where(hit, length, np.inf).min(axis=1, initial=np.inf)
    return found


def shortest_exits(edges: Floats, triangles: Floats) -> tuple[Floats, Floats]:
    """Length [k] and unit direction [k, 3] of the shortest translation of each edge [k, 2, 3] that takes it off its
    triangle [k, 3, 3], which it crosses.

    Their difference is a prism with five faces; the way out is along the normal of the nearest one.
    """
    length, direction = np.full(len(edges), np.inf), np.zeros((len(edges), 3))
    along = edges[:, 1] - edges[:, 0]
    sides = np.roll(triangles, -1, axis=1) - triangles
    normals = [np.cross(sides[:, 0], sides[:, 1]), *(np.cross(along, sides[:, k]) for k in range(3))]
    for normal in normals:
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        unit = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
        for n in (unit, -unit):
            way = np.einsum("kcd,kd->kc", triangles, n).max(axis=1) - np.einsum("kcd,kd->kc", edges, n).min(axis=1)
            better = (size[:, 0] > 0) & (way < length)
            length[better], direction[better] = way[better], n[better]
    length[~np.isfinite(length)] = 0.0
    return np.maximum(length, 0.0), direction


def _chunks(points: int, triangles: int) -> list[slice]:
    size = max(1, _AT_ONCE // max(triangles, 1))
    return [slice(k, k + size) for k in range(0, points, size)]
