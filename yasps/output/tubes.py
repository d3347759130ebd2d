"""Rods as tubes and loose vertices as balls: surfaces that follow their vertices."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]
Ids = npt.NDArray[np.int64]

_SIDES: Final = 10


def polylines(edges: npt.ArrayLike) -> list[Ids]:
    """Edges as chains that are as long as they can be: each runs through vertices with two edges and ends at others, or
    where it began.

    Args:
        edges: vertex numbers, [k, 2].

    Returns:
        Vertex numbers of each chain, one more than it has edges.
    """
    ends: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
    rows = np.asarray(edges, np.int64).reshape(-1, 2).tolist()
    for number, (a, b) in enumerate(rows):
        ends[a].append((number, b))
        ends[b].append((number, a))
    used = [False] * len(rows)

    def walk(start: int, number: int, vertex: int) -> Ids:
        chain = [start, vertex]
        used[number] = True
        while len(ends[vertex]) == 2 and vertex != start:
            number, vertex = next((one for one in ends[vertex] if not used[one[0]]), (-1, -1))
            if number < 0:
                break
            used[number] = True
            chain.append(vertex)
        return np.array(chain, np.int64)

    chains = [
        walk(vertex, number, other)
        for vertex in sorted(ends)
        if len(ends[vertex]) != 2
        for number, other in ends[vertex]
        if not used[number]
    ]
    chains += [walk(a, number, b) for number, (a, b) in enumerate(rows) if not used[number]]
    return chains


class Tubes:
    """The surface around the rods and loose vertices of a body, by VTK's filters.

    edges: [k, 2]; points: loose vertices, [l]; radii: at each vertex of the body, [n], those of 0 replaced by `thin`.
    """

    def __init__(self, edges: npt.ArrayLike, points: npt.ArrayLike, radii: Points, thin: float) -> None:
        self._chains = polylines(edges)
        self._points = np.asarray(points, np.int64).reshape(-1)
        self._radii = np.where(radii > 0, radii, thin)

    def surface(self, positions: Points) -> tuple[Points, Ids, Ids]:
        """Vertices [k, 3], triangles [m, 3], and the vertex of the body that each vertex belongs to, [k], for positions
        [n, 3]; the last two are the same for all positions."""
        import pyvista

        parts: list[Any] = []
        for chain in self._chains:
            line: Any = pyvista.PolyData(positions[chain], lines=np.r_[len(chain), np.arange(len(chain))])
            line["radius"], line["source"] = self._radii[chain], chain
            tube = line.tube(scalars="radius", absolute=True, n_sides=_SIDES, capping=True).triangulate()
            parts.append((np.asarray(tube.points), tube.regular_faces, np.asarray(tube["source"])))
        ball: Any = pyvista.Icosphere(radius=1.0, nsub=1)
        faces, corners = np.asarray(ball.regular_faces), np.asarray(ball.points)
        parts += [
            (positions[point] + self._radii[point] * corners, faces, np.full(len(corners), point))
            for point in self._points
        ]
        starts = np.cumsum([0, *(len(part[0]) for part in parts)])
        return (
            np.concatenate([np.asarray(part[0], np.float64) for part in parts]),
            np.concatenate([part[1] + start for part, start in zip(parts, starts, strict=False)]).astype(np.int64),
            np.concatenate([part[2] for part in parts]).astype(np.int64),
        )
