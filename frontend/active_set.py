"""Close pairs of a scene's surface, sorted by the distance formula that each needs."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ids = NDArray[np.int32]

# In the order of ipctk.EdgeEdgeDistanceType (0-7): the columns of (a0, a1, b0, b1) that put the closest
# features first. Point-point types: the two closest ends, then the other end of each. Point-edge types: the
# point, the edge, then the other end of the point's own edge.
_POINT_POINT_COLUMNS = np.array([[0, 2, 1, 3], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 0, 2]])
_POINT_EDGE_COLUMNS = np.array([[2, 0, 1, 3], [3, 0, 1, 2], [0, 2, 3, 1], [1, 2, 3, 0]])
_LINE_LINE = 8
"""Value of EdgeEdgeDistanceType.EA_EB: both closest points are inside their edges."""


@dataclass(frozen=True)
class Pairs:
    """Close pairs that share one distance formula, in lexicographic order of their vertex ids."""

    vertices: Ids
    """[n, arity] vertex ids of the scene, in the order the formula needs."""
    weight: Floats
    """[n]: how many surface pairs share the entry; multiplies its barrier."""

    def __len__(self) -> int:
        return len(self.weight)

    def same_as(self, other: Pairs) -> bool:
        """Whether the other has the same entries, to the last bit."""
        mine, others = vars(self), vars(other)
        return mine.keys() == others.keys() and all(np.array_equal(mine[name], others[name]) for name in mine)


@dataclass(frozen=True)
class MollifiedPairs(Pairs):
    """Nearly parallel edge pairs: the barrier is multiplied by the mollifier of both edges."""

    threshold: Floats
    """[n]: the mollifier is below 1 where |u x v|^2 < threshold; 1e-3 |U|^2 |V|^2 of the rest edges."""


@dataclass(frozen=True)
class ActiveSet:
    """All pairs closer than the activation distance, one array per formula.

    The IPC barrier potential (Li et al. 2020, section 4 and its supplement) is the sum over all entries of
    weight * mollifier * b(D): D is the squared distance named at each field, b the barrier. The mollifier is
    (c/e) (2 - c/e), with c = |u x v|^2 for the vectors u, v of both edges and e the entry's `threshold`;
    fields that are plain `Pairs` have none (that is, 1).
    """

    point_point: Pairs
    """Two vertices."""
    point_edge: Pairs
    """Vertex; ends of the edge. Distance of point and line."""
    point_triangle: Pairs
    """Vertex; corners of the triangle. Distance of point and plane."""
    edge_edge: Pairs
    """Ends of edge a; ends of edge b. Distance of two lines; mollifier exactly 1."""
    mollified_edge_edge: MollifiedPairs
    """Edges (0, 1) and (2, 3). Distance of two lines."""
    mollified_point_edge: MollifiedPairs
    """Edges (0, 3) and (1, 2). Distance of point 0 and the line (1, 2)."""
    mollified_point_point: MollifiedPairs
    """Edges (0, 2) and (1, 3). Distance of the points 0 and 1."""
    minimum_distance: float
    """Smallest distance of all pairs above; infinity when there are none."""

    def kinds(self) -> dict[str, Pairs]:
        """Every array of pairs by its field's name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Pairs)}

    def __len__(self) -> int:
        """Number of entries, one with a weight above 1 counted once."""
        return sum(map(len, self.kinds().values()))


