"""Where normals in pictures are smooth, and where an edge is a crease."""

from __future__ import annotations

import numpy as np
import pytest

from yasps.meshes import TriangleMesh, box, ground
from yasps.output.sharp_edges import split_at_creases, vertex_normals


def outside_of_a_box(divisions: int) -> TriangleMesh:
    shape = box((1.0, 1.0, 1.0), (divisions,) * 3)
    return TriangleMesh(shape.vertices, shape.surface_triangles())


@pytest.mark.parametrize("divisions", [1, 3])
def test_the_faces_of_a_box_are_flat(divisions: int) -> None:
    shape = outside_of_a_box(divisions)
    source, triangles = split_at_creases(shape.vertices, shape.triangles.astype(np.int64))
    np.testing.assert_array_equal(source[triangles], shape.triangles)
    assert len(source) == 6 * (divisions + 1) ** 2
    normals = vertex_normals(shape.vertices[source], triangles)
    np.testing.assert_allclose(np.abs(normals).max(axis=1), 1.0, atol=1e-12)


def test_what_bends_a_little_stays_smooth_and_a_fold_of_45_degrees_does_not() -> None:
    flat = ground((4.0, 1.0), 0.0, (4, 1))
    for degrees, is_crease in ((35.0, False), (45.0, True)):
        points = flat.vertices.copy()
        right = points[:, 0] > 0
        points[right, 2] = -np.tan(np.radians(degrees)) * points[right, 0]
        source, _ = split_at_creases(points, flat.triangles.astype(np.int64))
        assert len(source) == len(points) + (2 if is_crease else 0)


def test_triangles_that_share_a_vertex_alone_are_parted() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    source, triangles = split_at_creases(points, np.array([[0, 1, 2], [0, 3, 4]]))
    assert len(source) == 6
    np.testing.assert_array_equal(source[triangles], [[0, 1, 2], [0, 3, 4]])


def test_three_triangles_at_an_edge_are_parted() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0.1], [0, 1, -0.1], [0, -1, 0]])
    source, _ = split_at_creases(points, np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]]))
    assert len(source) == 9
