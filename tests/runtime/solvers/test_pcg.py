"""Conjugate gradients against SciPy, and every way a solve can end."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, StopReason

THREADS = (1, 2)
jacobi = partial(SolveOptions, preconditioner="jacobi")
"""Options of what is tested here."""


def block_jacobi(dense: np.ndarray, scene: Any) -> np.ndarray:
    """The preconditioner M of a dense matrix."""
    m = np.zeros_like(dense)
    for t, q in enumerate(scene.block_sizes.tolist()):
        for start in range(int(scene.boundaries[t]), int(scene.boundaries[t + 1]), q):
            m[start : start + q, start : start + q] = dense[start : start + q, start : start + q]
    return m


def make_definite(scene: Any, parts: list[BlockMatrix], seed: int = 0) -> np.ndarray:
    """Random values in all parts whose sum is positive definite; returns the dense sum."""
    rng = np.random.default_rng(seed)
    for part in parts:
        part.values[:] = rng.standard_normal(part.values.size)
        for group in part.groups:
            diagonal = group.rows == group.cols
            if group.r == group.c:
                group.values[diagonal] += group.values[diagonal].transpose(0, 2, 1)
    dense = sum(part.to_scipy().toarray() for part in parts)
    assert isinstance(dense, np.ndarray)
    for group in parts[0].groups:
        for block in np.flatnonzero(group.rows == group.cols):
            rows = slice(group.rows[block], group.rows[block] + group.r)
            group.values[block] += np.diag(np.abs(dense[rows]).sum(1) + 0.1)
    dense = sum(part.to_scipy().toarray() for part in parts)
    assert np.linalg.eigvalsh(dense)[0] > 0
    return dense


def two_parts(runtime: Runtime, scene: Any) -> list[BlockMatrix]:
    """A static part with all diagonal blocks and a dynamic one without."""
    parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
    parts[0].build(scene.boundaries, scene.block_sizes, scene.kappas[:2])
    parts[1].build(scene.boundaries, scene.block_sizes, scene.kappas[2:])
    return parts


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("warm", [False, True])
def test_solves_sum_of_parts(runtime: Runtime, scene: Any, threads: int, warm: bool) -> None:
    parts = two_parts(runtime, scene)
    dense = make_definite(scene, parts)
    rng = np.random.default_rng(1)
    g = rng.standard_normal(scene.size)
    x0 = rng.standard_normal(scene.size) if warm else None
    x, report = PcgSolver(runtime).solve(parts, g, jacobi(1e-28, 500, history=True), x0, threads=threads)
    assert report.reason is StopReason.CONVERGED
    assert report.converged
    np.testing.assert_allclose(x, np.linalg.solve(dense, g), rtol=1e-10, atol=1e-12)
    assert report.history is not None
    assert len(report.history) == report.iterations + 1
    assert report.history[-1] == report.relative_squared_residual <= 1e-28
    assert min(report.history[:-1]) > 1e-28
    if warm:
        m = block_jacobi(dense, scene)
        assert x0 is not None
        r = g - dense @ x0
        expected = r @ np.linalg.solve(m, r) / (g @ np.linalg.solve(m, g))
        assert report.history[0] == pytest.approx(expected, rel=1e-10)
    else:
        assert report.history[0] == pytest.approx(1, abs=1e-14)


@pytest.mark.parametrize("threads", THREADS)
def test_residuals_are_those_of_textbook_pcg(runtime: Runtime, scene: Any, threads: int) -> None:
    parts = two_parts(runtime, scene)
    dense = make_definite(scene, parts, seed=2)
    m = block_jacobi(dense, scene)
    g = np.random.default_rng(2).standard_normal(scene.size)
    x, r = np.zeros_like(g), g.copy()
    z = np.linalg.solve(m, r)
    p, rz = z.copy(), r @ z
    expected = [1.0]
    for _ in range(5):
        q = dense @ p
        alpha = rz / (p @ q)
        x, r = x + alpha * p, r - alpha * q
        z = np.linalg.solve(m, r)
        p, rz = z + (r @ z) / rz * p, r @ z
        expected.append(rz / (g @ np.linalg.solve(m, g)))
    options = jacobi(0.0, 5, history=True)
    got, report = PcgSolver(runtime).solve(parts, g, options, threads=threads)
    assert report.reason is StopReason.MAX_ITERATIONS
    assert report.iterations == 5
    np.testing.assert_allclose(got, x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(report.history, expected, rtol=1e-8)
    assert "max iterations after 5 iterations" in str(report)


def test_same_bits_every_time(runtime: Runtime, scene: Any) -> None:
    parts = two_parts(runtime, scene)
    make_definite(scene, parts)
    g = np.random.default_rng(3).standard_normal(scene.size)
    solver = PcgSolver(runtime)
    first, report = solver.solve(parts, g, jacobi(1e-20), threads=2)
    for _ in range(3):
        x, again = solver.solve(parts, g, jacobi(1e-20), threads=2)
        np.testing.assert_array_equal(x, first)
        assert again == report


def test_zero_gradient_gives_zero(runtime: Runtime, scene: Any) -> None:
    parts = two_parts(runtime, scene)  # all values zero: H is singular, and still x = 0 solves H x = 0
    x, report = PcgSolver(runtime).solve(parts, np.zeros(scene.size), x0=np.ones(scene.size))
    assert not x.any()
    assert report.reason is StopReason.CONVERGED
    assert report.iterations == 0
    assert report.relative_squared_residual == 0


def test_exact_start_needs_no_iteration(runtime: Runtime, scene: Any) -> None:
    parts = two_parts(runtime, scene)
    dense = make_definite(scene, parts)
    x0 = np.random.default_rng(0).standard_normal(scene.size)
    x, report = PcgSolver(runtime).solve(parts, dense @ x0, jacobi(1e-20), x0=x0)
    assert report.iterations == 0
    assert report.converged
    np.testing.assert_array_equal(x, x0)


def test_block_diagonal_system_takes_one_iteration(runtime: Runtime) -> None:
    """As the paper says of scenes with nothing but affine bodies."""
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 24, 33]), np.array([12, 9], np.int32), [])
    rng = np.random.default_rng(0)
    for group in matrix.groups:
        a = rng.standard_normal(group.values.shape)
        group.values[:] = a @ a.transpose(0, 2, 1) + 0.1 * np.eye(group.r)
    g = rng.standard_normal(33)
    x, report = PcgSolver(runtime).solve([matrix], g, jacobi(1e-24))
    assert report.iterations == 1
    np.testing.assert_allclose(matrix.to_scipy() @ x, g, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan, np.inf])
def test_bad_diagonal_block_is_named(runtime: Runtime, scene: Any, threads: int, value: float) -> None:
    parts = two_parts(runtime, scene)
    make_definite(scene, parts)
    group = parts[0].groups[-1] if parts[0].groups[-1].r == parts[0].groups[-1].c else parts[0].groups[0]
    block = int(np.flatnonzero(group.rows == group.cols)[1])
    start = int(group.rows[block])
    for other in parts[1].groups:  # so that only the static part has a say
        other.values[other.rows == start] = 0
        other.values[other.cols == start] = 0
    group.values[block] = np.eye(group.r)
    group.values[block, group.r - 1, group.r - 1] = value
    x, report = PcgSolver(runtime).solve(parts, np.ones(scene.size), x0=np.full(scene.size, 2.0), threads=threads)
    finite = bool(np.isfinite(value))
    assert report.reason is (StopReason.NOT_POSITIVE_DEFINITE if finite else StopReason.NOT_FINITE)
    assert report.block == start
    assert f"dof block at scalar {start}" in str(report)
    assert np.isnan(report.relative_squared_residual)
    np.testing.assert_array_equal(x, 2.0)


def test_singular_block_is_not_mistaken_for_a_definite_one(runtime: Runtime) -> None:
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 3]), np.array([3], np.int32), [])
    v = np.array([0.3, 0.7, 0.9])
    matrix.groups[0].values[0] = np.eye(3) - np.outer(v, v) / (v @ v)
    report = PcgSolver(runtime).solve([matrix], np.ones(3))[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE


def test_missing_diagonal_block_is_named(runtime: Runtime) -> None:
    matrix = BlockMatrix(runtime, with_diagonal=False)
    matrix.build(np.array([0, 6]), np.array([3], np.int32), [np.array([[1]], np.int32)])
    matrix.groups[0].values[0] = np.eye(3)
    report = PcgSolver(runtime).solve([matrix], np.ones(6))[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    assert report.block == 3


@pytest.mark.parametrize("threads", THREADS)
def test_indefinite_matrix_with_definite_diagonal_blocks(runtime: Runtime, threads: int) -> None:
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 2]), np.array([1], np.int32), [np.array([[1, 2]], np.int32)])
    np.testing.assert_array_equal(matrix.groups[0].cols, [0, 1, 1])
    matrix.values[:] = [1, 2, 1]
    report = PcgSolver(runtime).solve([matrix], np.array([1.0, -1.0]), threads=threads)[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    assert report.block is None


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite_numbers(runtime: Runtime, bad: float) -> None:
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 2]), np.array([1], np.int32), [np.array([[1, 2]], np.int32)])
    matrix.values[:] = [2, 1, 2]
    solver = PcgSolver(runtime)
    assert solver.solve([matrix], np.array([1.0, bad]))[1].reason is StopReason.NOT_FINITE
    x0 = np.array([0.0, bad])
    assert solver.solve([matrix], np.array([1.0, 1.0]), x0=x0)[1].reason is StopReason.NOT_FINITE
    matrix.values[1] = bad
    report = solver.solve([matrix], np.array([1.0, 1.0]))[1]
    assert report.reason is StopReason.NOT_FINITE
    assert report.block is None


def test_solver_survives_failures_and_changing_sizes(runtime: Runtime, scene: Any) -> None:
    """Its memory is reused; nothing of a failed or larger system may leak into the next."""
    solver = PcgSolver(runtime)
    parts = two_parts(runtime, scene)
    dense = make_definite(scene, parts)
    g = np.random.default_rng(1).standard_normal(scene.size)
    expected = np.linalg.solve(dense, g)
    small = BlockMatrix(runtime)
    small.build(np.array([0, 2]), np.array([1], np.int32), [np.array([[1, 2]], np.int32)])
    for values in ([1, 2, 1], [2, np.nan, 2], [2, 1, 2]):
        small.values[:] = values
        solver.solve([small], np.array([1.0, -1.0]), threads=2)
        np.testing.assert_allclose(
            solver.solve(parts, g, jacobi(1e-28), threads=2)[0], expected, rtol=1e-10, atol=1e-12
        )


def test_empty_system(runtime: Runtime) -> None:
    x, report = PcgSolver(runtime).solve([BlockMatrix(runtime)], np.zeros(0))
    assert x.shape == (0,)
    assert report.converged


def test_wrong_arguments_are_refused(runtime: Runtime, scene: Any) -> None:
    solver = PcgSolver(runtime)
    parts = two_parts(runtime, scene)
    g = np.zeros(scene.size)
    with pytest.raises(ValueError, match="parts is empty"):
        solver.solve([], g)
    with pytest.raises(ValueError, match="built for other targets"):
        solver.solve([parts[0], BlockMatrix(runtime)], g)
    with pytest.raises(ValueError, match="g has shape"):
        solver.solve(parts, np.zeros(scene.size + 1))
    with pytest.raises(ValueError, match="x0 has shape"):
        solver.solve(parts, g, x0=np.zeros(1))
