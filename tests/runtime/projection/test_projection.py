"""Projection onto the positive semidefinite cone, against numpy.linalg.eigh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from packed_matrices import packed_triangles, reference, unpacked

from yasps.runtime.core.library import LANES, Projection, Runtime

WIDTHS = [*range(1, 25), 30, 48]
Matrices = np.ndarray


def random_symmetric(rng: np.random.Generator, n: int, w: int) -> Matrices:
    a = rng.standard_normal((n, w, w))
    return a + a.swapaxes(1, 2)


def with_eigenvalues(rng: np.random.Generator, values: np.ndarray) -> Matrices:
    """Matrices with these eigenvalues, [n, w], in a random frame; exactly symmetric."""
    n, w = values.shape
    frames = np.linalg.qr(rng.standard_normal((n, w, w)))[0]
    a = (frames * values[:, None, :]) @ frames.swapaxes(1, 2)
    return 0.5 * (a + a.swapaxes(1, 2))


def rank_deficient(rng: np.random.Generator, n: int, w: int) -> Matrices:
    values = rng.standard_normal((n, w))
    values[:, ::2] = 0
    return with_eigenvalues(rng, values)


def repeated(rng: np.random.Generator, n: int, w: int) -> Matrices:
    return with_eigenvalues(rng, rng.choice([-2.0, 1.0], (n, w)))


def all_negative(rng: np.random.Generator, n: int, w: int) -> Matrices:
    return with_eigenvalues(rng, -rng.uniform(0.1, 1, (n, w)))


def wide_range(rng: np.random.Generator, n: int, w: int) -> Matrices:
    signs = rng.choice([-1.0, 1.0], (n, w))
    return with_eigenvalues(rng, signs * 10.0 ** rng.uniform(-12, 3, (n, w)))


def graded_diagonal(rng: np.random.Generator, n: int, w: int) -> Matrices:
    """Diagonal matrices, for which all reflections are trivial."""
    return np.eye(w) * rng.standard_normal((n, 1, w))


def mixed(rng: np.random.Generator, n: int, w: int) -> Matrices:
    """Few of the lanes need projection."""
    a = with_eigenvalues(rng, rng.uniform(0.5, 1, (n, w)))
    a[::5] = random_symmetric(rng, n, w)[::5]
    return a


def tiny_couplings(rng: np.random.Generator, n: int, w: int) -> Matrices:
    """Tridiagonal, with off-diagonal entries about the size that counts as zero."""
    a = np.eye(w) * rng.standard_normal((n, 1, w))
    couplings = rng.standard_normal((n, w - 1)) * 10.0 ** rng.uniform(-20, -13, (n, w - 1))
    steps = np.arange(w - 1)
    a[:, steps, steps + 1] = a[:, steps + 1, steps] = couplings
    return a


def decoupled(rng: np.random.Generator, n: int, w: int) -> Matrices:
    """Blocks that have nothing to do with each other: some sizes zero, all rows and columns shuffled."""
    a = random_symmetric(rng, n, w)
    block = rng.integers(0, 3, (n, w))
    a *= block[:, :, None] == block[:, None, :]
    return a * (block[:, :, None] > 0)


def nearly_equal_eigenvalues(rng: np.random.Generator, n: int, w: int) -> Matrices:
    """Wilkinson's matrix, shifted: its eigenvalues come in pairs that agree to many digits."""
    half = (w - 1) / 2
    a = np.diag(np.abs(np.arange(w) - half)) + np.eye(w, k=1) + np.eye(w, k=-1)
    return a - rng.uniform(0, half + 1, (n, 1, 1)) * np.eye(w)


def zero_diagonal(rng: np.random.Generator, n: int, w: int) -> Matrices:
    return random_symmetric(rng, n, w) * (1 - np.eye(w))


KINDS: list[Callable[[np.random.Generator, int, int], Matrices]] = [
    random_symmetric,
    rank_deficient,
    repeated,
    all_negative,
    wide_range,
    graded_diagonal,
    mixed,
    tiny_couplings,
    decoupled,
    nearly_equal_eigenvalues,
    zero_diagonal,
]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: str(kind.__name__))
@pytest.mark.parametrize("mode", [Projection.CLAMP, Projection.ABS])
def test_agrees_with_numpy(runtime: Runtime, kind: Callable[..., Matrices], mode: Projection) -> None:
    for width in WIDTHS:
        rng = np.random.default_rng(width)
        matrices = kind(rng, 21, width)
        packed = packed_triangles(matrices)
        changed = runtime.project(packed, 21, mode)
        result = unpacked(packed, 21)
        norms = np.linalg.norm(matrices, axis=(1, 2)) + 1e-300
        # Eigenvalues down to -1e-13 of the diagonal's sum may be left alone, on top of rounding.
        error = np.linalg.norm(result - reference(matrices, mode), axis=(1, 2)) / norms
        assert error.max() < 1e-13 * max(1, np.sqrt(width)), (width, error.max())
        smallest = np.linalg.eigvalsh(matrices)[:, 0]
        assert changed == np.any(result != matrices, axis=(1, 2)).sum()
        assert changed <= (smallest < 0).sum()
        assert changed >= (smallest < -1e-11 * norms).sum()
        assert (np.linalg.eigvalsh(result)[:, 0] > -2e-13 * np.sqrt(width) * norms).all()


