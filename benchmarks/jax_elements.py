"""The peer JAX in the benchmark `elements`: jit(vmap(hessian)) of the same energy; eigh, eigenvalues clamped."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks.element_problem import POISSON_RATIO, YOUNGS_MODULUS, FloatArray, Tets
from yasps.frontend import materials


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


@dataclass(frozen=True)
class JaxElements:
    """Gradients [m, 12] and Hessians [m, 12, 12] of the first tets, for positions [n, 3], on one thread.

    derive: as they are; derive_projected: with negative eigenvalues set to zero.
    """

    version: str
    count: int
    derive: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    derive_projected: Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def jax_elements(tets: Tets, most: int) -> JaxElements:
    """Compiles JAX's functions for at most `most` tets. Raises ImportError when JAX is not installed."""
    with one_processor():
        # XLA makes one thread for each processor that it may use when it starts, which is here.
        jax: Any = import_module("jax")  # typed loosely: it need not be installed
        jnp: Any = import_module("jax.numpy")

        jax.config.update("jax_enable_x64", True)
        cpu = jax.devices("cpu")[0]
        count = min(most, len(tets.tets))
        mu, lam = materials.stable_neo_hookean_parameters(YOUNGS_MODULUS, POISSON_RATIO)
        corners, inverse, volume = (
            jax.device_put(array[:count], cpu) for array in (tets.tets, tets.inverse, tets.volume)
        )

        def energy(corner_positions: Any, rest_inverse: Any, rest_volume: Any) -> Any:
            x = corner_positions.reshape(4, 3)
            f = (x[1:] - x[0]).T @ rest_inverse
            # Written out: faster here than jnp.linalg.det, which differentiates an LU decomposition.
            determinant = jnp.dot(f[0], jnp.cross(f[1], f[2]))
            stretch = jnp.sum(f * f)
            dilation = determinant - (1 + 0.75 * mu / lam)
            strain = 0.5 * mu * (stretch - 3 - jnp.log(stretch + 1))
            return rest_volume * (strain + 0.5 * lam * dilation**2)

        def derivatives(x: Any) -> tuple[Any, Any]:
            own = x[corners].reshape(-1, 12)
            gradient = jax.vmap(jax.grad(energy))(own, inverse, volume)
            return gradient, jax.vmap(jax.hessian(energy))(own, inverse, volume)

        def projected(x: Any) -> tuple[Any, Any]:
            gradient, hessian = derivatives(x)
            values, vectors = jnp.linalg.eigh(hessian)
            return gradient, (vectors * jnp.maximum(values, 0.0)[:, None, :]) @ vectors.swapaxes(1, 2)

        def ready(function: Any) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
            compiled = jax.jit(function).lower(jax.ShapeDtypeStruct(tets.vertices.shape, np.float64)).compile()

            def run(x: FloatArray) -> tuple[FloatArray, FloatArray]:
                gradient, hessian = jax.block_until_ready(compiled(x))
                return np.asarray(gradient), np.asarray(hessian)

            return run

        return JaxElements(jax.__version__, count, ready(derivatives), ready(projected))
