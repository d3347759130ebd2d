"""The temporal VTKHDF writer, read back through VTK's own reader."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import h5py
import numpy as np
import pytest

from yasps.output import OutputFileError, VtkHdfSeries, vtkhdf

vtk_hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
pyvista = pytest.importorskip("pyvista")

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 2, 2.0]])
CELLS = {"tetra": np.array([[0, 1, 2, 3]]), "triangle": np.array([[1, 2, 4], [0, 1, 4]])}


def steps_of(path):
    """(time, grid) of every step, as VTK's reader (that of ParaView) sees the file."""
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

    reader = vtk_hdf.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    information = reader.GetOutputInformation(0)
    times = [information.Get(Pipeline.TIME_STEPS(), i) for i in range(information.Length(Pipeline.TIME_STEPS()))]
    if not times:  # VTK gives a file with one step no times
        with h5py.File(path) as file:
            assert file["VTKHDF/Steps"].attrs["NSteps"] == 1
            times = file["VTKHDF/Steps/Values"][:].tolist()
    result = []
    for time in times:
        information.Set(Pipeline.UPDATE_TIME_STEP(), time)
        reader.Update()
        result.append((time, pyvista.wrap(reader.GetOutputDataObject(0)).copy()))
    return result


@pytest.mark.parametrize("single_precision", [False, True])
def test_all_steps_are_read_back(tmp_path, single_precision):
    path = tmp_path / "fall.vtkhdf"
    rng = np.random.default_rng(1)
    frames = [POINTS + rng.random(POINTS.shape) for _ in range(7)]
    pressure = rng.random((7, 3))
    with VtkHdfSeries(
        path,
        len(POINTS),
        CELLS,
        static_cell_data={"body": [0, 1, 1]},
        static_point_data={"rest": POINTS},
        single_precision=single_precision,
    ) as series:
        for i, points in enumerate(frames):
            series.write_frame(
                0.1 * i,
                points,
                point_data={"velocity": points - POINTS, "number": np.arange(5) + i},
                cell_data={"pressure": pressure[i], "active": pressure[i] > 0.5},
            )
        assert series.number_of_frames == 7

    tolerance = 1e-6 if single_precision else 0.0
    steps = steps_of(path)
    assert len(steps) == 7
    for i, (time, grid) in enumerate(steps):
        assert time == 0.1 * i
        assert grid.celltypes.tolist() == [10, 5, 5]
        assert grid.cells.tolist() == [4, 0, 1, 2, 3, 3, 1, 2, 4, 3, 0, 1, 4]
        np.testing.assert_allclose(grid.points, frames[i], rtol=0, atol=tolerance)
        np.testing.assert_allclose(grid.point_data["velocity"], frames[i] - POINTS, rtol=0, atol=tolerance)
        np.testing.assert_allclose(grid.point_data["rest"], POINTS, rtol=0, atol=0)
        assert grid.point_data["number"].tolist() == list(range(i, i + 5))
        np.testing.assert_allclose(grid.cell_data["pressure"], pressure[i], rtol=0, atol=tolerance)
        assert grid.cell_data["active"].tolist() == (pressure[i] > 0.5).tolist()
        assert grid.cell_data["body"].tolist() == [0, 1, 1]
    with h5py.File(path) as file:
        assert file["VTKHDF/Points"].dtype == (np.float32 if single_precision else np.float64)
        assert file["VTKHDF/Connectivity"].shape == (10,)  # the cells are there once, not once a frame


def test_pyvista_opens_the_file_by_its_name(tmp_path):
    with VtkHdfSeries(tmp_path / "a.vtkhdf", 5, CELLS) as series:
        series.write_frame(0.0, POINTS)
    np.testing.assert_array_equal(pyvista.read(tmp_path / "a.vtkhdf").points, POINTS)


def test_more_frames_than_a_chunk_of_times(tmp_path, monkeypatch):
    monkeypatch.setattr(vtkhdf, "_STEPS_PER_CHUNK", 2)
    monkeypatch.setattr(vtkhdf, "_LARGEST_CHUNK", 3)  # chunks that straddle frames
    with VtkHdfSeries(tmp_path / "a.vtkhdf", 5, CELLS) as series:
        for i in range(9):
            series.write_frame(i, POINTS + i)
    for i, (time, grid) in enumerate(steps_of(tmp_path / "a.vtkhdf")):
        assert time == i
        np.testing.assert_array_equal(grid.points, POINTS + i)


