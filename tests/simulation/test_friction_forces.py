"""Forces on an incline: m g times sine and cosine of its angle; and the report says what sticks."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Scene
from yasps.bodies import AffineBody, HalfSpace
from yasps.contact import ContactTable
from yasps.meshes import TetrahedralMesh, box
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

SLOPE = 0.5
"""Tangent of the angle: 26.565 degrees."""


def on_incline(friction: float) -> tuple[Simulation, AffineBody]:
    scene = Scene("incline", threads=1)
    normal = np.array([-SLOPE, 0.0, 1.0]) / np.hypot(SLOPE, 1.0)
    cube = box((0.1, 0.1, 0.02), (2, 2, 1))
    turn = np.stack([[normal[2], 0.0, -normal[0]], [0.0, 1.0, 0.0], normal])
    shape = TetrahedralMesh((cube.vertices + np.array([0.0, 0.0, 0.0104])) @ turn, cube.tets)
    block = AffineBody(scene, "block", shape)
    simulation = Simulation(
        scene,
        [block, HalfSpace(scene, "slope", normal=normal)],
        contacts=ContactTable(friction),
        activation_distance=5e-4,
        settings=NewtonSettings(velocity_tolerance=1e-6, solver="direct"),
    )
    return simulation, block


def test_a_block_that_sticks_pulls_with_the_tangent_of_the_angle() -> None:
    simulation, block = on_incline(0.6)
    simulation.run(40)
    forces = simulation.contact_forces()
    weight = float(block.mass.value.sum()) * 9.8
    normal = forces.between_bodies("normal")[0, 1]
    friction = forces.between_bodies("friction")[0, 1]
    cosine = 1 / np.hypot(SLOPE, 1.0)
    assert np.linalg.norm(normal) == pytest.approx(weight * cosine, rel=1e-3)
    assert np.linalg.norm(friction) / np.linalg.norm(normal) == pytest.approx(SLOPE, rel=1e-3)
    np.testing.assert_allclose(normal + friction, [0, 0, weight], atol=1e-3 * weight)
    np.testing.assert_array_equal(forces.on_bodies()[1], -forces.on_bodies()[0])
    # No torque is left about the centre of mass of what rests.
    assert np.abs(forces.torques()[0]).max() < 1e-3 * weight * 0.05
    report = simulation.report()
    assert (report.sticking, report.sliding) == (len(forces.friction), 0)
    assert f"friction: {report.sticking} pairs stick, 0 slide" in str(report)
    assert "residual force" in str(report)


def test_a_block_that_slides_pulls_with_the_coefficient() -> None:
    simulation, _ = on_incline(0.2)
    simulation.run(12)
    forces = simulation.contact_forces()
    rubs = forces.friction
    assert rubs.slides.all()
    np.testing.assert_allclose(np.linalg.norm(rubs.on_first, axis=1), 0.2 * rubs.load, rtol=1e-12)
    downhill = np.array([1.0, 0.0, SLOPE]) * -1 / np.hypot(SLOPE, 1.0)
    assert forces.on_bodies("friction")[0] @ downhill < 0  # it holds the block back
    assert simulation.report().sliding == len(rubs) > 0
