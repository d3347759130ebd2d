"""Results files: what the recorder writes, read back; runs that are resumed; files of others and damaged ones."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from results_files import CUBE, DT, Motion, cube, everything, record

from yasps import __version__
from yasps.output import (
    OBSTACLE_GREY,
    PALETTE,
    FrameRecorder,
    OutputFileError,
    Series,
    VtkHdfSeries,
    read_series,
    vtkhdf,
)


def test_a_file_says_all_of_a_run(tmp_path: Path) -> None:
    motion = everything()
    start = np.concatenate([body.positions() for body in motion.bodies])
    file = record(
        motion, tmp_path, 3, fields=("velocity", "contact_force"), colors={"sheet": "#102030"}, camera="follow"
    )
    end = np.concatenate([body.positions() for body in motion.bodies])

    series = read_series(file)
    assert [body.name for body in series.bodies] == ["cube", "sheet", "rod", "wall", "floor", "slope"]
    assert [body.kind for body in series.bodies] == ["Solid", "Sheet", "Rod", "Wall", "Floor", "Floor"]
    grey = OBSTACLE_GREY
    assert [body.color for body in series.bodies] == [PALETTE[0], "#102030", PALETTE[2], grey, grey, grey]
    assert [body.stands_still for body in series.bodies] == [False] * 3 + [True] * 3
    assert [body.two_sided for body in series.bodies] == [False, True, False, False, False, False]
    np.testing.assert_allclose(series.times, [0.0, DT, 2 * DT])
    assert (len(series), series.name, series.units["length"], series.view.camera) == (3, "motion", "m", "follow")
    for body, original in zip(series.bodies, motion.bodies, strict=True):
        np.testing.assert_array_equal(body.triangles, original.triangles)
        np.testing.assert_array_equal(body.edges, original.edges)
        np.testing.assert_array_equal(body.radii, original.radii())
    np.testing.assert_array_equal(series.positions(0), start)
    np.testing.assert_array_equal(series.positions(-1), end)
    slope = series.body("slope").plane
    assert slope is not None
    assert (slope.normal, slope.point, slope.size) == ((0.0, -0.6, 0.8), (0.0, 4.0, 0.0), 10.0)
    assert series.fields == ("contact_force", "velocity")
    of_cube = series.body("cube").vertices
    np.testing.assert_allclose(series.field("velocity", 1)[of_cube], np.tile([1.0, 0.0, -2.0], (8, 1)))
    np.testing.assert_array_equal(series.field("contact_force", 1)[series.body("rod").vertices], [[0.0, 0.0, 3.0]] * 12)
    np.testing.assert_array_equal(series.cells()["tetra"], CUBE.tets)
    np.testing.assert_allclose(series.box()[1], [3.5, 1.1 + 2 * DT, 2.5])


def test_vtk_reads_it_with_the_bodies_told_apart(tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    file = record(everything(), tmp_path, 3)
    grid = pyvista.read(file)
    x = Series(file).positions(0)
    np.testing.assert_array_equal(grid.points, x)
    np.testing.assert_array_equal(np.unique(grid.cell_data["body"]), [0, 1, 2, 3])
    for number in range(4):
        body = Series(file).bodies[number]
        used = np.unique(grid.extract_cells(grid.cell_data["body"] == number).point_data["body"])
        assert used == [number]
        np.testing.assert_array_equal(
            np.flatnonzero(grid.point_data["body"] == number), np.arange(len(x))[body.vertices]
        )


def test_a_resumed_file_is_that_of_an_uninterrupted_run(tmp_path: Path) -> None:
    whole = record(everything(), tmp_path, 7, "whole")
    motion = everything()
    record(motion, tmp_path, 3, "parts")
    state = [body.x for body in motion.bodies], motion.time
    with FrameRecorder(motion, tmp_path, "parts", pictures=False, resume=True) as lost:  # frames behind the checkpoint
        for _ in range(3):
            motion.step()
            motion.bodies[0].x = motion.bodies[0].x + 1.0
            lost.record(motion)
    assert len(read_series(lost.file)) == 6
    for body, x in zip(motion.bodies, state[0], strict=True):
        body.x = x
    motion.time = state[1]
    with FrameRecorder(motion, tmp_path, "parts", pictures=False, resume=True) as recorder:
        assert recorder.number_of_frames == 3
        assert len(read_series(recorder.file)) == 6  # until the next is there
        for _ in range(4):
            motion.step()
            recorder.record(motion)
            assert len(read_series(recorder.file)) == recorder.number_of_frames
    one, other = read_series(whole), read_series(recorder.file)
    np.testing.assert_array_equal(one.times, other.times)
    for frame in range(7):
        np.testing.assert_array_equal(one.positions(frame), other.positions(frame))
        np.testing.assert_array_equal(one.field("velocity", frame), other.field("velocity", frame))
    assert one.number_of_points * 7 == len(h5py.File(recorder.file)["VTKHDF/Points"])


def test_frames_that_are_cut_off_are_gone_before_they_are_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = everything()
    file = record(motion, tmp_path, 6)
    motion.time = 2 * DT
    put, seen = vtkhdf._put, []

    def watched(dataset: Any, first: int, rows: Any) -> None:
        copy = tmp_path / "as_a_kill_would_leave_it.vtkhdf"
        copy.write_bytes(file.read_bytes())
        seen.append(len(read_series(copy)))
        put(dataset, first, rows)

    with FrameRecorder(motion, tmp_path, "motion", pictures=False, resume=True) as recorder:
        motion.step()
        monkeypatch.setattr(vtkhdf, "_put", watched)
        recorder.record(motion)
    assert set(seen) == {3}
    assert len(read_series(file)) == 4


def test_a_resumed_run_may_look_different(tmp_path: Path) -> None:
    motion = everything()
    record(motion, tmp_path, 3)
    motion.step()
    file = record(motion, tmp_path, 2, resume=True, colors={"cube": "#010203"}, camera="follow")
    series = read_series(file)
    assert (series.body("cube").color, series.view.camera) == ("#010203", "follow")
    assert (len(series), series.version) == (5, __version__)


def test_resume_without_a_file_begins_one(tmp_path: Path) -> None:
    motion = everything()
    motion.step()
    file = record(motion, tmp_path, 2, resume=True)
    np.testing.assert_allclose(read_series(file).times, [DT, 2 * DT])


def other_place(motion: Motion) -> None:
    motion.bodies.pop(3)


def other_name(motion: Motion) -> None:
    motion.bodies[0].name = "die"


def other_cells(motion: Motion) -> None:
    motion.bodies[0].cells = {"tetra": CUBE.tets[:, [1, 0, 3, 2]]}


def other_radius(motion: Motion) -> None:
    motion.bodies[2].radius = 0.2


@pytest.mark.parametrize(
    ("change", "differs"),
    [
        (other_place, "Connectivity|body|NumberOfPoints"),
        (other_name, "description"),
        (other_cells, "Connectivity"),
        (other_radius, "radii"),
    ],
)
def test_a_file_of_another_scene_is_not_resumed(tmp_path: Path, change: Any, differs: str) -> None:
    file = record(everything(), tmp_path, 3)
    before = file.read_bytes()
    motion = everything()
    change(motion)
    with pytest.raises(OutputFileError, match=f"another scene, its .*({differs}) differs"):
        FrameRecorder(motion, tmp_path, "motion", resume=True)
    assert file.read_bytes() == before


def test_other_fields_are_not_resumed(tmp_path: Path) -> None:
    motion = everything()
    record(motion, tmp_path, 3)
    with FrameRecorder(motion, tmp_path, "motion", pictures=False, resume=True, fields=()) as recorder:
        motion.step()
        with pytest.raises(OutputFileError, match="same data"):
            recorder.record(motion)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
def test_a_killed_run_is_resumed(tmp_path: Path) -> None:
    script = textwrap.dedent(
        """
        import sys
        sys.path.insert(0, sys.argv[2])
        from results_files import everything
        from yasps.output import FrameRecorder
        motion = everything()
        recorder = FrameRecorder(motion, sys.argv[1], "motion", pictures=False)
        for i in range(1_000_000):
            recorder.record(motion)
            motion.step()
            if i == 20:
                print("running", flush=True)
        """
    )
    helpers = str(Path(__file__).parents[1] / "helpers")
    with subprocess.Popen([sys.executable, "-c", script, tmp_path, helpers], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        assert run.stdout.readline() == "running\n"
        run.send_signal(signal.SIGKILL)
    motion = everything()
    for _ in range(10):  # to the checkpoint
        motion.step()
    with FrameRecorder(motion, tmp_path, "motion", pictures=False, resume=True) as recorder:
        assert recorder.number_of_frames == 11
        motion.step()
        recorder.record(motion)
    series = read_series(recorder.file)
    assert len(series) == 12
    again = everything()
    for frame in range(12):
        np.testing.assert_array_equal(series.positions(frame), np.concatenate([b.positions() for b in again.bodies]))
        again.step()


def test_bodies_that_come_are_refused_and_those_that_go_stay(tmp_path: Path) -> None:
    motion = everything()
    with FrameRecorder(motion, tmp_path, "motion", pictures=False) as recorder:
        recorder.record(motion)
        gone = motion.bodies.pop(0)
        motion.step()
        recorder.record(motion)
        motion.bodies.append(cube("late", (9.0, 0.0, 0.0)))
        motion.step()
        with pytest.raises(OutputFileError, match=r"'late' came while 'motion\.vtkhdf' was recorded"):
            recorder.record(motion)
    series = read_series(recorder.file)
    assert len(series) == 2
    np.testing.assert_array_equal(series.positions(1)[series.body("cube").vertices], gone.positions())
    np.testing.assert_array_equal(series.field("velocity", 1)[series.body("cube").vertices], 0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fields": ("stress",)}, "fields are a list of 'velocity', 'contact_force'"),
        ({"fields": "velocity"}, "fields are a list"),
        ({"colors": {"sphere": "#000000"}}, "for the bodies cube, sheet"),
        ({"colors": {"cube": "red"}}, "'#rrggbb'"),
        ({"camera": "drone"}, "camera is one of 'whole', 'follow'"),
        ({"view_direction": (0, 0, 1)}, "neither zero nor vertical"),
        ({"bounds": [[1, 0, 0], [0, 0, 0]]}, "lowest and the highest corner"),
        ({"speed": 0}, "speed must be positive"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_written(tmp_path: Path, options: Any, message: str) -> None:
    with pytest.raises(OutputFileError, match=message):
        FrameRecorder(everything(), tmp_path / "new", "motion", **options)
    assert list(tmp_path.iterdir()) == []


def test_contact_forces_need_contact(tmp_path: Path) -> None:
    motion = everything()
    motion.contact = None  # type: ignore[assignment]
    with pytest.raises(OutputFileError, match="contact=False"):
        FrameRecorder(motion, tmp_path, "motion", fields=("contact_force",))


def by_another_program(file: Path) -> None:
    with VtkHdfSeries(file, 3, {"triangle": [[0, 1, 2]]}) as series:
        series.write_frame(0.0, np.eye(3))


def cut_off(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:3000])


def told(file: Path, **changes: Any) -> None:
    with h5py.File(file, "r+") as data:
        description = json.loads(data["yasps/description"].asstr()[()])
        description["bodies"][0].update(changes)
        data["yasps/description"][()] = json.dumps(description)


def looks(file: Path, what: str, value: Any) -> None:
    with h5py.File(file, "r+") as data:
        look = json.loads(data["yasps/look"].asstr()[()])
        data["yasps/look"][()] = json.dumps(look | {what: value})


def shuffled_times(file: Path) -> None:
    with h5py.File(file, "r+") as data:
        data["VTKHDF/Steps/Values"][:] = [0.0, 2.0, 1.0]


def too_many_steps(file: Path) -> None:
    with h5py.File(file, "r+") as data:
        data["VTKHDF/Steps"].attrs["NSteps"] = 9


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (Path.unlink, "There is no file"),
        (lambda file: file.write_text("a page"), "can't be read as a series"),
        (cut_off, "can't be read as a series"),
        (by_another_program, "says nothing about bodies"),
        (shuffled_times, "times of its frames don't grow"),
        (too_many_steps, "9 frames of"),
        (lambda file: told(file, count=7), "vertices that it does not have"),
        (lambda file: told(file, number_of_triangles=10**9), "triangles of body 'cube' are missing"),
        (lambda file: looks(file, "colors", [["url(x)", 1.0]] * 6), "colour"),
        (lambda file: looks(file, "colors", [["#102030", 1.0]] * 5), "can't be read"),
        (lambda file: looks(file, "view", {}), "can't be read"),
        (lambda file: file.with_suffix(".x").touch() or h5py.File(file, "w").close(), "is no series that yasps wrote"),
    ],
)
def test_a_file_that_is_no_series_is_refused(tmp_path: Path, damage: Any, message: str) -> None:
    file = record(everything(), tmp_path, 3)
    damage(file)
    with pytest.raises(OutputFileError, match=message):
        read_series(file)


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    series = read_series(record(everything(), tmp_path, 2))
    with pytest.raises(OutputFileError, match="no field 'heat'; it has velocity"):
        series.field("heat", 0)
    with pytest.raises(OutputFileError, match="no body 'ball'; it has cube, sheet, rod"):
        series.body("ball")
    with pytest.raises(OutputFileError, match="frames 0 to 1, not 2"):
        series.positions(2)
