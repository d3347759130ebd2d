"""Projection by singular values against numpy.linalg.eigh, for Hessians of random isotropic energies."""

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
Kind = Callable[[np.random.Generator, int], Array]


def hessians(rng: np.random.Generator, f: Array) -> Array:
    """Hessians [n, k, k] by the k entries of F [n, 3, 2 or 3] of functions of tr C, tr C^2, det F with C = F^T F.

    First and second derivatives by these invariants are random, so that any isotropic energy could be meant.
    """
    n, rows, cols = f.shape
    width = rows * cols
    directions = np.eye(width).reshape(width, 1, rows, cols)
    c = f.swapaxes(1, 2) @ f
    turned = directions.swapaxes(2, 3)
    gradients = [2 * f, 4 * f @ c]
    along = [
        2 * directions + 0 * f,
        4 * (directions @ c + f @ turned @ f + f @ f.swapaxes(1, 2) @ directions),
    ]
    if cols == 3:
        gradients.append(_cofactors(f, f) / 2)
        along.append(_cofactors(directions + 0 * f, f + 0 * directions))
    first = rng.standard_normal((n, len(along)))
    second = rng.standard_normal((n, len(along), len(along)))
    g = np.stack([gradient.reshape(n, width) for gradient in gradients], axis=1)
    h = np.stack([part.reshape(width, n, width).swapaxes(0, 1) for part in along], axis=1)
    result = np.einsum("nk,nkij->nij", first, h) + np.einsum("nkl,nki,nlj->nij", second, g, g)
    return np.asarray(0.5 * (result + result.swapaxes(1, 2)))


def _cofactors(a: Array, b: Array) -> Array:
    """The symmetric bilinear map that is twice the cofactor matrix for a = b: rows of a x b + b x a."""
    rows = [
        np.cross(a[..., (i + 1) % 3, :], b[..., (i + 2) % 3, :])
        + np.cross(b[..., (i + 1) % 3, :], a[..., (i + 2) % 3, :])
        for i in range(3)
    ]
    return np.stack(rows, axis=-2)


def project(runtime: Runtime, h: Array, f: Array, mode: Projection = Projection.CLAMP) -> tuple[int, Array]:
    """What comes back, and the projected matrices."""
    packed = packed_triangles(h)
    changed = runtime.project_isotropic(packed, packs(f.reshape(len(f), -1)), len(h), mode)
    return changed, unpacked(packed, len(h))


def rotations(rng: np.random.Generator, size: int) -> Array:
    q = np.linalg.qr(rng.standard_normal((COUNT, size, size)))[0]
    q[:, :, 0] *= np.linalg.det(q)[:, None]
    return q


def with_singular_values(*values: float) -> Kind:
    """F with these signed singular values (the last is left out of a 3x2 F) and random rotations."""

    def make(rng: np.random.Generator, cols: int) -> Array:
        middle = np.zeros((3, cols))
        middle[range(cols), range(cols)] = values[:cols]
        return rotations(rng, 3) @ middle @ rotations(rng, cols)

    return make


def whole_numbers(rng: np.random.Generator, cols: int) -> Array:
    """Small integers: many are singular, some are zero, some have columns that are orthogonal or equal."""
    return np.round(rng.uniform(-1.6, 1.6, (COUNT, 3, cols)))


def outer_products(rng: np.random.Generator, cols: int) -> Array:
    """Rank one without rounding."""
    return np.round(rng.uniform(-3, 3, (COUNT, 3, 1))) * np.round(rng.uniform(-3, 3, (COUNT, 1, cols)))


def evenly_spaced(rng: np.random.Generator, cols: int) -> Array:
    """F^T F has the eigenvalues 0, 2 and 4 exactly, of which neither end is farther from the others."""
    f = np.array([[0.0, -1.0, 1.0], [0.0, 1.0, -1.0], [0.0, 1.0, 1.0]])
    left, right = _signed_permutations(rng, 3), _signed_permutations(rng, 3)
    return np.asarray((left @ f @ right)[:, :, :cols])


