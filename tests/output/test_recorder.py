"""What pictures of a run show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yasps import Scene
from yasps.bodies import AffineBody, Ground, Obstacle
from yasps.meshes import TriangleMesh, box
from yasps.output import FrameRecorder, PicturesUnavailable, require_pictures
from yasps.simulation import Simulation


def test_obstacles_that_stand_still_are_in_the_pictures(tmp_path: Path) -> None:
    """Beside the cube, grey; a level one at the height of the ground is the ground itself."""
    try:
        require_pictures()
    except PicturesUnavailable as reason:
        pytest.skip(str(reason))
    from imageio.v3 import imread

    cube = box((1.0, 1.0, 1.0), (1, 1, 1)).translated((0.0, 0.0, 1.0))
    wall = cube.translated((1.5, 0.0, -0.5))
    grey = {}
    for name in ("alone", "beside"):
        scene = Scene(name, threads=1)
        bodies = [AffineBody(scene, "cube", cube), Ground(scene)]
        if name == "beside":
            bodies.append(Obstacle(scene, "wall", TriangleMesh(wall.vertices, wall.surface_triangles())))
        simulation = Simulation(scene, bodies, contact=False, time_step=1e-3)
        with FrameRecorder(simulation, tmp_path, name, bounds=[[-2.0, -1.0, 0.0], [2.5, 1.0, 2.0]]) as recorder:
            simulation.run(1, recorder)
        image = imread(tmp_path / f"{name}.png").astype(int)
        assert (image[..., 2] - image[..., 0] > 40).sum() > 5000  # the cube, light blue
        grey[name] = ((np.ptp(image, axis=2) < 20) & (image.max(axis=2) < 190)).sum()
    assert grey["beside"] > grey["alone"] + 5000
