"""Boxes, spheres, ground and cloth."""

import numpy as np
import pytest

from yasps.meshes import MeshError, TriangleMesh, box, cloth_grid, ground, sphere


def areas_and_normals(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    return 0.5 * length, normal / length[:, None]


def test_box_fills_its_size() -> None:
    mesh = box((1.0, 2.0, 3.0), (2, 3, 4))
    assert len(mesh.vertices) == 3 * 4 * 5
    assert len(mesh.tets) == 6 * 2 * 3 * 4
    assert mesh.volumes() == pytest.approx(np.full(len(mesh.tets), 6.0 / len(mesh.tets)))
    assert mesh.bounds[0].tolist() == [-0.5, -1.0, -1.5]
    triangles = mesh.surface_triangles()
    assert len(np.unique(triangles)) - len(mesh.surface_edges()) + len(triangles) == 2
    assert len(mesh.surface_pinches()) == 0


@pytest.mark.parametrize("vertices", [100, 146, 300, 1000, 4000])
def test_sphere_is_round_and_near_the_wished_number(vertices: int) -> None:
    mesh = sphere(2.0, vertices)
    assert abs(len(mesh.vertices) - vertices) <= (0.05 if vertices >= 300 else 0.2) * vertices
    on_surface = np.unique(mesh.surface_triangles())
    assert np.linalg.norm(mesh.vertices[on_surface], axis=1) == pytest.approx(np.full(len(on_surface), 2.0), abs=1e-3)
    middle = mesh.vertex_masses(1.0) @ mesh.vertices / mesh.volumes().sum()
    assert middle == pytest.approx(np.zeros(3), abs=0.05)


def test_sphere_scales_with_its_radius() -> None:
    small, large = sphere(0.001, 500), sphere(1000.0, 500)
    assert np.array_equal(small.tets, large.tets)
    assert small.vertices * 1e6 == pytest.approx(large.vertices, abs=1e-6)


@pytest.mark.parametrize("shape", [ground, cloth_grid])
def test_grids_face_up_and_cover_their_size(shape) -> None:  # type: ignore[no-untyped-def]
    mesh = shape(size=(2.0, 3.0), divisions=(4, 5), z=0.5)
    vertices, triangles = mesh
    area, normal = areas_and_normals(mesh)
    assert vertices.shape == (5 * 6, 3)
    assert vertices.dtype == np.float64
    assert triangles.shape == (2 * 4 * 5, 3)
    assert triangles.dtype == np.int32
    assert area == pytest.approx(np.full(40, 6.0 / 40))
    assert normal == pytest.approx(np.tile([0.0, 0.0, 1.0], (40, 1)))
    assert (vertices[:, 2] == 0.5).all()
    assert vertices.min(axis=0).tolist() == [-1.0, -1.5, 0.5]
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert np.count_nonzero(count == 1) == 2 * (4 + 5)
    assert count.max() == 2


def test_cloth_diagonals_alternate() -> None:
    vertices, triangles = cloth_grid((2.0, 2.0), (2, 2))
    middle = int(np.flatnonzero((vertices == 0).all(axis=1))[0])
    assert np.count_nonzero(triangles == middle) == 8


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: box((1, 0, 1)), "size of the box"),
        (lambda: box(divisions=(1, 0, 1)), "divisions of the box"),
        (lambda: box(divisions=(1, 2.5, 1)), "whole number of cells"),  # type: ignore[arg-type]
        (lambda: sphere(-1.0), "size of the sphere"),
        (lambda: sphere(1.0, 50), "at least 100"),
        (lambda: ground((np.inf, 1)), "size of the ground"),
        (lambda: ground(z=np.nan), "height of the ground"),
        (lambda: cloth_grid(divisions=(0, 4)), "divisions of the cloth"),
        (lambda: cloth_grid(z=np.inf), "height of the cloth"),
    ],
)
def test_unfit_sizes_are_told(build, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(MeshError, match=message):
        build()
