"""Which surface pieces of a scene are close, and how far a step may go: collision geometry through ipctk.

The IPC Toolkit finds candidate pairs, the active set and collision-free step sizes. It evaluates no energy
here: the barrier is an ordinary yasps energy over the index arrays of :class:`ActiveSet`, one formula per
array.

Conventions: positions are float64 [n, 3] over *all* vertices of the scene (the union of its meshes), in the
user's length unit; every vertex id taken or returned counts in that numbering; distances are plain, not
squared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import ipctk
import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.frontend.active_set import ActiveSet, Floats, Ids, read_collisions
from yasps.frontend.errors import YaspsError

_FREE_SHARE = 0.9
"""Share of its distance that a pair may use up in one step, as additive CCD's conservative rescaling."""
_ROUNDING = 8 * float(np.finfo(np.float64).eps)


class IntersectionError(YaspsError, ValueError):
    """Surfaces cross or touch where they must be apart."""


@dataclass(frozen=True)
class Candidates:
    """Pairs that may come closer than `distance` while each vertex stays between `lower` and `upper`."""

    distance: float
    pairs: Any
    """ipctk.Candidates, over the numbering of the collision mesh."""
    lower: Floats
    upper: Floats

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self.pairs)


class CollisionGeometry:
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
    ) -> None:
        """Take the scene's surface.

        `rest_positions` [n, 3]: all vertices; those in no triangle and no edge (the inside of tetrahedral
        meshes) take no part. `triangles` [m, 3]: ids. `activation_distance` > 0: pairs closer than this are
        active. `edges` [k, 2]: further edges of rods and curves. `fixed` [n] bool: vertices that never move;
        no pair of only fixed vertices is reported. `group` [n] int: no pair inside one group is reported;
        negative means no group. `objects`: name -> number of vertices, in the order of the union, for
        messages. Raises ValueError for wrong shapes or ids, and for a group that holds both fixed and free
        vertices.
        """
        rest = np.array(rest_positions, dtype=np.float64)
        if rest.ndim != 2 or rest.shape[1:] != (3,):
            raise ValueError(f"rest_positions must have shape [n, 3], got {list(rest.shape)}")
        self.vertex_count = len(rest)
        _check_finite(rest, "rest_positions")
        if not (np.isfinite(activation_distance) and activation_distance > 0):
            raise ValueError(f"activation_distance must be a positive length, got {activation_distance}")
        self.activation_distance = float(activation_distance)
        self._objects = _object_ranges(objects, self.vertex_count)
        faces = _element_ids(triangles, 3, self.vertex_count, "triangles")
        lines = _element_ids(np.empty((0, 2)) if edges is None else edges, 2, self.vertex_count, "edges")

        # The collision mesh numbers only the vertices that take part; `_full_id` leads back.
        full_id, local = np.unique(np.concatenate([faces.ravel(), lines.ravel()]), return_inverse=True)
        self._full_id: Ids = full_id.astype(np.int32)
        local = local.astype(np.int32)
        self._faces = np.asfortranarray(local[: faces.size].reshape(-1, 3))
        sides = self._faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        all_edges = np.concatenate([sides, local[faces.size :].reshape(-1, 2)])
        self._edges = np.asfortranarray(np.unique(np.sort(all_edges, axis=1), axis=0))
        self._mesh = ipctk.CollisionMesh(np.asfortranarray(rest[full_id]), self._edges, self._faces)
        labels = _filter_labels(fixed, group, self.vertex_count)
        if labels is not None:
            self._mesh.can_collide = ipctk.make_vertex_patches_filter(labels[full_id])

    # --- intersections ---

    def has_intersections(self, positions: ArrayLike) -> bool:
        """Whether any edge meets any triangle at `positions` [n, 3] (touching counts).

        A surface wholly inside another crosses nothing and is not noticed. Raises ValueError for a wrong
        shape or values that are not finite.
        """
        return self._crosses(self._surface(positions, "positions"))

    def check_intersection_free(self, positions: ArrayLike) -> None:
        """Raise IntersectionError, naming number and first of the crossings, if surfaces cross or touch."""
        self._require_no_crossing(self._surface(positions, "positions"), "positions")

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
        by no more than that in any coordinate of any vertex (see :meth:`covers`).
        """
        first = self._surface(start, "start")
        last = first if end is None else self._surface(end, "end")
        reach = self.activation_distance if distance is None else float(distance)
        if not (np.isfinite(reach) and reach >= 0):
            raise ValueError(f"distance must be a length >= 0, got {distance}")
        if not (np.isfinite(margin) and margin >= 0):
            raise ValueError(f"margin must be a length >= 0, got {margin}")
        lower, upper = np.minimum(first, last), np.maximum(first, last)
        # Two boxes inflated by r meet when their contents are within 2 r. The pad makes up for positions that
        # rounding of start + step * (end - start) puts just outside the swept boxes; _swept_surface allows
        # exactly that much.
        pad = margin + 1e-6 * reach + _ROUNDING * max(np.abs(lower).max(initial=0.0), np.abs(upper).max(initial=0.0))
        pairs = ipctk.Candidates()
        pairs.build(self._mesh, first, last, reach / 2 + pad, ipctk.LBVH())
        return Candidates(reach, pairs, lower - pad, upper + pad)

    def covers(self, candidates: Candidates, *positions: ArrayLike) -> bool:
        """Whether all these positions [n, 3], and so the straight ways between them, are inside the motion that
        `candidates` was made for."""
        surfaces = [self._surface(part, "positions") for part in positions]
        return not any(_outside(surface, candidates).any() for surface in surfaces)

    def active_set(self, positions: ArrayLike, candidates: Candidates | None = None) -> ActiveSet:
        """All pairs closer than the activation distance at `positions` [n, 3].

        With `candidates` of this line search only their distances are measured; without, the broad phase runs
        first.

        The set, and which field a pair is in, belongs to these positions: build it anew for every trial step.

        Raises ValueError if positions leave the motion that `candidates` was made for, or if its `distance`
        is smaller than the activation distance.
        """
        if candidates is None:
            candidates = self.candidates(positions)
        if candidates.distance < self.activation_distance:
            raise ValueError(
                f"candidates were made for distance {candidates.distance:g}, but the active set needs the"
                f" activation distance {self.activation_distance:g}: leave it out in candidates()"
            )
        surface = self._swept_surface(positions, "positions", candidates)
        return self._read(self._collisions(candidates, surface, self.activation_distance), surface)

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

        Additive CCD (Li, Kaufman & Jiang 2021). A step below 1 needs no further safety factor: each pair
        keeps about a tenth of its distance at `start`, because the search stops there (conservative rescaling
        0.9). `start_is_free=True` skips the intersection test of `start`, for callers whose every earlier
        step was bounded; contact at distance zero is always refused. Raises IntersectionError if surfaces at
        `start` cross or touch.
        """
        if candidates is None:
            candidates = self.candidates(start, end, distance=0.0)
        first = self._swept_surface(start, "start", candidates)
        last = self._swept_surface(end, "end", candidates)
        if not start_is_free:
            self._require_no_crossing(first, "start")
        touching = self._collisions(candidates, first, _ROUNDING * np.abs(first).max(initial=1e-300))
        if len(touching) > 0:
            self._raise_touching(self._read(touching, first))
        return float(
            candidates.pairs.compute_collision_free_stepsize(
                self._mesh, first, last, min_distance=0.0, narrow_phase_ccd=ipctk.AdditiveCCD()
            )
        )

    def moves_freely(self, start: ArrayLike, end: ArrayLike, candidates: Candidates) -> bool:
        """Whether every vertex moves so little from `start` to `end` [n, 3] that nothing can meet on any way there.

        A quick test without CCD, for short motions: no vertex may move by 0.45 of its distance to anything else, so
        that pairs keep a tenth of theirs, as with :meth:`step_bound`. `start` must be free of intersections.
        """
        first = self._swept_surface(start, "start", candidates)
        last = self._swept_surface(end, "end", candidates)
        # What is not among the candidates is at least their distance apart.
        gaps = candidates.pairs.compute_per_vertex_safe_distances(self._mesh, first, candidates.distance)
        moved = np.linalg.norm(last - first, axis=1)
        return bool((moved <= 0.5 * _FREE_SHARE * np.asarray(gaps).reshape(-1)).all())

    # --- inside ---

    def _surface(self, positions: ArrayLike, name: str) -> Floats:
        """Checked positions of the collision mesh's vertices, column-major as ipctk wants them."""
        full = np.asarray(positions, dtype=np.float64)
        if full.shape != (self.vertex_count, 3):
            raise ValueError(
                f"{name} must have shape [{self.vertex_count}, 3], one row per vertex of the scene,"
                f" got {list(full.shape)}"
            )
        _check_finite(full, name)
        return np.asfortranarray(full[self._full_id])

    def _swept_surface(self, positions: ArrayLike, name: str, candidates: Candidates) -> Floats:
        surface = self._surface(positions, name)
        if candidates.lower.shape != surface.shape:
            raise ValueError("candidates belong to another CollisionGeometry")
        outside = _outside(surface, candidates)
        if outside.any():
            vertex = self._name(int(self._full_id[int(np.argmax(outside))]))
            raise ValueError(
                f"{name}: {int(outside.sum())} vertices, first {vertex}, are outside the motion that the"
                " candidates were made for; call candidates(start, end) anew with these positions in between"
            )
        return surface

    def _collisions(self, candidates: Candidates, surface: Floats, distance: float) -> Any:
        # The defaults of NormalCollisions are the ones wanted: collision_set_type IPC, no area weighting.
        collisions = ipctk.NormalCollisions()
        collisions.build(candidates.pairs, self._mesh, surface, distance)
        return collisions

    def _read(self, collisions: Any, surface: Floats) -> ActiveSet:
        return read_collisions(collisions, self._mesh, surface, self._full_id)

    def _crosses(self, surface: Floats) -> bool:
        return bool(ipctk.has_intersections(self._mesh, surface, ipctk.LBVH()))

    def _require_no_crossing(self, surface: Floats, name: str) -> None:
        if not self._crosses(surface):
            return
        crossings = self._crossings(surface)
        edge, face = crossings[0]
        raise IntersectionError(
            f"{name}: {len(crossings)} edges cross or touch triangles; first: edge ({self._names(edge)})"
            f" and triangle ({self._names(face)}). Move the objects apart (contact needs a positive distance"
            " everywhere), or put objects that may overlap into one group"
        )

    def _crossings(self, surface: Floats) -> list[tuple[list[int], list[int]]]:
        """All (edge, triangle) pairs that meet, as sorted vertex ids; slow, for messages only."""
        boxes = ipctk.LBVH()
        boxes.can_vertices_collide = self._mesh.can_collide
        size = float(np.linalg.norm(np.ptp(surface, axis=0)))
        boxes.build(surface, self._edges, self._faces, 1e-6 * size)
        found = []
        for pair in boxes.detect_edge_face_candidates():
            edge, face = self._edges[pair.edge_id], self._faces[pair.face_id]
            if ipctk.is_edge_intersecting_triangle(*surface[edge], *surface[face]):
                found.append((self._full_id[edge].tolist(), self._full_id[face].tolist()))
        return sorted(found)

    def _raise_touching(self, touching: ActiveSet) -> None:
        kind, pairs = next((kind, pairs) for kind, pairs in touching.kinds().items() if len(pairs) > 0)
        raise IntersectionError(
            f"start: {len(touching)} pairs touch (distance zero); first, a {kind.replace('_', ' ')} pair:"
            f" {self._names(pairs.vertices[0].tolist())}. No step can be bounded from there: start with a gap"
            " between the objects"
        )

    def _name(self, vertex: int) -> str:
        for name, first, end in self._objects:
            if first <= vertex < end:
                return f"vertex {vertex - first} of '{name}'"
        return f"vertex {vertex}"

    def _names(self, vertices: list[int]) -> str:
        return ", ".join(self._name(vertex) for vertex in vertices)