@pytest.mark.parametrize("width", [1, 2, 3, 6, 9, 12, 14, 24])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.4, 0.9])
def test_many_packs_of_which_some_matrices_fail(runtime: Runtime, width: int, share: float) -> None:
    """Those that fail are gathered from all packs, and come back to where they were."""
    rng = np.random.default_rng(width)
    count = 203
    matrices = with_eigenvalues(rng, rng.uniform(0.5, 1, (count, width)))
    failing = rng.random(count) < share
    matrices[failing] -= rng.uniform(0.6, 2, (failing.sum(), 1, 1)) * np.eye(width)
    failing = np.linalg.eigvalsh(matrices)[:, 0] < 0
    packed = packed_triangles(matrices)
    assert runtime.project(packed, count) == failing.sum()
    result = unpacked(packed, count)
    np.testing.assert_array_equal(result[~failing], matrices[~failing])
    np.testing.assert_allclose(result, reference(matrices, Projection.CLAMP), rtol=0, atol=5e-15 * np.sqrt(width))
    assert np.isnan(packed[-1, :, count % LANES :]).all(), "what lies behind the last matrix is left alone"


@pytest.mark.parametrize("width", [4, 6])
def test_repeated_eigenvalues_are_always_found(runtime: Runtime, width: int) -> None:
    """Rounding must not keep an off-diagonal entry above what counts as zero; it did in one of 5,000 matrices."""
    matrices = repeated(np.random.default_rng(width), 20_000, width)
    packed = packed_triangles(matrices)
    assert runtime.project(packed, len(matrices)) > 0
    error = np.abs(unpacked(packed, len(matrices)) - reference(matrices, Projection.CLAMP))
    assert error.max() < 1e-14


def test_any_number_of_failing_matrices(runtime: Runtime) -> None:
    rng = np.random.default_rng(3)
    matrices = random_symmetric(rng, 50, 4) - 9 * np.eye(4)
    expected = reference(matrices, Projection.ABS)
    for count in range(51):
        packed = packed_triangles(matrices[:count])
        assert runtime.project(packed, count, Projection.ABS) == count
        np.testing.assert_allclose(unpacked(packed, count), expected[:count], rtol=0, atol=1e-13)


