"""What a simulation shows of itself in a notebook; scenes do in tests/test_tutorial.py."""

from __future__ import annotations

import base64
import io
import re

import imageio.v3 as imageio
import numpy as np
import pytest

from yasps import Scene
from yasps.bodies import AffineBody, MovingObstacle, Obstacle
from yasps.meshes import TriangleMesh, box
from yasps.output import PicturesUnavailable
from yasps.simulation import Simulation, notebook

SHAPE = box((1.0, 1.0, 1.0), (1, 1, 1))
SURFACE = TriangleMesh(SHAPE.vertices, SHAPE.surface_triangles())


def simulation() -> Simulation:
    scene = Scene("shown", threads=1)
    bodies = [
        AffineBody(scene, "stiff", SHAPE.translated((0.0, 0.0, 3.0)), density=500.0),
        Obstacle(scene, "wall", TriangleMesh(SURFACE.vertices + np.array([3.0, 0.0, 0.0]), SURFACE.triangles)),
        MovingObstacle(scene, "lift", SURFACE),
    ]
    return Simulation(scene, bodies, contact=False, activation_distance=0.01)


def test_bodies_and_time_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    def unavailable(*arguments: object, **keywords: object) -> None:
        raise PicturesUnavailable("no display")

    monkeypatch.setattr(notebook, "make_picture", unavailable)
    shown = simulation()._repr_html_()
    assert "simulation of shown</b>: frame 0, t = 0 s, time step 0.01 s, no contact" in shown
    for row in (("stiff", "AffineBody", 8, "6 tetra", "500 kg"), ("wall", "Obstacle", 8, "12 triangle", "fixed")):
        assert f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" in shown
    assert "<td>lift</td><td>MovingObstacle</td><td>8</td><td>12 triangle</td><td>driven</td>" in shown
    assert "<img" not in shown


def test_a_picture_is_shown_where_one_can_be_drawn() -> None:
    shown = simulation()._repr_html_()
    found = re.findall(r'src="data:image/png;base64,([^"]+)"', shown)
    if not found:
        pytest.skip("this machine can't draw")
    image = imageio.imread(io.BytesIO(base64.b64decode(found[0])))
    assert image.shape[:2] == (360, 480)
    assert np.ptp(image) > 50
