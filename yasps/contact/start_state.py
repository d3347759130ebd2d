"""What is wrong with where bodies are before the first step: surfaces that cross, touch or lie inside each other, and
elements that are flipped.

How deep an overlap is: the largest of the distances that single pieces have to go. For a vertex on the wrong side, that
is the way to the other surface; wrong are vertices inside a solid (winding number; Van Oosterom and Strackee 1983) and
those that crossing edges cut off from most of their surface (Baraff, Witkin and Kass 2003, "Untangling cloth"). For an
edge that crosses a triangle it is the shortest translation that takes the two apart, along one of the normals of their
difference. No shorter translation of one body takes two solids apart.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from yasps import Attribute, IntersectionError
from yasps.contact.active_set import Floats, Ids
from yasps.contact.collision_geometry import CollisionGeometry
from yasps.contact.pair_forces import closest_points
from yasps.contact.solid_geometry import closest_on_triangles, shortest_exits, winding_numbers

LOGGER = logging.getLogger("yasps")
SHOWN = 8
"""So many findings of one sort are written out in a message."""
TOUCHING = 32 * float(np.finfo(np.float64).eps)
"""Gaps below this share of the largest coordinate are rounding; from there `CollisionGeometry` bounds no step."""


class StartBody(Protocol):
    """What is asked of a body; `yasps.bodies.Body` is one."""

    name: str
    rest: Floats
    triangles: Ids
    cells: Mapping[str, Ids]
    targets: tuple[Attribute, ...]
    falling: tuple[Attribute, ...]
    meets_itself: bool

    @property
    def is_fixed(self) -> bool: ...
    @property
    def position(self) -> Attribute: ...
    @property
    def mass(self) -> Attribute: ...
    def positions(self) -> Floats: ...


@dataclass(frozen=True)
class Overlap:
    """Two bodies, or one with itself, whose surfaces cross or one of which lies inside the other."""

    bodies: tuple[str, str]
    crossings: int
    """Edges that cross or touch triangles; 0 if the first body lies wholly inside the second."""
    depth: float
    """[m]: how far the deepest piece has to go."""
    where: str
    """The first edge and triangle that cross, by body and number; empty if none does."""

    def __str__(self) -> str:
        first, second = self.bodies
        if not self.crossings:
            return f"{first!r} lies wholly inside {second!r}, {self.depth:.3g} m deep"
        who = f"{first!r} crosses itself" if first == second else f"{first!r} and {second!r} overlap"
        return (
            f"{who}, {self.depth:.3g} m deep: {self.crossings} edges cross or touch triangles, the first: {self.where}"
        )


@dataclass(frozen=True)
class Touching:
    """Two bodies, or one with itself, nearer than positions are rounded."""

    bodies: tuple[str, str]
    distance: float
    """[m]"""
    where: str

    def __str__(self) -> str:
        return f"{self.bodies[0]!r} and {self.bodies[1]!r} touch, {self.distance:.1g} m apart: {self.where}"


@dataclass(frozen=True)
class Flipped:
    """Elements of a body that are turned inside out or have no size."""

    body: str
    kind: str
    """"tetrahedra" or "triangles"."""
    elements: NDArray[np.int64]
    sizes: Floats
    """[m^3] or [m^2], of these elements now."""

    def __str__(self) -> str:
        unit, what = ("m^3", "flipped or flat") if self.kind == "tetrahedra" else ("m^2", "without area")
        listed = ", ".join(
            f"{k} ({size:.3g} {unit})" for k, size in zip(self.elements[:SHOWN], self.sizes[:SHOWN], strict=True)
        )
        more = f" and {len(self.elements) - SHOWN} more" if len(self.elements) > SHOWN else ""
        return f"{len(self.elements)} {self.kind} of {self.body!r} are {what}: {listed}{more}"


@dataclass(frozen=True)
class StartState:
    """What is wrong with the present state of bodies; all lists are empty if nothing is."""

    overlaps: tuple[Overlap, ...]
    touching: tuple[Touching, ...]
    flipped: tuple[Flipped, ...]

    @property
    def is_apart(self) -> bool:
        """Is there a gap between all surfaces?"""
        return not (self.overlaps or self.touching)

    def __str__(self) -> str:
        lines: list[str] = []
        for findings in (self.overlaps, self.touching, self.flipped):
            lines += [str(finding) for finding in findings[:SHOWN]]
            if len(findings) > SHOWN:
                lines.append(f"... and {len(findings) - SHOWN} more of this sort")
        return "\n".join(lines) or "surfaces are apart, and no element is flipped"


def start_state(bodies: Sequence[StartBody]) -> StartState:
    """Looks at the present state of bodies: what crosses, touches, lies inside, is flipped. Changes nothing.

    Groups are those of `yasps.simulation`: fixed bodies may overlap each other, and stiff ones themselves. Only bodies
    of tetrahedra have an inside: a closed surface alone may be a room.
    """
    return Surfaces(bodies).state()


def check_start(bodies: Sequence[StartBody]) -> None:
    """Raises IntersectionError with all that `start_state` finds, unless all surfaces are apart; elements that are
    flipped but cross nothing are a warning on the logger `yasps`, since some materials right them."""
    state = start_state(bodies)
    if not state.is_apart:
        raise IntersectionError(
            f"the bodies are not apart at the start:\n{state}\nContact needs a gap between all surfaces."
            " yasps.contact.separate(bodies) takes small overlaps away, by moving bodies as little as possible, before"
            " the simulation is made"
        )
    for flipped in state.flipped:
        LOGGER.warning("at the start, %s", flipped)


@dataclass(frozen=True)
class WrongSide:
    """Vertices of one body on the wrong side of another's surface, and the nearest places there."""

    vertices: Ids
    """[k], of the scene."""
    corners: Ids
    """[k, 3], of the scene: the triangle of the nearest place."""
    weights: Floats
    """[k, 3]: that place is the weighted sum of the corners."""
    way: Floats
    """[k, 3] from the vertex to it [m]."""


