"""What pictures of a run show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yasps import Scene
from yasps.bodies import AffineBody, Ground, Obstacle
from yasps.meshes import TriangleMesh, box
from yasps.output import FrameRecorder, PicturesUnavailable, make_picture, require_pictures
from yasps.simulation import Simulation


def test_a_run_leaves_pictures_with_what_stands_still(tmp_path: Path) -> None:
    """The wall beside the cube is grey; what is level is the ground itself."""
    try:
        require_pictures()
    except PicturesUnavailable as reason:
        pytest.skip(str(reason))
    from imageio.v3 import imread

    cube = box((1.0, 1.0, 1.0), (1, 1, 1)).translated((0.0, 0.0, 1.0))
    wall = cube.translated((1.5, 0.0, -0.5))
    bounds = [[-2.0, -1.0, 0.0], [2.5, 1.0, 2.0]]
    grey = {}
    for name in ("alone", "beside"):
        scene = Scene(name, threads=1)
        bodies = [AffineBody(scene, "cube", cube), Ground(scene)]
        if name == "beside":
            bodies.append(Obstacle(scene, "wall", TriangleMesh(wall.vertices, wall.surface_triangles())))
        simulation = Simulation(scene, bodies, contact=False, time_step=1e-3)
        is_last = name == "beside"
        with FrameRecorder(simulation, tmp_path, name, bounds=bounds, pictures=is_last) as recorder:
            simulation.run(1, recorder)
        if is_last:
            assert [path.name for path in recorder.written[:2]] == ["beside.vtkhdf", "beside.png"]
            assert recorder.written[2].name in ("beside.mp4", "beside.gif")  # without ffmpeg
            assert all(path.stat().st_size > 1000 for path in recorder.written)
        image = imread(make_picture(recorder.file, tmp_path / "small.png", size=(320, 240))).astype(int)
        assert (image[..., 2] - image[..., 0] > 40).sum() > 500  # the cube, light blue
        grey[name] = ((np.ptp(image, axis=2) < 20) & (image.max(axis=2) < 190)).sum()
    assert grey["beside"] > grey["alone"] + 500