def _signed_permutations(rng: np.random.Generator, size: int) -> Array:
    order = rng.permuted(np.tile(np.arange(size), (COUNT, 1)), axis=1)
    return np.asarray(np.eye(size)[order] * rng.choice([-1.0, 1.0], (COUNT, 1, size)))


KINDS: dict[str, Kind] = {
    "random": lambda rng, cols: rng.standard_normal((COUNT, 3, cols)),
    "near rest": lambda rng, cols: np.eye(3)[:, :cols] + 1e-3 * rng.standard_normal((COUNT, 3, cols)),
    "rest": lambda rng, cols: np.tile(np.eye(3)[:, :cols], (COUNT, 1, 1)),
    "zero": lambda rng, cols: np.zeros((COUNT, 3, cols)),
    "whole numbers": whole_numbers,
    "outer products": outer_products,
    "rotations": with_singular_values(1.0, 1.0, 1.0),
    "reflections": with_singular_values(1.0, 1.0, -1.0),
    "two equal": with_singular_values(0.5, 2.0, 2.0),
    "two opposite": with_singular_values(3.0, 0.7, -0.7),
    "almost equal": with_singular_values(1.0, 1.0 + 1e-9, 1.0 - 1e-13),
    "inverted": with_singular_values(1.5, 0.8, -0.3),
    "flat": with_singular_values(1.0, 0.7, 0.0),
    "a line": with_singular_values(1.0, 0.0, 0.0),
    "evenly spaced": evenly_spaced,
    "thin": with_singular_values(1.0, 0.03, 0.02),
    "tiny pair": with_singular_values(2.0, 1e-8, -1e-8),
    "graded": with_singular_values(1.0, 1e-6, 1e-12),
    "steeply graded": with_singular_values(1.0, 1e-15, -1e-17),
}


