"""Which edges and triangles of a surface meet, by the IPC Toolkit."""

from __future__ import annotations

import ipctk
import numpy as np

from yasps.contact.active_set import Floats, Ids
from yasps.runtime.collision.surface_pairs import Classes


class Crossings:
    """Edges that cross or touch triangles, of the vertices that take part only."""

    def __init__(
        self, rest: Floats, full_id: Ids, edges: Ids, triangles: Ids, *, labels: Ids | None, classes: Classes | None
    ) -> None:
        """Take all vertices at rest [n, 3]; the ids [v] of those that take part, which edges and triangles are numbered
        by; labels [n], of which equal ones don't meet, and classes."""
        self._full_id = full_id
        self._edges, self._triangles = np.asfortranarray(edges), np.asfortranarray(triangles)
        self._classes = classes
        self._mesh = ipctk.CollisionMesh(np.asfortranarray(rest[full_id]), self._edges, self._triangles)
        if labels is not None:
            self._mesh.can_collide = ipctk.make_vertex_patches_filter(labels[full_id])

    def exist(self, positions: Floats) -> bool:
        """Whether there are any at these positions [n, 3]."""
        surface = self._of_surface(positions)
        if not ipctk.has_intersections(self._mesh, surface, ipctk.LBVH()):
            return False
        return self._classes is None or len(self.all(positions)[0]) > 0

    def all(self, positions: Floats) -> tuple[Ids, Ids]:
        """The ends [k, 2] of all such edges and the numbers [k] of the triangles, sorted; slow."""
        surface = self._of_surface(positions)
        boxes = ipctk.LBVH()
        boxes.can_vertices_collide = self._mesh.can_collide
        size = float(np.linalg.norm(np.ptp(surface, axis=0)))
        boxes.build(surface, self._edges, self._triangles, 1e-6 * size)
        found = []
        for pair in boxes.detect_edge_face_candidates():
            edge, face = self._edges[pair.edge_id], self._triangles[pair.face_id]
            if not self._meet(self._full_id[edge[0]], self._full_id[face[0]]):
                continue
            if ipctk.is_edge_intersecting_triangle(*surface[edge], *surface[face]):
                found.append((*self._full_id[edge].tolist(), pair.face_id))
        table = np.array(sorted(found), np.int32).reshape(-1, 3)
        return table[:, :2], table[:, 2]

    def _meet(self, vertex: int, other: int) -> bool:
        return self._classes is None or bool(self._classes.meet[self._classes.of[vertex], self._classes.of[other]])

    def _of_surface(self, positions: Floats) -> Floats:
        return np.asfortranarray(positions[self._full_id])
