"""The checks and the helpers of tetrahedral meshes."""

import dataclasses

import numpy as np
import pytest

from yasps.meshes import MeshError, TetrahedralMesh, box
from yasps.meshes.tetrahedral_mesh import drop_unused_vertices, flip_inverted_tets, signed_volumes

CORNER = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TET = np.array([[0, 1, 2, 3]], dtype=np.int32)


def two_tets() -> TetrahedralMesh:
    vertices = np.vstack([CORNER, [1, 1, 1]])
    return TetrahedralMesh(vertices, np.array([[0, 1, 2, 3], [1, 2, 3, 4]], dtype=np.int32))


def test_arrays_are_converted_copied_and_read_only() -> None:
    vertices = CORNER.astype(int)
    mesh = TetrahedralMesh(vertices, TET.astype(np.int64))
    vertices[0] = 7
    assert mesh.vertices.dtype == np.float64
    assert mesh.tets.dtype == np.int32
    assert mesh.vertices[0].tolist() == [0, 0, 0]
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        mesh.tets = TET  # type: ignore[misc]


@pytest.mark.parametrize(
    ("vertices", "tets", "message"),
    [
        (CORNER[:, :2], TET, r"vertices is an array of shape \(4, 2\)"),
        (CORNER.astype(complex), TET, "complex128"),
        (CORNER, TET[0], r"tets is an array of shape \(4,\)"),
        (CORNER, TET.astype(float), "float64, but vertex indices are integers"),
        (CORNER, TET[:0], "no tetrahedra"),
        (CORNER, TET + 1, "1 of 1 tetrahedra use a vertex that does not exist.*Indices start at 0"),
        (CORNER, TET - 1, r"first is tetrahedron 0, \[-1, 0, 1, 2\]"),
        (np.where(CORNER == 1, np.nan, CORNER), TET, "3 of 4 vertices are not finite; the first is vertex 1"),
        (CORNER * [1, 1, 0], TET, "1 of 1 tetrahedra are flat"),
        (CORNER, np.array([[0, 1, 2, 2]]), "are flat"),
        (CORNER, TET[:, [0, 1, 3, 2]], "1 of 1 tetrahedra are inverted.*flip_inverted"),
        (np.vstack([CORNER, CORNER + 5]), TET, "4 of 8 vertices belong to no tetrahedron; the first is vertex 4"),
    ],
)
def test_what_is_wrong_is_told(vertices: np.ndarray, tets: np.ndarray, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        TetrahedralMesh(vertices, tets)


def test_flatness_does_not_depend_on_the_unit_of_length() -> None:
    assert TetrahedralMesh(CORNER * 1e-6, TET).volumes() == pytest.approx([1e-18 / 6])
    with pytest.raises(MeshError, match="flat"):
        TetrahedralMesh(CORNER * [1e6, 1e6, 1e-9], TET)


def test_volumes_and_masses() -> None:
    mesh = two_tets()
    assert mesh.volumes() == pytest.approx([1 / 6, 1 / 3])
    masses = mesh.vertex_masses(8.0)
    assert masses == pytest.approx([1 / 3, 1, 1, 1, 2 / 3])
    assert masses.sum() == pytest.approx(8.0 * mesh.volumes().sum())
    with pytest.raises(MeshError, match="density is -1"):
        mesh.vertex_masses(-1)


def test_surface_triangles_close_up_and_face_outward() -> None:
    mesh = box((1.0, 2.0, 3.0), (2, 3, 2))
    triangles = mesh.surface_triangles()
    a, b, c = (mesh.vertices[triangles[:, i]] for i in range(3))
    assert triangles.dtype == np.int32
    assert len(triangles) == 2 * 2 * (2 * 3 + 3 * 2 + 2 * 2)
    # The divergence theorem: outward triangles enclose the volume, inward ones its negative.
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(6.0)
    assert (np.einsum("ij,ij->i", a, np.cross(b - a, c - a)) > 0).all()
    assert len(mesh.surface_edges()) == 3 * len(triangles) // 2
    assert len(mesh.surface_pinches()) == 0


def test_a_triangle_of_three_tetrahedra_is_refused() -> None:
    vertices = np.vstack([CORNER, [1, 1, 1], [2, 2, 2]])
    mesh = TetrahedralMesh(vertices, np.array([[0, 1, 2, 3], [1, 2, 3, 4], [1, 2, 3, 5]], dtype=np.int32))
    with pytest.raises(MeshError, match="shared by 3"):
        mesh.surface_triangles()


def test_edges_come_once_each() -> None:
    expected = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [1, 4], [2, 3], [2, 4], [3, 4]]
    assert two_tets().edges.tolist() == expected
    assert two_tets().surface_edges().tolist() == expected
    assert two_tets().edges.dtype == np.int32


