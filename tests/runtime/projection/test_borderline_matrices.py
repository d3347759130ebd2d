"""Matrices that are just not definite, or look like another one: what must not be taken for what it resembles."""

from __future__ import annotations

import numpy as np
import pytest

from yasps.runtime.core.library import LANES, Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.direct import DirectSolver, available_libraries
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, StopReason


def test_projections_whose_last_pivot_is_a_rounding_error(runtime: Runtime) -> None:
    """I - v v^T / v^2 is singular; of its last pivots, about 1e-16, many are positive."""
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 3]), np.array([3], np.int32), [])
    for seed in range(100):
        v = np.random.default_rng(seed).uniform(0.5, 1.0, 3)
        matrix.groups[0].values[0] = np.eye(3) - np.outer(v, v) / (v @ v)
        report = PcgSolver(runtime).solve([matrix], np.ones(3))[1]
        assert report.reason is StopReason.NOT_POSITIVE_DEFINITE, seed
        assert report.block == 0


@pytest.mark.parametrize("library", available_libraries())
def test_blocks_of_the_same_number_at_other_places(runtime: Runtime, library: str) -> None:
    """The analysis of a direct solver belongs to the places of blocks, not to their number."""
    count = 6
    solver = DirectSolver(runtime, library)
    matrix = BlockMatrix(runtime)
    for pairs in ([[0, 1], [2, 3], [4, 5]], [[0, 5], [1, 4], [2, 3]], [[0, 2], [1, 3], [2, 4]]):
        kappa = (3 * np.array(pairs) + 1).astype(np.int32)
        matrix.build(np.array([0, 3 * count]), np.array([3], np.int32), [kappa])
        matrix.values[:] = np.random.default_rng(0).uniform(0.1, 0.2, matrix.values.size)
        (group,) = matrix.groups
        group.values[group.rows == group.cols] = 4 * np.eye(3)
        g = np.arange(1.0, 3 * count + 1)
        x, report = solver.solve([matrix], g, SolveOptions(1e-24))
        assert report.converged
        assert report.iterations == 0  # nothing had to be repaired
        np.testing.assert_allclose(matrix.to_scipy() @ x, g, rtol=1e-12)


@pytest.mark.parametrize("width", [1, 3, 7])
def test_negative_numbers_next_to_the_smallest_there_are(runtime: Runtime, width: int) -> None:
    """-1e-308 is negative, beside zeros too, and is not lost in what the check adds to let zero pass."""
    packed = np.zeros((1, width * (width + 1) // 2, LANES))
    packed[0, -1, :2] = -1e-308, 1e-308
    assert runtime.project(packed, 3) == 1
    assert not packed[0, :, 0].any()
    assert packed[0, -1, 1] == 1e-308
