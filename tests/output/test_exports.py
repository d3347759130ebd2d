"""USD, glTF and series of meshes of a results file, read back with the libraries of these formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from results_files import DT, Motion, cube, everything, record, rod

from yasps.output import (
    OutputFileError,
    PicturesUnavailable,
    export_series,
    exports,
    read_series,
    shown_surfaces,
    usd_file,
)
from yasps.output.tubes import Tubes, polylines


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return record(everything(), tmp_path, 5, colors={"wall": "#80808080"})


@pytest.mark.parametrize("ending", ["usda", "usdc", "usd"])
def test_usd_has_the_motion_of_each_body(tmp_path: Path, file: Path, ending: str) -> None:
    usd = pytest.importorskip("pxr.Usd")
    geometry = pytest.importorskip("pxr.UsdGeom")
    (written,) = export_series(file, tmp_path / f"a.{ending}")
    series = read_series(file)
    stage = usd.Stage.Open(str(written))
    assert geometry.GetStageUpAxis(stage) == "Z"
    assert geometry.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == 1 / DT
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, 4.0)
    names = [str(prim.GetPath()) for prim in stage.GetDefaultPrim().GetChildren()]
    assert names == [f"/World/{name}" for name in ("cube", "sheet", "rod", "wall", "floor", "slope")]

    for name in ("cube", "sheet", "wall"):
        body = series.body(name)
        mesh = geometry.Mesh(stage.GetPrimAtPath(f"/World/{name}"))
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
        assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
        assert mesh.GetDoubleSidedAttr().Get() == (name == "sheet")
        assert not mesh.GetNormalsAttr().HasAuthoredValue()
        assert mesh.GetPointsAttr().GetNumTimeSamples() == (0 if name == "wall" else 5)
        for frame in range(5):
            points = np.array(mesh.GetPointsAttr().Get(float(frame)))
            x = series.positions(frame)[body.vertices]
            np.testing.assert_allclose(points[corners], x[body.triangles], atol=1e-6)
            extent = np.array(mesh.GetExtentAttr().Get(float(frame)))
            np.testing.assert_allclose(extent, [points.min(axis=0), points.max(axis=0)], atol=1e-6)
    rods = geometry.BasisCurves(stage.GetPrimAtPath("/World/rod"))
    assert list(rods.GetCurveVertexCountsAttr().Get()) == [12]
    np.testing.assert_allclose(rods.GetWidthsAttr().Get(), 0.24)
    assert (rods.GetTypeAttr().Get(), rods.GetWidthsInterpolation()) == ("linear", "vertex")
    np.testing.assert_allclose(
        rods.GetPointsAttr().Get(3.0), series.positions(3)[series.body("rod").vertices], atol=1e-6
    )
    slope = geometry.Mesh(stage.GetPrimAtPath("/World/slope"))
    corners = np.array(slope.GetPointsAttr().Get())
    np.testing.assert_allclose((corners - [0.0, 4.0, 0.0]) @ [0.0, -0.6, 0.8], 0.0, atol=1e-6)
    assert np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ [0.0, -0.6, 0.8] > 0
    wall = geometry.Mesh(stage.GetPrimAtPath("/World/wall"))
    np.testing.assert_allclose(wall.GetDisplayColorAttr().Get()[0], ((0x80 / 255 + 0.055) / 1.055) ** 2.4, rtol=1e-5)
    np.testing.assert_allclose(wall.GetDisplayOpacityAttr().Get(), [0x80 / 255])
    assert [path.name for path in tmp_path.iterdir() if "unfinished" in path.name] == []


def test_usd_has_the_times_of_the_frames_that_it_has(tmp_path: Path, file: Path) -> None:
    usd = pytest.importorskip("pxr.Usd")
    series = read_series(file)
    for options, pace, end in (({"every": 2}, 0.5 / DT, 2.0), ({"frame": -1}, 24.0, 24 * 4 * DT)):
        (written,) = export_series(series, tmp_path / "a.usda", **options)
        stage = usd.Stage.Open(str(written))
        stage.Reload()
        assert stage.GetTimeCodesPerSecond() == pytest.approx(pace)
        assert stage.GetEndTimeCode() == pytest.approx(end)


def test_names_that_usd_does_not_know_are_changed(tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd")
    motion = Motion(cube("a b", (0.0, 0.0, 0.0)), cube("a_b", (2.0, 0.0, 0.0)), cube("2nd", (4.0, 0.0, 0.0)))
    (written,) = export_series(record(motion, tmp_path, 1), tmp_path / "a.usda")
    stage = usd.Stage.Open(str(written))
    assert [prim.GetName() for prim in stage.GetDefaultPrim().GetChildren()] == ["a_b", "a_b_", "_nd"]


def test_gltf_has_a_frame_with_y_up(tmp_path: Path, file: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("pyvista")
    (written,) = export_series(file, tmp_path / "a.glb", frame=2)
    scene = trimesh.load_scene(written)
    series = read_series(file)
    x = series.positions(2)
    assert set(scene.geometry) == {"cube", "sheet", "rod", "wall", "floor", "slope"}
    for name in ("cube", "sheet", "wall"):
        body = series.body(name)
        mesh = scene.geometry[name]
        here = x[body.vertices][body.triangles]
        np.testing.assert_allclose(mesh.vertices[mesh.faces], here[..., [0, 2, 1]] * [1, 1, -1], atol=1e-6)
        color = [int(body.color[k : k + 2], 16) for k in (1, 3, 5)]
        assert mesh.visual.material.baseColorFactor.tolist() == [*color, 0x80 if name == "wall" else 255]
    tube = scene.geometry["rod"]
    tube.merge_vertices()  # its ends have corners of their own
    assert tube.is_watertight
    length = np.linalg.norm(np.diff(x[series.body("rod").vertices], axis=0), axis=1).sum()
    assert tube.volume == pytest.approx(np.pi * 0.12**2 * length, rel=0.07)  # of a prism with ten sides
    last = trimesh.load_scene(export_series(file, tmp_path / "b.glb")[0])
    np.testing.assert_allclose(last.geometry["cube"].bounds[0][1], series.positions(-1)[:8, 2].min(), atol=1e-6)


@pytest.mark.parametrize("ending", ["obj", "ply", "stl"])
def test_meshes_are_one_file_a_frame(tmp_path: Path, ending: str) -> None:
    motion = Motion(cube("cube", (0.0, 0.0, 2.0)), cube("other", (3.0, 0.0, 2.0)), velocities={"cube": (0.0, 0.0, 1.0)})
    file = record(motion, tmp_path, 4)
    series = read_series(file)
    written = export_series(file, tmp_path / f"a.{ending}", every=3)
    assert [path.name for path in written] == [f"a_0000.{ending}", f"a_0003.{ending}"]
    for path, frame in zip(written, (0, 3), strict=True):
        mesh = meshio.read(path)
        x = series.positions(frame)
        (triangles,) = (block.data for block in mesh.cells if block.type == "triangle")
        expected = np.concatenate([x[body.vertices][body.triangles] for body in series.bodies])
        np.testing.assert_allclose(mesh.points[triangles], expected, atol=1e-6)


def test_rods_in_meshes_need_pyvista(tmp_path: Path, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shown_surfaces.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(PicturesUnavailable, match=r"'rod' has rods.*pip install"):
        export_series(file, tmp_path / "a.obj")


@pytest.mark.parametrize("missing", [(usd_file, "a.usd", "usd"), (exports, "a.glb", "gltf")])
def test_missing_libraries_are_named(
    tmp_path: Path, file: Path, monkeypatch: pytest.MonkeyPatch, missing: tuple[Any, str, str]
) -> None:
    module, name, extra = missing
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(OutputFileError, match=rf"pip install 'yasps\[{extra}\]'"):
        export_series(file, tmp_path / name)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.fbx", {}, "ends in none of .usd, .usda, .usdc, .glb, .obj, .ply, .stl"),
        ("no/a.usda", {}, "does not exist"),
        ("a.obj", {"every": 0}, "every is a whole number"),
        ("a.obj", {"frame": 5}, "frames 0 to 4, not 5"),
    ],
)
def test_wrong_exports_are_refused(tmp_path: Path, file: Path, name: str, options: Any, message: str) -> None:
    before = sorted(tmp_path.iterdir())
    with pytest.raises(OutputFileError, match=message):
        export_series(file, tmp_path / name, **options)
    assert sorted(tmp_path.iterdir()) == before


def test_a_usd_file_that_can_not_be_written_leaves_nothing(tmp_path: Path, file: Path) -> None:
    pytest.importorskip("pxr.Usd")
    (tmp_path / "a.usda").mkdir()
    with pytest.raises(OutputFileError, match="can't be written"):
        export_series(file, tmp_path / "a.usda")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.usda", "motion.vtkhdf"]


# -- rods --------------------------------------------------------------------------------------------------


def as_edges(chains: list[Any]) -> set[frozenset[int]]:
    return {frozenset(pair) for chain in chains for pair in zip(chain[:-1].tolist(), chain[1:].tolist(), strict=True)}


@pytest.mark.parametrize(
    ("edges", "lengths"),
    [
        ([[0, 1], [1, 2], [2, 3]], [4]),
        ([[2, 1], [0, 1], [3, 2]], [4]),
        ([[0, 1], [1, 2], [2, 0]], [4]),  # a ring
        ([[0, 1], [0, 2], [0, 3], [3, 4]], [2, 2, 3]),  # a star
        ([[0, 1], [2, 3]], [2, 2]),
        ([[0, 1], [1, 2], [2, 0], [2, 3]], [2, 4]),  # a ring with a tail
        ([], []),
    ],
)
def test_edges_are_joined_to_chains(edges: list[list[int]], lengths: list[int]) -> None:
    chains = polylines(np.array(edges, np.int32).reshape(-1, 2))
    assert sorted(len(chain) for chain in chains) == lengths
    assert as_edges(chains) == {frozenset(edge) for edge in edges}


def test_tubes_have_their_radius_and_follow_their_vertices() -> None:
    pytest.importorskip("pyvista")
    x = rod("rod", [[0.0, 0.0, 0.3 * i] for i in range(6)], 0.1).positions()
    tubes = Tubes([[i, i + 1] for i in range(4)], [5], np.array([0.1] * 4 + [0.0, 0.2]), 0.05)
    vertices, triangles, source = tubes.surface(x)
    off = vertices - x[source]
    np.testing.assert_allclose(np.linalg.norm(off[source < 4], axis=1), 0.1, rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(off[source == 4], axis=1), 0.05, rtol=1e-5)  # it had none
    np.testing.assert_allclose(np.linalg.norm(off[source == 5], axis=1), 0.2, rtol=1e-5)
    assert triangles.max() == len(vertices) - 1
    bent, same, of = tubes.surface(x + np.column_stack([x[:, 2] ** 2, 0 * x[:, 0], 0 * x[:, 0]]))
    np.testing.assert_array_equal(triangles, same)
    np.testing.assert_array_equal(source, of)
    assert np.abs(bent - vertices).max() > 0.5
