"""Frames and points that are fixed to the material of a body, whatever moves it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import DataError, SceneError
from yasps.bodies.body import Body
from yasps.frontend.language.arrays import real_numbers
from yasps.meshes.tetrahedral_mesh import Float64Array
from yasps.parameterisations import barycentric_coordinates

TETRAHEDRA = {"tetra": (0, 1, 2, 3), "tetra10": (0, 1, 2, 3), "hexahedron": (0, 1, 3, 4)}
"""Of a cell of this kind, four nodes that are not in a plane."""


def checked_vector(given: ArrayLike, what: str) -> Float64Array:
    """Three numbers. Raises DataError."""
    vector = real_numbers(given, what)
    if vector.shape != (3,):
        raise DataError(f"{what} is three numbers, got shape {list(vector.shape)}")
    return vector


def right_handed(axis: Float64Array) -> Float64Array:
    """An orthonormal frame, a row for each vector, the first along the axis [3]. Raises DataError for an axis of 0."""
    length = float(np.linalg.norm(axis))
    if not length > 0:
        raise DataError("the axis of a joint is a direction, not 0")
    first = axis / length
    second = np.cross(first, np.eye(3)[np.argmin(np.abs(first))])
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)])


def material_frame(body: Body, origin: Float64Array, vectors: Float64Array) -> tuple[NDArray[np.int64], Float64Array]:
    """Four vertices of a body, [4], and the weights by which they are a frame there now, [4, 4].

    origin [m], [3]; vectors: [3, 3], a row each. A stiff body takes four vertices far apart, a soft one the element
    nearest to the origin; a surface is held by its own triangle, at a point alone (vectors of 0). Raises SceneError for
    directions on a surface.
    """
    x = body.positions()
    kind = next((kind for kind in TETRAHEDRA if kind in body.cells), None)
    if kind is None or len(x) < 4:
        return _on_surface(body, x, origin, vectors)
    if body.meets_itself:
        tets = np.asarray(body.cells[kind])[:, TETRAHEDRA[kind]].astype(np.int64)
        chosen = tets[barycentric_coordinates(x[tets], origin).min(axis=1).argmax()]
    else:
        chosen = _far_apart(x)
    system = np.vstack([x[chosen].T, np.ones(4)])
    right = np.column_stack([np.append(origin, 1.0), *(np.append(vector, 0.0) for vector in vectors)])
    return chosen, np.linalg.solve(system, right).T


def _far_apart(x: Float64Array) -> NDArray[np.int64]:
    """Four vertices that span much: each farthest from the point, line, plane of those before."""
    first = int(np.linalg.norm(x - x.mean(axis=0), axis=1).argmax())
    from_first = x - x[first]
    second = int(np.linalg.norm(from_first, axis=1).argmax())
    line = from_first[second] / np.linalg.norm(from_first[second])
    off_line = from_first - np.outer(from_first @ line, line)
    third = int(np.linalg.norm(off_line, axis=1).argmax())
    heights = np.abs(from_first @ np.cross(line, off_line[third]))
    return np.array([first, second, third, int(heights.argmax())])


def _on_surface(
    body: Body, x: Float64Array, origin: Float64Array, vectors: Float64Array
) -> tuple[NDArray[np.int64], Float64Array]:
    if len(body.triangles) == 0:
        raise SceneError(f"{body.name} has no element that a joint could hold")
    if vectors.any():
        raise SceneError(
            f"{body.name} is a surface, whose triangles say nothing of a direction off them: hold it at points, or by"
            " several of them"
        )
    corners = x[body.triangles]
    edges = (corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
    later = (np.linalg.pinv(edges) @ (origin - corners[:, 0])[..., None])[..., 0]
    weights = np.column_stack([1 - later.sum(axis=1), later])
    miss = np.linalg.norm(np.einsum("mk,mkc->mc", weights, corners) - origin, axis=1)
    size = np.linalg.norm(np.ptp(corners, axis=1), axis=1)
    outside = np.maximum(-weights.min(axis=1), 0.0)
    best = int((outside + miss / size).argmin())
    if miss[best] > 1e-6 * size[best]:
        raise SceneError(
            f"the point {origin.tolist()} is {miss[best]:.3g} m off the surface {body.name}: choose one on it"
        )
    found = np.zeros((4, 4))
    found[0, :3] = weights[best]
    return np.append(body.triangles[best], body.triangles[best, 2]).astype(np.int64), found
