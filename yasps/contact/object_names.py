"""What vertices and pieces of a surface are called in messages: by object and number there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from yasps import DataError
from yasps.contact.active_set import Ids
from yasps.runtime.collision.surface_pairs import SurfacePairs


class ObjectNames:
    """Names of the objects that the vertices of a scene belong to."""

    def __init__(self, objects: Mapping[str, int] | None, vertex_count: int) -> None:
        """objects: name -> number of vertices, in order; None: all are one without a name. Raises DataError for counts
        that don't add up."""
        self._vertex_count = vertex_count
        self._ranges: list[tuple[str, int, int]] = []
        """Name, first vertex, one past the last."""
        if objects is None:
            return
        ends = np.cumsum(list(objects.values())).tolist()
        if ends[-1:] != [vertex_count] or min(objects.values()) < 0:
            raise DataError(
                f"objects must list the vertex counts of all meshes in the order of the union, which sum to"
                f" {vertex_count}; got {dict(objects)}"
            )
        self._ranges = list(zip(objects, [0, *ends[:-1]], ends, strict=True))

    def counts(self) -> dict[str, int]:
        """Name -> number of vertices, in order; one without a name if none were given."""
        return {name: end - first for name, first, end in self._ranges} or {"": self._vertex_count}

    def objects_of_vertices(self) -> Ids:
        """The number of the object that each vertex is in, int32 [n]; all in one where none are named."""
        numbers = np.zeros(self._vertex_count, np.int32)
        for number, (_, first, end) in enumerate(self._ranges):
            numbers[first:end] = number
        return numbers

    def of(self, vertex: int) -> str:
        """The object that a vertex belongs to, and its number there."""
        for name, first, end in self._ranges:
            if first <= vertex < end:
                return f"vertex {vertex - first} of '{name}'"
        return f"vertex {vertex}"

    def of_all(self, vertices: Sequence[int]) -> str:
        """Those of several vertices."""
        return ", ".join(self.of(vertex) for vertex in vertices)

    def of_pair(self, pair: SurfacePairs) -> str:
        """The two pieces of a single pair."""
        if len(pair.vertex_triangle) > 0:
            vertex, *corners = pair.vertex_triangle[0].tolist()
            return f"{self.of(vertex)} and triangle ({self.of_all(corners)})"
        ends = pair.edge_edge[0].tolist()
        pieces = [self.of(a) if a == b else f"edge ({self.of_all([a, b])})" for a, b in (ends[:2], ends[2:])]
        return " and ".join(pieces)
