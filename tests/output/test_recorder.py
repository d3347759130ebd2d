"""What pictures of a run show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yasps import Scene
from yasps.bodies import AffineBody, Cloth, Ground, Obstacle
from yasps.meshes import TriangleMesh, box, cloth_grid, edges_of, split_edges
from yasps.output import (
    FrameRecorder,
    PictureError,
    PicturesUnavailable,
    make_animation,
    make_picture,
    read_series,
    require_pictures,
)
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


def test_another_mesh_is_in_another_file(tmp_path: Path) -> None:
    """A file for each mesh that was seen, whose times follow each other; the animation is of all of them."""
    scene = Scene("flat", threads=1)
    cloth = Cloth(scene, "cloth", cloth_grid((1.0, 1.0), (2, 2), z=1.0), compression=0.5, refinable=True)
    simulation = Simulation(scene, [cloth], contact=False)
    meshes, positions = [], []
    recorder = FrameRecorder(simulation, tmp_path, "flat", pictures=False)
    for finer in (True, False, True, True):
        if finer:  # twice before a frame the second time
            for _ in range(len(meshes) + 1):
                marked = np.arange(len(edges_of(cloth.triangles)[0])) == 0
                simulation.remesh(cloth, *split_edges(TriangleMesh(cloth.rest, cloth.triangles), marked))
        simulation.step()
        recorder.record(simulation)
        meshes.append(cloth.triangles)
        positions.append(cloth.positions())
    assert recorder.number_of_frames == 4
    recorder.close()
    names = ["flat.vtkhdf", "flat.mesh-2.vtkhdf", "flat.mesh-3.vtkhdf"]
    assert [file.name for file in recorder.files] == names
    assert recorder.written == recorder.files
    seen = 0
    for file, count in zip(recorder.files, (2, 1, 1), strict=True):
        series = read_series(file)
        assert len(series) == count
        for frame in range(count):
            np.testing.assert_array_equal(series.cells()["triangle"], meshes[seen])
            np.testing.assert_array_equal(series.positions(frame), positions[seen])
            assert series.times[frame] == pytest.approx(0.01 * (seen + 1))
            seen += 1
    again = FrameRecorder(simulation, tmp_path, "flat", pictures=False, resume=True)
    assert again.files == recorder.files
    assert again.number_of_frames == 4
    simulation.step()
    again.record(simulation)
    assert [len(read_series(file)) for file in again.files] == [2, 1, 2]
    with pytest.raises(PictureError, match="times of these don't grow"):
        make_animation(recorder.files[::-1], tmp_path / "wrong.gif")
    try:
        require_pictures()
    except PicturesUnavailable as reason:
        pytest.skip(str(reason))
    from imageio.v3 import imread

    film = imread(make_animation(recorder.files, tmp_path / "flat.gif", size=(160, 120), frames_per_second=100.0))
    assert len(film) == 5