def test_the_file_can_be_read_while_the_run_goes_on(tmp_path):
    path = tmp_path / "a.vtkhdf"
    with VtkHdfSeries(path, 5, CELLS) as series:
        assert not path.exists()
        for i in range(3):
            series.write_frame(i, POINTS + i)
            steps = steps_of(path)
            assert len(steps) == i + 1
            np.testing.assert_array_equal(steps[i][1].points, POINTS + i)
    assert os.listdir(tmp_path) == ["a.vtkhdf"]


def test_an_older_file_stays_until_the_first_frame(tmp_path):
    path = tmp_path / "a.vtkhdf"
    path.write_text("older")
    with VtkHdfSeries(path, 5, CELLS) as series:
        assert path.read_text() == "older"
        with pytest.raises(OutputFileError):
            series.write_frame(0.0, POINTS * np.nan)
        assert path.read_text() == "older"
        series.write_frame(0.0, POINTS)
    assert len(steps_of(path)) == 1


def bad_frames():
    nan = POINTS.copy()
    nan[3, 1] = np.nan
    good = {"u": POINTS}
    return {
        "nan": ((1.0, nan), {"point_data": good}, r"points is not finite .* row 3"),
        "points": (
            (1.0, POINTS[:4]),
            {"point_data": good},
            r"points has shape \[4, 3\].*\[5\].*begin another series",
        ),
        "columns": ((1.0, POINTS[:, :2]), {"point_data": good}, r"shape \[5, 2\], expected \[5, 3\]"),
        "time": ((0.0, POINTS), {"point_data": good}, r"greater than that of the frame before \(0.0\)"),
        "time nan": ((np.nan, POINTS), {"point_data": good}, r"is nan"),
        "missing": ((1.0, POINTS), {}, r"Every frame of a series must hold the same data"),
        "additional": ((1.0, POINTS), {"point_data": good, "cell_data": {"w": [1, 2, 3]}}, "same data"),
        "data columns": ((1.0, POINTS), {"point_data": {"u": POINTS[:, 0]}}, r"components \[\]"),
        "data rows": (
            (1.0, POINTS),
            {"point_data": {"u": POINTS[:3]}},
            r"point_data\['u'\] has shape \[3, 3\]",
        ),
        "data nan": ((1.0, POINTS), {"point_data": {"u": nan}}, r"point_data\['u'\] is not finite"),
        "data type": ((1.0, POINTS), {"point_data": {"u": ["a"] * 5}}, r"only numbers"),
        "static": ((1.0, POINTS), {"point_data": {"u": POINTS, "rest": POINTS}}, "static data"),
    }


@pytest.mark.parametrize("case", bad_frames())
def test_a_refused_frame_leaves_the_file_as_it_was(tmp_path, case):
    arguments, keywords, message = bad_frames()[case]
    path = tmp_path / "a.vtkhdf"
    with VtkHdfSeries(path, 5, CELLS, static_point_data={"rest": POINTS}) as series:
        series.write_frame(0.0, POINTS, point_data={"u": POINTS})
        before = path.read_bytes()
        with pytest.raises(OutputFileError, match=message):
            series.write_frame(*arguments, **keywords)
        assert path.read_bytes() == before
        series.write_frame(1.0, POINTS + 1, point_data={"u": POINTS + 1})
    (_, first), (_, second) = steps_of(path)
    np.testing.assert_array_equal(first.points, POINTS)
    np.testing.assert_array_equal(second.point_data["u"], POINTS + 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.vtu", 5, CELLS), r"Call it 'a\.vtkhdf'"),
        (("nowhere/a.vtkhdf", 5, CELLS), "does not exist"),
        (("a.vtkhdf", 0, CELLS), "at least one point"),
        (("a.vtkhdf", 5, {}), "at least one cell"),
        (("a.vtkhdf", 5, {"tet": [[0, 1, 2, 3]]}), "Unknown kind of cell 'tet'"),
        (("a.vtkhdf", 5, {"tetra": [[0, 1, 2]]}), r"shape \[1, 3\].*\[cells, 4\]"),
        (("a.vtkhdf", 5, {"tetra": [[0, 1, 2, 3.0]]}), "type float64"),
        (
            ("a.vtkhdf", 5, {"tetra": [[0, 1, 2, 3], [0, 1, 2, 5]]}),
            r"Cell 1 of 'tetra' is \[0, 1, 2, 5\].*0 to 4",
        ),
    ],
)
def test_a_wrong_mesh_or_path_is_refused(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputFileError, match=message):
        VtkHdfSeries(*arguments)
    assert os.listdir(tmp_path) == []


