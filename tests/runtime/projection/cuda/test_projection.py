"""The device's projection, run on the host, against numpy.linalg.eigh and the CPU's projection."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from cuda_on_host import HostProgram
from device_projection import (
    KERNELS,
    check,
    compare_with_cpu,
    load_projections,
    on_cpu,
    project,
    project_apart,
    projections,
    reference,
)

from yasps.runtime.build.cuda.nvcc import CudaNotFoundError
from yasps.runtime.build.cuda.sources import with_includes
from yasps.runtime.build.cuda.toolchain import build_program, find_cuda
from yasps.runtime.build.toolchain import Source
from yasps.runtime.core.library import Projection, Runtime

Array = np.ndarray
WIDTHS = [*range(1, 25), 96]


@pytest.fixture(scope="module")
def program() -> HostProgram:
    return load_projections()


def random_symmetric(rng: np.random.Generator, n: int, w: int) -> Array:
    a = rng.standard_normal((n, w, w))
    return a + a.swapaxes(1, 2)


def with_eigenvalues(rng: np.random.Generator, values: Array) -> Array:
    """Matrices with these eigenvalues, [n, w], in a random frame; exactly symmetric."""
    n, w = values.shape
    frames = np.linalg.qr(rng.standard_normal((n, w, w)))[0]
    a = (frames * values[:, None, :]) @ frames.swapaxes(1, 2)
    return np.asarray(0.5 * (a + a.swapaxes(1, 2)))


def rank_deficient(rng: np.random.Generator, n: int, w: int) -> Array:
    values = rng.standard_normal((n, w))
    values[:, ::2] = 0
    return with_eigenvalues(rng, values)


def outer_products(rng: np.random.Generator, n: int, w: int) -> Array:
    """Rank one without rounding, as of a distance, and negative."""
    vectors = np.round(rng.uniform(-3, 3, (n, w)))
    return -vectors[:, :, None] * vectors[:, None, :]


def wide_range(rng: np.random.Generator, n: int, w: int) -> Array:
    return with_eigenvalues(rng, rng.choice([-1.0, 1.0], (n, w)) * 10.0 ** rng.uniform(-12, 3, (n, w)))


def few_fail(rng: np.random.Generator, n: int, w: int) -> Array:
    a = with_eigenvalues(rng, rng.uniform(0.5, 1, (n, w)))
    a[::5] = random_symmetric(rng, n, w)[::5]
    return a


def tiny_couplings(rng: np.random.Generator, n: int, w: int) -> Array:
    """Tridiagonal, with off-diagonal entries about the size that counts as zero."""
    a = np.eye(w) * rng.standard_normal((n, 1, w))
    steps = np.arange(w - 1)
    couplings = rng.standard_normal((n, w - 1)) * 10.0 ** rng.uniform(-20, -13, (n, w - 1))
    a[:, steps, steps + 1] = a[:, steps + 1, steps] = couplings
    return a


def decoupled(rng: np.random.Generator, n: int, w: int) -> Array:
    """Blocks that have nothing to do with each other: some sizes zero, all rows and columns shuffled."""
    block = rng.integers(0, 3, (n, w))
    a = random_symmetric(rng, n, w) * (block[:, :, None] == block[:, None, :])
    return np.asarray(a * (block[:, :, None] > 0))


def nearly_equal_eigenvalues(rng: np.random.Generator, n: int, w: int) -> Array:
    """Wilkinson's matrix, shifted: its eigenvalues come in pairs that agree to many digits."""
    half = (w - 1) / 2
    a = np.diag(np.abs(np.arange(w) - half)) + np.eye(w, k=1) + np.eye(w, k=-1)
    return np.asarray(a - rng.uniform(0, half + 1, (n, 1, 1)) * np.eye(w))


