"""Hessians and mixed derivatives as users get them."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Scene, SceneError


def springs() -> Scene:
    """Three points in a row; springs whose stiffness and rest lengths are constants."""
    scene = Scene("springs")
    mesh = scene.add_mesh("mesh")
    points = mesh.add_primitive("points", 3)
    x = points.add_attribute("x", 3, 1, value=[0, 0, 0, 1.2, 0.1, 0, 2, -0.1, 0.3])
    links = mesh.add_primitive("links", 2)
    ends = links.add_connectivity("ends", points, [0, 1, 1, 2], 2)
    both = links.add_attribute("both", through=ends, source=x)
    stiffness = links.add_constant("stiffness", 1, 1, value=[2.0, 3.0])
    length = mesh.add_constant("length", 1, 1, value=1.5)
    d = both.row(1) - both.row(0)
    strain = d.norm() - length
    scene.add_energy(links.add_attribute("energy", computed_attribute=0.5 * stiffness * strain * strain))
    scene.add_minimize_target(x)
    return scene


def test_exact_hessian_against_differences_of_the_gradient() -> None:
    scene = springs()
    exact = scene.hessian(projected=False).to_scipy().toarray()
    assert np.linalg.eigvalsh(exact).min() < -0.1
    x = scene.mesh.points["x"]
    start = x.value
    step = 1e-6
    for k in range(9):
        sides = []
        for sign in (1, -1):
            moved = start.copy()
            moved[k] += sign * step
            x.update_value(moved)
            sides.append(scene.gradient()[0])
        np.testing.assert_allclose((sides[0] - sides[1]) / (2 * step), exact[k], atol=1e-8)
    x.update_value(start)
    projected = scene.hessian()
    assert np.linalg.eigvalsh(projected.to_scipy().toarray()).min() >= -1e-12
    before = projected.to_scipy().toarray()
    x.update_value(2 * start)
    scene.minimize_energy()
    np.testing.assert_array_equal(projected.to_scipy().toarray(), before)  # a copy
    assert "9 x 9" in repr(projected)


def test_mixed_hessian_against_differences() -> None:
    scene = springs()
    x, stiffness, length = scene.mesh.points["x"], scene.mesh.links["stiffness"], scene.mesh["length"]
    mixed = scene.mixed_hessian(x, [stiffness, length]).toarray()
    assert mixed.shape == (9, 3)
    column = 0
    for parameter in (stiffness, length):
        start = parameter.value
        for k in range(start.size):
            sides = []
            for sign in (1, -1):
                moved = start.copy()
                moved[k] += sign * 1e-6
                parameter.update_value(moved)
                sides.append(scene.gradient()[0])
            parameter.update_value(start)
            np.testing.assert_allclose((sides[0] - sides[1]) / 2e-6, mixed[:, column], atol=1e-8)
            column += 1
    assert stiffness.node.array.size == 2
    with pytest.raises(SceneError, match="never takes part"):
        scene.add_minimize_target(stiffness)  # still a constant


def test_refuses_wrong_arguments() -> None:
    scene = springs()
    x, energy = scene.mesh.points["x"], scene.mesh.links["energy"]
    with pytest.raises(SceneError, match="computed"):
        scene.mixed_hessian(x, energy)
    with pytest.raises(SceneError, match="named twice"):
        scene.mixed_hessian(x, x)
    with pytest.raises(SceneError, match="at least one"):
        scene.mixed_hessian(x, [])


def test_jacobian_against_differences() -> None:
    """Of an attribute of a matrix' shape, by variables of which one is not read and one is the attribute itself."""
    scene = springs()
    x, stiffness, length = scene.mesh.points["x"], scene.mesh.links["stiffness"], scene.mesh["length"]
    first, second = scene.mesh.links["both"]
    way = scene.mesh.links.add_attribute(
        "way", computed_attribute=stiffness * (second - first) / (second - first).norm()
    )
    assert set(way.inputs) == {x, stiffness}
    found = scene.jacobian(way, [length, stiffness, x]).toarray()
    assert found.shape == (way.value.size, 1 + 2 + 9)
    assert not found[:, 0].any()
    for column, (attribute, number) in enumerate([(stiffness, 0), (stiffness, 1), *((x, k) for k in range(9))], 1):
        start, sides = attribute.value, []
        for sign in (1, -1):
            moved = start.copy()
            moved[number] += sign * 1e-6
            attribute.update_value(moved)
            sides.append(way.value)
        attribute.update_value(start)
        np.testing.assert_allclose(found[:, column], (sides[0] - sides[1]) / 2e-6, atol=1e-7)
    np.testing.assert_array_equal(scene.jacobian(x, x).toarray(), np.eye(9))
    with pytest.raises(SceneError, match="at least one"):
        scene.jacobian(way, [])
    with pytest.raises(SceneError, match="computed"):
        scene.jacobian(x, way)
