"""Reading and writing tetrahedral meshes: round trips, and every way in which a file can be unfit."""

import logging
from pathlib import Path

import meshio
import numpy as np
import pytest

from yasps.meshes import MeshError, box, read_tetrahedral_mesh, write_mesh

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
TETS = [[0, 1, 2, 3], [1, 2, 3, 4]]


def written(path: Path, cells: list[tuple[str, list[list[int]]]], points: np.ndarray = POINTS) -> Path:
    meshio.write(path, meshio.Mesh(points, cells))
    return path


@pytest.mark.parametrize("ending", [".msh", ".vtk", ".vtu", ".mesh", ".inp"])
def test_a_mesh_survives_a_file(tmp_path: Path, ending: str, capfd: pytest.CaptureFixture[str]) -> None:
    mesh = box((1, 2, 3), (2, 2, 2))
    path = tmp_path / f"box{ending}"
    write_mesh(path, mesh)
    again = read_tetrahedral_mesh(str(path))
    assert again.vertices == pytest.approx(mesh.vertices, abs=1e-12)
    assert again.tets.tolist() == mesh.tets.tolist()
    assert capfd.readouterr() == ("", "")


def test_blocks_are_joined_and_lower_cells_skipped(tmp_path: Path) -> None:
    path = written(tmp_path / "two.vtu", [("tetra", TETS[:1]), ("triangle", [[0, 1, 2]]), ("tetra", TETS[1:])])
    assert read_tetrahedral_mesh(path).tets.tolist() == TETS


def test_unused_vertices_are_dropped(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = written(tmp_path / "one.vtk", [("tetra", TETS[1:])])
    with caplog.at_level(logging.INFO):
        mesh = read_tetrahedral_mesh(path)
    assert mesh.vertices.tolist() == POINTS[1:].tolist()
    assert mesh.tets.tolist() == [[0, 1, 2, 3]]
    assert "dropped 1 of 5 vertices" in caplog.text


def test_inverted_tets_are_flipped_on_request_only(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = written(tmp_path / "mixed.vtk", [("tetra", [TETS[0], [2, 1, 3, 4]])])
    with pytest.raises(MeshError, match=r"mixed\.vtk' cannot be used\. 1 of 2 tetrahedra are inverted.*flip_inverted"):
        read_tetrahedral_mesh(path)
    mesh = read_tetrahedral_mesh(path, flip_inverted=True)
    assert mesh.volumes() == pytest.approx([1 / 6, 1 / 3])
    assert "turned 1 of 2 inverted" in caplog.text


def test_flat_tets_are_refused_even_when_flipping(tmp_path: Path) -> None:
    path = written(tmp_path / "flat.vtk", [("tetra", TETS)], POINTS * [1, 1, 0])
    with pytest.raises(MeshError, match="2 of 2 tetrahedra are flat"):
        read_tetrahedral_mesh(path, flip_inverted=True)


def test_missing_files_and_folders_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="does not exist"):
        read_tetrahedral_mesh(tmp_path / "none.msh")
    with pytest.raises(MeshError, match="is a folder"):
        read_tetrahedral_mesh(tmp_path)
    with pytest.raises(MeshError, match=r"folder .* does not exist"):
        write_mesh(tmp_path / "none" / "box.msh", box(divisions=(1, 1, 1)))


@pytest.mark.parametrize("name", ["bad.msh", "bad.vtk", "bad.vtu", "bad.mesh", "bad.stl", "bad.unknown", "bad"])
def test_unreadable_files_raise_and_print_nothing(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    path.write_text("this is no mesh\n1 2 3\n")
    with pytest.raises(MeshError, match=f"Cannot read a mesh from .*{name}"):
        read_tetrahedral_mesh(path)
    assert capfd.readouterr() == ("", "")


def test_a_cut_off_file_is_unreadable(tmp_path: Path) -> None:
    path = tmp_path / "cut.msh"
    write_mesh(path, box(divisions=(2, 2, 2)))
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(MeshError, match="Is the file whole"):
        read_tetrahedral_mesh(path)


def test_unwritable_format_is_told(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"Cannot write a mesh to .*box\.nothing"):
        write_mesh(tmp_path / "box.nothing", box(divisions=(1, 1, 1)))


def test_a_surface_is_refused_with_a_way_out(tmp_path: Path) -> None:
    path = written(tmp_path / "surface.obj", [("triangle", [[0, 1, 2], [0, 1, 3]])])
    with pytest.raises(MeshError, match=r"no tetrahedra; it has 2 triangle.*pytetwild"):
        read_tetrahedral_mesh(path)


def test_higher_order_and_other_volume_cells_are_refused(tmp_path: Path) -> None:
    middles = [0.5 * (POINTS[i] + POINTS[j]) for i, j in [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]]
    points = np.vstack([POINTS[:4], middles])
    path = written(tmp_path / "curved.vtu", [("tetra10", [list(range(10))])], points)
    with pytest.raises(MeshError, match=r"1 tetra10.*order 1"):
        read_tetrahedral_mesh(path)
    path = written(tmp_path / "mixed.vtu", [("tetra", TETS), ("pyramid", [[0, 1, 2, 3, 4]])])
    with pytest.raises(MeshError, match="1 pyramid"):
        read_tetrahedral_mesh(path)


def test_nan_and_wrong_indices_name_the_file(tmp_path: Path) -> None:
    path = written(tmp_path / "nan.vtu", [("tetra", TETS)], np.where(POINTS == 1, np.nan, POINTS))
    with pytest.raises(MeshError, match=r"nan\.vtu' cannot be used\. 4 of 5 vertices are not finite"):
        read_tetrahedral_mesh(path, flip_inverted=True)
    path = written(tmp_path / "range.vtu", [("tetra", [[0, 1, 2, 9]])])
    with pytest.raises(MeshError, match=r"range\.vtu' cannot be used.*does not exist"):
        read_tetrahedral_mesh(path)
