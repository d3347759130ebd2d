"""The peer JAX in the benchmarks `elements` and `cloth`: jit(vmap(hessian)) of the same energies; eigh, eigenvalues
clamped."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks.array_peer import ArrayPeer
from benchmarks.element_problem import (
    BARAFF_WITKIN,
    HINGE,
    LAMBDA,
    MU,
    NEO_HOOKEAN,
    SHEAR_STIFFNESS,
    STRETCH_STIFFNESS,
    Elements,
    FloatArray,
)


@contextmanager
def one_processor() -> Iterator[None]:
    """Threads started inside stay on one processor, where the system can do that."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    everything = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(everything)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, everything)


# JAX need not be installed: its modules and arrays are `Any`, and `jnp` is given to the energies.
def _neo_hookean(jnp: Any, x: Any, inverse: Any, volume: Any) -> Any:
    f = (x[1:] - x[0]).T @ inverse
    # Written out: faster here than jnp.linalg.det, which differentiates an LU decomposition.
    determinant = jnp.dot(f[0], jnp.cross(f[1], f[2]))
    stretch = jnp.sum(f * f)
    dilation = determinant - (1 + 0.75 * MU / LAMBDA)
    strain = 0.5 * MU * (stretch - 3 - jnp.log(stretch + 1))
    return volume * (strain + 0.5 * LAMBDA * dilation**2)


def _baraff_witkin(jnp: Any, x: Any, inverse: Any, area: Any) -> Any:
    f = (x[1:] - x[0]).T @ inverse
    u, v = f[:, 0], f[:, 1]
    stretch = (jnp.sqrt(u @ u) - 1) ** 2 + (jnp.sqrt(v @ v) - 1) ** 2
    return area * (STRETCH_STIFFNESS * stretch + SHEAR_STIFFNESS * (u @ v) ** 2)


def _hinge(jnp: Any, x: Any, stiffness: Any) -> Any:
    edge, left, right = x[1] - x[0], x[2] - x[0], x[3] - x[0]
    first, second = jnp.cross(edge, left), jnp.cross(right, edge)
    difference = first / jnp.sqrt(first @ first) - second / jnp.sqrt(second @ second)
    return stiffness * (difference @ difference)


ENERGIES: dict[str, Callable[..., Any]] = {
    NEO_HOOKEAN.name: _neo_hookean,
    BARAFF_WITKIN.name: _baraff_witkin,
    HINGE.name: _hinge,
}


def jax_elements(elements: Elements, most: int, place: str = "cpu") -> ArrayPeer:
    """Compiles JAX's functions for at most `most` elements, for one processor or (place "cuda") for the first GPU.

    Raises ImportError when JAX is not installed, or sees no GPU.
    """
    # On a GPU, JAX would take three quarters of its memory when it starts.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    with one_processor():
        # XLA makes one thread for each processor that it may use when it starts, which is here.
        jax: Any = import_module("jax")
        jnp: Any = import_module("jax.numpy")

        jax.config.update("jax_enable_x64", True)
        try:
            device = jax.devices(place)[0]
        except RuntimeError as error:
            raise ImportError(f"JAX has no place '{place}': {error}") from error
        count = min(most, len(elements))
        corners = jax.device_put(elements.corners[:count], device)
        constants = [jax.device_put(array[:count], device) for array in elements.constants.values()]
        energy_of = ENERGIES[elements.kind.name]

        def energy(flat: Any, *own: Any) -> Any:
            return energy_of(jnp, flat.reshape(-1, 3), *own)

        def derivatives(x: Any) -> tuple[Any, Any]:
            own = x[corners].reshape(count, -1)
            gradient = jax.vmap(jax.grad(energy))(own, *constants)
            return gradient, jax.vmap(jax.hessian(energy))(own, *constants)

        def projected(x: Any) -> tuple[Any, Any]:
            gradient, hessian = derivatives(x)
            values, vectors = jnp.linalg.eigh(hessian)
            return gradient, (vectors * jnp.maximum(values, 0.0)[:, None, :]) @ vectors.swapaxes(1, 2)

        def ready(function: Any) -> Any:
            with jax.default_device(device):
                shape = jax.ShapeDtypeStruct(elements.vertices.shape, np.float64)
                return jax.jit(function).lower(shape).compile()

        compiled = {False: ready(derivatives), True: ready(projected)}

        def there_and_back(project: bool, x: FloatArray) -> tuple[FloatArray, FloatArray]:
            gradient, hessian = jax.block_until_ready(compiled[project](jax.device_put(x, device)))
            return np.asarray(gradient), np.asarray(hessian)

        def resident(x: FloatArray, project: bool) -> Callable[[], object]:
            there = jax.device_put(x, device)
            return lambda: jax.block_until_ready(compiled[project](there))

        derive, derive_projected = partial(there_and_back, False), partial(there_and_back, True)
        return ArrayPeer("JAX", jax.__version__, count, derive, derive_projected, resident)
