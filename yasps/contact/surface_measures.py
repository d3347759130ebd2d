"""Areas that the pieces of a surface stand for in contact, as attributes of their positions at rest.

The barrier potential is an integral over the surface (Li et al. 2023, *Convergent incremental potential contact*):
half of it over each of two surfaces that meet. Vertices are its points, each with a third of the area of its triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, Connectivity, FloatArray, Mesh, Primitive, PrimitiveBase, SceneError
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

    def __init__(
        self, mesh: Mesh, points: Primitive, geometry: CollisionGeometry, radii: FloatArray, room: int = 1
    ) -> None:
        """Adds the primitives. room: for so many triangles around a vertex, before `resized` needs a compile."""
        pieces = _Pieces.of(geometry, radii)
        self.points, rest = points, points["rest_position"]
        self._faces: Primitive | None = None
        self._rods: Primitive | None = None
        self.edges = mesh.add_primitive("surface_edges", pieces.edge_count)
        of_points: list[Attribute] = []
        of_edges: list[Attribute] = []
        if len(pieces.triangles) > 0:
            faces = self._faces = mesh.add_primitive("surface_triangles", len(pieces.triangles))
            corners = faces.add_attribute(
                "rest_corners", through=faces.add_connectivity("corners", points, pieces.triangles, 3), source=rest
            )
            a, b, c = corners
            normal = faces.add_attribute("rest_normal", computed_attribute=0.5 * (b - a).cross(c - a))
            area = faces.add_attribute("rest_area", computed_attribute=normal.norm())
            of_points.append(_sum_of(self.points, "triangles", faces, pieces.around_points(), area, longest=room) / 3)
            of_edges.append(self._area_of_edges(faces, pieces) / 3)
        if len(pieces.rods) > 0:
            rod = self._rods = mesh.add_primitive("surface_rods", len(pieces.rods))
            start, end = rod.add_attribute(
                "rest_ends", through=rod.add_connectivity("ends", points, pieces.ends_of_rods, 2), source=rest
            )
            thick = rod.add_constant("width", 1, 1, value=pieces.widths_of_rods())
            side = rod.add_attribute("rest_area", computed_attribute=thick * (end - start).norm())
            of_points.append(_sum_of(self.points, "rods", rod, pieces.rods_at_points(), side) / 2)
            of_edges.append(_sum_of(self.edges, "rods", rod, pieces.rods_at_edges(), side))
        if len(pieces.loose) > 0:
            of_points.append(self.points.add_constant("disc", 1, 1, value=pieces.discs_of_points()))
            of_edges.append(self.edges.add_constant("disc", 1, 1, value=pieces.discs_of_edges()))
        point_area, edge_area = (reduce(add, areas) for areas in (of_points, of_edges))
        self.points.add_attribute("half_area", computed_attribute=0.5 * point_area)
        self.edges.add_attribute("half_area", computed_attribute=0.5 * edge_area)

    def resized(
        self, geometry: CollisionGeometry, radii: FloatArray
    ) -> tuple[dict[Primitive, int], dict[Attribute | Connectivity, Any]]:
        """What `Scene.resize` takes for another surface, but for the number of points. Raises SceneError for one with
        pieces of a kind that were not there, or that are gone."""
        pieces = _Pieces.of(geometry, radii)
        has_points = "disc" in self.points
        for kind, was, found in (
            ("triangles", self._faces is not None, pieces.triangles),
            ("rods", self._rods is not None, pieces.rods),
            ("loose points", has_points, pieces.loose),
        ):
            if was != (len(found) > 0):
                change = "has no more" if was else "had no"
                raise SceneError(f"contact {change} {kind}, and areas are other formulas then: make a new contact")
        counts, parts = {self.edges: pieces.edge_count}, dict[Attribute | Connectivity, Any]()
        if (faces := self._faces) is not None:
            counts[faces] = len(pieces.triangles)
            parts[faces.corners] = pieces.triangles
            parts[self.points.triangles] = pieces.around_points()
            parts[self.edges.triangles] = pieces.around_edges()
            parts[self.edges["inside"]] = pieces.is_inside()
        if (rod := self._rods) is not None:
            counts[rod] = len(pieces.rods)
            parts |= {rod.ends: pieces.ends_of_rods, rod["width"]: pieces.widths_of_rods()}
            parts |= {self.points.rods: pieces.rods_at_points(), self.edges.rods: pieces.rods_at_edges()}
        if has_points:
            parts |= {self.points["disc"]: pieces.discs_of_points(), self.edges["disc"]: pieces.discs_of_edges()}
        return counts, parts

    def _area_of_edges(self, faces: Primitive, pieces: _Pieces) -> Attribute:
        """The areas of each edge's triangles, or the share of them with which it takes part."""
        area = _sum_of(self.edges, "triangles", faces, pieces.around_edges(), faces["rest_area"], longest=2)
        normal = self.edges.add_attribute(
            "normals", through=self.edges.triangles, source=faces["rest_normal"], operation="sum"
        )
        # (cos of half the angle between two triangles)^2, where they are equal; a rim is as sharp as an edge can be.
        flat = normal.dot(normal) / (area * area + np.finfo(np.float64).tiny)
        inside = self.edges.add_constant("inside", 1, 1, value=pieces.is_inside())
        return area * (1 - (1 - FLAT_SHARE) * inside * flat)


