"""Pairs of surface pieces that may come close, the close ones by distance formula, and how far a step may go.

For a surface of vertices, edges and triangles that move in straight lines. Positions are float64 [n, 3], C-contiguous;
pairs are int32 [p, 4]: the ends of two edges, or a vertex and the corners of a triangle.
"""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from yasps.runtime.core.library import BoolArray, FloatArray, IntArray, Runtime, check_status
from yasps.runtime.core.uncopied import Uncopied

KINDS = 7
"""Kinds of close pairs, in the order of `Kind` in close_entry.h."""
_EFFORT = 4
"""What a search of all pairs costs, beside one of those of a few vertices."""
_EFFORT_PER_ORDER = 16 * _EFFORT
"""So many searches use one order of the trees: a better one costs as much as a few searches in a bad one."""
_FEW = 256
"""Surfaces with fewer vertices are searched before a second thread has woken up."""
_FEW_PAIRS = 4096
"""The same of pairs that are measured."""
MOST_PAIRS = (2**31 - 1) // 7
"""Close pairs are numbered with 31 bits, and with improved max a vertex and a triangle may add seven of them."""


@dataclass(frozen=True)
class SurfacePairs:
    """Pairs of pieces of a surface."""

    edge_edge: IntArray
    vertex_triangle: IntArray

    def __len__(self) -> int:
        return len(self.edge_edge) + len(self.vertex_triangle)


@dataclass(frozen=True)
class ClosePairs:
    """Pairs of one kind, sorted by their vertices, edges and share; see `ActiveSet` in yasps/contact/active_set.py.

    vertices: int32 [n, 4], 0 in places that the kind does not use. weight: float64 [n], how many pairs. counts, edges:
    int32 [n, 2], 0 without improved max. share: float64 [n], of the offset by the radii.
    """

    vertices: IntArray
    weight: FloatArray
    counts: IntArray
    edges: IntArray
    share: FloatArray


@dataclass(frozen=True)
class Meetings:
    """Pairs that would meet on a straight way.

    vertices: int32 [n, 4]. times: float64 [n], the share of the way after which a pair has a tenth of its gap. gaps,
    offsets: [n], at its start, and the sum of the radii there. weights: [n, 4], of the vertices where the pieces are
    closest at that time, negative for the first piece. ways: [n, 3], from the first piece to the second then.
    """

    vertices: IntArray
    times: FloatArray
    gaps: FloatArray
    offsets: FloatArray
    weights: FloatArray
    ways: FloatArray


@dataclass(frozen=True)
class Pieces:
    """What a surface consists of: int32 vertex ids, C-contiguous.

    vertices: [v], all that take part. edges: [e, 2], with those of triangles, each once, the lower end first, in
    lexicographic order. triangles: [t, 3]. points: [p], loose vertices. free_edges: [f, 2], those in no triangle, which
    points meet.
    """

    vertices: IntArray
    edges: IntArray
    triangles: IntArray
    points: IntArray
    free_edges: IntArray


@dataclass(frozen=True)
class Thickness:
    """radii: float64 [n], of all vertices. objects: int32 [n], a number of the object that each is in. reach: the gap
    that pieces of one object have at least at rest, as far as they may."""

    radii: FloatArray
    objects: IntArray
    reach: float


@dataclass(frozen=True)
class Classes:
    """of: int32 [n], the class of each vertex. meet: bool [c, c], symmetric: which classes do."""

    of: IntArray
    meet: BoolArray