class Surfaces:
    """The surfaces of bodies as one numbering of vertices and triangles."""

    def __init__(self, bodies: Sequence[StartBody]) -> None:
        self.bodies = list(bodies)
        self.parts = [body.positions() for body in self.bodies]
        counts = [len(part) for part in self.parts]
        self.starts = np.cumsum([0, *counts])
        self.first_triangle = np.cumsum([0, *(len(body.triangles) for body in self.bodies)])
        self.positions = np.concatenate(self.parts)
        self.triangles = np.concatenate([b.triangles + s for b, s in zip(bodies, self.starts, strict=False)])
        self.touching = TOUCHING * float(np.abs(self.positions).max(initial=1e-300))
        self.geometry = self.geometry_for(2 * self.touching)

    def geometry_for(self, distance: float) -> CollisionGeometry:
        """Collision geometry that finds pairs closer than this [m]."""
        counts = np.diff(self.starts)
        groups = [-1 if body.meets_itself else number for number, body in enumerate(self.bodies)]
        return CollisionGeometry(
            np.concatenate([body.rest for body in self.bodies]),
            self.triangles,
            distance,
            fixed=np.repeat([body.is_fixed for body in self.bodies], counts),
            group=np.repeat(groups, counts),
            objects={body.name: len(body.rest) for body in self.bodies},
        )

    def move_to(self, positions: Floats) -> None:
        """Looks at other positions [n, 3] from now on."""
        self.positions = positions
        self.parts = np.split(positions, self.starts[1:-1])

    def body_of(self, vertices: NDArray[np.integer]) -> NDArray[np.int64]:
        """Number of the body of each vertex."""
        return np.asarray(np.searchsorted(self.starts, vertices, side="right") - 1)

    def crossings(self) -> dict[tuple[int, int], tuple[Ids, Ids]]:
        """For each two bodies (smaller number first) whose surfaces cross: edges [k, 2] and triangle numbers [k]."""
        if not self.geometry.has_intersections(self.positions):
            return {}
        edges, numbers = self.geometry.crossings(self.positions)
        pairs = np.sort(np.stack([self.body_of(edges[:, 0]), self.body_of(self.triangles[numbers, 0])], 1), axis=1)
        found = {}
        for first, second in np.unique(pairs, axis=0).tolist():
            chosen = (pairs == (first, second)).all(axis=1)
            found[first, second] = edges[chosen], numbers[chosen]
        return found

    def state(self) -> StartState:
        overlaps = self.overlaps()
        crossing = {pair for overlap, pair in overlaps if overlap.crossings}
        return StartState(
            tuple(overlap for overlap, _ in overlaps), tuple(self._touching(crossing)), tuple(self.flipped())
        )

    # -- overlaps ------------------------------------------------------------------------------------------

    def overlaps(self) -> list[tuple[Overlap, tuple[int, int]]]:
        """What crosses or lies inside, with the numbers of the two bodies."""
        crossings = self.crossings()
        found = [(self._overlap(pair, *pieces), pair) for pair, pieces in crossings.items()]
        nested = [pair for pair in self.nested() if (min(pair), max(pair)) not in crossings]
        return found + [(self._inside(*pair), pair) for pair in nested]

    def nested(self) -> list[tuple[int, int]]:
        """Bodies (inner, outer) of which the outer is solid and holds some whole piece of the inner's surface."""
        boxes = [(part.min(axis=0), part.max(axis=0)) if len(part) else None for part in self.parts]
        found = []
        for outer, inner in permutations(range(len(self.bodies)), 2):
            large, small = boxes[outer], boxes[inner]
            both_fixed = self.bodies[outer].is_fixed and self.bodies[inner].is_fixed
            if large is None or small is None or both_fixed or not self.is_solid(outer):
                continue
            if (small[1] < large[0]).any() or (small[0] > large[1]).any():
                continue
            firsts = self._first_of_pieces(inner)
            points = self.parts[inner][firsts]
            points = points[((points >= large[0]) & (points <= large[1])).all(axis=1)]
            if (np.abs(winding_numbers(points, self._corners(outer))) > 0.5).any():
                found.append((inner, outer))
        return found

    def wrong_side(self, first: int, second: int, edges: Ids, numbers: Ids) -> WrongSide:
        """Vertices of the first body that are on the wrong side of the second's surface."""
        if self.is_solid(second):
            used = np.unique(self.bodies[first].triangles)
            points = self.parts[first][used]
            inside = ((points > self.parts[second].min(axis=0)) & (points < self.parts[second].max(axis=0))).all(axis=1)
            used = used[inside]
            wrong = used[np.abs(winding_numbers(points[inside], self._corners(second))) > 0.5]
        else:
            through = (self.body_of(edges[:, 0]) == first) & (self.body_of(self.triangles[numbers, 0]) == second)
            wrong = self._cut_off(first, edges[through] - self.starts[first])
        _, nearest, weights = closest_on_triangles(self.parts[first][wrong], self._corners(second))
        corners = self.bodies[second].triangles[nearest] + self.starts[second]
        way = np.einsum("kc,kcd->kd", weights, self.positions[corners]) - self.parts[first][wrong]
        return WrongSide((wrong + self.starts[first]).astype(np.int32), corners.astype(np.int32), weights, way)

    def is_solid(self, body: int) -> bool:
        """Has it an inside?"""
        return "tetra" in self.bodies[body].cells

    def _overlap(self, pair: tuple[int, int], edges: Ids, numbers: Ids) -> Overlap:
        first, second = pair
        depths = [shortest_exits(self.positions[edges], self.positions[self.triangles[numbers]])[0].max()]
        if first != second:
            sides = (self.wrong_side(a, b, edges, numbers) for a, b in (pair, pair[::-1]))
            depths += [np.linalg.norm(side.way, axis=1).max(initial=0.0) for side in sides]
        names = (self.bodies[first].name, self.bodies[second].name)
        where = f"{self._piece(edges[0].tolist())} and {self._triangle(int(numbers[0]))}"
        return Overlap(names, len(edges), float(max(depths)), where)

    def _inside(self, inner: int, outer: int) -> Overlap:
        nothing = np.empty((0, 2), np.int32), np.empty(0, np.int32)
        way = self.wrong_side(inner, outer, *nothing).way
        names = (self.bodies[inner].name, self.bodies[outer].name)
        return Overlap(names, 0, float(np.linalg.norm(way, axis=1).max(initial=0.0)), "")

    def _corners(self, body: int) -> Floats:
        return self.parts[body][self.bodies[body].triangles]

    def _labels(self, body: int, without: Ids) -> NDArray[np.int32]:
        """Connected pieces of a body's surface, by vertex, after some edges were taken away."""
        triangles, count = self.bodies[body].triangles, len(self.parts[body])
        sides = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0).astype(np.int64)
        gone = np.sort(without, axis=1).astype(np.int64) @ [count, 1]
        sides = sides[~np.isin(sides @ [count, 1], gone)]
        graph = sparse.coo_array((np.ones(len(sides)), (sides[:, 0], sides[:, 1])), shape=(count, count))
        return np.asarray(sparse.csgraph.connected_components(graph, directed=False)[1], np.int32)

    def _first_of_pieces(self, body: int) -> NDArray[np.int64]:
        """One vertex of each connected piece of its surface."""
        used = np.unique(self.bodies[body].triangles)
        labels = self._labels(body, np.empty((0, 2), np.int32))
        return np.asarray(used[np.unique(labels[used], return_index=True)[1]], np.int64)

    def _cut_off(self, body: int, edges: Ids) -> NDArray[np.int64]:
        """Vertices of a body that these edges connect to the greater part of their piece of surface."""
        whole, cut = self._labels(body, np.empty((0, 2), np.int32)), self._labels(body, edges)
        sizes = np.bincount(cut)
        largest = np.zeros(whole.max(initial=0) + 1, np.int64)
        np.maximum.at(largest, whole, sizes[cut])
        at_edges = np.zeros(len(sizes), np.bool_)
        at_edges[cut[edges.reshape(-1)]] = True
        return np.flatnonzero(at_edges[cut] & (sizes[cut] < largest[whole]))

    # -- touching and flipped ------------------------------------------------------------------------------

    def _touching(self, crossing: set[tuple[int, int]]) -> list[Touching]:
        nearest: dict[tuple[int, int], Touching] = {}
        active = self.geometry.active_set(self.positions)
        for kind, pairs in active.kinds().items():
            points = closest_points(kind, self.positions[pairs.vertices])
            distances = np.linalg.norm(points.way, axis=1)
            for vertices, distance in zip(pairs.vertices, distances.tolist(), strict=True):
                owners = np.unique(self.body_of(vertices))
                pair = (int(owners[0]), int(owners[-1]))
                if pair in crossing or (pair in nearest and nearest[pair].distance <= distance):
                    continue
                names = (self.bodies[pair[0]].name, self.bodies[pair[1]].name)
                nearest[pair] = Touching(names, distance, self._piece(vertices.tolist()))
        return list(nearest.values())

    def flipped(self) -> list[Flipped]:
        """Elements of all bodies that have no positive size."""
        found = []
        for body, x in zip(self.bodies, self.parts, strict=True):
            if "tetra" in body.cells:
                corners = x[body.cells["tetra"]]
                volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
                bad = np.flatnonzero(~(volumes > 0))
                found += [Flipped(body.name, "tetrahedra", bad, volumes[bad])] if len(bad) else []
            corners = x[body.triangles]
            areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
            bad = np.flatnonzero(~(areas > 0))
            found += [Flipped(body.name, "triangles", bad, areas[bad])] if len(bad) else []
        return found

    # -- names ---------------------------------------------------------------------------------------------

    def _piece(self, vertices: list[int]) -> str:
        """Vertices of a piece by body, such as "edge 3-7 of 'cube'"."""
        by_body: dict[int, list[str]] = {}
        for vertex in vertices:
            body = int(self.body_of(np.array([vertex]))[0])
            by_body.setdefault(body, []).append(str(vertex - int(self.starts[body])))
        kinds = ("vertex", "edge", "triangle", "vertices")
        parts = []
        for body, numbers in by_body.items():
            name = kinds[min(len(numbers), 4) - 1] if len(by_body) > 1 or len(vertices) < 4 else "vertices"
            parts.append(f"{name} {'-'.join(numbers)} of {self.bodies[body].name!r}")
        return " and ".join(parts)

    def _triangle(self, number: int) -> str:
        body = int(np.searchsorted(self.first_triangle, number, side="right") - 1)
        return f"triangle {number - int(self.first_triangle[body])} of {self.bodies[body].name!r}"
