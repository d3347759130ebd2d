"""What random scenes have found, in its smallest form."""

from __future__ import annotations

import numpy as np
import pytest
from scene_checks import check_kernels, check_passes

from yasps import Scene
from yasps.runtime.core.library import Runtime


def test_a_projected_hessian_that_is_zero(runtime: Runtime) -> None:
    """x - x is zero, so the Hessian reads nothing of what was projected; kernels read past the projected matrix."""
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    frames, points = mesh.add_primitive("f", 1), mesh.add_primitive("v", 1)
    matrix = frames.add_attribute("A", 2, 2, value=[1.0, 0.5, -0.5, 2.0])
    points.add_constant("r", 2, 1, value=[0.3, 0.6])
    frame = points.add_connectivity("frame", frames, [[0]], 1)
    joined = points.add_attribute("A", through=frame, source=matrix).reshape(2, 2)
    x = joined * points["r"]
    nothing = x - x
    energy = points.add_attribute("E", computed_attribute=(nothing.dot(nothing) - 0.5) ** 2)
    scene.add_energy(energy, projection="clamp")
    scene.add_minimize_target(matrix)
    check_passes(scene)
    check_kernels(scene, runtime)


def test_constants_beside_an_empty_primitive() -> None:
    """The interpreter joined the rows of a constant to those of no instances."""
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    points, pairs = mesh.add_primitive("v", 2), mesh.add_primitive("p", 0, is_dynamic=True)
    x = points.add_attribute("x", 2, 1, value=[0.1, 0.2, 0.3, 0.4])
    ends = pairs.add_connectivity("ends", points, [], 1)
    other = pairs.add_connectivity("other", points, [], 1)
    y, z = (pairs.add_attribute(c.name + "_x", through=c, source=x) for c in (ends, other))
    energy = pairs.add_attribute("E", computed_attribute=(1.0 + y.dot(y)).log() + z.sum())
    scene.add_energy(energy, projection="abs")
    scene.add_minimize_target(x)
    check_passes(scene)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_second_derivatives_of_a_singular_determinant(rank: int, runtime: Runtime) -> None:
    """The derivative of 4x4 cofactors divided by the determinant."""
    random = np.random.default_rng(rank)
    matrix = random.standard_normal((4, rank)) @ random.standard_normal((rank, 4))
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", 1)
    a = points.add_attribute("A", 4, 4, value=matrix)
    scene.add_energy(points.add_attribute("E", computed_attribute=a.det() * a[0, 0] + a.det() ** 2), projection="none")
    scene.add_minimize_target(a)
    check_passes(scene)
    check_kernels(scene, runtime)
