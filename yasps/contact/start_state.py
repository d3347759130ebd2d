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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from yasps import Attribute, IntersectionError, SceneError
from yasps.contact.active_set import Floats, Ids
from yasps.contact.collision_geometry import CollisionGeometry
from yasps.contact.contact_table import ContactTable
from yasps.contact.half_spaces import Plane
from yasps.contact.pair_forces import closest_points
from yasps.contact.solid_geometry import closest_on_triangles, shortest_exits, winding_numbers
from yasps.contact.start_findings import Flipped, Overlap, StartState, Touching

LOGGER = logging.getLogger("yasps")
SOLIDS = ("tetra", "tetra10", "hexahedron")
"""Kinds of cells that have an inside."""
TOUCHING = 32 * float(np.finfo(np.float64).eps)
"""Gaps below this share of the largest coordinate are rounding; from there `CollisionGeometry` bounds no step."""


class StartBody(Protocol):
    """What is asked of a body; `yasps.bodies.Body` is one."""

    name: str
    rest: Floats
    triangles: Ids
    cells: Mapping[str, Ids]
    edges: Ids
    points: Ids
    targets: tuple[Attribute, ...]
    falling: tuple[Attribute, ...]
    meets_itself: bool

    @property
    def is_fixed(self) -> bool: ...
    @property
    def stands_still(self) -> bool: ...
    @property
    def position(self) -> Attribute: ...
    @property
    def mass(self) -> Attribute: ...
    def positions(self) -> Floats: ...
    def radii(self) -> Floats: ...


def start_state(bodies: Sequence[StartBody], table: ContactTable | None = None) -> StartState:
    """Looks at the present state of bodies: what crosses, touches, lies inside, is flipped. Changes nothing.

    Groups are those of `yasps.simulation`: bodies that stand still may overlap each other, and stiff ones themselves;
    so may those that don't meet by the table. Only bodies of tetrahedra or hexahedra have an inside: a closed surface
    alone may be a room. Raises SceneError for what are no bodies.
    """
    return Surfaces(bodies, table).state()


