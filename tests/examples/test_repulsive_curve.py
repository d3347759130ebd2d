"""The curve on a sphere that stands for a rabbit: its map, and what counts as a crossing."""

from __future__ import annotations

import numpy as np
import pytest

from yasps.examples import repulsive_curve as example


def octahedron(stretch: float = 1.0) -> example.SphereMap:
    """Eight triangles; the surface is the sphere's, its upper corner `stretch` times as high."""
    corners = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    ring = [(k, (k + 1) % 4) for k in range(4)]
    triangles = [[a, b, 4] for a, b in ring] + [[b, a, 5] for a, b in ring]
    surface = corners.copy()
    surface[4] *= stretch
    return example.SphereMap(surface, np.array(triangles, np.int32), corners, 0.0)


def test_points_of_the_sphere_are_found_in_their_triangles() -> None:
    sphere_map = octahedron()
    assert (sphere_map.facing() == 1.0).all()
    points = np.random.default_rng(0).normal(size=(50, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    corners, weights = sphere_map.places(points)
    assert (weights >= 0).all()
    flat = np.einsum("nk,nki->ni", weights, sphere_map.vertices[corners])
    np.testing.assert_allclose(flat, points / np.abs(points).sum(axis=1, keepdims=True), atol=1e-14)


def test_density_is_area_over_area_and_1_on_the_whole() -> None:
    np.testing.assert_allclose(octahedron().density(), 1.0)
    density = octahedron(stretch=3.0).density()
    upper, lower = np.sqrt(9.0 + 0.5) * np.sqrt(2.0) / 2, np.sqrt(3.0) / 2  # areas of triangles
    np.testing.assert_allclose(density[4] / density[5], upper / lower)
    np.testing.assert_allclose(density[0], 0.5 * (density[4] + density[5]))


@pytest.mark.parametrize(("swapped", "expected"), [(False, 0), (True, 1)])
def test_crossings(swapped: bool, expected: int) -> None:
    points = np.array([[1.0, 0.3, 0.3], [1.0, -0.3, 0.3], [1.0, -0.3, -0.3], [1.0, 0.3, -0.3]])
    if swapped:
        points[[0, 1]] = points[[1, 0]]
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]], np.int32)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert example.crossings(points, edges) == expected
    assert example.crossings(-points, edges) == expected
