"""Scene(deterministic=True): the number of threads changes no bit; without it only rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yasps import Scene, materials
from yasps.meshes import box

MESH = box(divisions=(5, 5, 4))


def solution(threads: int, deterministic: bool) -> tuple[NDArray[np.float64], ...]:
    """Gradient and Newton step of a deformed block."""
    scene = Scene("block", threads=threads, deterministic=deterministic)
    mesh = scene.add_mesh("m")
    vertices, tets = mesh.add_primitive("v", len(MESH.vertices)), mesh.add_primitive("t", len(MESH.tets))
    noise = 0.05 * np.random.default_rng(0).standard_normal(MESH.vertices.shape)
    x = vertices.add_attribute("x", 3, 1, value=MESH.vertices + noise)
    corners = tets.add_connectivity("corners", vertices, MESH.tets, 4)
    inverse, volume = materials.rest_shape(MESH.vertices, MESH.tets)
    p = tets.add_attribute("p", through=corners, source=x)
    f = materials.deformation_gradient(p, tets.add_constant("B", 3, 3, value=inverse))
    energy = materials.stable_neo_hookean(f, 1.0, 4.0, tets.add_constant("V", 1, 1, value=volume))
    scene.add_energy(tets.add_attribute("E", computed_attribute=energy))
    d = x - vertices.add_constant("rest", 3, 1, value=MESH.vertices)
    scene.add_energy(vertices.add_attribute("pull", computed_attribute=0.1 * d.dot(d)))
    scene.add_minimize_target(x)
    return (*scene.gradient(), *scene.minimize_energy(tolerance=1e-12))


def test_bits() -> None:
    gradient, step = solution(1, True)
    for threads in (2, 3, 5):
        other_gradient, other_step = solution(threads, True)
        assert np.array_equal(gradient, other_gradient)
        assert np.array_equal(step, other_step)
    usual_gradient, usual_step = solution(2, False)
    np.testing.assert_allclose(usual_gradient, gradient, rtol=0, atol=1e-13)
    np.testing.assert_allclose(usual_step, step, rtol=0, atol=1e-9)
