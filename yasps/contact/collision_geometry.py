"""Which surface pieces of a scene are close, and how far a step may go.

The runtime finds candidate pairs, the active set and collision-free step sizes; the IPC Toolkit looks for
intersections. No energy is evaluated here: the barrier is an ordinary yasps energy over the index arrays of
:class:`ActiveSet`, one formula per array.

Conventions: positions are float64 [n, 3] over *all* vertices of the scene (the union of its meshes), in the
user's length unit; every vertex id taken or returned counts in that numbering; distances are plain, not
squared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Never

import ipctk
import numpy as np
from numpy.typing import ArrayLike

from yasps import DataError, IntersectionError, SceneError
from yasps.contact.active_set import ActiveSet, Floats, Ids, active_set_of
from yasps.contact.surface_arguments import (
    checked_ids,
    checked_length,
    checked_points,
    first_not_finite,
    labels_of_filter,
    ranges_of_objects,
)
from yasps.frontend.language.arrays import positive_number, real_numbers
from yasps.meshes import TetrahedralMesh
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.collision.surface_pairs import Surface, SurfacePairs
from yasps.runtime.core.library import Runtime, load_runtime
from yasps.runtime.core.uncopied import Uncopied

_ROUNDING = 8 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Candidates:
    """Pairs that may come closer than `distance` while each vertex is within `margin` of its place on the straight way
    from `start` to `end`, all of them at the same time."""

    surface: Surface
    distance: float
    margin: float
    start: Floats
    end: Floats
    pairs: SurfacePairs

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self.pairs)


class CollisionGeometry(Uncopied):
    """Collision queries for the surface of a whole scene, with fixed connectivity and moving vertices."""

    def __init__(
        self,
        rest_positions: ArrayLike,
        triangles: ArrayLike,
        activation_distance: float,
        *,
        edges: ArrayLike | None = None,
        fixed: ArrayLike | None = None,
        group: ArrayLike | None = None,
        objects: Mapping[str, int] | None = None,
        improved_max: bool = False,
        runtime: Runtime | None = None,
    ) -> None:
        """Take the scene's surface.

        `rest_positions` [n, 3]: all vertices, where edges have their lengths at rest; these say from when on two
        edges count as parallel. `triangles` [m, 3]: ids. `activation_distance` > 0: pairs closer than this are
        active. `edges` [k, 2]: further edges, of rods and curves; their ends meet triangles, and they meet all
        edges. `fixed` [n] bool: vertices that no energy moves; no pair of only fixed vertices is reported. `group`
        [n] int: no pair inside one group is reported; negative means no group. `objects`: name -> number of
        vertices, in the order of the union, for messages. `improved_max`: entries of the active set have counts and
        edges; a vertex counts at all triangles near it as often as at its nearest alone, once. `runtime`: loaded if
        not given.

        Vertices in no triangle and no edge take no part: the inside of tetrahedral meshes, but also loose points,
        which would go through everything. `taking_part` says which do; `edges` [k, 2] (each once, its lower end
        first, in lexicographic order) and `triangles` [m, 3] are what they are in.

        Raises DataError, ConnectivityError for ids, SceneError for a group that holds both fixed and free vertices.
        """
        rest = checked_points(rest_positions, "rest_positions").copy()
        self.vertex_count = len(rest)
        self.activation_distance = positive_number(activation_distance, "activation_distance", "m")
        self._objects = ranges_of_objects(objects, self.vertex_count)
        faces = checked_ids(triangles, 3, self.vertex_count, "triangles")
        lines = checked_ids(np.empty((0, 2)) if edges is None else edges, 2, self.vertex_count, "edges")

        # The collision mesh numbers only the vertices that take part; `_full_id` leads back.
        full_id, local = np.unique(np.concatenate([faces.ravel(), lines.ravel()]), return_inverse=True)
        self._full_id: Ids = full_id.astype(np.int32)
        local = local.astype(np.int32)
        self._faces = np.asfortranarray(local[: faces.size].reshape(-1, 3))
        sides = self._faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        all_edges = np.concatenate([sides, local[faces.size :].reshape(-1, 2)])
        self._edges = np.asfortranarray(np.unique(np.sort(all_edges, axis=1), axis=0))
        self._mesh = ipctk.CollisionMesh(np.asfortranarray(rest[full_id]), self._edges, self._faces)
        labels = labels_of_filter(fixed, group, self.vertex_count)
        if labels is not None:
            self._mesh.can_collide = ipctk.make_vertex_patches_filter(labels[full_id])
        self._rest = rest
        self._improved_max = improved_max
        self.taking_part = np.zeros(self.vertex_count, np.bool_)
        self.taking_part[self._full_id] = True
        self.edges: Ids = np.ascontiguousarray(self._full_id[self._edges])
        self.triangles: Ids = np.ascontiguousarray(self._full_id[self._faces])
        self.edges.flags.writeable = self.triangles.flags.writeable = False
        self._surface = Surface(
            runtime or load_runtime(find_compiler()),
            self._full_id,
            self.edges,
            self.triangles,
            np.full(self.vertex_count, -1, np.int32) if labels is None else labels,
        )

    @property
    def objects(self) -> dict[str, int]:
        """Name -> number of vertices, in the order of the scene; one without a name if none were given."""
        return {name: end - first for name, first, end in self._objects} or {"": self.vertex_count}

    def rest_areas(self) -> Floats:
        """A third of the area of the triangles around each vertex at rest [m^2], [n]."""
        corners = self._full_id[self._faces]
        x = self._rest[corners]
        areas = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 6
        return np.bincount(corners.ravel(), np.repeat(areas, 3), minlength=self.vertex_count).astype(np.float64)

    # --- intersections ---

    def has_intersections(self, positions: ArrayLike) -> bool:
        """Whether any edge meets any triangle at `positions` [n, 3] (touching counts).

        A surface wholly inside another crosses nothing and is not noticed. Raises DataError for a wrong
        shape or values that are not finite.
        """
        return self._crosses(self._of_mesh(self._checked(positions, "positions")))

    def check_intersection_free(self, positions: ArrayLike) -> None:
        """Raise IntersectionError, naming number and first of the crossings, if surfaces cross or touch."""
        self._require_no_crossing(self._of_mesh(self._checked(positions, "positions")), "positions")

    def crossings(self, positions: ArrayLike) -> tuple[Ids, Ids]:
        """All edges that meet triangles at `positions` [n, 3] (touching counts): their ends [k, 2], and the numbers [k]
        of the triangles. Slow where there are many."""
        return self._crossings(self._of_mesh(self._checked(positions, "positions")))

    # --- pairs ---

    def candidates(
        self,
        start: ArrayLike,
        end: ArrayLike | None = None,
        distance: float | None = None,
        *,
        margin: float = 0.0,
    ) -> Candidates:
        """Broad phase for one line search: pairs that may come closer than `distance` on the way.

        `start`, `end` [n, 3]; no `end` means no motion. `distance` defaults to the activation distance; 0 is
        enough for :meth:`step_bound` alone. `margin` [length]: the result also serves motions that leave this one
        by no more than that (see :meth:`covers`).
        """
        first = self._checked(start, "start").copy()
        last = first if end is None else self._checked(end, "end").copy()
        reach = self.activation_distance
        if distance is not None:
            reach = checked_length(distance, "distance")
        margin = checked_length(margin, "margin")
        # Positions that rounding of start + step * (end - start) puts just beside the way belong to it.
        size = max(np.abs(first).max(initial=0.0), np.abs(last).max(initial=0.0))
        allowed = margin + 1e-6 * reach + _ROUNDING * size
        # A pair comes nearer by twice the margin; and distances are rounded, too.
        pairs = self._surface.find(first, last, reach + 2 * allowed + _ROUNDING * size)
        return Candidates(self._surface, reach, allowed, first, last, pairs)

    def covers(self, candidates: Candidates, *positions: ArrayLike) -> bool:
        """Whether `candidates` serve all these positions [n, 3], and so the straight ways between them."""
        return all(self._off_way(self._checked(part, "positions"), candidates) <= 0 for part in positions)

    def active_set(self, positions: ArrayLike, candidates: Candidates | None = None) -> ActiveSet:
        """All pairs closer than the activation distance at `positions` [n, 3].

        With `candidates` of this line search only their distances are measured; without, the broad phase runs
        first.

        The set, and which field a pair is in, belongs to these positions: build it anew for every trial step.

        Raises SceneError if positions leave the motion that `candidates` was made for, or if its `distance`
        is smaller than the activation distance.
        """
        if candidates is None:
            candidates = self.candidates(positions)
        if candidates.distance < self.activation_distance:
            raise SceneError(
                f"candidates were made for distance {candidates.distance:g}, but the active set needs the"
                f" activation distance {self.activation_distance:g}: leave it out in candidates()"
            )
        there = self._on_way(positions, "positions", candidates)
        return self._distances(self.activation_distance, there, candidates.pairs, self._improved_max)

    # --- continuous collision detection ---

    def step_bound(
        self,
        start: ArrayLike,
        end: ArrayLike,
        candidates: Candidates | None = None,
        *,
        start_is_free: bool = False,
    ) -> float:
        """Largest step in [0, 1] from `start` straight towards `end` [n, 3] that is free of collisions.

        A step below 1 needs no further safety factor: every pair keeps at least a tenth of its distance at
        `start`, and one keeps hardly more. Sliding along each other and turning about a place where pieces
        nearly touch is no approach, however small the gap. `start_is_free=True` skips the intersection test of
        `start`, for callers whose every earlier step was bounded; a distance that rounding of the positions
        could take away is always refused. Raises IntersectionError if surfaces at `start` cross or touch.
        """
        if candidates is None:
            candidates = self.candidates(start, end, distance=0.0)
        first = self._on_way(start, "start", candidates)
        last = self._on_way(end, "end", candidates)
        if not start_is_free:
            self._require_no_crossing(self._of_mesh(first), "start")
        return self._bound(first, last, candidates.pairs)

    def check_way(self, start: ArrayLike, end: ArrayLike) -> None:
        """Raise IntersectionError, naming a pair that meets, if surfaces do on the straight way from `start` to `end`
        [n, 3].

        Surfaces may come as near each other as a thousandth of the activation distance, or half their smallest distance
        at `start` where that is less. `start` must be free of intersections.
        """
        first, last = self._checked(start, "start"), self._checked(end, "end")
        here, done, allowed = first, 0.0, 1e-3 * self.activation_distance
        while True:
            pairs = self.candidates(here, last, distance=0.0).pairs
            step = self._bound(here, last, pairs)
            if step == 1.0:
                return
            allowed = min(allowed, 0.5 * self._distance(here, pairs)) if done == 0.0 else allowed
            # The bound leaves a tenth of the distance: that need not be a collision. It is looked at again from there.
            reached = done + step * (1.0 - done)
            here = here + step * (last - here)
            if self._distance(here, pairs) <= allowed or reached == done:
                break
            done = reached
        nearest = self._nearest(here, pairs)
        if len(nearest.edge_edge) > 0:
            ends = nearest.edge_edge[0].tolist()
            what = f"edge ({self._names(ends[:2])}) and edge ({self._names(ends[2:])})"
        else:
            vertex, *corners = nearest.vertex_triangle[0].tolist()
            what = f"{self._name(vertex)} and triangle ({self._names(corners)})"
        raise IntersectionError(
            f"{what} collide at {reached:.3f} of the straight way; they are {self._distance(first, nearest):.3g} apart"
            f" at its start, and nearer than {allowed:.3g} counts as a collision"
        )

    # --- helpers ---

    def _bound(self, start: Floats, end: Floats, pairs: SurfacePairs) -> float:
        touching = 4 * _ROUNDING * float(np.abs(start).max(initial=1e-300))
        step = self._surface.step_bound(start, end, touching, pairs)
        if step is None:
            self._raise_touching(self._distances(2 * touching, start, pairs), touching)
        return step

    def _nearest(self, positions: Floats, pairs: SurfacePairs) -> SurfacePairs:
        """The nearest of the pairs, by bisection."""
        by_kind = {kind: _only(pairs, kind) for kind in ("edge_edge", "vertex_triangle")}
        kind = min(by_kind, key=lambda name: self._distance(positions, by_kind[name]))
        least = self._distance(positions, by_kind[kind])
        low, high = 0, len(by_kind[kind])
        while high - low > 1:
            middle = (low + high) // 2
            if self._distance(positions, _only(pairs, kind, low, middle)) == least:
                high = middle
            else:
                low = middle
        return _only(pairs, kind, low, high)

    def _distance(self, positions: Floats, pairs: SurfacePairs) -> float:
        return self._distances(np.inf, positions, pairs).minimum_distance

    def _checked(self, positions: ArrayLike, name: str) -> Floats:
        full = real_numbers(positions, name, finite=False)
        if full.shape != (self.vertex_count, 3):
            raise DataError(
                f"{name} must have shape [{self.vertex_count}, 3], one row per vertex of the scene,"
                f" got {list(full.shape)}"
            )
        if not np.isfinite(full).all():
            count, first = first_not_finite(full)
            raise DataError(
                f"{name}: {count} vertices are NaN or infinite, first {self._name(first)}; the previous step has gone"
                " wrong"
            )
        return full

    def _of_mesh(self, positions: Floats) -> Floats:
        return np.asfortranarray(positions[self._full_id])

    def _off_way(self, positions: Floats, candidates: Candidates) -> float:
        """By how much positions leave what candidates were made for; at most 0 if they do not."""
        if candidates.surface is not self._surface:
            raise SceneError("candidates belong to another CollisionGeometry: make them with this one's candidates()")
        return self._surface.distance_to_way(candidates.start, candidates.end, positions) - candidates.margin

    def _on_way(self, positions: ArrayLike, name: str, candidates: Candidates) -> Floats:
        full = self._checked(positions, name)
        off = self._off_way(full, candidates)
        if off > 0:
            raise SceneError(
                f"{name}: a vertex is {off:.3g} outside the motion that the candidates were made for; call"
                " candidates(start, end) anew with these positions in between"
            )
        return full

    def _distances(self, reach: float, positions: Floats, pairs: SurfacePairs, improved_max: bool = False) -> ActiveSet:
        """Those of the pairs that are closer than `reach`."""
        return active_set_of(*self._surface.close_pairs(positions, self._rest, reach, pairs, improved_max))

    def _crosses(self, surface: Floats) -> bool:
        return bool(ipctk.has_intersections(self._mesh, surface, ipctk.LBVH()))

    def _require_no_crossing(self, surface: Floats, name: str) -> None:
        if not self._crosses(surface):
            return
        edges, triangles = self._crossings(surface)
        face = self._full_id[self._faces[triangles[0]]]
        raise IntersectionError(
            f"{name}: {len(edges)} edges cross or touch triangles; first: edge ({self._names(edges[0].tolist())})"
            f" and triangle ({self._names(face.tolist())}). Move the objects apart (contact needs a positive distance"
            " everywhere), or put objects that may overlap into one group"
        )

    def _crossings(self, surface: Floats) -> tuple[Ids, Ids]:
        """All edges [k, 2] and triangle numbers [k] that meet, sorted; slow, for messages only."""
        boxes = ipctk.LBVH()
        boxes.can_vertices_collide = self._mesh.can_collide
        size = float(np.linalg.norm(np.ptp(surface, axis=0)))
        boxes.build(surface, self._edges, self._faces, 1e-6 * size)
        found = []
        for pair in boxes.detect_edge_face_candidates():
            edge, face = self._edges[pair.edge_id], self._faces[pair.face_id]
            if ipctk.is_edge_intersecting_triangle(*surface[edge], *surface[face]):
                found.append((*self._full_id[edge].tolist(), pair.face_id))
        table = np.array(sorted(found), np.int32).reshape(-1, 3)
        return table[:, :2], table[:, 2]

    def _raise_touching(self, touching: ActiveSet, rounding: float) -> Never:
        kind, pairs = next((kind, pairs) for kind, pairs in touching.kinds().items() if len(pairs) > 0)
        raise IntersectionError(
            f"start: {len(touching)} pairs touch (closer than positions are rounded, {rounding:.1g}); first, a"
            f" {kind.replace('_', ' ')} pair: {self._names(pairs.vertices[0].tolist())}. No step can be bounded from"
            " there: start with a gap between the objects"
        )

    def _name(self, vertex: int) -> str:
        """The object that a vertex belongs to, and its number there, for messages."""
        for name, first, end in self._objects:
            if first <= vertex < end:
                return f"vertex {vertex - first} of '{name}'"
        return f"vertex {vertex}"

    def _names(self, vertices: list[int]) -> str:
        return ", ".join(self._name(vertex) for vertex in vertices)


def _only(pairs: SurfacePairs, kind: str, first: int = 0, end: int | None = None) -> SurfacePairs:
    """Pairs of one kind, "edge_edge" or "vertex_triangle", from the first up to the end."""
    none = np.empty((0, 4), np.int32)
    chosen = np.ascontiguousarray(getattr(pairs, kind)[first:end])
    return SurfacePairs(chosen, none) if kind == "edge_edge" else SurfacePairs(none, chosen)


def narrowest_gap(shape: TetrahedralMesh, most: float) -> float:
    """Smallest distance [m] of two pieces of a shape's surface that share no vertex; infinite if it is `most` or more.

    An activation distance below it keeps the surface from repelling itself at rest.
    """
    geometry = CollisionGeometry(shape.vertices, shape.surface_triangles(), most)
    return geometry.active_set(shape.vertices).minimum_distance
