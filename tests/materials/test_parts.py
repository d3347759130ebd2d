"""Every energy of the shelf against NumPy (helpers/parts.py): energies, stresses, Hessians, projections, moduli."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from cuda_on_host import HostDevice
from device_checks import on_device
from parts import INSTANCES, PARTS, Batch, Part
from small_scenes import STEP, Emitted, dense_assembly, emit

from yasps.backend.reference.interpreter import Interpreter
from yasps.backend.reference.scene_data import SceneData
from yasps.passes.pipeline import run_pipeline

IN_EVERY_RUN = ("neo_hookean_membrane",)
"""Whose machine code is compiled in every run; that of the others, which needs a second or two each, every night."""
LONG = ("rod_material_bending",)
"""Whose derivatives take two seconds, and are made as those of another are."""


def named(parts: list[Part]) -> pytest.MarkDecorator:
    """One test for each, called by its name."""
    return pytest.mark.parametrize("part", parts, ids=lambda part: part.name)


@cache
def _derived(name: str) -> Emitted:
    """A part's module after all passes, without projection, and its numbers."""
    part = next(part for part in PARTS if part.name == name)
    emitted = emit(part.scene("none"))
    return Emitted(run_pipeline(emitted.module), emitted.data, emitted.targets)


def derivatives(part: Part, **unknowns: Batch) -> tuple[Batch, Batch]:
    """Gradient and exact Hessian of each instance by the interpreter, [instances, n] and [instances, n, n]."""
    derived = _derived(part.name)
    storages = {**derived.data.storages}
    storages.update({f"m.cells.{name}": numbers for name, numbers in unknowns.items()})
    data = SceneData(storages, derived.data.connectivities, derived.data.sizes)
    gradient, hessian = dense_assembly(derived.module, data)
    return by_instance(part, gradient, hessian)


def by_instance(part: Part, gradient: Batch, hessian: Batch) -> tuple[Batch, Batch]:
    """Of results for all unknowns, target by target, those of each instance; other instances have no part in them."""
    sizes = [numbers[0].size for numbers in part.unknowns.values()]
    starts = np.cumsum([0, *sizes]) * INSTANCES
    places = np.array(
        [
            np.concatenate([start + i * size + np.arange(size) for start, size in zip(starts, sizes, strict=False)])
            for i in range(INSTANCES)
        ]
    )
    blocks = np.stack([hessian[np.ix_(place, place)] for place in places])
    assert np.abs(hessian).sum() == pytest.approx(np.abs(blocks).sum())
    return gradient[places], blocks


def along_each_entry(part: Part, of: Callable[[dict[str, Batch]], Batch]) -> Batch:
    """Complex-step derivatives [instances, n, ...] of what has one value for each instance, by its unknowns."""
    columns = []
    for name, numbers in part.unknowns.items():
        for entry in np.ndindex(numbers.shape[1:]):
            stepped = numbers.astype(complex)
            stepped[(slice(None), *entry)] += 1j * STEP
            columns.append(of({name: stepped}).imag / STEP)
    return np.stack(columns, axis=1)


def close(found: Batch, wanted: Batch, digits: float) -> None:
    """Equal beside the largest entry of each instance."""
    scale = np.abs(wanted).reshape(len(wanted), -1).max(axis=1).reshape(-1, *[1] * (wanted.ndim - 1))
    assert (np.abs(found - wanted) <= digits * scale).all()


@pytest.mark.parametrize(
    "part", [pytest.param(p, marks=pytest.mark.nightly if p.name in LONG else [], id=p.name) for p in PARTS]
)
def test_energy_stress_and_hessian(part: Part) -> None:
    """Energy and stress are NumPy's, the Hessian is the derivative of the gradient."""
    emitted = emit(part.scene())
    energies = Interpreter(emitted.module, emitted.data).value("m.cells.energy").ravel()
    np.testing.assert_allclose(energies, part.energies(), rtol=1e-12)
    gradient, hessian = derivatives(part)
    close(gradient, along_each_entry(part, lambda moved: part.energies(**moved)), 1e-12)
    close(hessian, along_each_entry(part, lambda moved: derivatives(part, **moved)[0]), 1e-11)


