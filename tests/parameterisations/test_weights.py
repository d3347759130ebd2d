"""What NumPy finds for parameterisations: weights in cages, ways to the root, influences of bones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from yasps import ConnectivityError, DataError, Scene, SceneError, ShapeMismatchError
from yasps.meshes import box, hex_box
from yasps.parameterisations import ancestors, barycentric_weights, influences, trilinear_weights, turned

RNG = np.random.default_rng(5)
POINTS = RNG.uniform(-0.45, 0.45, (200, 3))


def test_barycentric_weights_give_points_and_affine_maps_back() -> None:
    cage = box((1.0, 1.0, 1.0), (2, 3, 2))
    cells, weights = barycentric_weights(POINTS, cage.vertices, cage.tets)
    assert weights.min() >= -1e-9
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-14)
    matrix, shift = RNG.standard_normal((3, 3)), RNG.standard_normal(3)
    moved = cage.vertices @ matrix.T + shift
    found = np.einsum("nk,nkc->nc", weights, moved[cage.tets[cells]])
    np.testing.assert_allclose(found, POINTS @ matrix.T + shift, atol=1e-13)


@pytest.mark.parametrize("distortion", [0.0, 0.05])
def test_trilinear_weights_in_distorted_hexahedra(distortion: float) -> None:
    cage = hex_box((1.0, 1.0, 1.0), (2, 3, 2))
    vertices = cage.vertices + distortion * RNG.uniform(-1, 1, cage.vertices.shape)
    points = 0.8 * POINTS
    cells, weights = trilinear_weights(points, vertices, cage.cells)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.einsum("nk,nkc->nc", weights, vertices[cage.cells[cells]]), points, atol=1e-13)
    assert weights.min() >= -1e-9


def test_points_on_a_corner_have_one_weight() -> None:
    cage = hex_box((1.0, 1.0, 1.0), (2, 2, 2))
    cells, weights = trilinear_weights(cage.vertices, cage.vertices, cage.cells)
    np.testing.assert_allclose(np.sort(weights, axis=1)[:, -1], 1.0, atol=1e-12)
    chosen = cage.cells[cells, weights.argmax(axis=1)]
    np.testing.assert_array_equal(chosen, np.arange(len(cage.vertices)))


def test_points_outside_are_named() -> None:
    cage = box((1.0, 1.0, 1.0), (1, 1, 1))
    with pytest.raises(SceneError, match=r"point 1 at \[0\.0, 0\.0, 0\.6\] is in no cell of the cage \(1 points"):
        barycentric_weights([[0.0, 0.0, 0.0], [0.0, 0.0, 0.6]], cage.vertices, cage.tets)
    grid = hex_box((1.0, 1.0, 1.0), (1, 1, 1))
    with pytest.raises(SceneError, match=r"point 0 .* is in no cell"):
        trilinear_weights([[2.0, 0.0, 0.0]], grid.vertices, grid.cells)
    with pytest.raises(ShapeMismatchError, match="hexes"):
        trilinear_weights([[0.0, 0.0, 0.0]], cage.vertices, cage.tets)


def test_ancestors() -> None:
    indices, counts = ancestors([-1, 0, 1, 0])
    assert indices.tolist() == [0, 1, 0, 2, 1, 0, 3, 0]
    assert counts.tolist() == [1, 2, 3, 2]
    with pytest.raises(ConnectivityError, match="link 0 is its own ancestor"):
        ancestors([1, 0])
    with pytest.raises(ConnectivityError, match="0 to 1, or -1"):
        ancestors([-1, 2])


def test_influences() -> None:
    found = influences([[0.25, 0.75, 0.0], [0.0, 0.0, 1.0]])
    assert found.vertices.tolist() == [0, 0, 1]
    assert found.bones.tolist() == [0, 1, 2]
    assert found.weights.tolist() == [0.25, 0.75, 1.0]
    assert found.counts.tolist() == [2, 1]
    with pytest.raises(DataError, match=r"the weights of vertex 1 add up to 0\.9 .*must add up to 1"):
        influences([[1.0, 0.0], [0.5, 0.4]])
    with pytest.raises(DataError, match="vertices, bones"):
        influences([1.0, 0.0])


def test_links_turn_in_their_plane_by_the_sum_of_angles() -> None:
    """A tree of four links, by the two sums, against rotations applied one after the other."""
    parents, angles = [-1, 0, 1, 0], np.array([0.4, -1.1, 2.0, 0.7])
    arms, axis = RNG.standard_normal((4, 3)), np.array([0.6, 0.0, 0.8])
    links = Scene("tree", threads=1).add_mesh("m").add_primitive("links", 4)
    indices, counts = ancestors(parents)
    way = links.add_connectivity("way", links, indices, counts=counts)
    angle = links.add_attribute("angle", 1, 1, value=angles)
    plane = [links.add_constant(name, 3, 1, value=[v] * 4) for name, v in (("u", [0.8, 0, -0.6]), ("v", [0, 1.0, 0]))]
    direction = links.add_attribute("direction", through=way, source=angle, operation="sum")
    arm = turned(links.add_constant("rest_arm", 3, 1, value=arms), direction, *plane)
    own = links.add_attribute("arm", computed_attribute=arm)
    ends = links.add_attribute("end", through=way, source=own, operation="sum").compute().array[:, :, 0]
    totals = [angles[0], angles[0] + angles[1], angles[:3].sum(), angles[0] + angles[3]]
    assert np.cross(plane[0].value[:3], plane[1].value[:3]) == pytest.approx(axis)
    moved = np.stack([Rotation.from_rotvec(t * axis).apply(a) for t, a in zip(totals, arms, strict=True)])
    expected = [moved[0], moved[0] + moved[1], moved[:3].sum(axis=0), moved[0] + moved[3]]
    np.testing.assert_allclose(ends, expected, atol=1e-14)
