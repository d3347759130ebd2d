"""Normals of surfaces with edges: smooth where a surface bends a little, with a crease where it is sharp."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Points = npt.NDArray[np.float64]
Ids = npt.NDArray[np.int64]

SHARP = np.radians(40.0)
"""Angle between two triangles from which on the edge between them is a crease."""


def split_at_creases(vertices: Points, triangles: Ids, sharp: float = SHARP) -> tuple[Ids, Ids]:
    """A vertex for each smooth part of the surface around it.

    VTK's own, PyVista's `compute_normals(split_vertices=True)`, parts smooth places, too: a box of 3x3 cells a face has
    104 vertices there instead of 96.

    Args:
        vertices: [n, 3]. triangles: [m, 3].
        sharp: from which angle between two triangles [rad] their edge, or a rim or an edge of more triangles, parts
            them.

    Returns:
        `source` [k], the vertex that each new one is a copy of, and the triangles of the new ones, [m, 3].
    """
    corners = triangles.ravel()
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)

    # Half edges that run along the same edge, one after the other; of two alone it is said whether they are smooth.
    start = np.arange(len(corners))
    end = 3 * (start // 3) + (start + 1) % 3
    low, high = np.minimum(corners[start], corners[end]), np.maximum(corners[start], corners[end])
    order = np.lexsort((high, low))
    key = np.stack([low, high], axis=1)[order]
    begins = np.flatnonzero(np.r_[True, (key[1:] != key[:-1]).any(axis=1)])
    pairs = begins[np.diff(np.r_[begins, len(key)]) == 2]
    one, other = order[pairs], order[pairs + 1]
    smooth = np.einsum("ij,ij->i", normals[one // 3], normals[other // 3]) > np.cos(sharp)
    one, other = one[smooth], other[smooth]

    # Corners of both triangles at the same vertex belong together.
    same = corners[start[one]] == corners[start[other]]
    first = np.concatenate([start[one], end[one]])
    second = np.concatenate([np.where(same, start[other], end[other]), np.where(same, end[other], start[other])])
    links = coo_array((np.ones(len(first), bool), (first, second)), shape=(len(corners),) * 2)
    _, label = connected_components(links, directed=False)
    _, representative, part = np.unique(label, return_index=True, return_inverse=True)
    return corners[representative], part.reshape(triangles.shape).astype(np.int64)


def vertex_normals(vertices: Points, triangles: Ids) -> Points:
    """Unit normals at the vertices, [n, 3]: the mean of the triangles' normals weighted by area; 0 without
    any."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    twice_area = np.cross(b - a, c - a)
    corners = triangles.T.ravel()
    total = np.stack(
        [np.bincount(corners, np.tile(twice_area[:, i], 3), minlength=len(vertices)) for i in range(3)], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normals: Points = np.divide(total, length, out=np.zeros_like(total), where=length > 0)
    return normals
