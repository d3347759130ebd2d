"""Areas that the pieces of a surface stand for in contact, as attributes of their positions at rest.

The barrier potential is an integral over the surface (Li et al. 2023, *Convergent incremental potential contact*):
half of it over each of two surfaces that meet. Vertices are its points, each with a third of the area of its triangles.
"""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, FloatArray, Mesh, Primitive, PrimitiveBase
from yasps.contact.active_set import Ids
from yasps.contact.collision_geometry import CollisionGeometry

FLAT_SHARE = 1e-2
"""Share of its area with which an edge between two triangles in one plane takes part. Vertices and triangles carry the
integral; where surfaces are flat, pairs of edges would count it several times: two like meshes have 7 crossings a
vertex. They only keep edges from crossing there. Sharp edges touch each other with no vertex near, and take part."""


def add_surface_points(
    mesh: Mesh, vertices: PrimitiveBase, rest_positions: FloatArray | None, radii: FloatArray
) -> Primitive:
    """A primitive `surface_points` with an instance for each vertex, its `radius` [m] and its `rest_position` [m], 3x1.

    rest_positions: [n, 3], or None for the attribute `rest_position` of the vertices.
    """
    points = mesh.add_primitive("surface_points", len(radii))
    points.add_constant("radius", 1, 1, value=radii)
    if rest_positions is None:
        own = points.add_connectivity("vertex", vertices, np.arange(len(radii)), 1)
        row = points.add_attribute("rest_row", through=own, source=vertices["rest_position"])
        points.add_attribute("rest_position", computed_attribute=row.T)
    else:
        points.add_constant("rest_position", 3, 1, value=rest_positions)
    return points


class SurfaceMeasures:
    """Areas of the points and edges of a surface.

    points: `half_area` [m^2], half of what the vertex stands for. edges: `half_area`; the instance after the last edge
    stands for none.

    A vertex stands for a third of the area of its triangles at rest; half the side area 2 r L of its rods, of radius r
    and length L; the cross-section pi r^2 of a loose point. Rods and loose points without radius take d_hat / 2 for it.
    """

    def __init__(self, mesh: Mesh, points: Primitive, geometry: CollisionGeometry, radii: FloatArray) -> None:
        count, reach = geometry.vertex_count, geometry.activation_distance
        triangles, edges = geometry.triangles, geometry.edges
        self.points, rest = points, points["rest_position"]
        lonely = np.flatnonzero(~_is_side(edges, triangles))
        is_point = edges[lonely, 0] == edges[lonely, 1]
        rods, loose = lonely[~is_point], lonely[is_point]
        self.edges = mesh.add_primitive("surface_edges", len(edges) + 1)
        of_points: list[Attribute] = []
        of_edges: list[Attribute] = []
        if len(triangles) > 0:
            faces = mesh.add_primitive("surface_triangles", len(triangles))
            corners = faces.add_attribute(
                "rest_corners", through=faces.add_connectivity("corners", points, triangles, 3), source=rest
            )
            a, b, c = corners
            normal = faces.add_attribute("rest_normal", computed_attribute=0.5 * (b - a).cross(c - a))
            area = faces.add_attribute("rest_area", computed_attribute=normal.norm())
            of_points.append(_sum_of(self.points, "triangles", faces, triangles, area) / 3)
            of_edges.append(self._area_of_edges(faces, _sides_of(edges, triangles)) / 3)
        if len(rods) > 0:
            rod = mesh.add_primitive("surface_rods", len(rods))
            start, end = rod.add_attribute(
                "rest_ends", through=rod.add_connectivity("ends", points, edges[rods], 2), source=rest
            )
            thick = rod.add_constant("width", 1, 1, value=_width(radii[edges[rods]].mean(axis=1), reach))
            side = rod.add_attribute("rest_area", computed_attribute=thick * (end - start).norm())
            of_points.append(_sum_of(self.points, "rods", rod, edges[rods], side) / 2)
            of_edges.append(_sum_of(self.edges, "rods", rod, rods.reshape(-1, 1), side))
        if len(loose) > 0:
            disc = np.zeros(count)
            disc[edges[loose, 0]] = np.pi / 4 * _width(radii[edges[loose, 0]], reach) ** 2
            of_edge = np.zeros(len(edges) + 1)
            of_edge[loose] = disc[edges[loose, 0]]
            of_points.append(self.points.add_constant("disc", 1, 1, value=disc))
            of_edges.append(self.edges.add_constant("disc", 1, 1, value=of_edge))
        point_area, edge_area = (reduce(add, areas) for areas in (of_points, of_edges))
        self.points.add_attribute("half_area", computed_attribute=0.5 * point_area)
        self.edges.add_attribute("half_area", computed_attribute=0.5 * edge_area)

    def _area_of_edges(self, faces: Primitive, sides: NDArray[np.int64]) -> Attribute:
        """The areas of each edge's triangles, or the share of them with which it takes part."""
        area = _sum_of(self.edges, "triangles", faces, sides, faces["rest_area"])
        normal = self.edges.add_attribute(
            "normals", through=self.edges.triangles, source=faces["rest_normal"], operation="sum"
        )
        # (cos of half the angle between two triangles)^2, where they are equal; a rim is as sharp as an edge can be.
        flat = normal.dot(normal) / (area * area + np.finfo(np.float64).tiny)
        inside = self.edges.add_constant(
            "inside", 1, 1, value=np.bincount(sides.ravel(), minlength=self.edges.num_instances) == 2
        )
        return area * (1 - (1 - FLAT_SHARE) * inside * flat)


def _width(radii: FloatArray, reach: float) -> FloatArray:
    """Diameter of what has a radius, else the activation distance [m]."""
    return np.where(radii > 0, 2 * radii, reach)


def _is_side(edges: Ids, triangles: Ids) -> NDArray[np.bool_]:
    """Which edges are sides of triangles."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    base = int(max(edges.max(initial=0), triangles.max(initial=0))) + 1
    ordered = np.sort(edges, axis=1).astype(np.int64)
    return np.isin(ordered[:, 0] * base + ordered[:, 1], sides[:, 0].astype(np.int64) * base + sides[:, 1])


def _sides_of(edges: Ids, triangles: Ids) -> NDArray[np.int64]:
    """The numbers of the three edges of each triangle, [m, 3]."""
    base = int(max(edges.max(initial=0), triangles.max(initial=0))) + 1
    ordered = np.sort(edges, axis=1).astype(np.int64)
    keys = ordered[:, 0] * base + ordered[:, 1]
    order = np.argsort(keys)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).astype(np.int64)
    return order[np.searchsorted(keys, sides[..., 0] * base + sides[..., 1], sorter=order)].reshape(-1, 3)


def _sum_of(owner: Primitive, name: str, pieces: Primitive, ids: NDArray[np.integer], value: Attribute) -> Attribute:
    """On each instance of the owner the sum of a value over the pieces that name it; ids: [pieces, k]."""
    of_piece = np.repeat(np.arange(len(ids)), ids.shape[1])
    order = np.argsort(ids.ravel(), kind="stable")
    counts = np.bincount(ids.ravel(), minlength=owner.num_instances)
    around = owner.add_connectivity(name, pieces, of_piece[order], counts=counts)
    return owner.add_attribute(f"{name}_area", through=around, source=value, operation="sum")