@pytest.mark.parametrize("cols", [3, 2])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mode", [Projection.CLAMP, Projection.ABS])
def test_agrees_with_numpy(runtime: Runtime, kind: str, cols: int, mode: Projection) -> None:
    rng = np.random.default_rng(len(kind))
    f = KINDS[kind](rng, cols)
    h = hessians(rng, f)
    changed, result = project(runtime, h, f, mode)
    norms = np.linalg.norm(h, axis=(1, 2)) + 1e-300
    error = np.linalg.norm(result - reference(h, mode), axis=(1, 2)) / norms
    assert error.max() < 5e-14
    smallest = np.linalg.eigvalsh(h)[:, 0]
    assert changed == np.any(result != h, axis=(1, 2)).sum()
    assert (smallest < -1e-11 * norms).sum() <= changed <= (smallest < 0).sum()
    assert changed > 0


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e-20, 1e20, 1e150, 1e300])
@pytest.mark.parametrize("of", ["F", "H"])
def test_huge_and_tiny(runtime: Runtime, scale: float, of: str) -> None:
    """The frames of F and of 2 F are the same, so the scales of F and H may be chosen apart."""
    rng = np.random.default_rng(3)
    f = rng.standard_normal((COUNT, 3, 3))
    h = hessians(rng, f)
    h /= np.abs(h).max(axis=(1, 2), keepdims=True)
    _, result = project(runtime, h * scale, f) if of == "H" else project(runtime, h, f * scale)
    wanted = reference(h, Projection.CLAMP)
    np.testing.assert_allclose(result / scale if of == "H" else result, wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("cols", [3, 2])
@pytest.mark.parametrize("mode", [Projection.CLAMP, Projection.ABS])
def test_semidefinite_matrices_keep_every_bit(runtime: Runtime, cols: int, mode: Projection) -> None:
    """Also beside others that do not, of which there are few or many in a pack."""
    rng = np.random.default_rng(cols)
    f = rng.standard_normal((COUNT, 3, cols))
    h = hessians(rng, f)
    good = rng.random(COUNT) < np.linspace(0, 1, COUNT)
    lift = np.maximum(0.0, -1.01 * np.linalg.eigvalsh(h)[:, 0])
    h[good] += lift[good, None, None] * np.eye(3 * cols)
    h[0] = 0
    changed, result = project(runtime, h, f, mode)
    kept = np.all(result == h, axis=(1, 2))
    assert kept[good].all()
    assert kept[0]
    assert changed == (~kept).sum() > 5


def hessians_failing(rng: np.random.Generator, f: Array, failing: Array) -> Array:
    """Hessians of which exactly these are indefinite."""
    h = hessians(rng, f)
    smallest, largest = np.linalg.eigvalsh(h)[:, [0, -1]].T
    h *= np.where(smallest > -1e-3 * largest, -1.0, 1.0)[:, None, None]
    lift = np.where(failing, 0.0, -1.01 * np.linalg.eigvalsh(h)[:, 0])
    return np.asarray(h + lift[:, None, None] * np.eye(h.shape[1]))


FAILING = [8] * 6 + [7, 6, 8, 7, 0, 0, 8, 8, 8, 5, 3, 8, 8, 0, 8, 8, 1, 7, 8, 8, 8]
"""Matrices of each pack to be projected: in place or drawn together, unchecked after packs that nearly all failed."""


@pytest.mark.parametrize("cols", [3, 2])
@pytest.mark.parametrize("mode", [Projection.CLAMP, Projection.ABS])
@pytest.mark.parametrize("left_over", [0, 3])
def test_packs_of_which_many_or_few_fail(runtime: Runtime, cols: int, mode: Projection, left_over: int) -> None:
    rng = np.random.default_rng(cols)
    failing = np.concatenate([rng.permuted(np.arange(LANES) < count) for count in FAILING])[: -left_over or None]
    f = rng.standard_normal((len(failing), 3, cols))
    h = hessians_failing(rng, f, failing)
    changed, result = project(runtime, h, f, mode)
    np.testing.assert_array_equal(np.any(result != h, axis=(1, 2)), failing)
    assert changed == failing.sum()
    error = np.linalg.norm(result - reference(h, mode), axis=(1, 2)) / np.linalg.norm(h, axis=(1, 2))
    assert error.max() < 5e-14


@pytest.mark.parametrize("scale_of", ["F", "H"])
@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_unusual_matrices_where_nearly_all_fail(runtime: Runtime, scale_of: str, scale: float) -> None:
    """Sizes near the ends of the number range, also of semidefinite matrices and of their F."""
    rng = np.random.default_rng(8)
    failing = np.arange(10 * LANES) % 9 != 0
    unusual = np.arange(10 * LANES) % 5 == 0
    assert (unusual & ~failing).any()
    f = rng.standard_normal((len(failing), 3, 3))
    h = hessians_failing(rng, f, failing)
    h /= np.abs(h).max(axis=(1, 2), keepdims=True)
    scales = np.where(unusual, scale, 1.0)[:, None, None]
    given = h * scales if scale_of == "H" else h
    changed, result = project(runtime, given, f * scales if scale_of == "F" else f)
    assert changed == failing.sum()
    assert np.all(result[~failing] == given[~failing])
    found = result / scales if scale_of == "H" else result
    np.testing.assert_allclose(found, reference(h, Projection.CLAMP), rtol=0, atol=1e-13)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("index", [0, 5, 8, 43, 79])
def test_first_not_finite_where_nearly_all_fail(runtime: Runtime, bad: float, index: int) -> None:
    rng = np.random.default_rng(7)
    failing = np.arange(12 * LANES) >= 4  # the first pack waits for others
    f = rng.standard_normal((len(failing), 3, 3))
    h = hessians_failing(rng, f, failing)
    h[[index, 80, 88], 2, 2] = bad
    assert project(runtime, h, f)[0] == -(1 + index)


@pytest.mark.parametrize("cols", [3, 2])
def test_not_finite_is_reported(runtime: Runtime, cols: int) -> None:
    rng = np.random.default_rng(4)
    f = rng.standard_normal((COUNT, 3, cols))
    h = hessians(rng, f)
    h[13, 0, 0] = np.nan
    h[17, 1, 1] = np.inf
    for mode in Projection:
        assert project(runtime, h, f, mode)[0] == -(1 + 13)
        assert project(runtime, h[:13], f[:13], mode)[0] >= 0, "what lies behind the last matrix is not looked at"


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_without_a_finite_f_projection_is_the_general_one(runtime: Runtime, bad: float) -> None:
    rng = np.random.default_rng(5)
    f = rng.standard_normal((COUNT, 3, 3))
    h = hessians(rng, f)
    f[7:24, 1, 2] = bad
    changed, result = project(runtime, h, f)
    np.testing.assert_allclose(result, reference(h, Projection.CLAMP), rtol=0, atol=1e-13 * np.abs(h).max())
    assert changed == runtime.project(packed_triangles(h), COUNT)


def test_leave_changes_nothing(runtime: Runtime) -> None:
    rng = np.random.default_rng(6)
    f = rng.standard_normal((COUNT, 3, 3))
    h = hessians(rng, f)
    changed, result = project(runtime, h, f, Projection.NONE)
    assert changed == 0
    np.testing.assert_array_equal(result, h)


def test_wrong_arguments_are_refused(runtime: Runtime) -> None:
    with pytest.raises(ValueError, match="needed are"):
        runtime.project_isotropic(np.zeros((1, 45, 8)), np.zeros((1, 8, 8)), 8)
    with pytest.raises(ValueError, match="needed are"):
        runtime.project_isotropic(np.zeros((1, 10, 8)), np.zeros((1, 4, 8)), 8)
    with pytest.raises(ValueError, match="C-contiguous float64"):
        runtime.project_isotropic(np.zeros((1, 45, 8)), np.zeros((1, 9, 8), np.float32), 8)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="lanes is 9"):
        runtime.project_isotropic(np.zeros((1, 45, 8)), np.zeros((1, 9, 8)), 9)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="registers of other widths are an x86 matter")
