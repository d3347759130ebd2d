"""Pictures. Those that render are skipped where pictures are unavailable; one of them renders for all."""

import subprocess
import sys

import numpy as np
import pytest

from yasps.output import FramePictures, PictureError, PicturesUnavailable, Surface, picture_errors, require_pictures
from yasps.output.camera import box_corners, camera_position
from yasps.output.sharp_edges import vertex_normals

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@pytest.fixture(scope="module")
def scene():
    try:
        with FramePictures(
            [Surface("red", CORNERS, FACES, color="#ff0000", smooth=False), Surface("green", CORNERS, FACES, "lime")],
            bounds=[[-3, -3, 0], [3, 3, 3]],
            window_size=(160, 120),
        ) as opened:
            yield opened
    except PicturesUnavailable as reason:
        pytest.skip(str(reason))


def mask(image, channel):
    """Pixels where one colour is much stronger than the others."""
    others = [c for c in range(3) if c != channel]
    return image[..., channel].astype(int) - image[..., others].max(axis=-1) > 60


def middle(chosen):
    return np.argwhere(chosen).mean(axis=0)


def test_surfaces_are_where_they_should_be_with_a_shadow_below(scene):
    scene.move("red", CORNERS + np.array([-2, 0, 0]))
    scene.move("green", CORNERS + np.array([2, 0, 1.5]))
    image = scene.image()
    assert image.shape == (120, 160, 3)
    red, green = mask(image, 0), mask(image, 1)
    assert red.sum() > 50
    assert green.sum() > 50
    assert middle(red)[1] < 80 < middle(green)[1]  # x to the right
    assert middle(green)[0] < middle(red)[0]  # z up
    assert image[0].min() > 230  # light background

    # The same without the box: what was darker outside the box is its shadow, below it and to its right.
    scene.move("green", CORNERS + np.array([0, 50, 50]))
    darker = (scene.image().astype(int) - image).min(axis=-1) > 5
    shadow = darker & ~green
    assert shadow.sum() > 20
    assert middle(shadow)[0] > middle(green)[0]


def test_a_shadow_lies_under_its_body_front_and_back(scene):
    for y in (-2.0, 2.0):
        scene.move("red", CORNERS + np.array([0, 50, 50]))
        scene.move("green", CORNERS + np.array([0, 50, 50]))
        empty = scene.image().astype(int)
        scene.move("red", CORNERS * [1, 1, 0.01] + [0, y, 0.1])
        image = scene.image()
        red = mask(image, 0)
        shadow = ((empty - image).min(axis=-1) > 4) & ~red
        assert shadow.sum() > 5
        assert np.abs(middle(shadow) - middle(red)).max() < 8


def test_nothing_shows_through_what_lies_close_above_it(scene):
    """A sheet 3e-4 above a smaller one, in a scene of 6 x 6 x 3."""
    thin = CORNERS * [4, 4, 1e-4]
    scene.move("red", thin + np.array([0, 0, 1.0]))
    scene.move("green", thin * [0.9, 0.9, 1.0] + np.array([0, 0, 0.9997]))
    image = scene.image()
    assert mask(image, 0).sum() > 1000
    assert mask(image, 1).sum() == 0


def test_moving_changes_the_very_next_image(scene):
    scene.move("green", CORNERS + np.array([0, 50, 50]))
    scene.move("red", CORNERS + np.array([-2, 0, 0]))
    left = middle(mask(scene.image(), 0))
    scene.move("red", CORNERS + np.array([2, 0, 0]))
    right = middle(mask(scene.image(), 0))
    assert right[1] > left[1] + 40


def test_pictures_are_saved(scene, tmp_path):
    from imageio.v3 import imread

    path = scene.save(tmp_path / "a.png")
    np.testing.assert_array_equal(imread(path), scene.image())
    with pytest.raises(PictureError, match=r"'\.png' or '\.jpg'"):
        scene.save(tmp_path / "a.bmp")
    with pytest.raises(PictureError, match="can't be written"):
        scene.save(tmp_path / "no" / "a.png")


