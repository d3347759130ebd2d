"""Positions inside cells of a coarse mesh, whose corners are the unknowns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, SceneError
from yasps.frontend.language.arrays import vertices_and_elements
from yasps.meshes import trilinear_shape, trilinear_slopes

INSIDE = 1e-9
"""How far outside a cell, in its local coordinates, a point counts as on its boundary."""
Weights = tuple[NDArray[np.int64], NDArray[np.float64]]
WeightsIn = Callable[[int, NDArray[np.float64]], NDArray[np.float64]]
"""(number of a cell, points [n, 3] near it) -> weights of its corners, [n, corners]."""


def caged_position(corners: Attribute, weights: Attribute) -> Attribute:
    """Sum of w_k x_k [m], 3x1. corners: n x 3, a JOIN of the cell's corners; weights: n x 1, or 1 x n.

    Linear in the corners: straight ways stay straight, and Hessians are projected inside each energy.
    """
    return (weights.reshape(1, corners.shape[0]) * corners).reshape(3, 1)


def barycentric_weights(points: ArrayLike, vertices: ArrayLike, tets: ArrayLike) -> Weights:
    """Of each point, which tetrahedron it lies in, [n], and the weights of the four corners, [n, 4].

    points [n, 3]; vertices [m, 3] and tets [k, 4] of the cage. The weights add up to 1, and give the point back.
    Raises SceneError for points outside of all; DataError, ShapeMismatchError.
    """
    corners, where = _cells(points, vertices, tets, 4, "tets")
    return _located(where, corners, lambda cell, inside: barycentric_coordinates(corners[cell], inside))


def barycentric_coordinates(corners: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of points [..., 3] in tetrahedra of these corners [..., 4, 3], one for each or one for all; [..., 4]."""
    edges = (corners[..., 1:, :] - corners[..., :1, :]).swapaxes(-1, -2)
    later = np.linalg.solve(edges, (points - corners[..., 0, :])[..., None])[..., 0]
    return np.concatenate([1 - later.sum(axis=-1, keepdims=True), later], axis=-1)


def trilinear_weights(points: ArrayLike, vertices: ArrayLike, hexes: ArrayLike) -> Weights:
    """Of each point, which hexahedron it lies in, [n], and the weights of the eight corners, [n, 8].

    points [n, 3]; vertices [m, 3] and hexes [k, 8] of the cage, corners in the order of VTK and meshio. The local
    coordinates are found by Newton's method, exactly in one iteration for parallelepipeds. Raises SceneError for points
    outside of all; DataError, ShapeMismatchError.
    """
    corners, where = _cells(points, vertices, hexes, 8, "hexes")

    def weights_in(cell: int, inside: NDArray[np.float64]) -> NDArray[np.float64]:
        local = np.zeros_like(inside)
        for _ in range(20):
            off = trilinear_shape(local) @ corners[cell] - inside
            jacobian = np.einsum("nkd,kc->ncd", trilinear_slopes(local), corners[cell])
            local = np.clip(local - np.linalg.solve(jacobian, off[..., None])[..., 0], -3, 3)
        return trilinear_shape(local)

    return _located(where, corners, weights_in)


def _cells(
    points: ArrayLike, vertices: ArrayLike, cells: ArrayLike, arity: int, name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of the cells, [k, arity, 3], and the points, checked."""
    x, elements = vertices_and_elements(vertices, cells, arity, ("vertices", name))
    where, _ = vertices_and_elements(points, np.empty((0, arity), np.int64), arity, ("points", name))
    return x[elements], where


def _located(points: NDArray[np.float64], corners: NDArray[np.float64], weights_in: WeightsIn) -> Weights:
    """The cell of each point, the one that it is deepest in, and its weights there."""
    owner = np.full(len(points), -1)
    found = np.zeros((len(points), corners.shape[1]))
    depth = np.full(len(points), -INSIDE)
    size = np.ptp(corners, axis=1).max(axis=1)
    low, high = corners.min(axis=1) - INSIDE * size[:, None], corners.max(axis=1) + INSIDE * size[:, None]
    for cell in range(len(corners)):
        near = np.flatnonzero(((points >= low[cell]) & (points <= high[cell])).all(axis=1))
        if near.size == 0:
            continue
        weights = weights_in(cell, points[near])
        deeper = weights.min(axis=1) > depth[near]
        chosen = near[deeper]
        owner[chosen], found[chosen], depth[chosen] = cell, weights[deeper], weights[deeper].min(axis=1)
    outside = np.flatnonzero(owner < 0)
    if outside.size:
        raise SceneError(
            f"point {outside[0]} at {points[outside[0]].tolist()} is in no cell of the cage ({outside.size} points are"
            " outside): make the cage larger"
        )
    return owner, found
