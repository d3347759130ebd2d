"""Videos, read back with imageio."""

import subprocess

import numpy as np
import pytest

from yasps.output import Animation, PictureError, animation

iio = pytest.importorskip("imageio.v3")


def grey(level):
    return np.full((48, 64, 3), level, dtype=np.uint8)


def write(path, levels):
    with Animation(path, frames_per_second=10) as video:
        for level in levels:
            video.add(grey(level))
    return video.path


def test_an_mp4_holds_the_images(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    path = write(tmp_path / "a.mp4", [0, 100, 200])
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]
    # Not imageio's reader, which leaves pipes open and warns.
    raw = subprocess.run(
        [ffmpeg, "-v", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"],
        capture_output=True,
        check=True,
    )
    frames = np.frombuffer(raw.stdout, dtype=np.uint8).reshape(-1, 48, 64, 3)
    assert len(frames) == 3
    np.testing.assert_allclose(frames.mean(axis=(1, 2, 3)), [0, 100, 200], atol=6)


def test_without_ffmpeg_a_gif_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "_has_ffmpeg", lambda: False)
    path = write(tmp_path / "a.mp4", [0, 100, 200])
    assert path == tmp_path / "a.gif"
    frames = iio.imread(path)
    np.testing.assert_allclose(frames[..., :3].mean(axis=(1, 2, 3)), [0, 100, 200], atol=6)


def test_an_error_keeps_the_images_so_far(tmp_path):
    def interrupted():
        with Animation(tmp_path / "a.gif") as video:
            video.add(grey(10))
            video.add(grey(90))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len(iio.imread(tmp_path / "a.gif")) == 2


def test_no_image_no_file(tmp_path):
    write(tmp_path / "a.gif", [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "speed", "message"),
    [("a.avi", 30, "must end in"), ("no/a.mp4", 30, "folder that exists"), ("a.gif", 0, "must be positive")],
)
def test_wrong_files_and_speeds_are_refused(tmp_path, name, speed, message):
    with pytest.raises(PictureError, match=message):
        Animation(tmp_path / name, speed)


@pytest.mark.parametrize("image", [grey(0)[:47], grey(0).astype(float), grey(0)[..., 0], grey(0)[:40]])
def test_wrong_images_are_refused(tmp_path, image):
    with Animation(tmp_path / "a.gif") as video:
        video.add(grey(0))
        with pytest.raises(PictureError, match="image"):
            video.add(image)
