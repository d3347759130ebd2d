"""Edges cut in their middle: conforming meshes of the same surface."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps.meshes import (
    MeshError,
    TriangleMesh,
    cloth_grid,
    edges_of,
    hinge_angles,
    hinges_of,
    sphere,
    split_edges,
    triangle_areas,
)


def rim_length(shape: TriangleMesh) -> float:
    """Of the edges of one triangle alone: a hanging vertex would add to it. No edge has more than two."""
    edges, sides = edges_of(shape.triangles)
    counts = np.bincount(sides.ravel())
    assert counts.max() <= 2
    ends = shape.vertices[edges[counts == 1]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())


def smallest_angle(shape: TriangleMesh) -> float:
    x = shape.vertices[shape.triangles]
    one, other = np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=2), (one * other).sum(axis=2)
    return float(np.arctan2(sine, cosine).min())


@pytest.mark.parametrize("share", [0.0, 0.05, 0.4, 1.0])
def test_the_surface_stays(share: float) -> None:
    """Area, rim, sides; marked edges are gone, corners are where they were."""
    random = np.random.default_rng(3)
    shape = cloth_grid((2.0, 1.0), (5, 4))
    shape = TriangleMesh(
        shape.vertices + 0.03 * random.standard_normal(shape.vertices.shape) * [1, 1, 0], shape.triangles
    )
    first, angle = shape, smallest_angle(shape)
    for _ in range(4 if share < 1 else 2):
        edges, _ = edges_of(shape.triangles)
        marked = random.uniform(size=len(edges)) < share
        finer, weights = split_edges(shape, marked)
        np.testing.assert_array_equal(finer.vertices[: len(shape.vertices)], shape.vertices)
        np.testing.assert_array_equal(weights @ shape.vertices, finer.vertices)
        np.testing.assert_array_equal(weights.sum(axis=1), 1.0)
        left = {tuple(edge) for edge in edges_of(finer.triangles)[0].tolist()}
        assert not left & {tuple(edge) for edge in edges[marked].tolist()}
        assert len(finer.vertices) >= len(shape.vertices) + marked.sum()
        shape = finer
    x = shape.vertices[shape.triangles]
    assert (np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])[:, 2] > 0).all()
    assert triangle_areas(*shape).sum() == pytest.approx(triangle_areas(*first).sum(), rel=1e-14)
    assert rim_length(shape) == pytest.approx(rim_length(first), rel=1e-14)
    assert len(np.unique(shape.triangles)) == len(shape.vertices)
    assert smallest_angle(shape) >= 0.5 * angle


def test_all_edges_of_a_triangle_make_four_of_it() -> None:
    shape = TriangleMesh(np.array([[0.0, 0, 0], [3, 0, 0], [0, 2, 0]]), np.array([[0, 1, 2]], np.int32))
    finer, _ = split_edges(shape, np.ones(3, np.bool_))
    assert len(finer.triangles) == 4
    np.testing.assert_allclose(triangle_areas(*finer), 0.75)


def test_a_closed_surface_stays_closed() -> None:
    ball = sphere(1.0, 100)
    shape = TriangleMesh(ball.vertices, ball.surface_triangles())
    marked = np.arange(len(edges_of(shape.triangles)[0])) % 7 == 0
    finer, _ = split_edges(shape, marked)
    edges, sides = edges_of(finer.triangles)
    assert (np.bincount(sides.ravel()) == 2).all()
    used = len(np.unique(finer.triangles))
    assert used - len(edges) + len(finer.triangles) == 2


@pytest.mark.parametrize("marked", [[True], np.zeros(5, int), np.zeros((5, 1), bool), "edges"])
def test_marks_that_are_none(marked: object) -> None:
    with pytest.raises(MeshError, match=r"marks are bool \[5\]"):
        split_edges(cloth_grid((1, 1), (1, 1)), marked)  # type: ignore[arg-type]


def test_angles_of_hinges() -> None:
    fold: NDArray[np.float64] = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3]], np.int32)
    hinges = hinges_of(triangles)
    for angle in (0.0, 0.3, 2.0, 3.1):
        fold[3] = [0.5, -np.cos(angle), np.sin(angle)]
        np.testing.assert_allclose(hinge_angles(fold, hinges), [angle], atol=1e-14)
