"""Scenes for tests of devices: one of each kind, all of which have a Newton step."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from layered_scenes import lever_scene, ring_scene
from numpy.typing import NDArray
from small_scenes import mixed_union, shared_targets, soft_tets

from yasps import Scene

sys.path.insert(0, str(Path(__file__).parents[2]))  # the folder `benchmarks`: xDSL installs a package of this name

from benchmarks.codegrowth import Parameterisation, affine, cage, contact_scene, free, lever

BODY = 6
"""Vertices of each body of a contact scene."""


def close_pairs(seed: int, count: int, vertices: int) -> NDArray[np.int32]:
    """Point-triangle pairs of different vertices, [count, 4]."""
    random = np.random.default_rng(seed)
    return np.array([random.permutation(vertices)[:4] for _ in range(count)], np.int32).reshape(-1, 4)


def contact(*bodies: Parameterisation, pairs: int = 12) -> Scene:
    """Barriers between random points and triangles over the union of these bodies' vertices."""
    scene = contact_scene(bodies)
    union = scene.everything.vertices
    scene.everything.pairs.connectivities["corners"].update_value(close_pairs(len(bodies), pairs, union.num_instances))
    return scene


def held(scene: Scene, weight: float) -> Scene:
    """With an energy on every target, so that the Hessian can be solved with."""
    for target in scene.minimize_targets:
        assert target.owner is not None
        hold = target.owner.add_attribute(f"hold_{target.name}", computed_attribute=weight * target.dot(target))
        scene.add_energy(hold)
    return scene


SCENES: dict[str, Callable[[], Scene]] = {
    "soft_tets": lambda: soft_tets("abs", stretch=0.1),
    "mixed_union": mixed_union,
    "shared_targets": lambda: held(shared_targets("none"), 200.0),
    "levers": lambda: held(lever_scene("clamp", nested=True), 1.0),
    "rings": lambda: ring_scene("sum", nonlinear=False, projection="clamp"),
    "rings_of_a_function": lambda: ring_scene("mean", nonlinear=True, projection="abs"),
    "contact": lambda: held(contact(free, affine, cage, cage, pairs=20), 1e3),
    "nonlinear_contact": lambda: held(contact(free, affine, cage, lever, pairs=20), 1e3),
}
