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

from yasps.frontend.active_set import ActiveSet, Floats, Ids, active_set_of
from yasps.frontend.errors import YaspsError
from yasps.runtime.library import Runtime, load_runtime
from yasps.runtime.surface_pairs import Surface, SurfacePairs
from yasps.runtime.toolchain import find_compiler

_ROUNDING = 8 * float(np.finfo(np.float64).eps)


class IntersectionError(YaspsError, ValueError):
    """Surfaces cross or touch where they must be apart."""


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
        runtime: Runtime | None = None,
    ) -> None:
        """Take the scene's surface.

        `rest_positions` [n, 3]: all vertices; those in no triangle and no edge (the inside of tetrahedral
        meshes) take no part. `triangles` [m, 3]: ids. `activation_distance` > 0: pairs closer than this are
        active. `edges` [k, 2]: further edges of rods and curves. `fixed` [n] bool: vertices that never move;
        no pair of only fixed vertices is reported. `group` [n] int: no pair inside one group is reported;
        negative means no group. `objects`: name -> number of vertices, in the order of the union, for
        messages. `runtime`: loaded if not given. Raises ValueError for wrong shapes or ids, and for a group that
        holds both fixed and free vertices.
        """
        rest = np.array(rest_positions, dtype=np.float64, order="C")
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
        self._rest = rest
        self._surface = Surface(
            runtime or load_runtime(find_compiler()),
            self._full_id,
            self._full_id[self._edges],
            self._full_id[self._faces],
            np.full(self.vertex_count, -1, np.int32) if labels is None else labels,
        )

    # --- intersections ---

    def has_intersections(self, positions: ArrayLike) -> bool:
        """Whether any edge meets any triangle at `positions` [n, 3] (touching counts).

        A surface wholly inside another crosses nothing and is not noticed. Raises ValueError for a wrong
        shape or values that are not finite.
        """
        return self._crosses(self._of_mesh(self._checked(positions, "positions")))

    def check_intersection_free(self, positions: ArrayLike) -> None:
        """Raise IntersectionError, naming number and first of the crossings, if surfaces cross or touch."""
        self._require_no_crossing(self._of_mesh(self._checked(positions, "positions")), "positions")

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
        reach = self.activation_distance if distance is None else float(distance)
        if not (np.isfinite(reach) and reach >= 0):
            raise ValueError(f"distance must be a length >= 0, got {distance}")
        if not (np.isfinite(margin) and margin >= 0):
            raise ValueError(f"margin must be a length >= 0, got {margin}")
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
        there = self._on_way(positions, "positions", candidates)
        return self._closer_than(self.activation_distance, there, candidates)

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
        touching = 4 * _ROUNDING * float(np.abs(first).max(initial=1e-300))
        step = self._surface.step_bound(first, last, touching, candidates.pairs)
        if step is None:
            self._raise_touching(self._closer_than(2 * touching, first, candidates), touching)
        return step

    # --- helpers ---

    def _checked(self, positions: ArrayLike, name: str) -> Floats:
        full = np.ascontiguousarray(positions, dtype=np.float64)
        if full.shape != (self.vertex_count, 3):
            raise ValueError(
                f"{name} must have shape [{self.vertex_count}, 3], one row per vertex of the scene,"
                f" got {list(full.shape)}"
            )
        _check_finite(full, name)
        return full

    def _of_mesh(self, positions: Floats) -> Floats:
        return np.asfortranarray(positions[self._full_id])

    def _off_way(self, positions: Floats, candidates: Candidates) -> float:
        """By how much positions leave what candidates were made for; at most 0 if they do not."""
        if candidates.surface is not self._surface:
            raise ValueError("candidates belong to another CollisionGeometry")
        return self._surface.distance_to_way(candidates.start, candidates.end, positions) - candidates.margin

    def _on_way(self, positions: ArrayLike, name: str, candidates: Candidates) -> Floats:
        full = self._checked(positions, name)
        off = self._off_way(full, candidates)
        if off > 0:
            raise ValueError(
                f"{name}: a vertex is {off:.3g} outside the motion that the candidates were made for; call"
                " candidates(start, end) anew with these positions in between"
            )
        return full

    def _closer_than(self, distance: float, positions: Floats, candidates: Candidates) -> ActiveSet:
        return active_set_of(*self._surface.close_pairs(positions, self._rest, distance, candidates.pairs))

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

    def _raise_touching(self, touching: ActiveSet, rounding: float) -> Never:
        kind, pairs = next((kind, pairs) for kind, pairs in touching.kinds().items() if len(pairs) > 0)
        raise IntersectionError(
            f"start: {len(touching)} pairs touch (closer than positions are rounded, {rounding:.1g}); first, a"
            f" {kind.replace('_', ' ')} pair: {self._names(pairs.vertices[0].tolist())}. No step can be bounded from"
            " there: start with a gap between the objects"
        )

    def _name(self, vertex: int) -> str:
        for name, first, end in self._objects:
            if first <= vertex < end:
                return f"vertex {vertex - first} of '{name}'"
        return f"vertex {vertex}"

    def _names(self, vertices: list[int]) -> str:
        return ", ".join(self._name(vertex) for vertex in vertices)


def _check_finite(positions: Floats, name: str) -> None:
    if not np.isfinite(positions).all():
        bad = ~np.isfinite(positions).all(axis=1)
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
