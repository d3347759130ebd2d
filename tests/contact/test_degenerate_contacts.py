"""Degenerate contacts, soft and affine: every state must be free of intersections, as ipctk sees it, and every Newton
iteration must converge.
"""

from __future__ import annotations

import numpy as np
import pytest
from contact_scenes import KINDS, Body, ContactScene, contact_scene
from degenerate_scenes import FALL, SCENES

from yasps.meshes import TetrahedralMesh


def run(scene: ContactScene, steps: int) -> None:
    assert not scene.intersects()
    most = 0
    for _ in range(steps):
        report = scene.step()  # raises NotConvergedError
        assert report.largest_velocity < scene.stepper.settings.velocity_tolerance
        assert not scene.intersects()
        most = max(most, report.contacts)
    assert most > 0


def test_there_are_34_scenes() -> None:
    assert len(SCENES) * len(KINDS) == 34


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SCENES)
def test_a_few_steps(name: str, kind: str) -> None:
    bodies, obstacles = SCENES[name]()
    run(contact_scene(kind, [Body(shape, FALL) for shape in bodies], obstacles), 4)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SCENES)
def test_many_steps_with_and_without_jitter(name: str, kind: str, seed: int) -> None:
    """The exact scene, and two with every vertex of the bodies off by up to 1e-9 and 1e-4 m."""
    bodies, obstacles = SCENES[name]()
    jitter = (0.0, 1e-9, 1e-4)[seed]
    random = np.random.default_rng(seed)
    shaken = [
        TetrahedralMesh(shape.vertices + random.uniform(-jitter, jitter, shape.vertices.shape), shape.tets)
        for shape in bodies
    ]
    run(contact_scene(kind, [Body(shape, FALL) for shape in shaken], obstacles), 60)
