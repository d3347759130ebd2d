"""What cloth needs to know of its triangles: areas, masses, and the pairs that share an edge."""

from __future__ import annotations

import numpy as np

from yasps.meshes.tetrahedral_mesh import Float64Array, Int32Array


def triangle_areas(vertices: Float64Array, triangles: Int32Array) -> Float64Array:
    """Area of each triangle [m^2], [m]."""
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(normals, axis=1), np.float64)


def triangle_vertex_masses(vertices: Float64Array, triangles: Int32Array, area_density: float) -> Float64Array:
    """Lumped masses [kg], [n]: a third of each triangle's mass to each of its corners. area_density [kg/m^2]."""
    shares = np.repeat(area_density * triangle_areas(vertices, triangles) / 3, 3)
    return np.bincount(triangles.reshape(-1), weights=shares, minlength=len(vertices)).astype(np.float64)


def hinges_of(triangles: Int32Array) -> Int32Array:
    """For every edge that two triangles share: its ends, then the third corner on its left and on its right, [h, 4]."""
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    third = triangles[:, [2, 0, 1]].reshape(-1)
    key = sides.min(axis=1) * (triangles.max(initial=0) + 1) + sides.max(axis=1)
    order = np.argsort(key, kind="stable")
    first, second = order[:-1], order[1:]
    shared = key[first] == key[second]
    first, second = first[shared], second[shared]
    return np.column_stack([sides[first], third[first], third[second]]).astype(np.int32)


def hinge_stiffness(vertices: Float64Array, hinges: Int32Array, bending: float) -> Float64Array:
    """Stiffness [J] of `materials.hinge_bending` for a bending stiffness [J]: 3 l^2 / (area of both) times it, [h].

    l is the edge's rest length (Grinspun et al. 2003, "Discrete shells", eq. 3).
    """
    edge = vertices[hinges[:, 1]] - vertices[hinges[:, 0]]
    sides = [vertices[hinges[:, k]] - vertices[hinges[:, 0]] for k in (2, 3)]
    area = 0.5 * sum(np.linalg.norm(np.cross(edge, side), axis=1) for side in sides)
    return np.asarray(3 * bending * (edge * edge).sum(axis=1) / area, np.float64)