_Rows = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Flat indices and how many of them each instance has."""


@dataclass(frozen=True)
class _Pieces:
    """Triangles [m, 3] and edges [k, 2] of a surface; of the edges the numbers of rods and of loose points. Sides: the
    numbers of the three edges of each triangle, [m, 3]. radii: [n] [m]."""

    triangles: Ids
    edges: Ids
    sides: NDArray[np.int64]
    rods: NDArray[np.int64]
    loose: NDArray[np.int64]
    radii: FloatArray
    reach: float

    @staticmethod
    def of(geometry: CollisionGeometry, radii: FloatArray) -> _Pieces:
        triangles, edges = geometry.triangles, geometry.edges
        lonely = np.flatnonzero(~_is_side(edges, triangles))
        is_point = edges[lonely, 0] == edges[lonely, 1]
        sides = _sides_of(edges, triangles)
        return _Pieces(
            triangles, edges, sides, lonely[~is_point], lonely[is_point], radii, geometry.activation_distance
        )

    @property
    def edge_count(self) -> int:
        """With the one that stands for none."""
        return len(self.edges) + 1

    @property
    def ends_of_rods(self) -> Ids:
        return np.asarray(self.edges[self.rods])

    def around_points(self) -> _Rows:
        return _naming(self.triangles, len(self.radii))

    def around_edges(self) -> _Rows:
        return _naming(self.sides, self.edge_count)

    def is_inside(self) -> NDArray[np.bool_]:
        """Which edges are between two triangles."""
        return np.asarray(np.bincount(self.sides.ravel(), minlength=self.edge_count) == 2)

    def rods_at_points(self) -> _Rows:
        return _naming(self.ends_of_rods, len(self.radii))

    def rods_at_edges(self) -> _Rows:
        return _naming(self.rods.reshape(-1, 1), self.edge_count)

    def widths_of_rods(self) -> FloatArray:
        return _width(self.radii[self.ends_of_rods].mean(axis=1), self.reach)

    def discs_of_points(self) -> FloatArray:
        """Cross-sections of loose points [m^2], [n]."""
        disc, points = np.zeros(len(self.radii)), self.edges[self.loose, 0]
        disc[points] = np.pi / 4 * _width(self.radii[points], self.reach) ** 2
        return disc

    def discs_of_edges(self) -> FloatArray:
        disc = np.zeros(self.edge_count)
        disc[self.loose] = self.discs_of_points()[self.edges[self.loose, 0]]
        return disc


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


def _naming(ids: NDArray[np.integer], count: int) -> _Rows:
    """For each of `count` instances the pieces that name it; ids: [pieces, k]."""
    of_piece = np.repeat(np.arange(len(ids)), ids.shape[1])
    order = np.argsort(ids.ravel(), kind="stable")
    return of_piece[order], np.bincount(ids.ravel(), minlength=count)


def _sum_of(
    owner: Primitive, name: str, pieces: Primitive, rows: _Rows, value: Attribute, *, longest: int = 1
) -> Attribute:
    """On each instance of the owner the sum of a value over the pieces that name it."""
    indices, counts = rows
    around = owner.add_connectivity(name, pieces, indices, counts=counts, longest=longest)
    return owner.add_attribute(f"{name}_area", through=around, source=value, operation="sum")
