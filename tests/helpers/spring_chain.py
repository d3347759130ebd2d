"""A chain of springs, long enough that its kernels, its assembly and its solver run on several threads."""

from __future__ import annotations

import numpy as np

from yasps import Scene


def spring_chain(length: int = 3000, threads: int = 2) -> Scene:
    """Points one metre apart, shaken, and springs between neighbours; every point is held a little."""
    scene = Scene("chain", threads=threads)
    mesh = scene.add_mesh("m")
    points, springs = mesh.add_primitive("points", length), mesh.add_primitive("springs", length - 1)
    shaken = np.random.default_rng(0).random((length, 3)) + np.arange(length)[:, None]
    x = points.add_attribute("x", 3, 1, value=shaken)
    ends = springs.add_connectivity("ends", points, [[i, i + 1] for i in range(length - 1)], 2)
    pair = springs.add_attribute("pair", through=ends, source=x)
    excess = (pair.row(1) - pair.row(0)).norm() - 1.0
    scene.add_energy(springs.add_attribute("stretch", computed_attribute=50.0 * excess * excess))
    scene.add_energy(points.add_attribute("hold", computed_attribute=x.dot(x)))
    scene.add_minimize_target(x)
    return scene
