"""Finer triangle meshes: edges cut in their middle, without hanging vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from yasps.frontend.language.arrays import plain_array
from yasps.meshes.shapes import TriangleMesh
from yasps.meshes.tetrahedral_mesh import Float64Array, Int32Array, MeshError


def edges_of(triangles: Int32Array) -> tuple[Int32Array, NDArray[np.int64]]:
    """All edges of triangles [m, 3], each once, lower end first, in lexicographic order, [k, 2]; and of each triangle
    the numbers of its edges from corner 0 to 1, 1 to 2, 2 to 0, [m, 3]."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, numbers = np.unique(sides, axis=0, return_inverse=True)
    return edges.astype(np.int32), numbers.reshape(-1, 3)


def split_edges(shape: TriangleMesh, marked: ArrayLike) -> tuple[TriangleMesh, sparse.csr_array[np.float64]]:
    """Cuts edges in their middle, and others where that takes it: a triangle is cut through its longest edge first, so
    that angles stay bounded however often that is done (Rivara 1984).

    marked: bool, of the edges as `edges_of` gives them, [k]. Returns the finer mesh, whose first vertices are those of
    the old one, and the weights of its vertices in old ones, [new, old]: 1 on itself, or 1/2 on both ends of an edge.
    Raises MeshError for marks that are none.
    """
    edges, sides = edges_of(shape.triangles)
    cut = plain_array(marked, "marked edges", MeshError)
    if cut.shape != (len(edges),) or cut.dtype != np.bool_:
        raise MeshError(f"marks are bool [{len(edges)}], one for each edge, got {cut.dtype} {list(cut.shape)}")
    cut = cut.copy()
    # Both triangles of an edge must agree which edge is longer, so that equal lengths are told apart by number.
    length = np.linalg.norm(shape.vertices[edges[:, 1]] - shape.vertices[edges[:, 0]], axis=1)
    rank = np.empty(len(edges), np.int64)
    rank[np.lexsort([np.arange(len(edges)), length])] = np.arange(len(edges))
    longest = rank[sides].argmax(axis=1)
    while True:
        through = sides[np.arange(len(sides)), longest]
        more = through[cut[sides].any(axis=1) & ~cut[through]]
        if len(more) == 0:
            break
        cut[more] = True

    count = len(shape.vertices)
    middle = np.full(len(edges), -1, np.int64)
    middle[cut] = count + np.arange(int(cut.sum()))
    rows, new = np.arange(len(shape.triangles))[:, None], np.arange(3)
    turned = (longest[:, None] + new) % 3  # corners a, b, c with the longest edge from a to b
    a, b, c = shape.triangles[rows, turned].astype(np.int64).T
    m, n, p = middle[sides[rows, turned]].T  # the middles of ab, bc, ca; -1 where there is none
    whole, right, left = m < 0, (m >= 0) & (n >= 0), (m >= 0) & (p >= 0)
    halves = ~whole
    pieces = [
        (whole, (a, b, c)),
        (left, (a, m, p)),
        (left, (p, m, c)),
        (halves & ~left, (a, m, c)),
        (right, (m, b, n)),
        (right, (m, n, c)),
        (halves & ~right, (m, b, c)),
    ]
    owners = np.concatenate([np.flatnonzero(mask) for mask, _ in pieces])
    triangles = np.concatenate([np.stack(corners, axis=1)[mask] for mask, corners in pieces])
    triangles = triangles[np.argsort(owners, kind="stable")].astype(np.int32)  # neighbours stay neighbours

    ends = edges[cut]
    indices = np.concatenate([np.arange(count), ends.ravel()])
    values = np.concatenate([np.ones(count), np.full(ends.size, 0.5)])
    starts = np.concatenate([np.arange(count), count + 2 * np.arange(len(ends) + 1)])
    weights = sparse.csr_array((values, indices, starts), shape=(count + len(ends), count))
    return TriangleMesh(np.asarray(weights @ shape.vertices, np.float64), triangles), weights


def hinge_angles(positions: Float64Array, hinges: Int32Array) -> Float64Array:
    """Angles between the normals of the two triangles of each hinge of `hinges_of` [rad], from 0, flat, to pi, [h]."""
    start, end, left, right = positions[hinges].transpose(1, 0, 2)
    first, second = np.cross(end - start, left - start), np.cross(right - start, end - start)
    sine, cosine = np.linalg.norm(np.cross(first, second), axis=1), (first * second).sum(axis=1)
    return np.asarray(np.arctan2(sine, cosine), np.float64)