def check_start(bodies: Sequence[StartBody], table: ContactTable | None = None) -> None:
    """Raises IntersectionError with all that `start_state` finds, unless all surfaces are apart; elements that are
    flipped but cross nothing are a warning on the logger `yasps`, since some materials right them."""
    state = start_state(bodies, table)
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

    def __init__(self, bodies: Sequence[StartBody], table: ContactTable | None = None) -> None:
        """Raises SceneError for what are no bodies, or none with vertices."""
        self.table = ContactTable() if table is None else table
        if not isinstance(self.table, ContactTable):
            raise SceneError(f"the table is a ContactTable (yasps.contact), got {table!r}")
        if not isinstance(bodies, Sequence) or not all(hasattr(body, "rest") for body in bodies):
            raise SceneError(f"bodies are a list of bodies (yasps.bodies), got {bodies!r}")
        self.bodies = [body for body in bodies if len(body.rest)]
        if not self.bodies:
            raise SceneError("there is no body with vertices to look at")
        planes = [getattr(body, "plane", None) for body in bodies]
        self.planes: list[Plane] = [plane for plane in planes if plane is not None]
        self.parts = [body.positions() for body in self.bodies]
        counts = [len(part) for part in self.parts]
        self.starts = np.cumsum([0, *counts])
        self.first_triangle = np.cumsum([0, *(len(body.triangles) for body in self.bodies)])
        self.positions = np.concatenate(self.parts)
        placed = list(zip(self.bodies, self.starts.tolist(), strict=False))
        self.triangles = np.concatenate([body.triangles + start for body, start in placed])
        self.edges = np.concatenate([body.edges + start for body, start in placed])
        self.radii = np.concatenate([body.radii() for body in self.bodies])
        self.touching = TOUCHING * float(np.abs(self.positions).max(initial=1e-300))
        self.points = np.concatenate([body.points + start for body, start in placed])
        self._geometries: dict[float, CollisionGeometry] = {}
        self.geometry = self.geometry_for(2 * self.touching)
        self.taking_part = np.flatnonzero(self.geometry.taking_part)

    def geometry_for(self, distance: float) -> CollisionGeometry:
        """Collision geometry that finds all pairs whose gap, less the radii, is smaller than this [m]."""
        if distance in self._geometries:
            return self._geometries[distance]
        counts = np.diff(self.starts)
        groups = [-1 if body.meets_itself else number for number, body in enumerate(self.bodies)]
        self._geometries[distance] = CollisionGeometry(
            np.concatenate([body.rest for body in self.bodies]),
            self.triangles,
            distance + 2 * float(self.radii.max(initial=0.0)),
            edges=self.edges,
            points=self.points,
            fixed=np.repeat([body.stands_still for body in self.bodies], counts),
            group=np.repeat(groups, counts),
            objects={body.name: len(body.rest) for body in self.bodies},
        )
        return self._geometries[distance]

    def move_to(self, positions: Floats) -> None:
        """Looks at other positions [n, 3] from now on."""
        self.positions = positions
        self.parts = np.split(positions, self.starts[1:-1])

    def meet(self, first: str, second: str) -> bool:
        """Does the table let two bodies meet?"""
        return self.table.entry(first, second)[3]

    def in_planes(self, gap: float = 0.0) -> Iterator[tuple[int, Plane, Ids, Floats]]:
        """Bodies that may move, with vertices nearer to a half-space than the gap, or in it: which vertices of the
        scene, [k], and their gaps [k] [m], negative inside."""
        for plane, (number, body) in product(self.planes, enumerate(self.bodies)):
            if body.stands_still or not self.meet(body.name, plane.name):
                continue
            here = (self.starts[number] <= self.taking_part) & (self.taking_part < self.starts[number + 1])
            ids = self.taking_part[here]
            gaps = (self.positions[ids] - plane.point) @ np.array(plane.normal) - self.radii[ids]
            near = gaps <= gap
            if near.any():
                yield number, plane, ids[near].astype(np.int32), gaps[near]

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
            if not self.meet(self.bodies[first].name, self.bodies[second].name):
                continue
            chosen = (pairs == (first, second)).all(axis=1)
            found[first, second] = edges[chosen], numbers[chosen]
        return found

    def state(self) -> StartState:
        overlaps = self.overlaps()
        crossing = {(pair[0], pair[-1]) for overlap, pair in overlaps if not overlap.in_half_space}
        return StartState(
            tuple(overlap for overlap, _ in overlaps), tuple(self._touching(crossing)), tuple(self.flipped())
        )

    # -- overlaps ------------------------------------------------------------------------------------------

    def overlaps(self) -> list[tuple[Overlap, tuple[int, ...]]]:
        """What crosses or lies inside, with the numbers of the bodies."""
        crossings = self.crossings()
        found: list[tuple[Overlap, tuple[int, ...]]] = []
        found += [(self._overlap(pair, *pieces), pair) for pair, pieces in crossings.items()]
        nested = [pair for pair in self.nested() if (min(pair), max(pair)) not in crossings]
        found += [(self._inside(*pair), pair) for pair in nested]
        for number, plane, ids, gaps in self.in_planes():
            names, deepest = (self.bodies[number].name, plane.name), int(gaps.argmin())
            where = self._piece([int(ids[deepest])])
            found.append((Overlap(names, len(ids), -float(gaps[deepest]), where, in_half_space=True), (number,)))
        return found

    def nested(self) -> list[tuple[int, int]]:
        """Bodies (inner, outer) of which the outer is solid and holds some whole piece of the inner's surface."""
        boxes = [(part.min(axis=0), part.max(axis=0)) if len(part) else None for part in self.parts]
        found = []
        for outer, inner in permutations(range(len(self.bodies)), 2):
            large, small = boxes[outer], boxes[inner]
            both_still = self.bodies[outer].stands_still and self.bodies[inner].stands_still
            if large is None or small is None or both_still or not self.is_solid(outer):
                continue
            if not self.meet(self.bodies[outer].name, self.bodies[inner].name):
                continue
            if (small[1] < large[0]).any() or (small[0] > large[1]).any():
                continue
            firsts = self._first_of_pieces(inner)
            points = self.parts[inner][firsts]
            points = points[((points >= large[0]) & (points <= large[1])).all(axis=1)]
            if (np.abs(winding_numbers(points, self.corners_of(outer))) > 0.5).any():
                found.append((inner, outer))
        return found

    def wrong_side(self, first: int, second: int, edges: Ids, numbers: Ids) -> WrongSide:
        """Vertices of the first body that are on the wrong side of the second's surface."""
        if self.is_solid(second):
            used = self._used(first)
            points = self.parts[first][used]
            inside = ((points > self.parts[second].min(axis=0)) & (points < self.parts[second].max(axis=0))).all(axis=1)
            used = used[inside]
            wrong = used[np.abs(winding_numbers(points[inside], self.corners_of(second))) > 0.5]
        else:
            through = (self.body_of(edges[:, 0]) == first) & (self.body_of(self.triangles[numbers, 0]) == second)
            wrong = self._cut_off(first, edges[through] - self.starts[first])
        if len(self.bodies[second].triangles) == 0:
            wrong = wrong[:0]
        _, nearest, weights = closest_on_triangles(self.parts[first][wrong], self.corners_of(second))
        corners = self.bodies[second].triangles[nearest] + self.starts[second]
        way = np.einsum("kc,kcd->kd", weights, self.positions[corners]) - self.parts[first][wrong]
        return WrongSide((wrong + self.starts[first]).astype(np.int32), corners.astype(np.int32), weights, way)

    def is_solid(self, body: int) -> bool:
        """Has it an inside?"""
        return any(kind in self.bodies[body].cells for kind in SOLIDS)

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

    def corners_of(self, body: int) -> Floats:
        """Corners of a body's triangles, [m, 3, 3]."""
        return self.parts[body][self.bodies[body].triangles]

    def _labels(self, body: int, without: Ids) -> NDArray[np.int32]:
        """Connected pieces of a body's surface, by vertex, after some edges were taken away."""
        triangles, count = self.bodies[body].triangles, len(self.parts[body])
        every = np.concatenate([triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), self.bodies[body].edges])
        sides = np.unique(np.sort(every, axis=1), axis=0).astype(np.int64)
        gone = np.sort(without, axis=1).astype(np.int64) @ [count, 1]
        sides = sides[~np.isin(sides @ [count, 1], gone)]
        graph = sparse.coo_array((np.ones(len(sides)), (sides[:, 0], sides[:, 1])), shape=(count, count))
        return np.asarray(sparse.csgraph.connected_components(graph, directed=False)[1], np.int32)

    def _used(self, body: int) -> NDArray[np.int64]:
        """Vertices of a body that take part in contact, in its own numbers."""
        first, end = self.starts[body : body + 2]
        return np.asarray(self.taking_part[(first <= self.taking_part) & (self.taking_part < end)] - first, np.int64)

    def _first_of_pieces(self, body: int) -> NDArray[np.int64]:
        """One vertex of each connected piece of its surface."""
        used = self._used(body)
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
            distances, thickness = self.gaps(kind, pairs.vertices, self.positions)
            for k in np.flatnonzero(distances - thickness <= 2 * self.touching).tolist():
                vertices = pairs.vertices[k]
                owners = np.unique(self.body_of(vertices))
                pair = (int(owners[0]), int(owners[-1]))
                names = (self.bodies[pair[0]].name, self.bodies[pair[1]].name)
                if pair in crossing or not self.meet(*names):
                    continue
                if pair[0] == pair[1] and self._is_near_at_rest(kind, vertices):
                    continue
                found = Touching(names, float(distances[k]), float(thickness[k]), self._piece(vertices.tolist()))
                known = nearest.get(pair)
                if known is None or found.distance - found.thickness < known.distance - known.thickness:
                    nearest[pair] = found
        return list(nearest.values())

    def gaps(self, kind: str, vertices: Ids, positions: Floats) -> tuple[Floats, Floats]:
        """Distances [m] of close pairs of a kind, [k], and the sums of both radii there [m], [k]."""
        points = closest_points(kind, positions[vertices])
        return np.linalg.norm(points.way, axis=1), (np.abs(points.weights) * self.radii[vertices]).sum(axis=1)

    def _is_near_at_rest(self, kind: str, vertices: Ids) -> bool:
        """Are two pieces of one body thicker than their distance at rest, as neighbours on a fine mesh are?"""
        distance, thickness = self.gaps(kind, vertices[None], np.concatenate([body.rest for body in self.bodies]))
        return bool(thickness[0] > 0 and distance[0] <= thickness[0])

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
