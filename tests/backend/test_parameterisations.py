"""Nonlinear layers, variable arity and their nesting: kernels against interpreter and complex step."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import Attribute, ConnectivityError, Scene, SceneError, concat_rows
from yasps.backend.interpreter import Interpreter
from yasps.backend.scene_view import SceneView
from yasps.frontend.cpu_scene import CpuScene

TOLERANCE = 1e-12
STEP = 1e-30
SPRINGS = {
    False: [[0, 4], [4, 7], [4, 5], [1, 9], [5, 5], [3, 8], [10, 4]],
    True: [[0, 11], [12, 7], [4, 13], [16, 9], [14, 14]],
}


def lever_scene(projection: str, nested: bool) -> Scene:
    """Free points, tips of levers (angle, paper fig. 29) and fixed points; springs between any of them.

    Nested: also midpoints, themselves nonlinear, of pairs of those.
    """
    rng = np.random.default_rng(1)
    scene = Scene("levers")
    mesh = scene.add_mesh("mesh")
    arms = mesh.add_primitive("arms", 3)
    angle = arms.add_attribute("angle", 1, 1, value=rng.random(3))
    length = arms.add_constant("length", 1, 1, value=1 + rng.random(3))
    tips = mesh.add_primitive("tips", 5)
    arm = tips.add_connectivity("arm", arms, [0, 1, 2, 0, 1], 1)
    a = tips.add_attribute("angle", through=arm, source=angle)
    r = tips.add_attribute("length", through=arm, source=length)
    offset = mesh.add_attribute("offset", 3, 1, value=rng.random(3))
    tip = tips.add_attribute("position", computed_attribute=concat_rows([r * a.cos(), r * a.sin(), a * 0.1]) + offset)
    free = mesh.add_primitive("free", 4)
    position = free.add_attribute("position", 3, 1, value=rng.random((4, 3)))
    fixed = mesh.add_primitive("fixed", 2)
    fixed.add_constant("position", 3, 1, value=rng.random((2, 3)))
    points = mesh.add_primitive_union("points", [free, tips, fixed])
    points.add_attribute("position")
    if nested:
        middles = mesh.add_primitive("middles", 6)
        ends = middles.add_connectivity("ends", points, [0, 4, 5, 6, 8, 1, 4, 7, 9, 4, 10, 5], 2)
        both = middles.add_attribute("both", through=ends, source=points["position"])
        first, second = both.row(0).T, both.row(1).T
        middle = 0.5 * (first + second) + 0.1 * first.hadamard(second)
        middles.add_attribute("position", computed_attribute=middle)
        points = mesh.add_primitive_union("everything", [points, middles])
        points.add_attribute("position")
    springs = mesh.add_primitive("springs", len(SPRINGS[nested]))
    ends = springs.add_connectivity("ends", points, SPRINGS[nested], 2)
    x = springs.add_attribute("ends_at", through=ends, source=points["position"])
    d = x.row(0) - x.row(1)
    energy = (d.dot(d) - 0.5) ** 2 + d.dot(d)
    scene.add_energy(springs.add_attribute("energy", computed_attribute=energy), projection=projection)
    scene.add_energy(tips.add_attribute("weight", computed_attribute=9.8 * tip[1]), projection=projection)
    scene.add_minimize_target([angle, position, offset])
    return scene


def ring_scene(operation: str, nonlinear: bool, projection: str) -> Scene:
    """One-ring Laplacian of values, or of a nonlinear function of them, and pairs of rings."""
    rng = np.random.default_rng(2)
    scene = Scene("rings")
    mesh = scene.add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", 7)
    x = vertices.add_attribute("x", 3, 1, value=rng.random((7, 3)))
    counts = [3, 2, 4, 1 if operation == "mean" else 0, 2, 5, 1]
    ring = vertices.add_connectivity("ring", vertices, rng.integers(0, 7, sum(counts)), counts=counts)
    source: Attribute = x
    if nonlinear:
        source = vertices.add_attribute("y", computed_attribute=x.hadamard(x) + x.sin())
    around = vertices.add_attribute("around", through=ring, source=source, operation=operation)
    d = around - x
    scene.add_energy(vertices.add_attribute("laplacian", computed_attribute=d.dot(d) ** 2), projection=projection)
    pairs = mesh.add_primitive("pairs", 4)
    ends = pairs.add_connectivity("ends", vertices, [[0, 1], [2, 3], [3, 3], [5, 6]], 2)
    both = pairs.add_attribute("both", through=ends, source=around)
    q = both.row(0) - 2 * both.row(1)
    scene.add_energy(pairs.add_attribute("energy", computed_attribute=q.dot(q) * (q.dot(q) - 3)), projection=projection)
    scene.add_minimize_target(x)
    return scene


def hessian_of(compiled: CpuScene) -> NDArray[np.float64]:
    return (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()


def by_complex_step(compiled: CpuScene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gradient and Hessian, one unknown at a time."""
    data = compiled.data()
    names = [compiled.emitter.symbol_of(target) for target in compiled.targets]
    gradient, rows = [], []
    for name in names:
        for k in range(data.storages[name].size):
            moved = data.storages[name].astype(complex)
            moved.flat[k] += 1j * STEP
            one = dataclasses.replace(data, storages={**data.storages, name: moved})
            interpreter = Interpreter(compiled.module, one)
            gradient.append(interpreter.total_energy().imag / STEP)
            rows.append(interpreter.gradient().imag / STEP)
    return np.array(gradient), np.array(rows)


