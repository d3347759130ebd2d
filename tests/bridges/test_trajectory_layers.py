"""Runs as functions of their parameters, and as layers of JAX and PyTorch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from inverse_runs import chain

from yasps import Attribute, DataError, Scene, SceneError, ShapeMismatchError
from yasps.bridges.trajectory_function import TrajectoryFunction
from yasps.inverse import InitialVelocity, Parameter, Trajectory


def made(steps: int = 3) -> tuple[Trajectory, list[Attribute | Parameter], list[Attribute]]:
    """A chain that swings; its stiffness and first velocity; where it is and an energy of it."""
    simulation, body = chain(30.0)
    outputs = [body.position, body.mesh.springs["stretch"]]
    return Trajectory(simulation, steps), [body.stiffness, InitialVelocity(body)], outputs


def test_a_run_as_a_function() -> None:
    """Pulled back, random slopes are what differences of the results say; the parameters stay as they were."""
    trajectory, parameters, outputs = made()
    function = TrajectoryFunction(trajectory, parameters, outputs, frames=[1, 3])
    arrays = [trajectory.value(parameter) for parameter in parameters]
    random = np.random.default_rng(2)
    slopes = [random.standard_normal(shape) for shape in function.shapes]
    directions = [random.standard_normal(array.shape) for array in arrays]

    def along(step: float) -> float:
        moved = [array + step * direction for array, direction in zip(arrays, directions, strict=True)]
        return float(sum((s * v).sum() for s, v in zip(slopes, function.values(*moved), strict=True)))

    weights = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
    difference = sum(weight * (along(1e-2 * k) - along(-1e-2 * k)) for k, weight in weights) / 1e-2
    for parameter, array in zip(parameters, arrays, strict=True):
        np.testing.assert_array_equal(trajectory.value(parameter), array)
    found = function.pull_back(arrays, slopes)
    assert [part.shape for part in found] == [array.shape for array in arrays]
    product = sum((part * direction).sum() for part, direction in zip(found, directions, strict=True))
    assert product == pytest.approx(difference, rel=1e-8)
    last = TrajectoryFunction(trajectory, parameters, outputs[0])
    np.testing.assert_array_equal(last.values(*arrays)[0], function.values(*arrays)[0][1])


def test_refusals() -> None:
    trajectory, parameters, outputs = made()
    with pytest.raises(SceneError, match="at least one parameter and one output"):
        TrajectoryFunction(trajectory, parameters, [])
    foreign = Scene("other").add_mesh("m").add_primitive("p", 1).add_attribute("a", 1, 1)
    with pytest.raises(SceneError, match=r"m\.p\.a is no attribute of scene chain"):
        TrajectoryFunction(trajectory, parameters, foreign)
    function = TrajectoryFunction(trajectory, parameters, outputs)
    stiffness, velocity = (trajectory.value(parameter) for parameter in parameters)
    with pytest.raises(ShapeMismatchError, match="has 2 arguments, got 1"):
        function.values(stiffness)
    with pytest.raises(
        ShapeMismatchError, match=r"argument 1 of <run of 3 steps in .*> has the shape \[3\], got \[2\]"
    ):
        function.values(stiffness, velocity[:2])
    with pytest.raises(DataError, match="slopes of"):
        function.pull_back([stiffness, velocity], [np.zeros(3)])


@pytest.fixture
def jax() -> Iterator[Any]:
    found = pytest.importorskip("jax", reason="pip install 'yasps[jax]'")
    before = found.config.jax_enable_x64
    found.config.update("jax_enable_x64", True)
    yield found
    found.config.update("jax_enable_x64", before)


def test_a_layer_of_jax(jax: Any) -> None:
    from jax.test_util import check_grads

    from yasps.bridges.jax import trajectory_layer

    trajectory, parameters, outputs = made(2)
    layer = trajectory_layer(trajectory, parameters, outputs, frames="all")
    arrays = [jax.numpy.asarray(trajectory.value(parameter)) for parameter in parameters]
    check_grads(layer, arrays, order=1, modes=["rev"])
    alone = trajectory_layer(trajectory, parameters, outputs[0])
    assert alone(*arrays).shape == (3, 3, 1)
    slope = jax.jit(jax.grad(lambda k, v: (alone(k, v) ** 2).sum()))(*arrays)
    assert slope.shape == (1, 1, 1)
    with pytest.raises(TypeError, match="forward-mode"):
        jax.jvp(layer, arrays, arrays)
    with pytest.raises(DataError, match="argument 0 must be a float64 array"):
        layer(1.0, arrays[1])


def test_a_layer_of_torch() -> None:
    torch = pytest.importorskip("torch", reason="pip install 'yasps[torch]'")
    from yasps.bridges.torch import trajectory_layer

    trajectory, parameters, outputs = made(2)
    layer = trajectory_layer(trajectory, parameters, outputs, frames="all")
    tensors = [torch.from_numpy(trajectory.value(parameter)).requires_grad_() for parameter in parameters]
    assert torch.autograd.gradcheck(layer, tensors)
    (slope,) = torch.autograd.grad(layer(*tensors)[0].square().sum(), tensors[0], create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        slope.backward()
    with pytest.raises(DataError, match="argument 0 must be a float64 tensor"):
        layer(tensors[0].float(), tensors[1])