@pytest.mark.parametrize("width", [1, 3, 9, 12, 24, 31])
def test_semidefinite_matrices_keep_every_bit(runtime: Runtime, width: int) -> None:
    rng = np.random.default_rng(width)
    thin = rng.standard_normal((24, width, max(1, width // 3)))
    matrices = thin @ thin.swapaxes(1, 2)
    matrices = 0.5 * (matrices + matrices.swapaxes(1, 2))
    matrices[3] = 0
    matrices[4] = np.eye(width)
    matrices[5] *= 1e-310  # below the normal numbers
    matrices[6] *= 1e-200
    matrices[7] *= 1e200
    packed = packed_triangles(matrices)
    before = packed.copy()
    assert runtime.project(packed, 24, Projection.CLAMP) == 0
    assert packed.tobytes() == before.tobytes()
    assert runtime.project(packed, 24, Projection.ABS) == 0
    assert packed.tobytes() == before.tobytes()


def test_lanes_that_pass_keep_every_bit_next_to_one_that_fails(runtime: Runtime) -> None:
    rng = np.random.default_rng(0)
    matrices = with_eigenvalues(rng, rng.uniform(0.5, 1, (8, 9)))
    matrices[2] = -matrices[2]
    packed = packed_triangles(matrices)
    before = packed.copy()
    assert runtime.project(packed, 8) == 1
    keep = [lane for lane in range(8) if lane != 2]
    np.testing.assert_array_equal(packed[:, :, keep], before[:, :, keep])
    assert np.abs(packed[:, :, 2]).max() < 1e-13


@pytest.mark.parametrize("scale", [1e-305, 1e-290, 1e-160, 1e-100, 1e100, 1e160, 1e290, 1e306])
def test_huge_and_tiny_norms(runtime: Runtime, scale: float) -> None:
    rng = np.random.default_rng(7)
    matrices = random_symmetric(rng, 16, 9)
    packed = packed_triangles(matrices * scale)
    assert runtime.project(packed, 16) == 16
    np.testing.assert_allclose(unpacked(packed, 16) / scale, reference(matrices, Projection.CLAMP), rtol=0, atol=1e-12)


def test_lanes_of_very_different_size(runtime: Runtime) -> None:
    rng = np.random.default_rng(8)
    matrices = random_symmetric(rng, 8, 6)
    scales = 10.0 ** np.array([-300, -150, -20, 0, 20, 150, 300, 0])
    packed = packed_triangles(matrices * scales[:, None, None])
    runtime.project(packed, 8)
    result = unpacked(packed, 8) / scales[:, None, None]
    np.testing.assert_allclose(result, reference(matrices, Projection.CLAMP), rtol=0, atol=1e-13 * 30)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("mode", list(Projection))
@pytest.mark.parametrize("width", [1, 5, 26])
def test_not_finite_is_reported(runtime: Runtime, bad: float, mode: Projection, width: int) -> None:
    matrices = np.tile(np.eye(width), (19, 1, 1))
    matrices[13, width - 1, width - 1] = bad
    matrices[17, 0, 0] = bad
    assert runtime.project(packed_triangles(matrices), 19, mode) == -(1 + 13)
    assert runtime.project(packed_triangles(matrices), 13, mode) == 0, (
        "what lies behind the last matrix is not looked at"
    )


@pytest.mark.parametrize("mode", list(Projection))
def test_not_finite_is_reported_among_matrices_that_fail(runtime: Runtime, mode: Projection) -> None:
    rng = np.random.default_rng(5)
    matrices = random_symmetric(rng, 60, 6)
    for lane in (0, 7, 8, 22, 59):
        spoilt = matrices.copy()
        spoilt[lane, 2, 4] = spoilt[lane, 4, 2] = np.nan
        assert runtime.project(packed_triangles(spoilt), 60, mode) == -(1 + lane)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("mode", list(Projection))
def test_not_finite_is_reported_at_every_entry(runtime: Runtime, bad: float, mode: Projection) -> None:
    for row, col in zip(*np.triu_indices(6), strict=True):
        matrices = np.tile(np.eye(6), (11, 1, 1))
        matrices[9, row, col] = matrices[9, col, row] = bad
        assert runtime.project(packed_triangles(matrices), 11, mode) == -(1 + 9)


@pytest.mark.parametrize("scale", [1e-305, 1e-200, 1e-100, 1.0, 1e100, 1e300])
def test_without_a_diagonal_of_any_size(runtime: Runtime, scale: float) -> None:
    """The shift of the check is a share of the trace, which is nothing here."""
    matrices = zero_diagonal(np.random.default_rng(9), 16, 9)
    packed = packed_triangles(matrices * scale)
    assert runtime.project(packed, 16) == 16
    np.testing.assert_allclose(unpacked(packed, 16) / scale, reference(matrices, Projection.CLAMP), rtol=0, atol=1e-12)


def test_entries_whose_sum_overflows_are_finite(runtime: Runtime) -> None:
    matrices = np.tile(np.full((6, 6), 1.5e308), (8, 1, 1))
    matrices[1:] *= np.array([1, -1] * 3)[:, None] * np.array([1, -1] * 3)
    packed = packed_triangles(matrices)
    before = packed.copy()
    assert runtime.project(packed, 8) == 0
    assert packed.tobytes() == before.tobytes()


def test_leave_changes_nothing(runtime: Runtime) -> None:
    matrices = random_symmetric(np.random.default_rng(1), 8, 6)
    packed = packed_triangles(matrices)
    assert runtime.project(packed, 8, Projection.NONE) == 0
    np.testing.assert_array_equal(unpacked(packed, 8), matrices)


def test_wrong_arguments_are_refused(runtime: Runtime) -> None:
    with pytest.raises(ValueError, match="need shape"):
        runtime.project(np.zeros((1, 5, 8)), 8)
    with pytest.raises(ValueError, match="need shape"):
        runtime.project(np.zeros((6, 8)), 8)
    with pytest.raises(ValueError, match="C-contiguous float64"):
        runtime.project(np.zeros((1, 6, 8), np.float32), 8)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="lanes is 9"):
        runtime.project(np.zeros((1, 6, 8)), 9)
