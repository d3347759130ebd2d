"""Tetrahedra inside closed surfaces."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from yasps import Scene
from yasps.bodies import SoftBody
from yasps.meshes import MeshError, TriangleMesh, box, tetrahedralize

CUBE = box((0.1, 0.1, 0.1), (1, 1, 1))
SURFACE = TriangleMesh(CUBE.vertices, CUBE.surface_triangles())


def test_a_body_from_a_closed_surface(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    body = SoftBody(Scene("s"), "cube", SURFACE)
    assert list(tmp_path.iterdir()) == []  # fTetWild leaves a file behind
    assert body.mass.value.sum() == pytest.approx(1.0, rel=5e-3)  # 1000 kg/m^3
    low, high = body.rest.min(axis=0), body.rest.max(axis=0)
    np.testing.assert_allclose([low, high], [[-0.05] * 3, [0.05] * 3], atol=2e-4)  # 1/1000 of the diagonal
    assert body.tets.num_instances > 6


@pytest.mark.parametrize(
    ("triangles", "message"),
    [
        (SURFACE.triangles[:0], "has no triangles"),
        (SURFACE.triangles[:-1], "not closed: the edge of vertices . and . borders one triangle only"),
        (SURFACE.triangles[:, ::-1], r"encloses a volume of -0.001 m\^3: its triangles face inwards"),
        (np.concatenate([SURFACE.triangles, SURFACE.triangles]), "is used twice in one direction"),
    ],
    ids=["empty", "open", "inside out", "twice"],
)
def test_surfaces_without_an_inside(triangles: np.ndarray, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        tetrahedralize(TriangleMesh(SURFACE.vertices, triangles))


def test_edge_lengths_are_positive() -> None:
    with pytest.raises(MeshError, match=r"edge_length is -1\.0"):
        tetrahedralize(SURFACE, -1.0)


def test_without_pytetwild(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pytetwild", None)
    scene = Scene("s")
    with pytest.raises(MeshError, match=r"pip install 'yasps\[tetwild\]'"):
        SoftBody(scene, "cube", SURFACE)
    scene.add_mesh("cube")  # nothing half done


def test_a_surface_that_crosses_itself_is_reported_or_meshed() -> None:
    """fTetWild resolves crossings: two cubes that overlap become their union."""
    other = CUBE.translated((0.05, 0.05, 0.05))
    vertices = np.concatenate([CUBE.vertices, other.vertices])
    triangles = np.concatenate([SURFACE.triangles, other.surface_triangles() + len(CUBE.vertices)])
    mesh = tetrahedralize(TriangleMesh(vertices, triangles), 0.05)
    assert mesh.volumes().sum() == pytest.approx(2e-3 - 1.25e-4, rel=2e-2)
