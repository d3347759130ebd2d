"""The device's projection by singular values, run on the host, against numpy.linalg.eigh and the CPU's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from cuda_on_host import HostProgram
from device_projection import check, compare_with_cpu, load_projections, on_cpu, project, reference

from yasps.runtime.core.library import Projection, Runtime

Array = np.ndarray
COUNT = 45


@pytest.fixture(scope="module")
def program() -> HostProgram:
    return load_projections()


def hessians(rng: np.random.Generator, f: Array) -> Array:
    """Hessians [n, k, k] by the k entries of F [n, 3, 2 or 3] of functions of tr C, tr C^2, det F with C = F^T F.

    First and second derivatives by these invariants are random, so that any isotropic energy could be meant.
    """
    n, rows, cols = f.shape
    width = rows * cols
    directions = np.eye(width).reshape(width, 1, rows, cols) + 0 * f
    c = f.swapaxes(1, 2) @ f
    gradients = [2 * f, 4 * f @ c]
    products = directions @ c + f @ directions.swapaxes(2, 3) @ f + f @ f.swapaxes(1, 2) @ directions
    along = [2 * directions, 4 * products]
    if cols == 3:
        gradients.append(cofactors(f, f) / 2)
        along.append(cofactors(directions, f + 0 * directions))
    first = rng.standard_normal((n, len(along)))
    second = rng.standard_normal((n, len(along), len(along)))
    g = np.stack([gradient.reshape(n, width) for gradient in gradients], axis=1)
    h = np.stack([part.reshape(width, n, width).swapaxes(0, 1) for part in along], axis=1)
    result = np.einsum("nk,nkij->nij", first, h) + np.einsum("nkl,nki,nlj->nij", second, g, g)
    return np.asarray(0.5 * (result + result.swapaxes(1, 2)))


def cofactors(a: Array, b: Array) -> Array:
    """The symmetric bilinear map that is twice the cofactor matrix for a = b."""
    rows = [
        np.cross(a[..., i - 2, :], b[..., i - 1, :]) + np.cross(b[..., i - 2, :], a[..., i - 1, :]) for i in range(3)
    ]
    return np.stack(rows, axis=-2)


def rotations(rng: np.random.Generator, size: int) -> Array:
    q = np.linalg.qr(rng.standard_normal((COUNT, size, size)))[0]
    q[:, :, 0] *= np.linalg.det(q)[:, None]
    return q


def with_singular_values(*values: float) -> Callable[[np.random.Generator, int], Array]:
    """F with these signed singular values (the last is left out of a 3x2 F) and random rotations."""

    def make(rng: np.random.Generator, cols: int) -> Array:
        middle = np.zeros((3, cols))
        middle[range(cols), range(cols)] = values[:cols]
        return np.asarray(rotations(rng, 3) @ middle @ rotations(rng, cols))

    return make


DEFORMATIONS: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "random": lambda rng, cols: rng.standard_normal((COUNT, 3, cols)),
    "near rest": lambda rng, cols: np.eye(3)[:, :cols] + 1e-3 * rng.standard_normal((COUNT, 3, cols)),
    "rest": lambda rng, cols: np.tile(np.eye(3)[:, :cols], (COUNT, 1, 1)),
    "zero": lambda rng, cols: np.zeros((COUNT, 3, cols)),
    "whole numbers": lambda rng, cols: np.round(rng.uniform(-1.6, 1.6, (COUNT, 3, cols))),
    "outer products": lambda rng, cols: (
        np.round(rng.uniform(-3, 3, (COUNT, 3, 1))) * np.round(rng.uniform(-3, 3, (COUNT, 1, cols)))
    ),
    "rotations": with_singular_values(1.0, 1.0, 1.0),
    "reflections": with_singular_values(1.0, 1.0, -1.0),
    "two equal": with_singular_values(0.5, 2.0, 2.0),
    "two opposite": with_singular_values(3.0, 0.7, -0.7),
    "almost equal": with_singular_values(1.0, 1.0 + 1e-9, 1.0 - 1e-13),
    "inverted": with_singular_values(1.5, 0.8, -0.3),
    "flat": with_singular_values(1.0, 0.7, 0.0),
    "a line": with_singular_values(1.0, 0.0, 0.0),
    "graded": with_singular_values(1.0, 1e-6, 1e-12),
    "steeply graded": with_singular_values(1.0, 1e-15, -1e-17),
}


@pytest.mark.parametrize("cols", [3, 2])
@pytest.mark.parametrize("kind", DEFORMATIONS)
@pytest.mark.parametrize("mode", [Projection.CLAMP, Projection.ABS])
def test_isotropic(program: HostProgram, runtime: Runtime, kind: str, cols: int, mode: Projection) -> None:
    rng = np.random.default_rng(len(kind))
    f = DEFORMATIONS[kind](rng, cols)
    h = hessians(rng, f)
    outcome, result = project(program, h, mode, f)
    check(h, outcome, result, mode, 5e-14)
    assert outcome.max() == 1
    compare_with_cpu(h, outcome, result, on_cpu(runtime, h, mode, f), 5e-14)


@pytest.mark.parametrize("cols", [3, 2])
@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e-20, 1e20, 1e150, 1e300])
@pytest.mark.parametrize("of", ["F", "H"])
def test_isotropic_huge_and_tiny(program: HostProgram, scale: float, of: str, cols: int) -> None:
    """The frames of F and of 2 F are the same, so the scales of F and H may be chosen apart."""
    rng = np.random.default_rng(3)
    f = rng.standard_normal((COUNT, 3, cols))
    h = hessians(rng, f)
    h /= np.abs(h).max(axis=(1, 2), keepdims=True)
    given = (h * scale, f) if of == "H" else (h, f * scale)
    outcome, result = project(program, given[0], Projection.CLAMP, given[1])
    assert outcome.min() >= 0
    wanted = reference(h, Projection.CLAMP)
    np.testing.assert_allclose(result / scale if of == "H" else result, wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("cols", [3, 2])
@pytest.mark.parametrize("mode", list(Projection))
def test_isotropic_semidefinite_matrices_keep_every_bit(program: HostProgram, cols: int, mode: Projection) -> None:
    rng = np.random.default_rng(cols)
    f = rng.standard_normal((COUNT, 3, cols))
    h = hessians(rng, f)
    good = rng.random(COUNT) < np.linspace(0, 1, COUNT)
    lift = np.maximum(0.0, -1.01 * np.linalg.eigvalsh(h)[:, 0])
    h[good] += lift[good, None, None] * np.eye(3 * cols)
    h[0] = 0
    outcome, result = project(program, h, mode, f)
    kept = np.all(result == h, axis=(1, 2))
    np.testing.assert_array_equal(kept, outcome == 0)
    assert kept[good].all()
    assert kept[0]
    assert (outcome == 1).sum() > 5 or mode == Projection.NONE


@pytest.mark.parametrize("cols", [3, 2])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("mode", list(Projection))
def test_isotropic_not_finite(program: HostProgram, cols: int, bad: float, mode: Projection) -> None:
    """H that is not finite is reported; without a finite F the general projection takes over."""
    rng = np.random.default_rng(5)
    f = rng.standard_normal((COUNT, 3, cols))
    h = hessians(rng, f)
    f[7:24, 1, 1] = bad
    h[13, 0, 0] = bad
    h[40, 1, 2] = h[40, 2, 1] = bad
    outcome, result = project(program, h, mode, f)
    finite = np.isfinite(h).all(axis=(1, 2))
    np.testing.assert_array_equal(outcome == -1, ~finite)
    wanted = h[finite] if mode == Projection.NONE else reference(h[finite], mode)
    np.testing.assert_allclose(result[finite], wanted, rtol=0, atol=1e-13 * np.abs(h[finite]).max())
