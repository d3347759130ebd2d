"""Energies as JAX functions, by JAX's own checks of derivatives."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from bridge_scenes import springs_over_a_union

from yasps import DataError, Scene, SceneError, ShapeMismatchError

jax = pytest.importorskip("jax", reason="pip install 'yasps[jax]'")

import jax.numpy as jnp  # noqa: E402
from jax.test_util import check_grads  # noqa: E402

from yasps.bridges import EnergyFunction  # noqa: E402
from yasps.bridges.jax import energy_function  # noqa: E402


@pytest.fixture(autouse=True)
def float64() -> Iterator[None]:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def made() -> tuple[Scene, Any, list[Any], EnergyFunction]:
    """A scene, its energies as a JAX function, where it stands, and the same function of NumPy arrays."""
    scene, inputs = springs_over_a_union()
    plain = EnergyFunction(scene, inputs)
    return scene, energy_function(scene, inputs), [jnp.asarray(array) for array in plain.numbers()], plain


def test_gradients_by_jax() -> None:
    """Forward and reverse mode of the value and of the gradient, against JAX's differences; mixed ones too."""
    _, energy, arrays, _ = made()
    check_grads(energy, arrays, order=2)


def test_transformations_of_jax() -> None:
    scene, energy, arrays, plain = made()
    before = {path: array.copy() for path, array in scene.numbers().items()}
    hessian = plain.hessian(*arrays).toarray()
    assert float(jax.jit(energy)(*arrays)) == plain.value(*arrays)
    everything = tuple(range(5))
    rows = jax.jit(jax.hessian(energy, argnums=everything))(*arrays)
    sizes = [array.size for array in arrays]
    found = np.block([[np.reshape(rows[i][k], (n, m)) for k, m in enumerate(sizes)] for i, n in enumerate(sizes)])
    np.testing.assert_allclose(found, hessian, rtol=1e-13, atol=1e-13)
    twice_backwards = jax.jit(jax.jacrev(jax.grad(energy)))(*arrays)
    np.testing.assert_allclose(np.reshape(twice_backwards, (9, 9)), hessian[:9, :9], rtol=1e-13, atol=1e-13)
    _, moved = jax.jvp(jax.grad(energy, argnums=everything), arrays, arrays)
    flat = np.concatenate([np.ravel(array) for array in arrays])
    np.testing.assert_allclose(np.concatenate([np.ravel(part) for part in moved]), hessian @ flat, atol=1e-12)
    batch = jnp.stack([arrays[0], 2 * arrays[0]])
    slopes = jax.jit(jax.vmap(jax.grad(energy), in_axes=(0, None, None, None, None)))(batch, *arrays[1:])
    np.testing.assert_array_equal(slopes[1], plain.gradient(batch[1], *arrays[1:])[0])
    for path, array in scene.numbers().items():
        np.testing.assert_array_equal(array, before[path])


def test_the_hessian_is_assembled_once_for_all_directions(monkeypatch: pytest.MonkeyPatch) -> None:
    _, energy, arrays, _ = made()
    calls = []
    of_function = EnergyFunction.hessian_entries

    def counted(*arguments: Any) -> Any:
        calls.append(1)
        return of_function(*arguments)

    monkeypatch.setattr(EnergyFunction, "hessian_entries", counted)
    jax.jit(jax.hessian(energy))(*arrays)
    assert len(calls) == 1


def test_newton_in_jax_converges_quadratically() -> None:
    """The loop of docs/bridges.md, on the scene with a UNION: the exponent of the error doubles."""
    _, energy, arrays, _ = made()
    x, rest = arrays[0] + 0.05, arrays[1:]

    def flat(x: Any) -> Any:
        return energy(x.reshape(3, 3, 1), *rest) + 0.5 * jnp.sum((x - 1) ** 2)

    x, slopes = x.ravel(), []
    gradient, hessian = jax.jit(jax.grad(flat)), jax.jit(jax.hessian(flat))
    for _ in range(12):
        g = gradient(x)
        slopes.append(float(jnp.linalg.norm(g)))
        x = x - jnp.linalg.solve(hessian(x), g)
    assert slopes[-1] < 1e-13
    orders = [np.log(b) / np.log(a) for a, b in pairwise(slopes) if 1e-7 < a < 1e-2]
    assert orders
    assert min(orders) > 1.8


def test_refusals() -> None:
    scene, energy, arrays, _ = made()
    with pytest.raises(ShapeMismatchError, match="in this order; got 2"):
        energy(*arrays[:2])
    with pytest.raises(DataError, match=r"argument 0 \(mesh\.free\.position\) needs"):
        energy(arrays[1], arrays[0][:1], *arrays[2:])
    with pytest.raises(DataError, match="argument 1 must be a float64 array, got float32"):
        energy(arrays[0], arrays[1].astype(jnp.float32), *arrays[2:])
    with pytest.raises(DataError, match="argument 0 must be a float64 array, got list"):
        energy([1.0], *arrays[1:])
    with pytest.raises(NotImplementedError, match="third ones were asked for"):
        jax.jacfwd(jax.hessian(energy))(*arrays)
    with pytest.raises((jax.errors.JaxRuntimeError, ValueError), match=r"argument 0 .*: entry 0 is nan"):
        jax.jit(energy)(jnp.nan * arrays[0], *arrays[1:]).block_until_ready()
    hessian = jax.jit(jax.hessian(energy))
    hessian(*arrays)
    scene.mesh.springs.connectivities["ends"].update_value([[0, 1], [1, 2], [2, 3]])
    with pytest.raises((jax.errors.JaxRuntimeError, ValueError), match="trace it again"):
        hessian(*arrays).block_until_ready()
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(SceneError, match=re.escape("jax.config.update('jax_enable_x64', True)")):
        energy(*map(np.asarray, arrays))
