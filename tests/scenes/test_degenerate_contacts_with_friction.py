"""The 34 degenerate scenes with friction, with thickness, with both, and with every vertex a little off.

Every state must be free of intersections, as ipctk sees it, thick bodies must keep their distance, and every Newton
iteration must converge. `python -m pytest -m nightly` with this file runs all 442, in a quarter of an hour on two
cores; `-k "aligned and soft"`, `-k "jittered and affine-7"` (kind, and amount of jitter from 0 to 9) and the like run a
part of them.
"""

from __future__ import annotations

import numpy as np
import pytest
from degenerate_scenes import FALL, SCENES
from intersection_checks import least_distance_between_bodies, surfaces_intersect
from scene_shapes import joined

from yasps import Scene
from yasps.bodies import AffineBody, Obstacle, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import TetrahedralMesh
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

KINDS = ("soft", "affine")
RADIUS = 1e-4  # m, of thick bodies and obstacles: two of them start 4e-4 m apart, less their radii
VARIANTS = {"friction": (0.5, 0.0), "thickness": (0.0, RADIUS), "friction and thickness": (0.5, RADIUS)}
EPS_V = 1e-3  # m/s
JITTERS = np.geomspace(1e-12, 5e-5, 10)  # m
SAMPLE = (("corner on edge", "affine"), ("edge along edge", "affine"), ("cliff", "affine"), ("crack", "affine"))


def build(name: str, kind: str, friction: float, radius: float, *, jitter: float = 0.0, seed: int = 0) -> Simulation:
    shapes, obstacles = SCENES[name]()
    random = np.random.default_rng(seed)
    shapes = [
        TetrahedralMesh(shape.vertices + random.uniform(-jitter, jitter, shape.vertices.shape), shape.tets)
        for shape in shapes
    ]
    scene = Scene("degenerate", threads=1)
    bodies: list[SoftBody | AffineBody]
    if kind == "soft":
        bodies = [SoftBody(scene, f"body_{k}", s, youngs_modulus=1e5, radius=radius) for k, s in enumerate(shapes)]
    else:
        bodies = [AffineBody(scene, f"body_{k}", s, youngs_modulus=1e7, radius=radius) for k, s in enumerate(shapes)]
    still = Obstacle(scene, "obstacle", joined(obstacles), radius=radius)
    simulation = Simulation(
        scene,
        [*bodies, still],
        activation_distance=1e-3,
        contacts=ContactTable(friction=friction),
        eps_v=EPS_V,
        velocities=dict.fromkeys(bodies, FALL),
        settings=NewtonSettings(velocity_tolerance=0.1 * EPS_V, solver="direct"),
    )
    simulation.rescue = 0
    return simulation


def run(simulation: Simulation, steps: int, radius: float) -> None:
    assert not surfaces_intersect(simulation)
    most = 0
    for _ in range(steps):
        report = simulation.step()  # raises NotConvergedError
        assert report.largest_velocity < simulation.stepper.settings.velocity_tolerance
        assert not surfaces_intersect(simulation)
        if radius > 0:
            assert least_distance_between_bodies(simulation) > 2 * radius
        most = max(most, report.contacts)
    assert most > 0


@pytest.mark.parametrize(("name", "kind"), SAMPLE)
def test_a_few_steps_with_friction_and_thickness(name: str, kind: str) -> None:
    run(build(name, kind, 0.5, RADIUS), 3, RADIUS)


@pytest.mark.nightly
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SCENES)
def test_exactly_aligned(name: str, kind: str, variant: str) -> None:
    friction, radius = VARIANTS[variant]
    run(build(name, kind, friction, radius), 20, radius)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(len(JITTERS)))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SCENES)
def test_jittered(name: str, kind: str, seed: int) -> None:
    """Every vertex of the bodies is off by up to 1e-12 to 5e-5 m."""
    run(build(name, kind, 0.5, RADIUS, jitter=float(JITTERS[seed]), seed=seed), 10, RADIUS)