def test_pinches_are_found() -> None:
    at_a_vertex = TetrahedralMesh(
        np.vstack([CORNER, -CORNER[1:]]), np.array([[0, 1, 2, 3], [0, 4, 6, 5]], dtype=np.int32)
    )
    assert at_a_vertex.surface_pinches().tolist() == [0]
    vertices = np.vstack([CORNER, [0, -1, 0], [0, 0, -1]])
    along_an_edge = TetrahedralMesh(vertices, np.array([[0, 1, 2, 3], [0, 1, 4, 5]], dtype=np.int32))
    assert along_an_edge.surface_pinches().tolist() == [0, 1]


def test_motions_give_new_meshes() -> None:
    mesh = TetrahedralMesh(CORNER, TET)
    assert mesh.translated((1, 2, 3)).vertices[0].tolist() == [1, 2, 3]
    assert mesh.scaled(2.0).volumes() == pytest.approx([8 / 6])
    assert mesh.scaled((1, 2, 3)).volumes() == pytest.approx([1.0])
    assert mesh.rotated((0, 0, 5), np.pi / 2).vertices == pytest.approx(
        np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    )
    assert mesh.centered((5, 0, 0)).bounds[0].tolist() == [4.5, -0.5, -0.5]
    fitted = mesh.scaled((1, 2, 4)).fitted(2.0)
    assert np.stack(fitted.bounds) == pytest.approx(np.array([[0.25, 0.5, 1], [0.75, 1.5, 3]]))
    assert mesh.vertices.tolist() == CORNER.tolist()


def test_impossible_motions_are_refused() -> None:
    mesh = TetrahedralMesh(CORNER, TET)
    with pytest.raises(MeshError, match="scale factor is -1"):
        mesh.scaled(-1)
    with pytest.raises(MeshError, match="axis must not be zero"):
        mesh.rotated((0, 0, 0), 1.0)
    with pytest.raises(MeshError, match=r"offset .* three finite numbers"):
        mesh.translated((1, 2))
    with pytest.raises(MeshError, match="scale factor is 0"):
        mesh.fitted(0.0)


def test_repr_tells_size_and_place() -> None:
    expected = "TetrahedralMesh(5 vertices, 2 tets, volume 0.5, from (0, 0, 0) to (1, 1, 1))"
    assert repr(two_tets()) == expected


def test_flipping_turns_only_the_inverted() -> None:
    mesh = two_tets()
    mixed = mesh.tets.copy()
    mixed[1] = mixed[1, [1, 0, 2, 3]]
    flipped, count = flip_inverted_tets(mesh.vertices, mixed)
    assert count == 1
    assert flipped[0].tolist() == mesh.tets[0].tolist()
    assert signed_volumes(mesh.vertices, flipped) == pytest.approx(mesh.volumes())


def test_dropping_unused_vertices_keeps_the_shape() -> None:
    vertices = np.vstack([[9.0, 9, 9], CORNER[:2], [8, 8, 8], CORNER[2:]])
    kept, tets = drop_unused_vertices(vertices, np.array([[1, 2, 4, 5]]))
    assert kept.tolist() == CORNER.tolist()
    assert tets.tolist() == TET.tolist()
