"""Distances, formulas and step bounds of single pairs, as the runtime gives them; and pairs to try it on."""

from __future__ import annotations

import numpy as np
from collision_scenes import distances
from numpy.typing import NDArray

from yasps.contact.active_set import active_set_of
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.collision.surface_pairs import Pieces, Surface, SurfacePairs
from yasps.runtime.core.library import load_runtime

Floats = NDArray[np.float64]

_NONE = np.empty((0, 4), np.int32)
_PAIR = np.arange(4, dtype=np.int32)[None]


class PairGeometry:
    """The runtime's answers for one pair at a time; triangle: a vertex and a triangle, else two edges."""

    def __init__(self, triangle: bool) -> None:
        nothing = np.empty((0, 2), np.int32)
        pieces = Pieces(np.arange(4, dtype=np.int32), nothing, np.empty((0, 3), np.int32), nothing[:, 0], nothing)
        runtime = load_runtime(find_compiler())
        labels = np.full(4, -1, np.int32)
        self.surface = Surface(runtime, pieces, labels)
        self.pairs = SurfacePairs(_NONE, _PAIR) if triangle else SurfacePairs(_PAIR, _NONE)

    def distance(self, points: Floats) -> tuple[float, str, float]:
        """Distance of the pair [4, 3], its kind, and the distance that the formula of this kind gives."""
        points = np.ascontiguousarray(points)
        kinds, least, gap = self.surface.close_pairs(points, points, np.inf, self.pairs)
        (kind, entry), *others = [(k, e) for k, e in active_set_of(kinds, least, gap).kinds().items() if len(e) > 0]
        assert not others
        formula = distances(kind, points[entry.vertices].astype(np.complex128))
        return least, kind, float(np.sqrt(formula[0].real))

    def step_bound(self, start: Floats, end: Floats) -> float:
        first, last = np.ascontiguousarray(start), np.ascontiguousarray(end)
        step = self.surface.step_bound(first, last, first, 0.0, self.pairs)
        assert step is not None
        return step


def turned(points: Floats, rng: np.random.Generator) -> Floats:
    """Points [n, ..., 3] of n pairs, each pair turned at random."""
    turns = np.linalg.qr(rng.standard_normal((len(points), 3, 3)))[0]
    return np.einsum("nij,n...j->n...i", turns, points)


def crossing_edges(
    rng: np.random.Generator, count: int, angle: float, gap: float, *, length: float = 1.0, beyond: float = 0.3
) -> Floats:
    """[count, 4, 3]: edges of lengths 1 and `length` in two planes that are `gap` apart, at an angle; their lines
    cross on them, or up to `beyond` of their length outside."""
    places = rng.uniform(-beyond, 1 + beyond, (count, 2, 1))
    first = np.array([1.0, 0.0, 0.0])
    second = length * np.array([np.cos(angle), np.sin(angle), 0.0])
    start = -places[:, 0] * first
    other = np.array([0.0, 0.0, gap]) - places[:, 1] * second
    return turned(np.stack([start, start + first, other, other + second], axis=1), rng)


def vertices_over_thin_triangles(rng: np.random.Generator, count: int, width: float, gap: float) -> Floats:
    """[count, 4, 3]: a vertex `gap` over the plane of a triangle of length 1 and height `width`, inside or beside."""
    apex = rng.choice([0.0, 1e-9, 0.3, 1.0], count)
    zero = np.zeros(count)
    corners = np.stack(
        [np.zeros((count, 3)), np.tile([1.0, 0, 0], (count, 1)), np.stack([apex, zero + width, zero], 1)], 1
    )
    corners = np.take_along_axis(corners, rng.permuted(np.tile(np.arange(3), (count, 1)), axis=1)[..., None], axis=1)
    vertex = np.stack([rng.uniform(-0.3, 1.3, count), width * rng.uniform(-0.5, 1.5, count), zero + gap], axis=1)
    return turned(np.concatenate([vertex[:, None], corners], axis=1), rng)
