"""Finite elements: shape functions reproduce what they must, masses and volumes add up, surfaces are closed."""

from __future__ import annotations

import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import DataError, ShapeMismatchError
from yasps.meshes import ElementMesh, MeshError, TriangleMesh, box, cloth_grid, hex_box, quadratic
from yasps.meshes.element_kinds import KINDS

RNG = np.random.default_rng(8)
BOX = box((0.4, 0.3, 0.2), (2, 1, 1))


def distorted(mesh: ElementMesh, by: float) -> ElementMesh:
    """All nodes moved a little: curved sides, uneven hexahedra."""
    return ElementMesh(mesh.kind, mesh.vertices + by * RNG.uniform(-1, 1, mesh.vertices.shape), mesh.cells)


SOLIDS = {
    "tetra": ElementMesh("tetra", BOX.vertices, BOX.tets),
    "tetra10": quadratic(BOX),
    "hexahedron": hex_box((0.4, 0.3, 0.2), (2, 1, 1)),
}


def local_of_nodes(kind: str) -> NDArray[np.float64]:
    """Local coordinates of the nodes: shape functions are 1 at their own and 0 at the others."""
    if kind == "hexahedron":
        return KINDS[kind].points * np.sqrt(3)
    corners = np.vstack([np.zeros(KINDS[kind].dimension), np.eye(KINDS[kind].dimension)])
    sides = {"tetra10": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)], "triangle6": [(0, 1), (1, 2), (2, 0)]}
    return np.vstack([corners, *(corners[list(side)].mean(axis=0)[None] for side in sides.get(kind, []))])


@pytest.mark.parametrize("kind", KINDS)
def test_slopes_differentiate_what_the_kind_can_represent(kind: str) -> None:
    """Polynomials of the kind's degree, given at the nodes, have their exact derivatives everywhere."""
    element, nodes = KINDS[kind], local_of_nodes(kind)
    dimension = element.dimension
    at = RNG.uniform(0.05, 0.3, (5, dimension))
    slopes = element.slopes(at)
    np.testing.assert_allclose(slopes.sum(axis=1), 0.0, atol=1e-14)
    linear = RNG.standard_normal(dimension)
    found = np.einsum("n,qnd->qd", nodes @ linear, slopes)
    np.testing.assert_allclose(found, np.tile(linear, (5, 1)), atol=1e-13)
    if kind in {"tetra10", "triangle6"}:
        form = RNG.standard_normal((dimension, dimension))
        form = form + form.T
        values = 0.5 * np.einsum("ni,ij,nj->n", nodes, form, nodes)
        np.testing.assert_allclose(np.einsum("n,qnd->qd", values, slopes), at @ form, atol=1e-12)


@pytest.mark.parametrize("kind", SOLIDS)
@pytest.mark.parametrize("distortion", [0.0, 0.01])
def test_an_affine_map_has_its_matrix_at_every_point(kind: str, distortion: float) -> None:
    mesh = distorted(SOLIDS[kind], distortion)
    points, f = mesh.points(), RNG.standard_normal((3, 3))
    found = np.einsum("qna,qnb->qab", mesh.vertices[points.nodes] @ f.T, points.gradients)
    np.testing.assert_allclose(found, np.tile(f, (len(found), 1, 1)), atol=1e-12)


@pytest.mark.parametrize("kind", SOLIDS)
def test_volumes_masses_and_centre(kind: str) -> None:
    mesh = SOLIDS[kind]
    assert mesh.volumes().sum() == pytest.approx(0.4 * 0.3 * 0.2, rel=1e-13)
    masses = mesh.vertex_masses(700.0)
    assert (masses > 0).all()
    assert masses.sum() == pytest.approx(700.0 * 0.4 * 0.3 * 0.2, rel=1e-13)
    np.testing.assert_allclose(masses @ mesh.vertices, 0.0, atol=1e-13)


@pytest.mark.parametrize("kind", ["tetra10", "triangle6"])
def test_masses_are_the_scaled_diagonal_of_the_consistent_matrix(kind: str) -> None:
    """HRZ, with the integrals of N^2 by formula: of barycentric monomials, d! a! b! .../(d + a + b + ...)! volumes.

    N = 2 b^2 - b at a corner and 4 b c in the middle of a side.
    """
    d = KINDS[kind].dimension
    factorial = np.cumprod([1.0, *range(1, 10)])

    def integral(*powers: int) -> float:
        return float(factorial[d] * np.prod([factorial[p] for p in powers]) / factorial[d + sum(powers)])

    corner = 4 * integral(4) - 4 * integral(3) + integral(2)
    middle = 16 * integral(2, 2)
    corners = d + 1
    middles = len(KINDS[kind].masses) - corners
    expected = np.array([corner] * corners + [middle] * middles)
    np.testing.assert_allclose(KINDS[kind].masses, expected / expected.sum(), rtol=1e-13)
    row_sum = 2 * integral(2) - integral(1)  # what lumping by row sums would give a corner
    assert row_sum <= 1e-16


