"""Pictures and animations of results files. Those that render are skipped where pictures are unavailable."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from results_files import DT, Floor, Motion, Solid, cube, everything, record, rod, sheet, wall

from yasps.output import (
    FrameRecorder,
    OutputFileError,
    PictureError,
    PicturesUnavailable,
    View,
    make_animation,
    make_picture,
    motion_pictures,
    pictures,
    read_series,
    recorder,
    require_pictures,
    show_window,
    window,
)
from yasps.output.camera import VIEW_ANGLE
from yasps.output.motion_pictures import cameras, frames_to_show, ground_body, seen_box
from yasps.output.recorded_bodies import dark_sectors

SIZE = (160, 120)
RED, GREEN, BLUE = "#ff1010", "#10ff10", "#1010ff"


@pytest.fixture(scope="module")
def looked() -> str:
    """Why nothing can be drawn here, or nothing."""
    try:
        require_pictures()
    except PicturesUnavailable as reason:
        return str(reason)
    return ""


@pytest.fixture
def draws(looked: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if looked:
        pytest.skip(looked)
    monkeypatch.setattr(pictures, "require_pictures", lambda: None)  # which takes half a second


def picture(file: Path, **options: Any) -> Any:
    from imageio.v3 import imread

    return imread(make_picture(file, file.with_suffix(".png"), **({"size": SIZE} | options)))


def pixels(image: Any, channel: int) -> Any:
    """Where one colour is much stronger than the others, [k, 2]."""
    others = np.delete(image.astype(int), channel, axis=2).max(axis=2)
    return np.argwhere(image[..., channel].astype(int) - others > 60)


def in_the_picture(points: Any, eye: Any, focus: Any, aspect: float) -> Any:
    """How far to the right and up points are, in halves of the picture, [k, 2]."""
    forward = (focus - eye) / np.linalg.norm(focus - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    off = points - eye
    half = np.tan(np.radians(VIEW_ANGLE / 2)) * (off @ forward)
    return np.stack([off @ right / (aspect * half), off @ np.cross(right, forward) / half], axis=1)


def test_bodies_are_where_they_are_in_their_colours(tmp_path: Path, draws: None) -> None:
    motion = Motion(
        cube("red", (-2.0, 0.0, 1.0)),
        sheet("green", (2.0, 0.0, 0.5)),
        rod("blue", [[0.0, 0.4 * i, 3.0] for i in range(6)], 0.3),
        Floor("floor"),
        velocities={"red": (0.0, 0.0, 20.0)},
    )
    file = record(motion, tmp_path, 11, colors={"red": RED, "green": GREEN, "blue": BLUE})
    first, last = picture(file, frame=0), picture(file)
    for image in (first, last):
        assert min(len(pixels(image, channel)) for channel in range(3)) > 50
    assert pixels(first, 0)[:, 1].mean() < pixels(first, 2)[:, 1].mean() < pixels(first, 1)[:, 1].mean()
    assert pixels(first, 0)[:, 0].mean() > pixels(first, 2)[:, 0].mean()  # the cube below the rod,
    assert pixels(last, 0)[:, 0].mean() < pixels(last, 2)[:, 0].mean()  # and then above it
    by_speed = picture(file, field="velocity")
    assert len(pixels(by_speed, 0)) < 20
    assert len(pixels(by_speed, 1)) < len(pixels(last, 1))


def test_folds_that_come_later_are_smooth(tmp_path: Path, draws: None) -> None:
    """A flat sheet that is bent sharply is shaded without an edge, also in a picture of the bent state alone."""
    motion = Motion(sheet("sheet", (0.0, 0.0, 1.0), cells=2))
    file = record(motion, tmp_path, 1)
    motion.time = 1.0
    fold = motion.bodies[0]
    fold.x = fold.x + np.outer(-np.abs(fold.x[:, 0]), [0.0, 0.0, 1.0])
    with FrameRecorder(motion, tmp_path, "motion", pictures=False, resume=True) as recording:
        recording.record(motion)
    with motion_pictures.MotionPictures(read_series(file), [1], size=SIZE) as drawn:
        assert drawn.frames.plotter.meshes[0].n_points == 9


def test_forces_are_arrows(tmp_path: Path, draws: None) -> None:
    file = record(Motion(sheet("sheet", (0.0, 0.0, 1.0)), Floor("floor")), tmp_path, 1, fields=("contact_force",))
    with_arrows, without = picture(file), picture(file, forces=False)
    assert (np.abs(with_arrows.astype(int) - without).max(axis=2) > 40).sum() > 100


def test_planes_and_clear_bodies_are_drawn(tmp_path: Path, draws: None) -> None:
    behind = wall("wall", (0.0, 1.6, 1.0))
    box = cube("box", (0.0, 0.0, 1.0))
    images = {}
    for name, color in (("solid", BLUE), ("clear", f"{BLUE}40")):
        motion = Motion(box, behind, Floor("floor"))
        images[name] = picture(record(motion, tmp_path, 1, name, colors={"box": color, "wall": RED}))
    assert len(pixels(images["clear"], 0)) > len(pixels(images["solid"], 0)) + 30  # the wall is seen through the box
    slope = Floor("slope", normal=(0.0, -0.6, 0.8), point=(0.0, 2.0, 0.0))
    sloping = picture(
        record(Motion(box, behind, Floor("floor"), slope), tmp_path, 1, "slope", colors={"box": BLUE, "wall": RED})
    )
    assert (np.abs(sloping.astype(int) - images["solid"]).max(axis=2) > 15).sum() > 1000


def test_an_animation_runs_as_the_world_does(tmp_path: Path, draws: None) -> None:
    import PIL.Image

    motion = Motion(cube("cube", (0.0, 0.0, 1.0)), Floor("floor"), velocities={"cube": (5.0, 0.0, 0.0)})
    file = record(motion, tmp_path, 21, colors={"cube": RED})
    for ending in ("gif", "webp"):
        path = make_animation(file, tmp_path / f"a.{ending}", size=SIZE, frames_per_second=10.0)
        with PIL.Image.open(path) as video:
            assert (video.n_frames, video.size) == (5, SIZE)
            places = []
            for k in range(5):
                video.seek(k)
                video.load()
                assert video.info["duration"] == 100
                places.append(pixels(np.asarray(video.convert("RGB")), 0)[:, 1].mean())
        assert (np.diff(places) > 5).all()


@pytest.mark.parametrize(
    ("times", "speed", "pace", "chosen", "shown"),
    [
        (np.arange(7) * 0.01, 1.0, 25.0, [0, 4, 6], 25.0),
        (np.arange(7) * 0.01, 1.0, 100.0, [0, 1, 2, 3, 4, 5, 6], 100.0),
        (np.arange(7) * 0.01, 0.1, 30.0, [0, 1, 2, 3, 4, 5, 6], 10.0),
        (np.arange(7) * 0.01, 2.0, 50.0, [0, 4, 6], 50.0),
        (np.arange(3) * 0.5, 1.0, 30.0, [0, 1, 2], 2.0),
        (np.array([0.3]), 1.0, 30.0, [0], 30.0),
    ],
)
def test_frames_are_chosen_by_time(times: Any, speed: float, pace: float, chosen: list[int], shown: float) -> None:
    frames, rate = frames_to_show(times, speed, pace)
    assert (frames, rate) == (chosen, pytest.approx(shown))


def test_the_camera_sees_the_whole_motion_or_follows(tmp_path: Path) -> None:
    motion = Motion(cube("cube", (0.0, 0.0, 1.0)), Floor("floor"), velocities={"cube": (20.0, 0.0, 0.0)})
    series = read_series(record(motion, tmp_path, 60))
    frames = list(range(60))
    whole = cameras(series, frames, View(), 4 / 3, 0.0)
    seen = [in_the_picture(series.positions(frame), *whole[frame], 4 / 3) for frame in frames]
    assert all(np.array_equal(eye, whole[0][0]) for eye, _ in whole)
    assert 0.85 < np.abs(seen).max() <= 1.0
    follows = cameras(series, frames, View(camera="follow"), 4 / 3, 0.0)
    seen = [in_the_picture(series.positions(frame), *follows[frame], 4 / 3) for frame in frames]
    assert np.abs(seen).max() <= 1.0
    assert np.abs(np.mean(seen, axis=1)).max() < 0.2  # in the middle, at both ends, too
    large = [np.ptp(one[:, 1]) for one in seen]
    assert min(large) > 4 * np.ptp(in_the_picture(series.positions(0), *whole[0], 4 / 3)[:, 1])
    box = seen_box(series, frames, View(bounds=((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))))
    assert box.tolist() == [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]


def test_the_ground_is_the_lowest_level_thing(tmp_path: Path) -> None:
    def ground(*others: Solid) -> str | None:
        found = ground_body(read_series(record(Motion(cube("cube", (0.0, 0.0, 3.0)), *others), tmp_path, 1)))
        return found and found.name

    plate = sheet("plate", (0.0, 0.0, 0.5))
    plate.stands_still = plate.is_fixed = True
    ceiling = Floor("ceiling", normal=(0.0, 0.0, -1.0), point=(0.0, 0.0, -5.0))
    low = Floor("low", point=(1.0, 0.0, -0.5))
    assert ground() is None
    assert ground(plate) == "plate"
    assert ground(plate, low, ceiling) == "low"
    assert ground(wall("wall", (0.0, 0.0, 0.0)), Floor("slope", normal=(0.0, 0.6, 0.8)), ceiling) is None


def test_what_is_driven_has_sectors() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 16, endpoint=False) + 0.1
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(16)], axis=1)
    assert (np.diff(np.flatnonzero(np.diff(dark_sectors(ring).astype(int)))) == 4).all()
    assert dark_sectors(ring).sum() == 8
    octants = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1.0)])
    assert dark_sectors(octants).tolist() == [False, True, True, False, True, False, False, True]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"field": "stress"}, r"no field 'stress'; it has velocity.*fields=\['velocity', 'stress'\]"),
        ({"forces": True}, "no field 'contact_force'"),
        ({"frame": 3}, "frames 0 to 2, not 3"),
        ({"size": (161, 120)}, "even"),
    ],
)
def test_wrong_pictures_are_refused(tmp_path: Path, options: Any, message: str) -> None:
    file = record(everything(), tmp_path, 3)
    with pytest.raises(PictureError, match=message):
        make_picture(file, tmp_path / "a.png", **options)
    with pytest.raises(PictureError, match="frames_per_second"):
        make_animation(file, tmp_path / "a.gif", frames_per_second=0.0)


def test_views_are_kept_and_changed(tmp_path: Path) -> None:
    file = record(
        everything(), tmp_path, 1, camera="follow", view_direction=(1, 0, 0.5), bounds=[[0] * 3, [1] * 3], speed=0.5
    )
    view = read_series(file).view
    assert view == View("follow", (1.0, 0.0, 0.5), ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), 0.5)
    assert view.changed(camera="whole", speed=None) == View("whole", view.direction, view.bounds, 0.5)
    with pytest.raises(OutputFileError, match="camera is one of"):
        view.changed(camera="drone")


# -- the recorder ------------------------------------------------------------------------------------------


def test_whatever_happens_to_pictures_the_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def breaks(*_: Any) -> Path:
        raise MemoryError("too large")

    monkeypatch.setattr(recorder, "make_picture", breaks)
    file = record(everything(), tmp_path, 2, pictures=True)
    assert "no pictures: too large" in capsys.readouterr().err
    assert len(read_series(file)) == 2


def record_until(error: type[BaseException], motion: Motion, folder: Path) -> None:
    with recorder.FrameRecorder(motion, folder, "motion") as files:
        files.record(motion)
        raise error


def test_ctrl_c_does_not_wait_for_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Path] = []
    monkeypatch.setattr(recorder, "make_picture", lambda file, path: drawn.append(path) or path)
    monkeypatch.setattr(recorder, "make_animation", lambda file, path: drawn.append(path) or path)
    for error, count in ((KeyboardInterrupt, 0), (ValueError, 2)):
        motion = everything()
        with pytest.raises(error):
            record_until(error, motion, tmp_path)
        assert len(drawn) == count
        assert len(read_series(tmp_path / "motion.vtkhdf")) == 1


# -- windows -----------------------------------------------------------------------------------------------


@pytest.mark.skipif("sys.platform != 'linux'")
def test_a_window_needs_a_display(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyvista")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(PicturesUnavailable, match=r"no display.*writes a page for a browser"):
        show_window(record(everything(), tmp_path, 2))


def test_a_window_plays_the_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, draws: None) -> None:
    """In a window that nobody sees: what the slider, the space bar and the clock do."""
    import pyvista

    monkeypatch.setattr(pyvista, "OFF_SCREEN", True)
    motion = Motion(cube("cube", (0.0, 0.0, 1.0)), Floor("floor"), velocities={"cube": (4.0, 0.0, 0.0)})
    series = read_series(record(motion, tmp_path, 11, colors={"cube": RED}))
    with motion_pictures.MotionPictures(series, list(range(11)), size=SIZE, window=True) as drawn:
        player = window.Player(series, drawn)
        drawn.frames.plotter.show(auto_close=False)

        def place() -> float:
            drawn.frames.plotter.render()
            return float(pixels(drawn.frames.plotter.screenshot(None, return_img=True), 0)[:, 1].mean())

        start = place()
        player.show_frame(10)
        assert place() > start + 30
        player.toggle()  # from the end: anew
        for _ in range(3):
            player.tick(0)
        assert player.frame == round(3 * 0.03 / DT)
        player.toggle()
        player.tick(0)
        assert player.frame == round(3 * 0.03 / DT)