def _outside(surface: Floats, candidates: Candidates) -> NDArray[np.bool_]:
    """Vertices that are not where the candidates were made for."""
    return np.asarray(((surface < candidates.lower) | (surface > candidates.upper)).any(axis=1))


def _check_finite(positions: Floats, name: str) -> None:
    bad = ~np.isfinite(positions).all(axis=1)
    if bad.any():
        raise ValueError(
            f"{name}: {int(bad.sum())} vertices are NaN or infinite, first vertex {int(np.argmax(bad))};"
            " the previous step has gone wrong"
        )


def _element_ids(elements: ArrayLike, arity: int, vertex_count: int, name: str) -> Ids:
    """Checked [m, arity] vertex ids."""
    ids = np.asarray(elements)
    if ids.size == 0:
        return np.empty((0, arity), np.int32)
    if ids.ndim != 2 or ids.shape[1] != arity:
        raise ValueError(f"{name} must have shape [m, {arity}], got {list(ids.shape)}")
    if not np.issubdtype(ids.dtype, np.integer):
        raise ValueError(f"{name} must hold integer vertex ids, got {ids.dtype}")
    if ids.min() < 0 or ids.max() >= vertex_count:
        raise ValueError(f"{name} must hold ids from 0 to {vertex_count - 1}, got {ids.min()} to {ids.max()}")
    ordered = np.sort(ids, axis=1)
    twice = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if twice.any():
        row = int(np.argmax(twice))
        raise ValueError(f"{name}: row {row} names a vertex twice: {ids[row].tolist()}")
    return ids.astype(np.int32)


