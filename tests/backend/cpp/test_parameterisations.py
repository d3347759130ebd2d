"""Nonlinear layers, variable arity and their nesting: kernels against interpreter and complex step."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from layered_scenes import lever_scene, ring_scene
from numpy.typing import NDArray

from yasps import ConnectivityError, Scene, SceneError
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution.cpu_scene import CpuScene

TOLERANCE = 1e-12
STEP = 1e-30


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
