"""The peer ipctk in the benchmark `contacts`: the barrier of the IPC Toolkit, whole gradient and sparse Hessian."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ipctk
import numpy as np
from scipy import sparse

from benchmarks.contact_problem import REACH, STIFFNESS, FloatArray, Pairs

NEVER_PARALLEL = 0.0  # mollifier threshold


@dataclass(frozen=True)
class IpctkPairs:
    """The same pairs as objects of ipctk."""

    count: int
    potential: Any
    collisions: Any
    mesh: Any
    x: FloatArray

    def gradient(self) -> FloatArray:
        """[3 n]."""
        return np.asarray(self.potential.gradient(self.collisions, self.mesh, self.x))

    def hessian(self, project: bool) -> sparse.csc_matrix[Any]:
        """[3 n, 3 n], each pair's projected (clamped) before it is added."""
        method = ipctk.PSDProjectionMethod.CLAMP if project else ipctk.PSDProjectionMethod.NONE
        matrix: sparse.csc_matrix[Any] = self.potential.hessian(self.collisions, self.mesh, self.x, method)
        return matrix

    def assemble(self, project: bool) -> None:
        """Gradient and Hessian, as yasps' assembly gives them."""
        self.gradient()
        self.hessian(project)


def ipctk_pairs(pairs: Pairs) -> IpctkPairs:
    """The pairs for ipctk, on one thread from now on."""
    ipctk.set_num_threads(1)
    x = np.asfortranarray(pairs.vertices)
    faces = np.asfortranarray(pairs.triangles)
    edges = np.asfortranarray(ipctk.edges(faces))
    mesh = ipctk.CollisionMesh(x, edges, faces)
    collisions = ipctk.NormalCollisions()
    name, objects = _objects(pairs, _Finder(edges), _Finder(faces))
    setattr(collisions, name, objects)
    barrier = ipctk.ClampedLogSqBarrier()
    return IpctkPairs(len(objects), ipctk.BarrierPotential(barrier, REACH, STIFFNESS), collisions, mesh, x)


class _Finder:
    """Finds the number of an edge or triangle by its vertices."""

    def __init__(self, elements: Any) -> None:
        self._numbers = {tuple(sorted(row)): number for number, row in enumerate(elements.tolist())}

    def __call__(self, *vertices: int) -> int:
        return self._numbers[tuple(sorted(vertices))]


def _objects(pairs: Pairs, edge: _Finder, face: _Finder) -> tuple[str, list[Any]]:
    """Name of ipctk's list, and what goes into it."""
    rows = pairs.pairs.tolist()
    if pairs.kind == "point_point":
        return "vv_collisions", [ipctk.VertexVertexNormalCollision(p, q) for p, q in rows]
    if pairs.kind == "point_edge":
        return "ev_collisions", [ipctk.EdgeVertexNormalCollision(edge(a, b), p) for p, a, b in rows]
    if pairs.kind == "point_triangle":
        return "fv_collisions", [ipctk.FaceVertexNormalCollision(face(a, b, c), p) for p, a, b, c in rows]
    thresholds = np.full(len(rows), NEVER_PARALLEL) if pairs.threshold is None else pairs.threshold
    inside = ipctk.EdgeEdgeDistanceType.EA_EB
    return "ee_collisions", [
        ipctk.EdgeEdgeNormalCollision(edge(a, b), edge(c, d), threshold, inside)
        for (a, b, c, d), threshold in zip(rows, thresholds.tolist(), strict=True)
    ]
