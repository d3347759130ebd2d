"""Half-spaces that a surface stays out of: which vertices are near one, and how far a step may go.

Vertices alone meet a half-space: one that no vertex enters is not entered by edges and triangles either.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps import DataError, IntersectionError
from yasps.contact.active_set import Floats, PlanePairs
from yasps.contact.rows import row_dots

KEPT = 0.1
"""Share of its gap that a vertex keeps in one step, as pairs of surface pieces do."""


@dataclass(frozen=True)
class Plane:
    """The boundary of a half-space: a unit normal that points out of it, and a point of it [m]."""

    name: str
    normal: tuple[float, float, float]
    point: tuple[float, float, float]


class HalfSpaces:
    """Planes, and the vertices that stay out of the half-spaces below them.

    meets: bool [planes, n], which vertices do; radii: [n], of all vertices [m]; reach: d_hat [m].
    """

    def __init__(self, planes: Sequence[Plane], meets: NDArray[np.bool_], radii: Floats, reach: float) -> None:
        self.names = [plane.name for plane in planes]
        self.normals = np.array([plane.normal for plane in planes], np.float64).reshape(-1, 3)
        self.points = np.array([plane.point for plane in planes], np.float64).reshape(-1, 3)
        self.reach, self._radii = reach, radii
        self._vertices = [np.flatnonzero(row).astype(np.int32) for row in meets]
        self._radii_of_plane = [radii[ids] for ids in self._vertices]
        if not np.allclose(np.linalg.norm(self.normals, axis=1), 1.0, rtol=0, atol=1e-12):
            raise DataError("normals of half-spaces have length 1")

    def __len__(self) -> int:
        return len(self.names)

    def _gaps(self, positions: Floats, plane: int) -> Floats:
        ids = self._vertices[plane]
        heights = row_dots(np.take(positions, ids, axis=0) - self.points[plane], self.normals[plane])
        heights -= self._radii_of_plane[plane]
        return heights

    def close(self, positions: Floats) -> tuple[PlanePairs, float]:
        """Vertices nearer than d_hat to a plane, by plane and vertex; and the smallest gap of all [m]."""
        found = [(plane, self._gaps(positions, plane)) for plane in range(len(self))]
        near = [self._vertices[plane][gaps < self.reach] for plane, gaps in found]
        least = min((float(gaps.min(initial=np.inf)) for _, gaps in found), default=np.inf)
        planes = np.repeat(np.arange(len(near), dtype=np.int32), [len(ids) for ids in near])
        return PlanePairs.of(np.concatenate([np.empty(0, np.int32), *near]), planes), least

    def step_bound(self, start: Floats, end: Floats) -> float:
        """The largest step in [0, 1] from start to end [n, 3] at which each vertex keeps a tenth of its gap."""
        step = 1.0
        for plane in range(len(self)):
            before = self._gaps(start, plane)
            approach = before - self._gaps(end, plane)
            bounded = approach > (1 - KEPT) * before
            if bounded.any():
                step = min(step, float(((1 - KEPT) * before[bounded] / approach[bounded]).min()))
        return max(step, 0.0)

    def meetings(self, start: Floats, end: Floats) -> tuple[NDArray[np.int32], NDArray[np.int32], Floats]:
        """The vertices that do not keep a tenth of their gap on the way from start to end [n, 3], the numbers of their
        planes and their gaps at the start, [m] each."""
        found = []
        for plane, ids in enumerate(self._vertices):
            gaps = self._gaps(start, plane)
            meets = self._gaps(end, plane) < KEPT * gaps
            found.append((ids[meets], np.full(int(meets.sum()), plane, np.int32), gaps[meets]))
        vertices, planes, gaps = (np.concatenate(part) for part in zip(*found, strict=True))
        return vertices, planes, gaps

    def radii_of(self, vertices: NDArray[np.int32]) -> Floats:
        """Radii of these vertices [m]."""
        return np.asarray(self._radii[vertices])

    def check_free(self, positions: Floats, name: Callable[[int], str]) -> None:
        """Raises IntersectionError for vertices in or on a half-space; name(vertex) says what a vertex is called."""
        for plane, half_space in enumerate(self.names):
            gaps = self._gaps(positions, plane)
            if not (gaps > 0).all():
                inside = np.flatnonzero(~(gaps > 0))
                deepest = inside[np.argmin(gaps[inside])]
                vertex = int(self._vertices[plane][deepest])
                raise IntersectionError(
                    f"{len(inside)} vertices are in half-space {half_space!r} or touch it; deepest: "
                    f"{name(vertex)}, {-gaps[deepest]:.3g} m"
                )