def _filter_labels(fixed: ArrayLike | None, group: ArrayLike | None, vertex_count: int) -> Ids | None:
    """One label per vertex such that exactly the pairs of equal labels are left out; None if no pair is."""
    if fixed is None and group is None:
        return None
    labels = np.full(vertex_count, -1) if group is None else np.array(group)
    still = np.zeros(vertex_count, np.bool_) if fixed is None else np.asarray(fixed)
    if labels.shape != (vertex_count,) or not np.issubdtype(labels.dtype, np.integer):
        raise ValueError(f"group must be integers [{vertex_count}], got {labels.dtype} {list(labels.shape)}")
    if still.shape != (vertex_count,) or still.dtype != np.bool_:
        raise ValueError(f"fixed must be bool [{vertex_count}], got {still.dtype} {list(still.shape)}")
    mixed = np.intersect1d(labels[still & (labels >= 0)], labels[~still])
    if len(mixed) > 0:
        raise ValueError(
            f"group {mixed[0]} holds both fixed and free vertices, and ipctk's filter takes one label per"
            " vertex: give the fixed ones group -1 (they then can collide with the rest of the group)"
        )
    # Small labels: one for the fixed vertices, one per group, then one for each remaining vertex by itself.
    alone = ~still & (labels < 0)
    _, packed = np.unique(np.where(still, -1, labels), return_inverse=True)
    packed[alone] = packed.max(initial=0) + 1 + np.arange(int(alone.sum()))
    return packed.astype(np.int32)


def _object_ranges(objects: Mapping[str, int] | None, vertex_count: int) -> list[tuple[str, int, int]]:
    """(name, first vertex, one past the last) of each object."""
    if objects is None:
        return []
    ends = np.cumsum(list(objects.values())).tolist()
    if ends[-1:] != [vertex_count]:
        raise ValueError(
            f"objects must list the vertex counts of all meshes in the order of the union, which sum to"
            f" {vertex_count}; got {dict(objects)}"
        )
    return list(zip(objects, [0, *ends[:-1]], ends, strict=True))