class Surface(Uncopied):
    """The pieces of a surface, in bounding volume trees."""

    def __init__(
        self,
        runtime: Runtime,
        pieces: Pieces,
        labels: IntArray,
        thickness: Thickness | None = None,
        classes: Classes | None = None,
    ) -> None:
        """Take the pieces, and a label for each vertex of the scene, int32 [n].

        Pieces whose vertices all have the same label >= 0 do not meet other such pieces with that label.
        """
        self._runtime = runtime
        self._effort = _EFFORT_PER_ORDER
        self.vertices = pieces.vertices
        self.thickness, self._classes = thickness, classes  # the library keeps their addresses
        # A point is an edge without length.
        points = np.column_stack([pieces.points, pieces.points])
        arrays = (pieces.vertices, pieces.edges, pieces.triangles, points, pieces.free_edges)
        own = [np.ascontiguousarray(part, np.int32) for part in arrays]
        self.edges = own[1] if len(points) == 0 else np.unique(np.concatenate([own[1], own[3]]), axis=0)
        handle = runtime.library.yasps_surface_new(
            (ctypes.c_void_p * len(own))(*(part.ctypes.data for part in own)),
            (ctypes.c_long * len(own))(*map(len, own)),
            labels.ctypes.data,
            None if thickness is None else thickness.radii.ctypes.data,
            None if classes is None else classes.of.ctypes.data,
            None if classes is None else classes.meet.ctypes.data,
            0 if classes is None else len(classes.meet),
        )
        if not handle:
            raise MemoryError("no memory for the trees of a surface")
        self._handle: int = handle
        weakref.finalize(self, runtime.library.yasps_surface_free, handle)
        close_set = runtime.library.yasps_close_set_new(
            self.edges.ctypes.data,
            len(self.edges),
            len(labels),
            *self._thickness_arguments(),
        )
        if not close_set:
            raise MemoryError("no memory for the close pairs of a surface")
        self._close_set: int = close_set
        weakref.finalize(self, runtime.library.yasps_close_set_free, close_set)
        step_bound = runtime.library.yasps_step_bound_new()
        if not step_bound:
            raise MemoryError("no memory for the step bounds of a surface")
        self._step_bound: int = step_bound
        weakref.finalize(self, runtime.library.yasps_step_bound_free, step_bound)

    def find(
        self, start: FloatArray, end: FloatArray, reach: float, kept: tuple[SurfacePairs, BoolArray] | None = None
    ) -> SurfacePairs:
        """All pairs without a common vertex that may come within `reach` and their radii on the straight way; and some
        that do not.

        kept: pairs found before with this reach or more, and a mask [n]: the vertices whose pairs have to be looked for
        again. The others move as they did then, or for a part of that way, all at the same time.
        """
        counts = (ctypes.c_long * 2)()
        sort = self._effort >= _EFFORT_PER_ORDER
        self._effort = (0 if sort else self._effort) + (_EFFORT if kept is None else 1)
        library = self._runtime.library
        threads = self._runtime.thread_count(None) if len(self.vertices) >= _FEW else 1
        status = library.yasps_surface_find(
            self._handle,
            start.ctypes.data,
            end.ctypes.data,
            len(start),
            reach,
            int(sort),
            *((None, None, 0, None, 0) if kept is None else (kept[1].ctypes.data, *_addresses(kept[0]))),
            counts,
            threads,
        )
        check_status(status)
        check_pair_count(sum(counts))
        pairs = SurfacePairs(np.empty((counts[0], 4), np.int32), np.empty((counts[1], 4), np.int32))
        library.yasps_surface_pairs(
            self._handle, pairs.edge_edge.ctypes.data, pairs.vertex_triangle.ctypes.data, threads
        )
        return pairs

    def distance_to_way(self, start: FloatArray, end: FloatArray, positions: FloatArray, margin: float) -> float:
        """The largest distance of a vertex at `positions` from where it is on the straight way, all at the same time:
        one at which all are within the margin, if there is one, else about the best for all."""
        distance = ctypes.c_double()
        self._runtime.library.yasps_distance_to_way(
            start.ctypes.data,
            end.ctypes.data,
            positions.ctypes.data,
            self.vertices.ctypes.data,
            len(self.vertices),
            margin,
            ctypes.addressof(distance),
        )
        return distance.value

    def part_of_way(
        self, start: FloatArray, end: FloatArray, new_start: FloatArray, new_end: FloatArray, allowed: float
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """A way near the one from new_start to new_end: of vertices that are within `allowed` of it the nearest part of
        the way from start to end, the same part for all; of others, which the mask [n] marks, the new one."""
        first, last, strayed = new_start.copy(), new_end.copy(), np.zeros(len(start), np.bool_)
        self._runtime.library.yasps_part_of_way(
            start.ctypes.data,
            end.ctypes.data,
            self.vertices.ctypes.data,
            len(self.vertices),
            allowed,
            first.ctypes.data,
            last.ctypes.data,
            strayed.ctypes.data,
        )
        return first, last, strayed

    def close_pairs(
        self, positions: FloatArray, rest: FloatArray, reach: float, pairs: SurfacePairs, improved_max: bool = False
    ) -> tuple[list[ClosePairs], float, float]:
        """Those of the pairs whose gap (their distance less their radii) is below `reach`, one entry for each kind, and
        their least distance and gap, infinite where there are none.

        rest: positions whose edge lengths say where edges count as parallel, and which share pairs have. Equal entries
        come once, with their number as weight. With improved max those of edge pairs each come alone, and those of
        vertices and triangles with the counts that are left.
        """
        ends = (ctypes.c_long * KINDS)()
        least = (ctypes.c_double * 2)()
        library, threads = self._runtime.library, self._threads_for(pairs)
        status = library.yasps_close_set_find(
            self._close_set,
            positions.ctypes.data,
            rest.ctypes.data,
            reach,
            int(improved_max),
            *_addresses(pairs),
            threads,
            ends,
            least,
        )
        check_status(status)
        count = ends[-1]
        vertices, weight, share = np.empty((count, 4), np.int32), np.empty(count), np.empty(count)
        counts, edges = np.zeros((count, 2), np.int32), np.zeros((count, 2), np.int32)
        status = library.yasps_close_set_copy(
            self._close_set,
            threads,
            vertices.ctypes.data,
            weight.ctypes.data,
            counts.ctypes.data if improved_max else None,
            edges.ctypes.data if improved_max else None,
            share.ctypes.data,
        )
        check_status(status)
        parts = [slice(begin, end) for begin, end in pairwise([0, *ends])]
        kinds = [ClosePairs(vertices[k], weight[k], counts[k], edges[k], share[k]) for k in parts]
        return kinds, *least

    def step_bound(
        self, start: FloatArray, end: FloatArray, rest: FloatArray, touching: float, pairs: SurfacePairs
    ) -> float | None:
        """The largest step in [0, 1] from start straight towards end at which every pair still has a tenth of its gap,
        to 1 %; None if one is within `touching` at the start."""
        step = ctypes.c_double()
        status = self._runtime.library.yasps_step_bound(
            self._step_bound,
            start.ctypes.data,
            end.ctypes.data,
            len(start),
            rest.ctypes.data,
            *self._thickness_arguments(),
            touching,
            *_addresses(pairs),
            self._threads_for(pairs),
            ctypes.addressof(step),
        )
        check_status(status)
        return step.value if step.value >= 0 else None

    def meetings(self, start: FloatArray, end: FloatArray, rest: FloatArray, pairs: SurfacePairs) -> Meetings:
        """Those of the pairs that do not keep a tenth of their gap on the straight way from start to end."""
        found = []
        for vertices, split in ((pairs.edge_edge, 2), (pairs.vertex_triangle, 1)):
            count = len(vertices)
            times, gaps, offsets = np.empty(count), np.empty(count), np.empty(count)
            weights, ways = np.empty((count, 4)), np.empty((count, 3))
            status = self._runtime.library.yasps_meetings(
                start.ctypes.data,
                end.ctypes.data,
                len(start),
                rest.ctypes.data,
                *self._thickness_arguments(),
                vertices.ctypes.data,
                count,
                split,
                self._threads_for(pairs),
                *(one.ctypes.data for one in (times, gaps, offsets, weights, ways)),
            )
            check_status(status)
            meets = times <= 1
            found.append([one[meets] for one in (vertices, times, gaps, offsets, weights, ways)])
        return Meetings(*(np.concatenate(both) for both in zip(*found, strict=True)))

    def _thickness_arguments(self) -> tuple[int | None, int | None, float]:
        thick = self.thickness
        return (None, None, 0.0) if thick is None else (thick.radii.ctypes.data, thick.objects.ctypes.data, thick.reach)

    def _threads_for(self, pairs: SurfacePairs) -> int:
        return self._runtime.thread_count(None) if len(pairs) >= _FEW_PAIRS else 1


def check_pair_count(count: int) -> None:
    """Raises MemoryError if the pairs that may come close are more than can be numbered."""
    if count > MOST_PAIRS:
        raise MemoryError(
            f"{count} pairs of surface pieces may come close, but at most {MOST_PAIRS} are numbered: is the activation"
            " distance much larger than the edges of the surfaces, or do bodies move very far in a step?"
        )


def _addresses(pairs: SurfacePairs) -> tuple[int, int, int, int]:
    edges, triangles = pairs.edge_edge, pairs.vertex_triangle
    return edges.ctypes.data, len(edges), triangles.ctypes.data, len(triangles)
