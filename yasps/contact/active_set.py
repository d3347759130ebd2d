"""Close pairs of a scene's surface, sorted by the distance formula that each needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.collision.surface_pairs import ClosePairs

Floats = NDArray[np.float64]
Ids = NDArray[np.int32]


@dataclass(frozen=True)
class Pairs:
    """Close pairs that share one distance formula, in lexicographic order of vertex ids, then of edges and share.

    `counts` and `edges` are for improved max and 0 without it.
    """

    vertices: Ids
    """[n, arity] vertex ids of the scene, in the order the formula needs."""
    weight: Floats
    """[n]: how many surface pairs share the entry; multiplies its barrier where there is no improved max."""
    counts: Ids
    """[n, 2]: how often the areas of vertices 0 and 1 count, for pairs of a vertex and triangles; perhaps negative."""
    edges: Ids
    """[n, 2]: rows of `CollisionGeometry.edges`, for pairs of edges; their number for all others."""
    share: Floats
    """[n], from 0 to 1: a factor on the offset by the radii; below 1 for pairs that are near already at rest."""

    def __len__(self) -> int:
        return len(self.weight)

    def chosen(self, mask: NDArray[np.bool_]) -> Self:
        """The entries where the mask, [n], says so."""
        return type(self)(**{name: value[mask] for name, value in vars(self).items()})

    def same_as(self, other: Pairs) -> bool:
        """Whether the other has the same entries, to the last bit."""
        mine, others = vars(self), vars(other)
        return mine.keys() == others.keys() and all(np.array_equal(mine[name], others[name]) for name in mine)


@dataclass(frozen=True)
class PlanePairs(Pairs):
    """Vertices near half-spaces, sorted by half-space and vertex."""

    planes: Ids
    """[n]: the number of the half-space."""

    @classmethod
    def of(cls, vertices: Ids, planes: Ids) -> PlanePairs:
        """Pairs of vertices and planes, [n] each."""
        count = len(planes)
        none = np.zeros((count, 2), np.int32)
        return cls(vertices.reshape(-1, 1), np.ones(count), none, none, np.ones(count), planes)


@dataclass(frozen=True)
class ActiveSet:
    """All pairs whose gap is below the activation distance, one array per formula.

    The gap is the distance, less, where vertices have radii, the sum of both radii where the pair is closest times the
    entry's `share`.

    The IPC barrier potential (Li et al. 2020, section 4 and its supplement) is the sum over all entries of
    weight * mollifier * b(D): D is the squared distance named at each field, b the barrier. The mollifier is
    (c/e) (2 - c/e), with c = |u x v|^2 for the vectors u, v of both edges and e = 1e-3 |U|^2 |V|^2 of the same edges at
    rest; fields that do not name edges (0, 1) and the like have none (that is, 1).

    With improved max (Li et al. 2023, arXiv 2307.15908) an entry's weight is a sum of areas of vertices, each as often
    as `counts` says, or, for each pair of edges alone, of these edges.
    """

    point_point: Pairs
    """Two vertices."""
    point_edge: Pairs
    """Vertex; ends of the edge. Distance of point and line."""
    point_triangle: Pairs
    """Vertex; corners of the triangle. Distance of point and plane."""
    edge_edge: Pairs
    """Ends of edge a; ends of edge b. Distance of two lines; mollifier exactly 1."""
    mollified_edge_edge: Pairs
    """Edges (0, 1) and (2, 3). Distance of two lines."""
    mollified_point_edge: Pairs
    """Edges (0, 3) and (1, 2). Distance of point 0 and the line (1, 2)."""
    mollified_point_point: Pairs
    """Edges (0, 2) and (1, 3). Distance of the points 0 and 1."""
    minimum_distance: float
    """Smallest distance of all pairs above; infinity when there are none."""
    minimum_gap: float
    """Smallest gap of all pairs, those of half-spaces, too; infinity when there are none."""
    half_space: PlanePairs | None = None
    """Vertices near half-spaces, if there are half-spaces. Distance of point and plane."""

    @property
    def overlaps(self) -> bool:
        """Whether a gap is 0 or less: no barrier has a finite energy then."""
        return self.minimum_gap <= 0

    def kinds(self) -> dict[str, Pairs]:
        """Every array of pairs by its field's name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Pairs)}

    def with_half_spaces(self, pairs: PlanePairs, least: float) -> ActiveSet:
        """The same with these vertices near half-spaces, the nearest of them at the distance `least`."""
        return replace(
            self,
            half_space=pairs,
            minimum_distance=min(self.minimum_distance, least),
            minimum_gap=min(self.minimum_gap, least),
        )

    def __len__(self) -> int:
        """Number of entries, one with a weight above 1 counted once."""
        return sum(map(len, self.kinds().values()))


def active_set_of(kinds: Sequence[ClosePairs], minimum_distance: float, minimum_gap: float) -> ActiveSet:
    """The active set of the runtime's close pairs, which come in the order of its fields."""
    arities = (2, 3, 4, 4, 4, 4, 4)
    return ActiveSet(*(_pairs(*kind) for kind in zip(kinds, arities, strict=True)), minimum_distance, minimum_gap)


def _pairs(pairs: ClosePairs, arity: int) -> Pairs:
    return Pairs(
        np.ascontiguousarray(pairs.vertices[:, :arity]),
        pairs.weight,
        pairs.counts,
        pairs.edges,
        pairs.share,
    )
