"""Direct solvers against dense algebra, what they keep, and every way a factorisation can end."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers import direct as direct_solver
from yasps.runtime.solvers.direct import DirectSolver, UpperSum, available_libraries, load_library
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import StopReason


@pytest.fixture(params=available_libraries())
def solver(runtime: Runtime, request: pytest.FixtureRequest) -> DirectSolver:
    """A solver with each library that is installed."""
    return DirectSolver(runtime, request.param)


def random_parts(runtime: Runtime, scene: Any, seed: int = 0, shift: float = 0.1) -> tuple[list[BlockMatrix], Any]:
    """A static and a dynamic part with random values, and their dense sum, positive definite for a positive shift."""
    parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
    parts[0].build(scene.boundaries, scene.block_sizes, scene.kappas[:2])
    parts[1].build(scene.boundaries, scene.block_sizes, scene.kappas[2:])
    return parts, refill(parts, seed, shift)


def refill(parts: list[BlockMatrix], seed: int, shift: float = 0.1) -> Any:
    """New random values; the dense sum."""
    rng = np.random.default_rng(seed)
    for part in parts:
        part.values[:] = rng.standard_normal(part.values.size)
        for group in part.groups:
            diagonal = group.rows == group.cols
            if group.r == group.c:
                group.values[diagonal] += group.values[diagonal].transpose(0, 2, 1)
    dense = sum(part.to_scipy().toarray() for part in parts)
    for group in parts[0].groups:
        for block in np.flatnonzero(group.rows == group.cols):
            rows = slice(group.rows[block], group.rows[block] + group.r)
            group.values[block] += np.diag(np.abs(dense[rows]).sum(1) + shift)
    return sum(part.to_scipy().toarray() for part in parts)


def test_solves_sum_of_parts(runtime: Runtime, scene: Any, solver: DirectSolver) -> None:
    parts, dense = random_parts(runtime, scene)
    g = np.random.default_rng(1).standard_normal(scene.size)
    for threads in (1, 2):
        x, report = solver.solve(parts, g, SolveOptions(1e-20), threads=threads)
        np.testing.assert_allclose(x, np.linalg.solve(dense, g), rtol=1e-10, atol=1e-12)
        assert report.converged
        assert report.direct
        assert report.relative_squared_residual <= 1e-20
        assert solver.name in str(report)


def test_upper_sum_is_the_upper_triangle(runtime: Runtime, scene: Any) -> None:
    parts, dense = random_parts(runtime, scene)
    upper = UpperSum()
    assert not upper.describes(parts)
    upper.follow(parts)
    matrix = upper.add(parts)
    np.testing.assert_allclose(matrix.toarray(), np.triu(dense), rtol=0, atol=1e-13)
    assert matrix.has_sorted_indices
    for row in range(scene.size):
        assert matrix.indices[matrix.indptr[row]] == row  # the diagonal first, stored even where it is zero
    assert upper.describes(parts)


def test_analysis_is_kept_while_the_sparsity_is_the_same(runtime: Runtime, scene: Any, solver: DirectSolver) -> None:
    parts, dense = random_parts(runtime, scene)
    g = np.random.default_rng(1).standard_normal(scene.size)
    for seed in range(3):
        dense = refill(parts, seed)
        np.testing.assert_allclose(solver.solve(parts, g)[0], np.linalg.solve(dense, g), rtol=1e-9, atol=1e-12)
    assert solver.analyses == 1
    parts[1].build(scene.boundaries, scene.block_sizes, [])
    dense = refill(parts, 4)
    np.testing.assert_allclose(solver.solve(parts, g)[0], np.linalg.solve(dense, g), rtol=1e-9, atol=1e-12)
    assert solver.analyses == 2


def test_same_bits_every_time(runtime: Runtime, scene: Any, solver: DirectSolver) -> None:
    parts, _ = random_parts(runtime, scene)
    g = np.random.default_rng(3).standard_normal(scene.size)
    first, report = solver.solve(parts, g, threads=1)
    for _ in range(3):
        x, again = solver.solve(parts, g, threads=1)
        np.testing.assert_array_equal(x, first)
        assert again == report


def test_indefinite_matrix_names_a_block(runtime: Runtime, scene: Any, solver: DirectSolver) -> None:
    parts, _ = random_parts(runtime, scene)
    group = next(group for group in parts[0].groups if group.r == group.c)
    block = int(np.flatnonzero(group.rows == group.cols)[1])
    group.values[block] -= 1e3 * np.eye(group.r)
    x, report = solver.solve(parts, np.ones(scene.size))
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    assert report.block == group.rows[block]
    assert not x.any()
    refill(parts, 0)
    assert solver.solve(parts, np.ones(scene.size))[1].converged  # a failure leaves nothing behind


def test_indefinite_matrix_with_definite_diagonal_blocks(runtime: Runtime, solver: DirectSolver) -> None:
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 2]), np.array([1], np.int32), [np.array([[1, 2]], np.int32)])
    matrix.values[:] = [1, 2, 1]
    report = solver.solve([matrix], np.array([1.0, -1.0]))[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    assert report.block in (0, 1)


def test_zero_matrix_is_not_positive_definite(runtime: Runtime, scene: Any, solver: DirectSolver) -> None:
    parts, _ = random_parts(runtime, scene)
    for part in parts:
        part.values[:] = 0
    assert solver.solve(parts, np.ones(scene.size))[1].reason is StopReason.NOT_POSITIVE_DEFINITE


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite_numbers(runtime: Runtime, scene: Any, solver: DirectSolver, bad: float) -> None:
    parts, _ = random_parts(runtime, scene)
    g = np.ones(scene.size)
    g[1] = bad
    assert solver.solve(parts, g)[1].reason is StopReason.NOT_FINITE
    parts[0].values[0] = bad
    assert solver.solve(parts, np.ones(scene.size))[1].reason is StopReason.NOT_FINITE


def test_empty_system_and_wrong_arguments(runtime: Runtime, scene: Any, solver: DirectSolver) -> None:
    assert solver.solve([BlockMatrix(runtime)], np.zeros(0))[1].converged
    parts, _ = random_parts(runtime, scene)
    with pytest.raises(ValueError, match="parts is empty"):
        solver.solve([], np.zeros(scene.size))
    with pytest.raises(ValueError, match="built for other targets"):
        solver.solve([parts[0], BlockMatrix(runtime)], np.zeros(scene.size))
    with pytest.raises(ValueError, match="g has shape"):
        solver.solve(parts, np.zeros(scene.size + 1))
    with pytest.raises(ValueError, match=r"no factorisation 'lu'.*superlu"):
        load_library("lu")


def test_a_grid_of_springs_is_solved_to_rounding(runtime: Runtime, solver: DirectSolver) -> None:
    """Large enough for supernodes and for more than one thread."""
    n = 14
    ids = np.arange(n**3).reshape(n, n, n)
    edges = np.concatenate(
        [np.stack([np.delete(ids, -1, axis).ravel(), np.delete(ids, 0, axis).ravel()], 1) for axis in range(3)]
    )
    matrix = BlockMatrix(runtime)
    kappa = (3 * edges + 1).astype(np.int32)
    matrix.build(np.array([0, 3 * n**3]), np.array([3], np.int32), [kappa])
    group = matrix.groups[0]
    diagonal = group.rows == group.cols
    group.values[~diagonal] = -np.eye(3)
    degree = np.bincount(edges.ravel(), minlength=n**3)
    group.values[diagonal] = (degree[group.rows[diagonal] // 3] + 1e-6)[:, None, None] * np.eye(3)
    g = np.random.default_rng(0).standard_normal(3 * n**3)
    (name,) = [name for name, library in direct_solver.LIBRARIES.items() if library == solver.name]
    solver = DirectSolver(runtime, name, deterministic=True)
    x, report = solver.solve([matrix], g, SolveOptions(1e-18), threads=2)
    assert report.converged
    assert np.abs(matrix.to_scipy() @ x - g).max() <= 1e-8 * np.abs(x).max()
    assert isinstance(matrix.to_scipy(), sparse.csr_array)
    # The same bits for any number of threads, by a solver of its own each time.
    for threads in (1, 2, 3, 2, 2):
        other = DirectSolver(runtime, name, deterministic=True)
        np.testing.assert_array_equal(other.solve([matrix], g, SolveOptions(1e-18), threads=threads)[0], x)


def test_the_slow_library_says_so(
    runtime: Runtime, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(direct_solver, "available_libraries", lambda: ["superlu"])
    with caplog.at_level(logging.WARNING, "yasps"):
        DirectSolver(runtime)
    assert "yasps[direct]" in caplog.text