@pytest.mark.parametrize("flag", ["-mno-avx512f", "-mno-avx"])
def test_on_narrower_registers(compiler: Compiler, flag: str) -> None:
    wanted = {"runtime.projection", "runtime.negative_part", "runtime.isotropic"}
    sources = [source for source in runtime_sources() if source.name in wanted]
    assert len(sources) == len(wanted)
    other = compiler.with_flags(flag, "-O1")
    library = ctypes.CDLL(str(link(compile_sources(sources, other), other, ("-lm",)).path))
    function = library.yasps_project_isotropic
    function.restype = ctypes.c_long
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.c_int]
    for cols in (3, 2):
        rng = np.random.default_rng(cols)
        f = np.concatenate([KINDS[kind](rng, cols) for kind in KINDS])
        h = hessians(rng, f)
        packed, deformation = packed_triangles(h), packs(f.reshape(len(f), -1))
        changed = function(packed.ctypes.data, deformation.ctypes.data, 3 * cols, len(h), 0)
        result = unpacked(packed, len(h))
        error = np.linalg.norm(result - reference(h, Projection.CLAMP), axis=(1, 2))
        assert (error / (np.linalg.norm(h, axis=(1, 2)) + 1e-300)).max() < 5e-14
        assert changed == np.any(result != h, axis=(1, 2)).sum() > len(h) // 2


def test_sources_are_complete_and_say_where_lines_come_from() -> None:
    (text,) = [source.text for source in runtime_sources() if source.name == "runtime.isotropic"]
    assert '#include "' not in text
    assert "#pragma once" not in text
    for header in ("runtime.h", "semidefinite_check.h", "three_by_three.h", "vectors.h"):
        assert text.count(f'#line 1 "{header}"') == 1
