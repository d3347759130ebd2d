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

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import DataError, IntersectionError, SceneError
from yasps.contact.active_set import ActiveSet, Floats, Ids, active_set_of
from yasps.contact.crossings import Crossings
from yasps.contact.object_names import ObjectNames
from yasps.contact.surface_arguments import (
    checked_classes,
    checked_ids,
    checked_length,
    checked_points,
    checked_radii,
    checked_vertices,
    first_not_finite,
    labels_of_filter,
)
from yasps.frontend.language.arrays import positive_number, real_numbers
from yasps.meshes import TetrahedralMesh
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.collision.surface_pairs import Meetings, Pieces, Surface, SurfacePairs, Thickness
from yasps.runtime.core.library import Runtime, load_runtime
from yasps.runtime.core.uncopied import Uncopied

_ROUNDING = 8 * float(np.finfo(np.float64).eps)
_FEW_STRAY = 0.25
"""Of all vertices; if more leave the way of earlier candidates, pairs are looked for anew."""


@dataclass(frozen=True)
class Candidates:
    """Pairs that may come closer than `distance`, and their radii, while each vertex is within `margin` of its place on
    the straight way from `start` to `end`, all of them at the same time."""

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
        points: ArrayLike | None = None,
        radii: ArrayLike = 0.0,
        fixed: ArrayLike | None = None,
        group: ArrayLike | None = None,
        class_of: ArrayLike | None = None,
        allowed: ArrayLike | None = None,
        objects: Mapping[str, int] | None = None,
        improved_max: bool = False,
        runtime: Runtime | None = None,
    ) -> None:
        """Take the scene's surface.

        `rest_positions` [n, 3]: all vertices, where they are at rest; the edges' lengths there say from when on two
        edges count as parallel. `triangles` [m, 3]: ids. `activation_distance` > 0: pairs closer than this are active.
        `edges` [k, 2]: further edges, of rods and curves; their ends meet triangles, and they meet all edges. `points`
        [p]: ids of loose vertices, in no triangle or edge, that meet triangles, those edges that are in no triangle,
        and each other. `radii` >= 0, one or [n]: surfaces are that thick at each vertex, on both sides; see below.
        `fixed` [n] bool: vertices that no energy moves; no pair of only fixed vertices is reported. `group` [n] int: no
        pair inside one group is reported; negative means no group. `class_of` [n] int, `allowed` [c, c] bool: pairs of
        classes that are not allowed are neither reported nor do they cross. `objects`: name -> number of vertices, in
        the order of the union; default: all are one. `improved_max`: entries of the active set have counts and edges; a
        vertex counts at all triangles near it as often as at its nearest alone, once. `runtime`: loaded if not given.

        With radii, the gap of a pair is its distance less its offset, the sum of both radii where it is closest. Pairs
        are active, and steps are bounded, by the gap. Pairs of one object whose gap at rest is less than the activation
        distance have only that `share` of the offset which makes it so, perhaps none.

        Other vertices in no triangle and no edge take no part: the inside of tetrahedral meshes, but also loose
        points that are not named, which would go through everything. `taking_part` says which do; `edges` [k, 2] (each
        once, its lower end first, in lexicographic order; a loose point twice, as an edge without length) and
        `triangles` [m, 3] are what they are in.

        Raises DataError, ConnectivityError for ids, SceneError for a group that holds both fixed and free vertices.
        """
        rest = checked_points(rest_positions, "rest_positions").copy()
        self.vertex_count = len(rest)
        self.activation_distance = reach = positive_number(activation_distance, "activation_distance", "m")
        self.names = ObjectNames(objects, self.vertex_count)
        faces = checked_ids(triangles, 3, self.vertex_count, "triangles")
        lines = checked_ids(np.empty((0, 2)) if edges is None else edges, 2, self.vertex_count, "edges")

        loose = checked_vertices(points, faces, lines, self.vertex_count)
        thick = checked_radii(radii, self.vertex_count)
        is_thick = bool(thick.any())

        # The collision mesh numbers only the vertices that take part; `full_id` leads back.
        used, place = np.unique(np.concatenate([faces.ravel(), lines.ravel(), loose]), return_inverse=True)
        full_id, local = used.astype(np.int32), place.astype(np.int32)
        local_faces = local[: faces.size].reshape(-1, 3)
        sides = local_faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        all_edges = np.concatenate([sides, local[faces.size : faces.size + lines.size].reshape(-1, 2)])
        found, number = np.unique(np.sort(all_edges, axis=1), axis=0, return_inverse=True)
        local_edges = found.astype(np.int32)
        is_free = np.ones(len(local_edges), np.bool_)
        is_free[number.ravel()[: len(sides)]] = False

        labels = labels_of_filter(fixed, group, self.vertex_count)
        classes = checked_classes(class_of, allowed, self.vertex_count, faces, lines)
        self._rest = rest
        self._improved_max = improved_max
        self._crossings = Crossings(rest, full_id, local_edges, local_faces, labels=labels, classes=classes)
        self.taking_part = np.zeros(self.vertex_count, np.bool_)
        self.taking_part[full_id] = True
        self.triangles: Ids = full_id[local_faces]
        edges_of_scene = full_id[local_edges]
        self._surface = Surface(
            runtime or load_runtime(find_compiler()),
            Pieces(full_id, edges_of_scene, self.triangles, loose, edges_of_scene[is_free]),
            np.full(self.vertex_count, -1, np.int32) if labels is None else labels,
            Thickness(thick, self.names.objects_of_vertices(), reach) if is_thick else None,
            classes,
        )
        self.edges: Ids = self._surface.edges
        self.edges.flags.writeable = self.triangles.flags.writeable = False

    @property
    def objects(self) -> dict[str, int]:
        """Name -> number of vertices, in the order of the scene; one without a name if none were given."""
        return self.names.counts()

    def rest_areas(self) -> Floats:
        """A third of the area of the triangles around each vertex at rest [m^2], [n]."""
        corners = self.triangles
        x = self._rest[corners]
        areas = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 6
        return np.bincount(corners.ravel(), np.repeat(areas, 3), minlength=self.vertex_count).astype(np.float64)

    # --- intersections ---

    def has_intersections(self, positions: ArrayLike) -> bool:
        """Whether any edge meets any triangle at `positions` [n, 3] (touching counts).

        A surface wholly inside another crosses nothing and is not noticed. Raises DataError for a wrong
        shape or values that are not finite.
        """
        return self._crossings.exist(self._checked(positions, "positions"))

    def check_intersection_free(self, positions: ArrayLike) -> None:
        """Raise IntersectionError, naming number and first of the crossings, if surfaces cross or touch; or number and
        deepest of the pairs that are nearer than their radii."""
        full = self._checked(positions, "positions")
        self._require_no_crossing(full, "positions")
        self._require_gap(full, "positions")

    def crossings(self, positions: ArrayLike) -> tuple[Ids, Ids]:
        """All edges that meet triangles at `positions` [n, 3] (touching counts): their ends [k, 2], and the numbers [k]
        of the triangles. Slow where there are many."""
        return self._crossings.all(self._checked(positions, "positions"))

    # --- pairs ---

    def candidates(
        self,
        start: ArrayLike,
        end: ArrayLike | None = None,
        distance: float | None = None,
        *,
        margin: float = 0.0,
        before: Candidates | None = None,
    ) -> Candidates:
        """Broad phase for one line search: pairs that may come closer than `distance` on the way.

        `start`, `end` [n, 3]; no `end` means no motion. `distance` defaults to the activation distance; 0 is
        enough for :meth:`step_bound` alone. `margin` [length]: the result also serves motions that leave this one
        by no more than that (see :meth:`covers`).

        `before`: earlier candidates. Where most vertices are near the way that these were made for, only the pairs of
        others are looked for, which is faster; then the result serves motions that leave this one by half the margin.
        """
        first = self._checked(start, "start").copy()
        last = first if end is None else self._checked(end, "end").copy()
        reach = self.activation_distance
        if distance is not None:
            reach = checked_length(distance, "distance")
        margin = checked_length(margin, "margin")
        # Positions that rounding of start + step * (end - start) puts just beside the way belong to it.
        size = max(np.abs(first).max(initial=0.0), np.abs(last).max(initial=0.0))
        rounding = _ROUNDING * size
        allowed = margin + 1e-6 * reach + rounding
        kept = None
        if before is not None and before.surface is self._surface and before.distance >= reach:
            # A part of the other way is rounded.
            shared = min(allowed, before.margin - rounding)
            start_of_both, end_of_both, strayed = self._surface.part_of_way(
                before.start, before.end, first, last, 0.5 * shared
            )
            if shared >= margin and np.count_nonzero(strayed) <= _FEW_STRAY * self.vertex_count:
                first, last, allowed, kept = start_of_both, end_of_both, shared, (before.pairs, strayed)
        # A pair comes nearer by twice the margin; and distances are rounded, too.
        pairs = self._surface.find(first, last, reach + 2 * allowed + rounding, kept)
        return Candidates(self._surface, reach, allowed, first, last, pairs)

    def covers(self, candidates: Candidates, *positions: ArrayLike) -> bool:
        """Whether `candidates` serve all these positions [n, 3], and so the straight ways between them."""
        # By a little less than the margin: rounding of places between them is then no reason to refuse those.
        most = -1e-9 * candidates.margin
        return all(self._off_way(self._checked(part, "positions"), candidates) <= most for part in positions)

    def active_set(self, positions: ArrayLike, candidates: Candidates | None = None) -> ActiveSet:
        """All pairs whose gap is below the activation distance at `positions` [n, 3].

        A gap may be negative there, see `ActiveSet.overlaps`.

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

        A step below 1 needs no further safety factor: every pair keeps at least a tenth of its gap at `start`, and
        one keeps hardly more. (Where radii vary in a piece the gap is by the least of each, so that it may be less by
        the radii where pieces are closest.) Sliding along each other and turning about a place where pieces
        nearly touch is no approach, however small the gap. `start_is_free=True` skips the intersection test of
        `start`, for callers whose every earlier step was bounded; a distance that rounding of the positions
        could take away is always refused. Raises IntersectionError if surfaces at `start` cross, or
        a gap there is nothing.
        """
        if candidates is None:
            candidates = self.candidates(start, end, distance=0.0)
        first = self._on_way(start, "start", candidates)
        last = self._on_way(end, "end", candidates)
        if not start_is_free:
            self._require_no_crossing(first, "start")
        return self._bound(first, last, candidates.pairs)

    def meetings(self, start: ArrayLike, end: ArrayLike, candidates: Candidates) -> Meetings:
        """The pairs for which the straight way from `start` to `end` [n, 3] is not free: those that bound a step.

        They are ordered by their vertices: candidates come as the search found them, which a saved state does not know.
        """
        first, last = self._on_way(start, "start", candidates), self._on_way(end, "end", candidates)
        found = self._surface.meetings(first, last, self._rest, candidates.pairs)
        order = np.lexsort(found.vertices.T[::-1])
        return Meetings(*(value[order] for value in vars(found).values()))

    def check_way(self, start: ArrayLike, end: ArrayLike, *, only: NDArray[np.bool_] | None = None) -> None:
        """Raise IntersectionError, naming a pair that meets, if surfaces do on the straight way from `start` to `end`
        [n, 3].

        Surfaces may come as near each other as a thousandth of the activation distance, or half their smallest distance
        at `start` where that is less. `start` must be free of intersections. `only` [n]: pairs of these vertices alone.
        """
        first, last = self._checked(start, "start"), self._checked(end, "end")
        here, done, allowed = first, 0.0, 1e-3 * self.activation_distance
        while True:
            pairs = self.candidates(here, last, distance=0.0).pairs
            if only is not None:
                pairs = SurfacePairs(
                    *(kind[only[kind].all(axis=1)] for kind in (pairs.edge_edge, pairs.vertex_triangle))
                )
            step = self._bound(here, last, pairs)
            if step == 1.0:
                return
            allowed = min(allowed, 0.5 * self._gap(here, pairs)) if done == 0.0 else allowed
            # The bound leaves a tenth of the distance: that need not be a collision. It is looked at again from there.
            reached = done + step * (1.0 - done)
            here = here + step * (last - here)
            if self._gap(here, pairs) <= allowed or reached == done:
                break
            done = reached
        nearest = self._nearest(here, pairs)
        raise IntersectionError(
            f"{self.names.of_pair(nearest)} collide at {reached:.3f} of the straight way; they are"
            f" {self._gap(first, nearest):.3g} apart{self._beyond} at its start, and nearer than {allowed:.3g} counts"
            " as a collision"
        )

    # --- helpers ---

    def _bound(self, start: Floats, end: Floats, pairs: SurfacePairs) -> float:
        touching = _touching(start)
        step = self._surface.step_bound(start, end, self._rest, touching, pairs)
        if step is None:
            self._raise_touching(self._distances(2 * touching, start, pairs), touching)
        return step

    def _nearest(self, positions: Floats, pairs: SurfacePairs) -> SurfacePairs:
        """The pair of the least gap, by bisection."""
        by_kind = {kind: _only(pairs, kind) for kind in ("edge_edge", "vertex_triangle")}
        kind = min(by_kind, key=lambda name: self._gap(positions, by_kind[name]))
        least = self._gap(positions, by_kind[kind])
        low, high = 0, len(by_kind[kind])
        while high - low > 1:
            middle = (low + high) // 2
            if self._gap(positions, _only(pairs, kind, low, middle)) == least:
                high = middle
            else:
                low = middle
        return _only(pairs, kind, low, high)

    def _gap(self, positions: Floats, pairs: SurfacePairs) -> float:
        return self._distances(np.inf, positions, pairs).minimum_gap

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
                f"{name}: {count} vertices are NaN or infinite, first {self.names.of(first)}; the previous step has"
                " gone wrong"
            )
        return full

    def _off_way(self, positions: Floats, candidates: Candidates) -> float:
        """By how much positions leave what candidates were made for; at most 0 if they do not."""
        if candidates.surface is not self._surface:
            raise SceneError("candidates belong to another CollisionGeometry: make them with this one's candidates()")
        margin = candidates.margin
        return self._surface.distance_to_way(candidates.start, candidates.end, positions, margin) - margin

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
        """Those of the pairs whose gap is less than `reach`."""
        return active_set_of(*self._surface.close_pairs(positions, self._rest, reach, pairs, improved_max))

    def _require_no_crossing(self, positions: Floats, name: str) -> None:
        if not self._crossings.exist(positions):
            return
        edges, triangles = self._crossings.all(positions)
        edge, face = (self.names.of_all(ids.tolist()) for ids in (edges[0], self.triangles[triangles[0]]))
        raise IntersectionError(
            f"{name}: {len(edges)} edges cross or touch triangles; first: edge ({edge}) and triangle ({face}). Move the"
            " objects apart (contact needs a positive distance everywhere), or put objects that may overlap into one"
            " group"
        )

    def _require_gap(self, positions: Floats, name: str) -> None:
        if self._surface.thickness is None:
            return
        pairs = self.candidates(positions, distance=0.0).pairs
        touching = self._distances(_touching(positions), positions, pairs)
        if len(touching) == 0:
            return
        count = int(sum(kind.weight.sum() for kind in touching.kinds().values()))
        raise IntersectionError(
            f"{name}: {count} pairs are nearer to each other than their radii; deepest:"
            f" {self.names.of_pair(self._nearest(positions, pairs))}, by {max(0.0, -touching.minimum_gap):.3g}. Move"
            " the objects apart, or give them smaller radii"
        )

    def _raise_touching(self, touching: ActiveSet, rounding: float) -> Never:
        kind, pairs = next((kind, pairs) for kind, pairs in touching.kinds().items() if len(pairs) > 0)
        first = f"a {kind.replace('_', ' ')} pair: {self.names.of_all(pairs.vertices[0].tolist())}"
        raise IntersectionError(
            f"start: {len(touching)} pairs touch (closer{self._beyond} than positions are rounded, {rounding:.1g});"
            f" first, {first}. No step can be bounded from there: start with a gap between the objects"
        )

    @property
    def _beyond(self) -> str:
        return "" if self._surface.thickness is None else " beyond their radii"


def _touching(positions: Floats) -> float:
    """A gap that rounding of positions could take away."""
    return 4 * _ROUNDING * float(np.abs(positions).max(initial=1e-300))


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
