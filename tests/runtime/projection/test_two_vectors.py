"""Projection in the plane of two vectors and across it against numpy.linalg.eigh, for random isotropic energies."""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Callable

import numpy as np
import pytest
from packed_matrices import packed_triangles, packs, reference, unpacked

from yasps.runtime.build.toolchain import Compiler, compile_sources, link
from yasps.runtime.core.library import LANES, Projection, Runtime, runtime_sources

COUNT = 45
Array = np.ndarray
PAIRS = ((0, 0), (0, 1), (1, 1))


def hessians(rng: np.random.Generator, a: Array) -> Array:
    """Hessians [n, 6, 6] by the entries of two vectors, a [n, 2, 3], of functions of their three dot products.

    First and second derivatives by these are random, so that any isotropic energy could be meant, and the larger the
    shorter the vectors are, as those of norms.
    """
    n = len(a)
    largest = np.abs(a).max(axis=2, keepdims=True)
    unit = a / np.where(largest > 0, largest, 1.0)
    unit /= np.where(largest > 0, np.linalg.norm(unit, axis=2, keepdims=True), 1.0)
    first, second = rng.standard_normal((n, 3)), rng.standard_normal((n, 3, 3))
    gradients, h = np.zeros((n, 3, 2, 3)), np.zeros((n, 2, 3, 2, 3))
    for k, (i, j) in enumerate(PAIRS):
        gradients[:, k, i] += unit[:, j]
        gradients[:, k, j] += unit[:, i]
        part = first[:, k, None, None] * np.eye(3)
        h[:, i, :, j] += part
        h[:, j, :, i] += part
    h += np.einsum("nkl,nkar,nlbs->narbs", second, gradients, gradients)
    result = h.reshape(n, 6, 6)
    return np.asarray(0.5 * (result + result.swapaxes(1, 2)))


def project(runtime: Runtime, h: Array, a: Array, mode: Projection = Projection.CLAMP) -> tuple[int, Array]:
    """What comes back, and the projected matrices."""
    packed = packed_triangles(h)
    changed = runtime.project_two_vectors(packed, packs(a.reshape(len(a), -1)), len(h), mode)
    return changed, unpacked(packed, len(h))


def beside(distance: float, factor: float = 1.0) -> Callable[[np.random.Generator], Array]:
    """The second vector is the first, times a factor, and a bit in another direction."""

    def make(rng: np.random.Generator) -> Array:
        a, other = rng.standard_normal((2, COUNT, 3))
        return np.stack([a, factor * (a + distance * other)], axis=1)

    return make


def scaled(first: float, second: float) -> Callable[[np.random.Generator], Array]:
    return lambda rng: rng.standard_normal((COUNT, 2, 3)) * np.array([first, second])[:, None]


KINDS: dict[str, Callable[[np.random.Generator], Array]] = {
    "random": scaled(1.0, 1.0),
    "axes": lambda rng: np.tile(np.eye(3)[:2], (COUNT, 1, 1)),
    "whole numbers": lambda rng: np.round(rng.uniform(-1.6, 1.6, (COUNT, 2, 3))),
    "equal": beside(0.0),
    "opposite": beside(0.0, -3.0),
    "nearly parallel": beside(1e-7, 1e3),
    "parallel but for rounding": beside(1e-15),
    "one is zero": scaled(0.0, 1.0),
    "the other is zero": scaled(1.0, 0.0),
    "both are zero": scaled(0.0, 0.0),
    "one is tiny": scaled(1e-250, 1.0),
    "the other is tiny": scaled(1.0, 1e-250),
    "one is not normal": scaled(1.0, 1e-310),
    "tiny and huge": scaled(1e-300, 1e300),
}


def errors(result: Array, h: Array, mode: Projection) -> Array:
    """Relative to the size of each matrix."""
    difference = np.linalg.norm(result - reference(h, mode), axis=(1, 2))
    return np.asarray(difference / (np.linalg.norm(h, axis=(1, 2)) + 1e-300))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mode", [Projection.CLAMP, Projection.ABS])
def test_agrees_with_numpy(runtime: Runtime, kind: str, mode: Projection) -> None:
    rng = np.random.default_rng(len(kind))
    a = KINDS[kind](rng)
    h = hessians(rng, a)
    changed, result = project(runtime, h, a, mode)
    assert errors(result, h, mode).max() < 2e-14
    assert changed == np.any(result != h, axis=(1, 2)).sum() == (np.linalg.eigvalsh(h)[:, 0] < -1e-11).sum()


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e150, 1e300])
def test_huge_and_tiny(runtime: Runtime, scale: float) -> None:
    rng = np.random.default_rng(3)
    a = rng.standard_normal((COUNT, 2, 3))
    h = hessians(rng, a)
    h /= np.abs(h).max(axis=(1, 2), keepdims=True)
    _, result = project(runtime, h * scale, a)
    np.testing.assert_allclose(result / scale, reference(h, Projection.CLAMP), rtol=0, atol=2e-14)