KINDS: dict[str, Callable[[np.random.Generator, int, int], Array]] = {
    "random": random_symmetric,
    "rank deficient": rank_deficient,
    "outer products": outer_products,
    "repeated": lambda rng, n, w: with_eigenvalues(rng, rng.choice([-2.0, 1.0], (n, w))),
    "all negative": lambda rng, n, w: with_eigenvalues(rng, -rng.uniform(0.1, 1, (n, w))),
    "wide range": wide_range,
    "diagonal": lambda rng, n, w: np.eye(w) * rng.standard_normal((n, 1, w)),
    "minus identity": lambda rng, n, w: np.tile(-np.eye(w), (n, 1, 1)),
    "few fail": few_fail,
    "tiny couplings": tiny_couplings,
    "decoupled": decoupled,
    "nearly equal": nearly_equal_eigenvalues,
    "zero diagonal": lambda rng, n, w: random_symmetric(rng, n, w) * (1 - np.eye(w)),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mode", [Projection.CLAMP, Projection.ABS])
def test_agrees_with_numpy_and_the_cpu(program: HostProgram, runtime: Runtime, kind: str, mode: Projection) -> None:
    for width in WIDTHS:
        count = 35 if width < 50 else 3
        matrices = KINDS[kind](np.random.default_rng(width), count, width)
        outcome, result = project(program, matrices, mode)
        tolerance = 1e-13 * max(1, np.sqrt(width / 10))
        check(matrices, outcome, result, mode, tolerance)
        compare_with_cpu(matrices, outcome, result, on_cpu(runtime, matrices, mode), tolerance)
        for one, other in zip(project_apart(program, matrices, mode), (outcome, result), strict=True):
            np.testing.assert_array_equal(one, other, "wherever its numbers are")


@pytest.mark.parametrize("width", [2, 3, 4, 6])
def test_repeated_eigenvalues_are_always_found(program: HostProgram, width: int) -> None:
    """Rounding must not keep an off-diagonal entry above what counts as zero."""
    matrices = KINDS["repeated"](np.random.default_rng(width), 5_000, width)
    outcome, result = project(program, matrices, Projection.CLAMP)
    assert outcome.min() == 0
    assert np.abs(result - reference(matrices, Projection.CLAMP)).max() < 2e-14


@pytest.mark.parametrize("width", [1, 2, 3, 4, 6, 9, 12, 24, 31])
@pytest.mark.parametrize("mode", list(Projection))
def test_semidefinite_matrices_keep_every_bit(program: HostProgram, width: int, mode: Projection) -> None:
    rng = np.random.default_rng(width)
    thin = rng.standard_normal((24, width, max(1, width // 3)))
    matrices = thin @ thin.swapaxes(1, 2)
    matrices = 0.5 * (matrices + matrices.swapaxes(1, 2))
    matrices[3] = 0
    matrices[4] = np.eye(width)
    matrices[5] *= 1e-310  # below the normal numbers
    matrices[6] *= 1e-200
    matrices[7] *= 1e200
    outcome, result = project(program, matrices, mode)
    assert (outcome == 0).all()
    assert result.tobytes() == matrices.tobytes()


@pytest.mark.parametrize("width", [1, 2, 3, 4, 6, 9, 13])
@pytest.mark.parametrize("scale", [1e-305, 1e-290, 1e-150, 1e-100, 1e100, 1e150, 1e290, 1e306])
def test_huge_and_tiny_norms(program: HostProgram, scale: float, width: int) -> None:
    matrices = random_symmetric(np.random.default_rng(7), 16, width)
    matrices[:, 0, 0] = -1.0
    outcome, result = project(program, matrices * scale, Projection.CLAMP)
    assert (outcome == 1).all()
    np.testing.assert_allclose(result / scale, reference(matrices, Projection.CLAMP), rtol=0, atol=1e-12)


def test_entries_whose_sum_overflows_are_finite(program: HostProgram) -> None:
    for width in (2, 3, 6, 9):
        signs = np.array([1, -1] * width)[:width]
        matrices = np.stack([np.full((width, width), 1.5e308), 1.5e308 * signs[:, None] * signs])
        outcome, result = project(program, matrices, Projection.CLAMP)
        assert (outcome == 0).all()
        assert result.tobytes() == matrices.tobytes()
        outcome, result = project(program, -matrices / width, Projection.CLAMP)
        assert (outcome == 1).all()
        assert np.abs(result).max() < 1e295


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("mode", list(Projection))
def test_not_finite_is_reported(program: HostProgram, bad: float, mode: Projection) -> None:
    for width in (1, 2, 3, 5, 6, 12, 26):
        matrices = np.tile(np.eye(width), (5, 1, 1))
        matrices[1, width - 1, width - 1] = bad
        matrices[2, 0, width - 1] = bad
        matrices[3] *= -1
        outcome, _ = project(program, matrices, mode)
        np.testing.assert_array_equal(outcome, [0, -1, -1, 0 if mode == Projection.NONE else 1, 0])


def test_leave_changes_nothing(program: HostProgram) -> None:
    for width in (1, 3, 6, 8):
        matrices = random_symmetric(np.random.default_rng(1), 8, width)
        outcome, result = project(program, matrices, Projection.NONE)
        assert (outcome == 0).all()
        np.testing.assert_array_equal(result, matrices)


@pytest.mark.parametrize("arch", ["sm_80", "sm_120"])
def test_threads_need_little_local_memory(arch: str) -> None:
    """Nothing that is held in arrays of constant size is indexed by a variable, and hardly anything spills."""
    try:
        toolchain = find_cuda(arch)
    except CudaNotFoundError as error:
        pytest.skip(str(error))
    program = build_program(toolchain, [], [Source("callers", with_includes(KERNELS)), *projections()])
    rows = {row.name: row for row in program.rows}
    (general,) = [f for f in rows["callers"].functions if f.name == "project_all"]
    (apart,) = [f for f in rows["callers"].functions if f.name == "project_all_apart"]
    assert apart.stack_bytes <= 256, "besides what is in global memory"
    (isotropic,) = [f for f in rows["callers"].functions if f.name == "project_all_isotropic"]
    assert general.stack_bytes <= 160, "besides the work it is given"
    assert isotropic.stack_bytes <= 1200, "of which 792 are work of the general projection"
    for function in rows["projection"].functions:  # addresses of numbers that are apart take registers too
        assert function.spill_bytes <= (350 if "Apart" in function.name else 200)
    assert rows["isotropic"].spill_bytes <= 600