@pytest.mark.parametrize(("kind", "faces"), [("tetra", 2), ("tetra10", 8), ("hexahedron", 2)])
def test_surfaces_are_closed_and_look_outwards(kind: str, faces: int) -> None:
    mesh = SOLIDS[kind]
    triangles = mesh.surface_triangles()
    assert len(triangles) == faces * (2 * 2 + 2 * 2 + 2)  # quadrilaterals of the box
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert len({tuple(edge) for edge in edges.tolist()}) == len(edges)
    assert {tuple(edge) for edge in edges.tolist()} == {tuple(edge[::-1]) for edge in edges.tolist()}
    x = mesh.vertices[triangles]
    volume = np.einsum("ij,ij->i", x[:, 0], np.cross(x[:, 1], x[:, 2])).sum() / 6
    assert volume == pytest.approx(0.4 * 0.3 * 0.2, rel=1e-13)


def test_cells_come_from_meshio(tmp_path: pytest.TempPathFactory) -> None:
    """Names and node orders are those of files."""
    for mesh in (SOLIDS["tetra10"], SOLIDS["hexahedron"]):
        file = f"{tmp_path}/mesh.vtu"
        meshio.write(file, meshio.Mesh(mesh.vertices, [(mesh.kind, mesh.cells)]))
        read = meshio.read(file)
        again = ElementMesh(mesh.kind, read.points, read.cells_dict[mesh.kind])
        assert again.volumes().sum() == pytest.approx(0.4 * 0.3 * 0.2, rel=1e-13)


def test_surface_elements() -> None:
    flat = quadratic(cloth_grid((1.0, 0.5), (2, 2)))
    assert flat.kind == "triangle6"
    assert flat.volumes().sum() == pytest.approx(0.5, rel=1e-13)
    assert len(flat.surface_triangles()) == 4 * len(flat.cells)
    points, f = flat.points(warp=(0.0, 1.0, 0.0)), RNG.standard_normal((3, 3))
    found = np.einsum("qna,qnb->qab", flat.vertices[points.nodes] @ f.T, points.gradients)
    x = flat.vertices
    a, b, c = x[flat.cells[0, :3]]
    normal = np.cross(b - a, c - a)
    np.testing.assert_allclose(found[:, :, 0], np.tile(f @ [0.0, 1.0, 0.0], (len(found), 1)), atol=1e-12)
    with pytest.raises(MeshError, match="is normal to an element"):
        flat.points(warp=normal)


def test_refusals() -> None:
    mesh = SOLIDS["hexahedron"]
    with pytest.raises(MeshError, match="Elements are of the kinds tetra, tetra10"):
        ElementMesh("wedge", mesh.vertices, mesh.cells)
    with pytest.raises(ShapeMismatchError, match=r"cells \[m, 10\]"):
        ElementMesh("tetra10", mesh.vertices, mesh.cells)
    with pytest.raises(DataError, match="there are vertices 0 to"):
        ElementMesh("hexahedron", mesh.vertices[:-1], mesh.cells)
    with pytest.raises(MeshError, match="1 of 13 nodes belong to no element; the first is node 12"):
        ElementMesh("hexahedron", np.vstack([mesh.vertices, [9.0, 9.0, 9.0]]), mesh.cells)
    with pytest.raises(MeshError, match=r"Cell 0 \(hexahedron\) is flat or inside out at rest \(2 cells are\)"):
        ElementMesh("hexahedron", mesh.vertices, mesh.cells[:, [4, 5, 6, 7, 0, 1, 2, 3]])
    with pytest.raises(MeshError, match="share a face"):
        ElementMesh("hexahedron", mesh.vertices, np.vstack([mesh.cells, mesh.cells])).surface_triangles()
    with pytest.raises(MeshError, match=r"The density is -1\.0"):
        mesh.vertex_masses(-1.0)
    square = TriangleMesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float), np.array([[0, 1, 2]], np.int32))
    assert quadratic(square).kind == "triangle6"
