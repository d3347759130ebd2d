"""Energies as functions of JAX arrays, which `jax.grad`, `jax.hessian`, `jax.jvp`, `jax.jit` and `jax.vmap` take.

JAX calls back to the host for the value, the gradient and the entries of the sparse Hessian. Products with the Hessian
are JAX's own operations: they can be transposed, batched and fused, and for any number of directions the Hessian is
assembled once. `pip install 'yasps[jax]'` brings JAX for the processor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, DataError, Scene, SceneError
from yasps.bridges.energy_function import EnergyFunction
from yasps.bridges.trajectory_function import Frames, TrajectoryFunction
from yasps.inverse import Parameter, Trajectory

_Arrays = Sequence[Any]


def energy_function(
    scene: Scene,
    inputs: Attribute | Sequence[Attribute],
    *,
    energies: Attribute | Sequence[Attribute] | None = None,
) -> Callable[..., Any]:
    """The energies [J] as a JAX function of one float64 array for each input, with exact derivatives up to the second.

    inputs, energies and the shapes of arguments: see `EnergyFunction`. What is no input is read from the scene when the
    function runs, under `jax.jit` too; but which entries of the second derivatives are not zero is found when they are
    traced. Batches: `jax.vmap`, which evaluates one after another.

    Calls raise SceneError unless JAX computes in float64, DataError for arguments of another type or shape and
    NotImplementedError where third derivatives are asked for. What fails when the function runs (see `EnergyFunction`)
    reaches the caller as JAX's error, jax.errors.JaxRuntimeError or ValueError, which quotes it.
    """
    return _EnergyInJax(EnergyFunction(scene, inputs, energies=energies))


class _EnergyInJax:
    """Three functions on the host, each with the next as its derivative: value, gradient, entries of the Hessian."""

    def __init__(self, function: EnergyFunction) -> None:
        self._function = function
        self._value = jax.custom_jvp(self._value_on_host)
        self._value.defjvp(self._value_rule)
        self._gradient = jax.custom_jvp(self._gradient_on_host)
        self._gradient.defjvp(self._gradient_rule)

    def __repr__(self) -> str:
        return f"{self._function!r} for JAX"

    def __call__(self, *arrays: Any) -> Any:
        _check_arrays(self._function, arrays)
        return self._value(*map(jnp.asarray, arrays))

    def _value_on_host(self, *arrays: Any) -> Any:
        return _on_host(self._function.value, jax.ShapeDtypeStruct((), jnp.float64), arrays)

    def _value_rule(self, arrays: _Arrays, tangents: _Arrays) -> tuple[Any, Any]:
        slopes = self._gradient(*arrays)
        along = sum(jnp.vdot(slope, tangent) for slope, tangent in zip(slopes, tangents, strict=True))
        return self._value(*arrays), along

    def _gradient_on_host(self, *arrays: Any) -> Any:
        return _on_host(self._function.gradient, [_like(array) for array in arrays], arrays)

    def _gradient_rule(self, arrays: _Arrays, tangents: _Arrays) -> tuple[Any, Any]:
        rows, cols = self._function.pattern()
        entries = self._hessian_entries(rows, cols)(*arrays)
        direction = jnp.concatenate([tangent.ravel() for tangent in tangents])
        product = jnp.zeros_like(direction).at[rows].add(entries * direction[cols])
        parts = jnp.split(product, np.cumsum([array.size for array in arrays])[:-1])
        moved = [part.reshape(array.shape) for part, array in zip(parts, arrays, strict=True)]
        return self._gradient(*arrays), moved

    def _hessian_entries(self, rows: NDArray[np.int32], cols: NDArray[np.int32]) -> Any:
        """Entries of the Hessian at these places, as a function of the arguments that has no derivative."""

        def host(*given: Any) -> Any:
            return self._function.hessian_entries((rows, cols), given)

        def entries(*arrays: Any) -> Any:
            return _on_host(host, jax.ShapeDtypeStruct(rows.shape, jnp.float64), arrays)

        def refuse(arrays: _Arrays, tangents: _Arrays) -> Any:
            raise NotImplementedError(
                f"{self!r} has first and second derivatives, but third ones were asked for: hold the second ones "
                "constant, by jax.lax.stop_gradient around what jax.hessian gives or around its arguments"
            )

        made = jax.custom_jvp(entries)
        made.defjvp(refuse)
        return made


def _check_arrays(function: EnergyFunction | TrajectoryFunction, arrays: _Arrays) -> None:
    """Raises SceneError unless JAX computes in float64, DataError and ShapeMismatchError for wrong arguments."""
    if jnp.result_type(float) != jnp.float64:
        raise SceneError(
            f"{function!r} computes in float64, and JAX in float32 now: call "
            "jax.config.update('jax_enable_x64', True) before JAX makes its first array"
        )
    for k, array in enumerate(arrays):
        kind = getattr(array, "dtype", type(array).__name__)
        if kind != jnp.float64:
            raise DataError(f"argument {k} must be a float64 array, got {kind}: jnp.asarray(values, jnp.float64)")
    function.check_shapes([array.shape for array in arrays])


def _like(array: Any) -> Any:
    return jax.ShapeDtypeStruct(array.shape, jnp.float64)


def _on_host(function: Callable[..., Any], result: Any, arrays: _Arrays) -> Any:
    def call(*given: Any) -> Any:
        made = function(*map(np.asarray, given))
        return np.float64(made) if isinstance(made, float) else made

    return jax.pure_callback(call, result, *arrays, vmap_method="sequential")


def trajectory_layer(
    trajectory: Trajectory,
    parameters: Attribute | Parameter | Sequence[Attribute | Parameter],
    outputs: Attribute | Sequence[Attribute],
    *,
    frames: Frames = "last",
) -> Callable[..., Any]:
    """A run as a JAX function of one float64 array for each parameter, with exact derivatives backwards (`jax.grad`,
    `jax.vjp`, `jax.jacrev`); it gives an array for each output, alone if there is but one.

    See `TrajectoryFunction`. There are no derivatives forwards, and no second ones: JAX says so. Raises as
    `energy_function` does.
    """
    function = TrajectoryFunction(trajectory, parameters, outputs, frames=frames)

    def forward(*arrays: Any) -> Any:
        results = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in function.shapes]
        return _on_host(function.values, results, arrays)

    def forward_kept(*arrays: Any) -> Any:
        return forward(*arrays), arrays

    def backward(arrays: _Arrays, slopes: _Arrays) -> Any:
        def host(*given: Any) -> Any:
            return function.pull_back(given[: len(arrays)], given[len(arrays) :])

        return tuple(_on_host(host, [_like(array) for array in arrays], [*arrays, *slopes]))

    layer = jax.custom_vjp(forward)
    layer.defvjp(forward_kept, backward)

    def call(*arrays: Any) -> Any:
        _check_arrays(function, arrays)
        results = layer(*map(jnp.asarray, arrays))
        return results[0] if len(results) == 1 else results

    return call