def check(scene: Scene, projection: str) -> None:
    compiled = scene.compile()
    gradient = compiled.assemble()
    hessian = hessian_of(compiled)
    interpreter = Interpreter(compiled.module, compiled.data())
    expected_gradient, expected_hessian = interpreter.assemble()
    exact_gradient, exact_hessian = by_complex_step(compiled)
    largest = np.abs(hessian).max()
    assert np.abs(gradient - expected_gradient).max() <= TOLERANCE * np.abs(gradient).max()
    assert np.abs(gradient - exact_gradient).max() <= TOLERANCE * np.abs(gradient).max()
    assert np.abs(hessian - expected_hessian.toarray()).max() <= TOLERANCE * largest
    if projection == "none":
        assert np.abs(hessian - exact_hessian).max() <= TOLERANCE * largest
        assert np.linalg.eigvalsh(exact_hessian).min() < 0  # or the projected cases would show nothing
    else:
        assert np.linalg.eigvalsh(hessian).min() >= -TOLERANCE * largest
        assert np.abs(hessian - exact_hessian).max() > 1e-3 * largest


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("projection", ["none", "clamp", "abs"])
def test_nonlinear_parameterisations(projection: str, nested: bool) -> None:
    scene = lever_scene(projection, nested)
    check(scene, projection)
    where = {
        op.symbol: op.projects.data for op in SceneView(scene.compile().module).derivatives if op.projects is not None
    }
    if projection != "none":
        assert "whole local Hessian" in where["mesh.springs.energy.derivative"]


@pytest.mark.parametrize("operation", ["sum", "mean"])
def test_linear_rings(operation: str) -> None:
    scene = ring_scene(operation, False, "clamp")
    compiled = scene.compile()
    gradient = compiled.assemble(project=False)
    hessian = hessian_of(compiled)
    exact_gradient, exact_hessian = by_complex_step(compiled)
    assert np.abs(gradient - exact_gradient).max() <= TOLERANCE * np.abs(gradient).max()
    assert np.abs(hessian - exact_hessian).max() <= TOLERANCE * np.abs(hessian).max()
    compiled.assemble()
    assert np.linalg.eigvalsh(hessian_of(compiled)).min() >= -TOLERANCE * np.abs(hessian).max()


@pytest.mark.parametrize("projection", ["none", "clamp"])
def test_rings_of_a_nonlinear_function(projection: str) -> None:
    check(ring_scene("mean", True, projection), projection)


def test_sum_and_mean_against_numpy() -> None:
    scene = Scene("rings")
    vertices = scene.add_mesh("mesh").add_primitive("vertices", 4)
    x = vertices.add_attribute("x", 2, 1, value=np.arange(8.0))
    ring = vertices.add_connectivity("ring", vertices, [1, 2, 3, 0, 0, 1], counts=[3, 0, 1, 2])
    total = vertices.add_attribute("total", through=ring, source=x, operation="sum")
    values = x.compute().array[:, :, 0]
    np.testing.assert_array_equal(
        total.compute().array[:, :, 0], [values[1] + values[2] + values[3], [0, 0], values[0], values[0] + values[1]]
    )
    ring.update_value([0, 1, 2, 3, 0, 1, 2, 3], [4, 2, 1, 1])  # longer rows than before
    np.testing.assert_array_equal(total.compute().array[0, :, 0], values.sum(axis=0))
    mean = vertices.add_attribute("mean", through=ring, source=x, operation="mean")
    np.testing.assert_allclose(mean.compute().array[0, :, 0], values.mean(axis=0), rtol=1e-15)
    with pytest.raises(ConnectivityError, match="a mean is taken"):
        ring.update_value([0, 1, 2, 3], [0, 2, 1, 1])
    np.testing.assert_allclose(mean.compute().array[0, :, 0], values.mean(axis=0), rtol=1e-15)


def test_refuses_what_has_no_meaning() -> None:
    scene = Scene("rings")
    vertices = scene.add_mesh("mesh").add_primitive("vertices", 3)
    x = vertices.add_attribute("x", 1, 1)
    with pytest.raises(ConnectivityError, match="either arity or counts"):
        vertices.add_connectivity("c", vertices, [0, 1, 2], 1, counts=[1, 1, 1])
    with pytest.raises(ConnectivityError, match="add up to 4"):
        vertices.add_connectivity("c", vertices, [0, 1, 2], counts=[1, 1, 2])
    with pytest.raises(ConnectivityError, match="needs 3 counts"):
        vertices.add_connectivity("c", vertices, [0, 1, 2], counts=[1, 2])
    with pytest.raises(ConnectivityError, match="out of range"):
        vertices.add_connectivity("c", vertices, [0, 1, 3], counts=[1, 1, 1])
    with pytest.raises(ConnectivityError, match="out of range"):
        vertices.add_connectivity("c", vertices, [0, 1, -1], counts=[1, 1, 1])
    ring = vertices.add_connectivity("ring", vertices, [0, 1], counts=[1, 1, 0])
    with pytest.raises(SceneError, match="variable arity"):
        vertices.add_attribute("a", through=ring, source=x)
    with pytest.raises(ConnectivityError, match="connected to nothing"):
        vertices.add_attribute("a", through=ring, source=x, operation="mean")
    pair = vertices.add_connectivity("pair", vertices, [0, 1, 2, 0, 1, 2], 2)
    with pytest.raises(SceneError, match="fixed arity"):
        vertices.add_attribute("a", through=pair, source=x, operation="sum")
    with pytest.raises(ConnectivityError, match="takes no counts"):
        pair.update_value([0, 1, 2, 0, 1, 2], [2, 2, 2])
    assert not vertices.attributes.keys() - {"x"}