def test_single_precision_refuses_what_overflows(tmp_path):
    with (
        VtkHdfSeries(tmp_path / "a.vtkhdf", 5, CELLS, single_precision=True) as series,
        pytest.raises(OutputFileError, match="infinite in float32"),
    ):
        series.write_frame(0.0, POINTS * 1e300)


def test_nothing_is_added_after_close(tmp_path):
    series = VtkHdfSeries(tmp_path / "a.vtkhdf", 5, CELLS)
    series.close()
    with pytest.raises(OutputFileError, match="closed"):
        series.write_frame(0.0, POINTS)


def another_series(path):
    with VtkHdfSeries(path.with_name("b.vtkhdf"), 5, CELLS) as series:
        series.write_frame(0.0, POINTS)
        series.write_frame(1.0, POINTS)
    path.with_name("b.vtkhdf").replace(path)


def no_series(path):
    with h5py.File(path, "w") as file:
        file["VTKHDF/Steps"] = np.zeros(3)


def no_hdf5(path):
    path.write_bytes(b"something else")


@pytest.mark.parametrize("change", [another_series, no_series, no_hdf5, Path.unlink])
def test_a_file_that_is_not_the_series_any_more_is_left_alone(tmp_path, change):
    path = tmp_path / "a.vtkhdf"
    series = VtkHdfSeries(path, 5, CELLS)
    series.write_frame(0.0, POINTS)
    change(path)
    before = path.read_bytes() if path.exists() else None
    with pytest.raises(OutputFileError, match="Frame 1"):
        series.write_frame(1.0, POINTS)
    assert (path.read_bytes() if path.exists() else None) == before


@pytest.mark.parametrize("interrupted_at", range(9))
def test_an_interrupt_at_any_write_leaves_whole_frames(tmp_path, monkeypatch, interrupted_at):
    path = tmp_path / "a.vtkhdf"
    series = VtkHdfSeries(path, 5, CELLS)
    series.write_frame(0.0, POINTS, point_data={"u": POINTS})
    put = vtkhdf._put
    calls = 0

    def interrupted_put(dataset, first, rows):
        nonlocal calls
        if calls == interrupted_at:
            raise KeyboardInterrupt
        calls += 1
        put(dataset, first, rows)

    monkeypatch.setattr(vtkhdf, "_put", interrupted_put)
    with pytest.raises(KeyboardInterrupt):
        series.write_frame(1.0, POINTS + 1, point_data={"u": POINTS + 1})
    monkeypatch.undo()
    assert [time for time, _ in steps_of(path)] == [0.0]
    series.write_frame(2.0, POINTS + 2, point_data={"u": POINTS + 2})
    assert [time for time, _ in steps_of(path)] == [0.0, 2.0]
    np.testing.assert_array_equal(steps_of(path)[1][1].point_data["u"], POINTS + 2)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
def test_a_killed_run_leaves_a_readable_file(tmp_path):
    path = tmp_path / "a.vtkhdf"
    script = textwrap.dedent(
        """
        import sys
        import numpy as np
        from yasps.output import VtkHdfSeries
        points = np.zeros((1000, 3))
        series = VtkHdfSeries(sys.argv[1], 1000, {"tetra": [[0, 1, 2, 3]]})
        for i in range(1_000_000):
            series.write_frame(i, points + i)
            if i == 20:
                print("running", flush=True)
        """
    )
    process = subprocess.Popen([sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process.stdout:
        assert process.stdout.readline() == "running\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    with h5py.File(Path(path)) as file:
        frames = int(file["VTKHDF/Steps"].attrs["NSteps"])
        assert frames >= 21
        points = file["VTKHDF/Points"][: 1000 * frames].reshape(frames, -1)
        np.testing.assert_array_equal(points, np.repeat(np.arange(frames), 3000).reshape(frames, -1))
        assert len(file["VTKHDF/Steps/Values"]) <= frames