FAILING = [8] * 6 + [7, 6, 8, 0, 0, 8, 5, 3, 0, 1, 8, 8, 8]
"""Matrices of each pack to be projected: in place or drawn together, unchecked after packs that nearly all failed."""


@pytest.mark.parametrize("mode", [Projection.CLAMP, Projection.ABS])
@pytest.mark.parametrize("left_over", [0, 3])
def test_packs_of_which_many_or_few_fail(runtime: Runtime, mode: Projection, left_over: int) -> None:
    """Semidefinite matrices keep every bit."""
    rng = np.random.default_rng(2)
    failing = np.concatenate([rng.permuted(np.arange(LANES) < count) for count in FAILING])[: -left_over or None]
    a = rng.standard_normal((len(failing), 2, 3))
    h = hessians(rng, a)
    smallest, largest = np.linalg.eigvalsh(h)[:, [0, -1]].T
    h *= np.where(smallest > -1e-3 * largest, -1.0, 1.0)[:, None, None]
    h += np.where(failing, 0.0, -1.01 * np.linalg.eigvalsh(h)[:, 0])[:, None, None] * np.eye(6)
    changed, result = project(runtime, h, a, mode)
    np.testing.assert_array_equal(np.any(result != h, axis=(1, 2)), failing)
    assert changed == failing.sum()
    assert errors(result, h, mode).max() < 2e-14


def test_not_finite_is_reported(runtime: Runtime) -> None:
    rng = np.random.default_rng(4)
    a = rng.standard_normal((COUNT, 2, 3))
    h = hessians(rng, a)
    h[13, 0, 0] = np.nan
    h[17, 1, 4] = h[17, 4, 1] = np.inf
    for mode in Projection:
        assert project(runtime, h, a, mode)[0] == -(1 + 13)
        assert project(runtime, h[:13], a[:13], mode)[0] >= 0, "what lies behind the last matrix is not looked at"


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_without_finite_vectors_projection_is_the_general_one(runtime: Runtime, bad: float) -> None:
    rng = np.random.default_rng(5)
    a = rng.standard_normal((COUNT, 2, 3))
    h = hessians(rng, a)
    a[7:24, 1, 2] = bad
    changed, result = project(runtime, h, a)
    assert errors(result, h, Projection.CLAMP).max() < 2e-14
    assert changed == runtime.project(packed_triangles(h), COUNT)


def test_wrong_arguments_are_refused(runtime: Runtime) -> None:
    with pytest.raises(ValueError, match="needed are"):
        runtime.project_two_vectors(np.zeros((1, 21, 8)), np.zeros((1, 5, 8)), 8)
    with pytest.raises(ValueError, match="needed are"):
        runtime.project_two_vectors(np.zeros((1, 45, 8)), np.zeros((1, 9, 8)), 8)
    with pytest.raises(ValueError, match="C-contiguous float64"):
        # The checker of types would see it, too; callers may not have one.
        runtime.project_two_vectors(np.zeros((1, 21, 8)), np.zeros((1, 6, 8), np.float32), 8)  # type: ignore[arg-type]


@pytest.mark.nightly
@pytest.mark.skipif(platform.machine() != "x86_64", reason="registers of other widths are an x86 matter")
def test_on_narrower_registers(compiler: Compiler) -> None:
    wanted = {"runtime.projection", "runtime.negative_part", "runtime.two_vectors"}
    sources = [source for source in runtime_sources() if source.name in wanted]
    assert len(sources) == len(wanted)
    other = compiler.with_flags("-mno-avx512f", "-O1")
    library = ctypes.CDLL(str(link(compile_sources(sources, other), other, ("-lm",)).path))
    function = library.yasps_project_two_vectors
    function.restype = ctypes.c_long
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.c_int]
    rng = np.random.default_rng(1)
    a = np.concatenate([make(rng) for make in KINDS.values()])
    h = hessians(rng, a)
    packed, vectors = packed_triangles(h), packs(a.reshape(len(a), -1))
    changed = function(packed.ctypes.data, vectors.ctypes.data, 6, len(h), 0)
    result = unpacked(packed, len(h))
    assert errors(result, h, Projection.CLAMP).max() < 2e-14
    assert changed == np.any(result != h, axis=(1, 2)).sum() > len(h) // 2