@pytest.mark.parametrize(
    "part",
    [pytest.param(p, marks=[] if p.name in IN_EVERY_RUN else pytest.mark.nightly, id=p.name) for p in PARTS],
)
def test_machine_code_and_projection(part: Part) -> None:
    """The kernel has the same energy and stress; its Hessian is the exact one without what eigh finds negative.

    Where the energy sees its unknowns through a linear map to fewer numbers, or to a matrix of other columns, the
    projection is made there: then it is semi-definite and no less than the exact one.
    """
    scene = part.scene()
    (energies,) = scene.energy_values().values()
    np.testing.assert_allclose(energies.ravel(), part.energies(), rtol=1e-12)
    gradient, exact = derivatives(part)
    found, projected = by_instance(part, np.concatenate(scene.gradient()), scene.hessian().to_scipy().toarray())
    close(found, gradient, 1e-12)
    values, vectors = np.linalg.eigh(exact)
    size = np.abs(values).max()
    if set(part.unknowns) == {"deformation"}:
        clamped = np.einsum("nik,nk,njk->nij", vectors, np.maximum(values, 0), vectors)
        np.testing.assert_allclose(projected, clamped, atol=1e-12 * size)
    assert np.linalg.eigvalsh(projected).min() > -1e-12 * size
    assert np.linalg.eigvalsh(projected - exact).min() > -1e-12 * size


@pytest.mark.parametrize(
    "name",
    ["strain_limiting", *(pytest.param(n, marks=pytest.mark.nightly) for n in ("fixed_corotated", "rod_twisting"))],
)
def test_device_code_has_the_same_results(name: str) -> None:
    """The CUDA text, built for the host: of what has most of it, Jacobi's method written out and the longest rod."""
    part = next(part for part in PARTS if part.name == name)
    found, wanted = on_device(part.scene(), HostDevice()), part.scene()
    close(np.concatenate(found.gradient())[None], np.concatenate(wanted.gradient())[None], 1e-12)
    close(found.hessian().to_scipy().toarray()[None], wanted.hessian().to_scipy().toarray()[None], 1e-12)


@named([part for part in PARTS if part.moduli is not None])
def test_moduli_at_rest_are_those_of_linear_elasticity(part: Part) -> None:
    """No stress, and the Hessian is V (lambda d_ij d_kl + mu (d_ik d_jl + d_il d_jk)); a sheet is slack across."""
    assert part.moduli is not None
    columns = part.unknowns["deformation"].shape[2]
    gradient, hessian = derivatives(part, deformation=np.tile(np.eye(3, columns), (INSTANCES, 1, 1)))
    mu, lam, volume = (np.reshape(numbers, (-1, 1, 1, 1, 1)) for numbers in part.moduli(**part.arguments))
    one = np.eye(3, columns)
    shear = np.einsum("ik,jl->ijkl", one @ one.T, np.eye(columns)) + np.einsum("il,kj->ijkl", one, one)
    wanted = volume * (lam * np.einsum("ij,kl->ijkl", one, one) + mu * shear)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-13)
    np.testing.assert_allclose(hessian.reshape(wanted.shape), wanted, atol=1e-13)


def test_fibres_resist_stretching_alone() -> None:
    """4 k1 is Young's modulus along fibres that are a little longer than at rest; shorter ones give way."""
    part = next(part for part in PARTS if part.name == "holzapfel_fibres")
    direction = part.constants["direction"]
    along = direction * direction.swapaxes(1, 2)
    for strain, factor in ((1e-9, 4.0), (-1e-9, 0.0)):
        _, hessian = derivatives(part, deformation=np.eye(3) + strain * along)
        modulus = np.einsum("ni,nij,nj->n", along.reshape(-1, 9), hessian, along.reshape(-1, 9))
        wanted = factor * part.constants["stiffness"].ravel() * part.constants["volume"].ravel()
        np.testing.assert_allclose(modulus, wanted, rtol=1e-7)