def test_wrong_moves_are_refused(scene):
    with pytest.raises(PictureError, match="there are red, green"):
        scene.move("blue", CORNERS)
    with pytest.raises(PictureError, match=r"\[7, 3\], expected \[8, 3\]"):
        scene.move("red", CORNERS[:7])
    with pytest.raises(PictureError, match=r"Vertex 0 .* diverged"):
        scene.move("red", CORNERS * np.nan)


def test_nothing_leaks_to_the_terminal(scene):
    code = """
from yasps.output import FramePictures, Surface
with FramePictures([Surface("a", CORNERS, FACES)], window_size=(64, 48)) as pictures:
    print(pictures.image().std() > 5)
"""
    code = f"CORNERS, FACES = {CORNERS.tolist()}, {FACES.tolist()}\n{code}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("True\n", "")


@pytest.mark.parametrize(
    ("probe", "outcome"),
    [
        ("import os; os.abort()", "exit status -6"),
        ("raise ImportError('libEGL.so.1: cannot open')", "libEGL.so.1: cannot open"),
        ("print('no OpenGL')", "exit status 0: no OpenGL"),
    ],
)
def test_a_probe_that_dies_says_what_to_install(probe, outcome):
    pytest.importorskip("pyvista")
    with pytest.raises(PicturesUnavailable, match=f"{outcome}.*apt-get install libegl1"):
        require_pictures(probe)


def test_a_missing_package_says_what_to_install(monkeypatch):
    util = picture_errors.importlib.util
    find = util.find_spec
    monkeypatch.setattr(util, "find_spec", lambda name: None if name == "pyvista" else find(name))
    with pytest.raises(PicturesUnavailable, match=r"pyvista not installed.*pip install 'yasps\[examples\]'"):
        require_pictures()


@pytest.mark.parametrize(
    ("surfaces", "options", "message"),
    [
        ([], {}, "different names"),
        ([Surface("a", CORNERS, FACES)] * 2, {}, r"\['a', 'a'\]"),
        ([Surface("a", CORNERS[:, :2], FACES)], {}, r"shape \[8, 2\]"),
        ([Surface("a", CORNERS[:5], FACES)], {}, "vertices 0 to 7, but there are vertices 0 to 4"),
        ([Surface("a", CORNERS, FACES + 0.5)], {}, "type float64"),
        ([Surface("a", CORNERS, FACES)], {"window_size": (161, 120)}, "even"),
        ([Surface("a", CORNERS, FACES)], {"bounds": [[1, 1, 1], [0, 0, 0]]}, "lowest and the highest"),
        ([Surface("a", CORNERS, FACES)], {"view_direction": (0, 0, 1)}, "vertical"),
    ],
)
def test_wrong_scenes_are_refused_before_anything_is_drawn(surfaces, options, message):
    with pytest.raises(PictureError, match=message):
        FramePictures(surfaces, **options)


def test_an_unknown_color_is_refused(scene):
    with pytest.raises(PictureError, match="unknown color 'bleu'"):
        FramePictures([Surface("a", CORNERS, FACES, "bleu")])


@pytest.mark.parametrize("direction", [(0.3, -1, 0.3), (-1, 0.2, 2.0), (1, 0, 0)])
@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_the_camera_sees_the_whole_box_and_not_much_more(direction, aspect):
    bounds = np.array([[1.0, 2, 3], [2.0, 6, 5]])
    eye, focus = camera_position(box_corners(bounds), direction, aspect)
    forward = (focus - eye) / np.linalg.norm(focus - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    corners = np.array([[x, y, z] for x in bounds[:, 0] for y in bounds[:, 1] for z in bounds[:, 2]]) - eye
    depth = corners @ forward
    half = np.tan(np.radians(15))
    reach = max(
        np.abs(corners @ right / depth).max() / (half * aspect),
        np.abs(corners @ np.cross(right, forward) / depth).max() / half,
    )
    assert reach == pytest.approx(1 / 1.12)


def test_vertex_normals_of_a_cube_point_outwards():
    normals = vertex_normals(CORNERS, FACES)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    assert (np.sign(normals) == np.sign(CORNERS - [0, 0, 0.5])).all()
    assert vertex_normals(np.zeros((3, 3)), np.array([[0, 1, 2]])).tolist() == [[0, 0, 0]] * 3
