"""What has to part, and in which direction: inequalities n . (sum of g_i x_i) >= level between pieces of surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps.contact.active_set import Floats, Ids
from yasps.contact.kinds import KINDS
from yasps.contact.pair_forces import closest_points
from yasps.contact.solid_geometry import ray_lengths, shortest_exits
from yasps.contact.start_state import Surfaces

MORE = 1.02
"""The gap aimed at, in gaps wished for: the quadratic program leaves a little undone."""
KEPT = 2.0
"""A direction in which two bodies were parted before is taken again unless another is shorter by this factor."""
DIRECTIONS = 24
"""So many directions are tried, at most, for two bodies that cross."""
RAYS = 64
"""For so many vertices, at most."""


@dataclass(frozen=True)
class Inequalities:
    """k of them: n . (sum of g_i x_i) >= level, n a unit vector, g the weights of vertices of the scene."""

    vertices: NDArray[np.integer]
    """[k, m]"""
    weights: Floats
    """[k, m]"""
    normals: Floats
    """[k, 3]"""
    levels: Floats
    """[k] [m]"""


class Translations:
    """Inequalities between bodies as wholes: of two that cross the shortest way out along one direction."""

    def __init__(self, surfaces: Surfaces) -> None:
        self.surfaces = surfaces
        self._directions: dict[tuple[int, int], list[Floats]] = {}

    def look(self, gap: float) -> list[Inequalities]:
        """Of the present positions; none if bodies are apart. What a body does to itself is left out."""
        surfaces = self.surfaces
        crossings = {pair: pieces for pair, pieces in surfaces.crossings().items() if pair[0] != pair[1]}
        found = [self._between(pair, *self._way_out(pair, *pieces, gap)) for pair, pieces in crossings.items()]
        nearest: dict[tuple[int, int], tuple[float, Floats]] = {}
        for pairs in near_pairs(surfaces, gap):
            for k in np.flatnonzero(pairs.distance > 0).tolist():
                first, second = pairs.bodies[k].tolist()
                pair, sign = (min(first, second), max(first, second)), 1.0 if first < second else -1.0
                if pair not in crossings and pairs.gap[k] < nearest.get(pair, (np.inf, None))[0]:
                    nearest[pair] = float(pairs.gap[k]), sign * pairs.direction[k]
        found += [self._between(pair, MORE * gap - left, n) for pair, (left, n) in nearest.items()]
        for body, plane, ids, gaps in surfaces.in_planes(gap):
            if gaps.min() < gap:
                del ids
                place = surfaces.starts[[body]][None]
                normal = np.array(plane.normal)
                level = normal @ surfaces.positions[place[0, 0]] + MORE * gap - gaps.min()
                found.append(Inequalities(place, np.ones((1, 1)), normal[None], np.array([level])))
        return found

    def _way_out(self, pair: tuple[int, int], edges: Ids, numbers: Ids, gap: float) -> tuple[float, Floats]:
        """How far, and along which direction, the first of two crossing bodies leaves the second.

        Vertices on the wrong side go straight on to the other surface; edges that cross without such a vertex go off
        their triangle.
        """
        surfaces = self.surfaces
        corners = surfaces.triangles[numbers]
        first, second = (surfaces.wrong_side(a, b, edges, numbers) for a, b in (pair, pair[::-1]))
        wrong = np.concatenate([first.vertices, second.vertices])
        left = ~np.isin(np.column_stack([edges, corners]), wrong).any(axis=1)
        x = surfaces.positions[corners]
        outwards = [first.way, -second.way, np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])]
        known = self._directions.setdefault(pair, [])
        tried = np.concatenate([np.array(known).reshape(-1, 3), _spread(np.concatenate([*outwards, -outwards[2]]))])
        straight = [
            self._straight_ways(first.vertices, tried, pair[1]),
            self._straight_ways(second.vertices, -tried, pair[0]),
            self._off_triangles(pair[0], edges[left], corners[left], tried),
        ]
        ways = np.concatenate(straight).max(axis=0)
        if not np.isfinite(ways).any():
            ways = self._off_triangles(pair[0], edges, corners, tried).max(axis=0)
        best = int(np.argmin(np.where(np.arange(len(ways)) < len(known), ways / KEPT, ways)))
        if best >= len(known):
            known.append(tried[best])
        thick = surfaces.radii[edges].max() + surfaces.radii[corners].max()
        return float(ways[best] + MORE * gap + thick), tried[best]

    def _straight_ways(self, vertices: Ids, directions: Floats, body: int) -> Floats:
        """From some of the vertices along each direction to the surface of a body, [k, directions] [m]."""
        chosen = vertices[np.linspace(0, len(vertices) - 1, min(len(vertices), RAYS)).astype(int)]
        return ray_lengths(self.surfaces.positions[chosen], directions, self.surfaces.corners_of(body))

    def _off_triangles(self, first: int, edges: Ids, corners: Ids, directions: Floats) -> Floats:
        """How far the first body has to go along each direction until edges are off triangles, [k, directions] [m]."""
        surfaces = self.surfaces
        along = [np.einsum("kcd,nd->kcn", surfaces.positions[ids], directions) for ids in (edges, corners)]
        mine = (surfaces.body_of(edges[:, 0]) == first)[:, None]
        onwards, back = along[1].max(axis=1) - along[0].min(axis=1), along[0].max(axis=1) - along[1].min(axis=1)
        return np.asarray(np.where(mine, onwards, back), np.float64)

    def _between(self, pair: tuple[int, int], way: float, direction: Floats) -> Inequalities:
        """The first body has to go so far along the direction, seen from the second [m]."""
        places = self.surfaces.starts[list(pair)]
        first, second = self.surfaces.positions[places]
        level = direction @ (first - second) + way
        return Inequalities(places[None], np.array([[1.0, -1.0]]), direction[None], np.array([level]))


class Bendings:
    """Inequalities between single pieces: vertices on the wrong side, edges that cross triangles, close pairs."""

    def __init__(self, surfaces: Surfaces) -> None:
        self.surfaces = surfaces

    def look(self, gap: float) -> list[Inequalities]:
        """Of the present positions; none if bodies are apart and cross nothing, not even themselves."""
        surfaces = self.surfaces
        crossings = surfaces.crossings()
        found = [part for pair, pieces in crossings.items() for part in self._crossing(pair, *pieces, gap)]
        for pairs in near_pairs(surfaces, gap):
            crossing = np.array([(min(pair), max(pair)) in crossings for pair in pairs.bodies.tolist()], bool)
            chosen = ~crossing & (pairs.distance > 0)
            found.append(
                self._apart(pairs.vertices[chosen], pairs.weights[chosen], pairs.direction[chosen], MORE * gap)
            )
        for _, plane, ids, gaps in surfaces.in_planes(gap):
            near = ids[gaps < gap]
            normal = np.array(plane.normal)
            least = MORE * gap + float(normal @ plane.point)
            found.append(self._apart(near[:, None], np.ones((len(near), 1)), np.tile(normal, (len(near), 1)), least))
        return [part for part in found if len(part.levels)]

    def _crossing(self, pair: tuple[int, int], edges: Ids, numbers: Ids, gap: float) -> Iterator[Inequalities]:
        surfaces, least = self.surfaces, MORE * gap
        seen = [np.empty(0, np.int32)]
        for first, second in (pair, pair[::-1]) if pair[0] != pair[1] else ():
            side = surfaces.wrong_side(first, second, edges, numbers)
            length = np.linalg.norm(side.way, axis=1, keepdims=True)
            chosen = length[:, 0] > surfaces.touching
            vertices = np.column_stack([side.vertices, side.corners])[chosen]
            weights = np.column_stack([np.ones(len(side.weights)), -side.weights])[chosen]
            yield self._apart(vertices, weights, (side.way / np.maximum(length, 1e-300))[chosen], least)
            seen.append(side.vertices[chosen])
        corners = surfaces.triangles[numbers]
        left = ~np.isin(np.column_stack([edges, corners]), np.concatenate(seen)).any(axis=1)
        yield self._apart(*_parting(surfaces.positions, edges[left], corners[left]), least)

    def _apart(self, vertices: NDArray[np.integer], weights: Floats, normals: Floats, least: float) -> Inequalities:
        """Pieces have to be so far from each other, and by their radii more."""
        thickness = (np.abs(weights) * self.surfaces.radii[vertices]).sum(axis=1)
        return Inequalities(vertices, weights, normals, least + thickness)


@dataclass(frozen=True)
class NearPairs:
    """Pairs of pieces of different bodies, k of one kind."""

    vertices: Ids
    weights: Floats
    """[k, arity]: the sum of g_i x_i leads from the second piece to the first."""
    bodies: NDArray[np.int64]
    """[k, 2]"""
    distance: Floats
    gap: Floats
    """The distance less the radii."""
    direction: Floats
    """[k, 3]: unit vector from the second piece to the first."""


def near_pairs(surfaces: Surfaces, gap: float) -> Iterator[NearPairs]:
    """Pairs of different bodies that meet and are nearer than the gap, by kind."""
    for name, pairs in surfaces.geometry_for(gap).active_set(surfaces.positions).kinds().items():
        vertices = pairs.vertices
        points = closest_points(name, surfaces.positions[vertices])
        distance, thickness = surfaces.gaps(name, vertices, surfaces.positions)
        bodies = surfaces.body_of(vertices[:, list(KINDS[name].sides)])
        names = [[surfaces.bodies[k].name for k in pair] for pair in bodies.tolist()]
        meet = np.array([first != second and surfaces.meet(first, second) for first, second in names], bool)
        near = meet & (distance - thickness < gap)
        yield NearPairs(
            vertices[near],
            -points.weights[near],
            bodies[near],
            distance[near],
            (distance - thickness)[near],
            (-points.way / np.maximum(distance, 1e-300)[:, None])[near],
        )


def _parting(positions: Floats, edges: Ids, triangles: Ids) -> tuple[Ids, Floats, Floats]:
    """Vertices [k, 5], weights and directions that take edges off the triangles that they cross, the shortest way."""
    ends, corners = positions[edges], positions[triangles]
    _, direction = shortest_exits(ends, corners)
    place = _crossing_weights(ends, corners)
    along = np.concatenate([np.einsum("kcd,kd->kc", part, direction) for part in (ends, corners)], axis=1)
    size = np.abs(along).max(axis=1, keepdims=True, initial=1e-300)
    size = np.maximum(np.ptp(along, axis=1, keepdims=True), 1e-12 * size)
    last = np.concatenate(
        [along[:, :2].min(axis=1, keepdims=True)] * 2 + [along[:, 2:].max(axis=1, keepdims=True)] * 3, 1
    )
    weights = np.where(np.abs(along - last) <= 1e-9 * size, np.maximum(place, 1e-6), 0.0)
    weights[:, :2] /= weights[:, :2].sum(axis=1, keepdims=True)
    weights[:, 2:] /= -weights[:, 2:].sum(axis=1, keepdims=True)
    return np.concatenate([edges, triangles], axis=1), weights, direction


def _crossing_weights(ends: Floats, corners: Floats) -> NDArray[np.float64]:
    """Weights [k, 5] of the ends and corners in the place where edge and triangle cross."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = np.einsum("kcd,kd->kc", ends - corners[:, :1], normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(heights[:, 0] / (heights[:, 0] - heights[:, 1]), nan=0.5)
        share = np.clip(share, 0.0, 1.0)[:, None]
        place = (1 - share) * ends[:, 0] + share * ends[:, 1]
        areas = np.stack(
            [
                np.einsum("kd,kd->k", np.cross(q - place, r - place), normal)
                for q, r in (
                    (corners[:, 1], corners[:, 2]),
                    (corners[:, 2], corners[:, 0]),
                    (corners[:, 0], corners[:, 1]),
                )
            ],
            axis=1,
        )
        weights = np.nan_to_num(areas / np.einsum("kd,kd->k", normal, normal)[:, None], nan=1 / 3)
    return np.asarray(np.concatenate([1 - share, share, weights], axis=1), np.float64)


def _spread(ways: Floats) -> Floats:
    """Unit vectors along ways [k, 3], like ones once and at most so many as are tried."""
    units = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-300)
    units = units[np.unique(np.round(units, 1), axis=0, return_index=True)[1]]
    units = units[np.linalg.norm(units, axis=1) > 0.5]
    units = units[np.linspace(0, len(units) - 1, min(len(units), DIRECTIONS)).astype(int)]
    return np.asarray(units, np.float64)
