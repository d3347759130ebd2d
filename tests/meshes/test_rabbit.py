"""The rabbit: its size, its stance, and that it is one sound piece at every resolution."""

import ipctk
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from yasps.meshes import MeshError, rabbit
from yasps.meshes.rabbit_shape import Ellipsoid, ellipsoid_distance, rabbit_surface, smooth_minimum


@pytest.mark.parametrize("vertices", [1500, 2000, 3000, 5000, 8000])
def test_rabbit_is_one_sound_piece(vertices: int) -> None:
    mesh = rabbit(vertices)
    triangles, edges = mesh.surface_triangles(), mesh.surface_edges()
    assert abs(len(mesh.vertices) - vertices) <= 0.05 * vertices
    assert len(np.unique(triangles)) - len(edges) + len(triangles) == 2
    assert len(mesh.surface_pinches()) == 0
    count = len(mesh.vertices)
    graph = coo_array((np.ones(len(mesh.edges)), mesh.edges.T), shape=(count, count))
    assert connected_components(graph, directed=False)[0] == 1


def test_rabbit_stands_on_the_ground() -> None:
    mesh = rabbit(3000)
    low, high = mesh.bounds
    assert low[2] == pytest.approx(0.0, abs=1e-12)
    assert high[2] == pytest.approx(1.0)
    assert low[:2] == pytest.approx(-high[:2])
    # It does not topple: the centre of mass is above the feet that touch the ground.
    middle = mesh.vertex_masses(1.0) @ mesh.vertices / mesh.volumes().sum()
    feet = mesh.vertices[mesh.vertices[:, 2] < 0.01]
    assert (feet[:, :2].min(axis=0) < middle[:2]).all()
    assert (middle[:2] < feet[:, :2].max(axis=0)).all()


def test_surface_does_not_cut_itself() -> None:
    mesh = rabbit(2000)
    collision_mesh = ipctk.CollisionMesh.build_from_full_mesh(
        mesh.vertices, mesh.surface_edges(), mesh.surface_triangles()
    )
    surface = collision_mesh.vertices(mesh.vertices)
    assert not ipctk.has_intersections(collision_mesh, surface)
    # The check is a check: one vertex pulled through the body is seen.
    surface[0] = [0.0, 0.0, 5.0]
    assert ipctk.has_intersections(collision_mesh, surface)


def test_rabbit_has_ears_and_a_plane_of_symmetry() -> None:
    points = np.random.default_rng(0).uniform((-0.3, -0.4, 0), (0.3, 0.4, 1), (500, 3))
    assert rabbit_surface(points) == pytest.approx(rabbit_surface(points * (-1, 1, 1)))
    between, ear = rabbit_surface(np.array([[0, -0.09, 0.85], [0.1, -0.09, 0.85]]))
    assert between > 0 > ear


def test_the_same_wish_gives_the_same_rabbit() -> None:
    one, two = rabbit(1500), rabbit(1500)
    assert np.array_equal(one.vertices, two.vertices)
    assert np.array_equal(one.tets, two.tets)


def test_too_small_a_rabbit_is_refused() -> None:
    with pytest.raises(MeshError, match=r"100 vertices was asked for.*at least 1500"):
        rabbit(100)


def test_ellipsoid_distance_is_a_distance_near_the_surface() -> None:
    part = Ellipsoid((0.1, 0.2, 0.3), (0.5, 0.3, 0.2))
    directions = np.random.default_rng(1).normal(size=(50, 3))
    on_unit_ball = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    radii = np.array(part.radii)
    surface = np.array(part.center) + on_unit_ball * radii
    normals = on_unit_ball / radii
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert ellipsoid_distance(surface, part) == pytest.approx(np.zeros(50), abs=1e-12)
    assert ellipsoid_distance(surface + 1e-6 * normals, part) == pytest.approx(np.full(50, 1e-6), rel=1e-3)
    assert ellipsoid_distance(np.array([part.center]), part) == pytest.approx([-0.2])


def test_smooth_minimum_is_the_minimum_outside_its_blend() -> None:
    a, b = np.array([0.0, 1.0, 0.3]), np.array([1.0, 0.0, 0.3])
    assert smooth_minimum(a, b, 0.4) == pytest.approx([0.0, 0.0, 0.2])
