"""The bunnies in a glass container."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yasps import SceneError
from yasps.bodies import AffineBody, SoftBody
from yasps.examples import bunnies_in_container as example
from yasps.meshes import box, write_mesh
from yasps.program import CheckFailedError


def test_the_box_is_open_at_the_top_and_seen_from_inside() -> None:
    mesh = example.open_box(2.0, 3.0)
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.array([0.0, 0.0, 1.5]) - corners.mean(axis=1)
    assert (np.einsum("ij,ij->i", normals, inwards) > 0).all()
    assert 0.5 * np.linalg.norm(normals, axis=1).sum() == pytest.approx(2.0 * 2.0 + 4 * 2.0 * 3.0)


def test_bunnies_of_a_file_and_affine_ones(tmp_path: Path) -> None:
    mesh = tmp_path / "box.vtu"
    write_mesh(mesh, box((1.0, 2.0, 4.0), (1, 1, 1)))
    with pytest.raises(SceneError, match="how many of the 5 bunnies are affine bodies, got 6"):
        example.build(example.PROGRAM.options(["--size", "5", "--affine", "6"]))
    simulation = example.build(example.PROGRAM.options(["--mesh", str(mesh), "--size", "5", "--affine", "2"]))
    assert [type(body) for body in simulation.moving] == 3 * [SoftBody] + 2 * [AffineBody]
    for number, body in enumerate(simulation.moving):
        layer, place = divmod(number, 4)
        x = body.positions()
        middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
        expected = example.SPACING * np.array([place % 2 - 0.5, place // 2 - 0.5, layer + 0.5])
        np.testing.assert_allclose(middle, expected, atol=1e-12)
        assert np.linalg.norm(x - middle, axis=1).max() == pytest.approx(0.5 * example.DIAMETER)


@pytest.mark.slow
def test_the_check_sees_what_is_wrong(tmp_path: Path) -> None:
    mesh = tmp_path / "box.vtu"
    write_mesh(mesh, box(divisions=(1, 1, 1)))
    options = example.PROGRAM.options(["--mesh", str(mesh), "--size", "1", "--frames", "2"])
    simulation = example.build(options)
    simulation.run(2)
    assert "all 1 bunnies are in the container" in example.check(simulation, options)
    (bunny,) = simulation.moving
    x = bunny.positions()
    for change, message in (
        ([0.3, 0.0, 0.0], "soft_0 is not in the container"),
        ([0.0, 0.0, 1.0], "but only -"),
    ):
        bunny.position.update_value(x + change)
        with pytest.raises(CheckFailedError, match=message):
            example.check(simulation, options)
    bunny.position.update_value(2 * x.mean(axis=0) - x)
    with pytest.raises(CheckFailedError, match="of soft_0 is inside out"):
        example.check(simulation, options)
