"""Results that are the same bit for bit whatever the number of threads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from yasps.runtime.core.library import DETERMINISTIC_PIECES, Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver

THREADS = (1, 2, 3, 7, DETERMINISTIC_PIECES + 3)


def grid(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Boundaries and kappa of the squares of a grid with one block of 3 on each vertex: rows that span pieces."""
    vertices = np.arange(side * side).reshape(side, side)
    corners = [vertices[:-1, :-1], vertices[1:, :-1], vertices[:-1, 1:], vertices[1:, 1:]]
    return np.array([0, 3 * side * side]), (3 * np.stack(corners, -1).reshape(-1, 4) + 1).astype(np.int32)


@pytest.fixture
def matrix(runtime: Runtime) -> BlockMatrix:
    """A positive definite matrix of 400 dof blocks."""
    boundaries, kappa = grid(20)
    made = BlockMatrix(runtime)
    made.build(boundaries, np.array([3], np.int32), [kappa])
    made.values[:] = np.random.default_rng(0).standard_normal(made.values.size)
    group = made.groups[0]
    diagonal = group.rows == group.cols
    group.values[diagonal] += group.values[diagonal].transpose(0, 2, 1) + 40 * np.eye(3)
    return made


def test_product(runtime: Runtime, matrix: BlockMatrix) -> None:
    x = np.random.default_rng(1).standard_normal(matrix.size)
    results = {matrix.multiply(x, threads, deterministic=True).tobytes() for threads in THREADS}
    assert len(results) == 1
    np.testing.assert_allclose(np.frombuffer(results.pop()), matrix.to_scipy() @ x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("warm", [False, True])
def test_solution(runtime: Runtime, matrix: BlockMatrix, warm: bool) -> None:
    rng = np.random.default_rng(2)
    g = rng.standard_normal(matrix.size)
    start = rng.standard_normal(matrix.size) if warm else None
    solver = PcgSolver(runtime, deterministic=True)
    results = [
        solver.solve([matrix], g, SolveOptions(1e-20, history=True), x0=start, threads=threads) for threads in THREADS
    ]
    x, report = results[0]
    np.testing.assert_allclose(matrix.to_scipy() @ x, g, rtol=1e-8, atol=1e-8)
    for other, other_report in results[1:]:
        np.testing.assert_array_equal(other, x)
        assert other_report == report


def test_more_threads_than_unknowns(runtime: Runtime) -> None:
    tiny = BlockMatrix(runtime)
    tiny.build(np.array([0, 2]), np.array([1], np.int32), [np.array([[1, 2]], np.int32)])
    tiny.values[:] = [2, 1, 3]
    for deterministic in (False, True):
        np.testing.assert_array_equal(tiny.multiply(np.array([1.0, 10.0]), 6, deterministic=deterministic), [12, 31])
        x, report = PcgSolver(runtime, deterministic=deterministic).solve(
            [tiny], np.array([12.0, 31.0]), SolveOptions(1e-28), threads=6
        )
        assert report.converged
        np.testing.assert_allclose(x, [1, 10], rtol=1e-12)


def test_pieces_share_the_work(runtime: Runtime, scene: Any) -> None:
    """Every number of pieces gives the same product up to rounding, also when rows are few and long."""
    made = BlockMatrix(runtime)
    made.build(scene.boundaries, scene.block_sizes, scene.kappas)
    made.values[:] = np.random.default_rng(0).standard_normal(made.values.size)
    for group in made.groups:
        if group.r == group.c:
            diagonal = group.rows == group.cols
            group.values[diagonal] += group.values[diagonal].transpose(0, 2, 1)
    x = np.random.default_rng(1).standard_normal(scene.size)
    expected = made.to_scipy() @ x
    for threads in range(1, 12):
        np.testing.assert_allclose(made.multiply(x, threads), expected, rtol=1e-12, atol=1e-12)
