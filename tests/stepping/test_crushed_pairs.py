"""Cubes that hit edge on edge, so fast that pairs are crushed on the way to where forces balance."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Scene
from yasps.bodies import AffineBody, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import box
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings, detour

SIZE = 0.1  # m
APART = 2.5e-3  # m, of each edge from the middle
DISTANCE = 1e-3  # m, of activation


def cubes_that_meet(
    make: type[AffineBody | SoftBody], divisions: int, angle: float, *, friction: float, speed: float, tolerance: float
) -> Simulation:
    """Two cubes of 20 and 50 kPa, each with an edge towards the other; angle: between the edges."""
    cube = box((SIZE,) * 3, (divisions,) * 3).rotated((0.0, 1.0, 0.0), np.pi / 4)
    middle = SIZE / 2**0.5 + APART
    scene = Scene("pair", threads=1)
    shapes = cube.translated((-middle, 0.0, 0.0)), cube.rotated((1.0, 0.0, 0.0), angle).translated((middle, 3e-3, 2e-3))
    bodies = [
        make(scene, f"body_{k}", shape, youngs_modulus=modulus)
        for k, (shape, modulus) in enumerate(zip(shapes, (2e4, 5e4), strict=True))
    ]
    simulation = Simulation(
        scene,
        bodies,
        gravity=(0.0, 0.0, 0.0),
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=friction),
        velocities={bodies[0]: (speed / 2, 0.0, 0.0), bodies[1]: (-speed / 2, 0.0, 0.0)},
        settings=NewtonSettings(velocity_tolerance=tolerance, solver="direct", max_iterations=500),
    )
    simulation.rescue = 0
    return simulation


def test_crushed_pairs_are_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes 26 iterations; where gaps of 1e-8 m are left to Newton's method it takes 85. Detours, which keep pairs
    from being crushed here, are off."""
    monkeypatch.setattr(detour, "DETOURS", 0)
    simulation = cubes_that_meet(AffineBody, 2, 0.013, friction=0.3, speed=6.0, tolerance=1e-4)
    assert simulation.step().iterations < 50
    simulation.check_intersection_free()


@pytest.mark.nightly
def test_crushed_pairs_are_opened_until_forces_balance() -> None:
    """A way of 3 cm for each body in one step. Gaps fell to 4e-10 m, where 500 iterations of some micrometres each do
    not get anywhere, and 5e4 N were left; the step ends with a gap of 0.4 mm."""
    simulation = cubes_that_meet(SoftBody, 1, 0.013, friction=0.0, speed=6.0, tolerance=1e-5)
    report = simulation.step()
    assert report.iterations < 50
    assert report.residual_force < 1e-3
    assert simulation.contact is not None
    assert simulation.contact.active.minimum_gap > 0.1 * DISTANCE
    simulation.check_intersection_free()


@pytest.mark.nightly
@pytest.mark.parametrize("speed", [2.5, 6.0])
@pytest.mark.parametrize("angle", [0.013, 0.275, 0.4, 0.8, 1.3])
@pytest.mark.parametrize("divisions", [1, 2, 3])
def test_soft_cubes_that_meet_edge_on_edge(divisions: int, angle: float, speed: float) -> None:
    """With friction, to a tenth of the slip speed, and no step in parts."""
    simulation = cubes_that_meet(SoftBody, divisions, angle, friction=0.3, speed=speed, tolerance=1e-4)
    iterations = [simulation.step().iterations for _ in range(8)]
    print(f"{divisions} divisions, {angle} rad, {speed} m/s: Newton iterations {iterations}")
    assert max(iterations) < 200
    simulation.check_intersection_free()