def read_collisions(collisions: Any, mesh: Any, positions: Floats, full_id: Ids) -> ActiveSet:
    """Sort an ipctk.NormalCollisions, built at `positions` of its `mesh`, into one array per formula.

    `full_id` maps the numbering of `mesh` to the scene's and must be increasing.
    """
    # Every access to a list or matrix of an ipctk object makes a new copy: once each.
    edges, faces = mesh.edges, mesh.faces
    vertex_vertex, vertex_weight = _columns(collisions.vv_collisions, ("vertex0_id", "vertex1_id"))
    edge_vertex, edge_weight = _columns(collisions.ev_collisions, ("edge_id", "vertex_id"))
    face_vertex, face_weight = _columns(collisions.fv_collisions, ("face_id", "vertex_id"))
    edge_pairs = collisions.ee_collisions
    edge_edge, pair_weight = _columns(edge_pairs, ("edge0_id", "edge1_id"))
    threshold = np.fromiter(map(attrgetter("eps_x"), edge_pairs), np.float64, len(edge_pairs))

    four = np.concatenate([edges[edge_edge[:, 0]], edges[edge_edge[:, 1]]], axis=1)
    u = positions[four[:, 1]] - positions[four[:, 0]]
    v = positions[four[:, 3]] - positions[four[:, 2]]
    cross = np.square(np.cross(u, v)).sum(axis=1)
    # Far from parallel, ipctk keeps a pair here only if both closest points are inside the edges. Reading
    # the type costs more than the rest, so only nearly parallel pairs are asked; the margin covers
    # rounding of `cross`.
    kind = np.full(len(four), _LINE_LINE)
    nearly = np.flatnonzero(cross < threshold * (1 + 1e-9))
    kind[nearly] = [edge_pairs[i].dtype.value for i in nearly.tolist()]
    plain = (kind == _LINE_LINE) & (cross >= threshold)
    line = (kind == _LINE_LINE) & (cross < threshold)
    mixed = (kind >= 4) & (kind < _LINE_LINE)
    point = kind < 4
    mixed_rows = np.take_along_axis(four[mixed], _POINT_EDGE_COLUMNS[kind[mixed] - 4], axis=1)
    point_rows = np.take_along_axis(four[point], _POINT_POINT_COLUMNS[kind[point]], axis=1)

    vertex_edge = np.column_stack([edge_vertex[:, 1], edges[edge_vertex[:, 0]]])
    vertex_face = np.column_stack([face_vertex[:, 1], faces[face_vertex[:, 0]]])
    squared = float(collisions.compute_minimum_distance(mesh, positions))
    ends = [2, 3, 0, 1]  # column order that exchanges the two edges
    return ActiveSet(
        point_point=_pairs(_smaller_first(full_id[vertex_vertex], [1, 0]), vertex_weight),
        point_edge=_pairs(full_id[vertex_edge], edge_weight),
        point_triangle=_pairs(full_id[vertex_face], face_weight),
        edge_edge=_pairs(_smaller_first(full_id[four[plain]], ends), pair_weight[plain]),
        mollified_edge_edge=_mollified(_smaller_first(full_id[four[line]], ends), pair_weight[line], threshold[line]),
        mollified_point_edge=_mollified(full_id[mixed_rows], pair_weight[mixed], threshold[mixed]),
        mollified_point_point=_mollified(
            _smaller_first(full_id[point_rows], [1, 0, 3, 2]), pair_weight[point], threshold[point]
        ),
        minimum_distance=float(np.sqrt(squared)),
    )


def _columns(collisions: list[Any], names: tuple[str, str]) -> tuple[Ids, Floats]:
    """Two integer attributes [n, 2] and the weight [n] of a list of ipctk collisions."""
    values = np.array(list(map(attrgetter(*names, "weight"), collisions)), np.float64).reshape(-1, 3)
    return values[:, :2].astype(np.int32), values[:, 2].copy()


def _smaller_first(rows: Ids, swap: list[int]) -> Ids:
    """The same pairs, smaller first id in front; `swap`: the column order that exchanges both sides."""
    swapped = rows[:, swap]
    return np.where(rows[:, :1] > swapped[:, :1], swapped, rows)


def _pairs(rows: Ids, weight: Floats) -> Pairs:
    order = _lexicographic(rows)
    return Pairs(rows[order], weight[order])


def _mollified(rows: Ids, weight: Floats, threshold: Floats) -> MollifiedPairs:
    order = _lexicographic(rows)
    return MollifiedPairs(rows[order], weight[order], threshold[order])


def _lexicographic(rows: Ids) -> NDArray[np.intp]:
    """Sorting permutation of the rows: makes results independent of ipctk's threads."""
    return np.lexsort(rows.T[::-1])
