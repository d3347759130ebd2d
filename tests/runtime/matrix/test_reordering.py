"""Dof blocks in another order inside the matrix: nobody outside may see more of it than rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.matrix.ordering import FEWEST_BLOCKS, bandwidth_reducing_order
from yasps.runtime.solvers.direct import DirectSolver
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, StopReason


def block_count(scene: Any) -> int:
    """Dof blocks of a random scene."""
    return int((np.diff(scene.boundaries) // scene.block_sizes).sum())


def fill(matrix: BlockMatrix, positions: list[np.ndarray], scene: Any, seed: int = 0) -> np.ndarray:
    """Add symmetric local Hessians to the matrix as kernels do; returns the dense sum, diagonally dominant or not."""
    rng = np.random.default_rng(seed)
    dense = np.zeros((scene.size, scene.size))
    for kappa, position in zip(scene.kappas, positions, strict=True):
        for slots, places in zip(kappa, position, strict=True):
            pairs = [(a, b) for a in range(len(slots)) for b in range(a, len(slots))]
            for (a, b), place in zip(pairs, places.tolist(), strict=True):
                if place < 0:
                    continue
                i, j = int(slots[a]) - 1, int(slots[b]) - 1
                r, c = scene.size_of(i + 1), scene.size_of(j + 1)
                local = rng.standard_normal((r, c))
                if a == b:
                    local += local.T
                dense[i : i + r, j : j + c] += local
                if a != b:
                    dense[j : j + c, i : i + r] += local.T
                block = local.T if place & 1 else local
                if place & 2:
                    block = block + block.T
                matrix.values[place >> 2 : (place >> 2) + r * c] += block.reshape(-1)
    return dense


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("with_diagonal", [True, False])
def test_any_order_gives_the_same_matrix(runtime: Runtime, scene: Any, threads: int, with_diagonal: bool) -> None:
    order = np.random.default_rng(threads).permutation(block_count(scene)).astype(np.int32)
    matrix = BlockMatrix(runtime, with_diagonal)
    positions = matrix.build(scene.boundaries, scene.block_sizes, scene.kappas, threads, order=order)
    dense = fill(matrix, positions, scene)
    np.testing.assert_allclose(matrix.to_scipy().toarray(), dense, rtol=1e-13, atol=1e-13)
    x = np.random.default_rng(3).standard_normal(scene.size)
    for deterministic in (False, True):
        product = matrix.multiply(x, threads, deterministic=deterministic)
        np.testing.assert_allclose(product, dense @ x, rtol=1e-12, atol=1e-12)


def test_one_of_two_symmetric_blocks_is_stored(runtime: Runtime, scene: Any) -> None:
    plain, reordered = BlockMatrix(runtime), BlockMatrix(runtime)
    plain.build(scene.boundaries, scene.block_sizes, scene.kappas)
    order = np.arange(block_count(scene), dtype=np.int32)[::-1]
    reordered.build(scene.boundaries, scene.block_sizes, scene.kappas, order=order)

    def pairs(matrix: BlockMatrix) -> set[tuple[int, int]]:
        return {
            (min(i, j), max(i, j))
            for group in matrix.groups
            for i, j in zip(group.rows.tolist(), group.cols.tolist(), strict=True)
        }

    assert pairs(reordered) == pairs(plain)
    assert reordered.block_count == plain.block_count == len(pairs(plain))
    assert all((group.rows >= group.cols).all() for group in reordered.groups), "back to front"


@pytest.mark.parametrize("threads", [1, 2])
def test_solvers_work_in_any_order(runtime: Runtime, scene: Any, threads: int) -> None:
    order = np.random.default_rng(8).permutation(block_count(scene)).astype(np.int32)
    parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
    positions = [part.build(scene.boundaries, scene.block_sizes, scene.kappas, order=order) for part in parts]
    dense = fill(parts[0], positions[0], scene, 1) + fill(parts[1], positions[1], scene, 2)
    for group in parts[0].groups:
        for block in np.flatnonzero(group.rows == group.cols):
            rows = slice(group.rows[block], group.rows[block] + group.r)
            extra = np.diag(np.abs(dense[rows]).sum(1) + 0.1)
            group.values[block] += extra
            dense[rows, rows] += extra
    g = np.random.default_rng(0).standard_normal(scene.size)
    expected = np.linalg.solve(dense, g)
    for solver in (PcgSolver(runtime), PcgSolver(runtime, deterministic=True), DirectSolver(runtime, "superlu")):
        x, report = solver.solve(parts, g, SolveOptions(1e-28), threads=threads)
        assert report.converged
        np.testing.assert_allclose(x, expected, rtol=1e-10, atol=1e-12)

    group = next(group for group in parts[0].groups if group.r == group.c)
    block = int(np.flatnonzero(group.rows == group.cols)[0])
    group.values[block] = -1e6 * np.eye(group.r)
    report = PcgSolver(runtime).solve(parts, g, threads=threads)[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    assert report.block == group.rows[block], "in the order of the scalars"


def test_parts_in_different_orders_are_refused(runtime: Runtime, scene: Any) -> None:
    count = block_count(scene)
    parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
    parts[0].build(scene.boundaries, scene.block_sizes, scene.kappas, order=np.arange(count, dtype=np.int32)[::-1])
    for order in (None, np.arange(count, dtype=np.int32)):
        parts[1].build(scene.boundaries, scene.block_sizes, [], order=order)
        with pytest.raises(ValueError, match="another order of dof blocks"):
            PcgSolver(runtime).solve(parts, np.zeros(scene.size))


def test_order_that_is_no_permutation_is_refused(runtime: Runtime) -> None:
    matrix = BlockMatrix(runtime)
    boundaries, sizes = np.array([0, 9]), np.array([3], np.int32)
    for order in ([0, 1], [0, 1, 1], [0, 1, 3], [-1, 0, 1]):
        with pytest.raises(ValueError, match=r"order (has shape|is not a permutation)"):
            matrix.build(boundaries, sizes, [], order=np.array(order, np.int32))
    with pytest.raises(ValueError, match="not both"):
        matrix.build(boundaries, sizes, [], order=np.arange(3, dtype=np.int32), reorder=True)
    assert matrix.size == 0


def test_layout_is_kept_or_replaced_between_builds(runtime: Runtime, scene: Any) -> None:
    """Building again with the same targets takes a short cut; every way to leave it must notice."""
    count = block_count(scene)
    rng = np.random.default_rng(0)
    orders = [None, rng.permutation(count).astype(np.int32), rng.permutation(count).astype(np.int32)]
    matrix = BlockMatrix(runtime)
    x = rng.standard_normal(scene.size)
    for order in (orders[0], orders[0], orders[1], orders[1].copy(), orders[2], orders[0]):
        positions = matrix.build(scene.boundaries, scene.block_sizes, scene.kappas, order=order)
        dense = fill(matrix, positions, scene)
        np.testing.assert_allclose(matrix.multiply(x), dense @ x, rtol=1e-12, atol=1e-12)
        bad = np.array([[scene.size + 1]], np.int32)
        with pytest.raises(ValueError, match="is not the 1-based offset"):
            matrix.build(scene.boundaries, scene.block_sizes, [bad], order=orders[2])
        np.testing.assert_allclose(matrix.multiply(x), dense @ x, rtol=1e-12, atol=1e-12)
    matrix.build(np.array([0, 4]), np.array([2], np.int32), [np.array([[1, 3]], np.int32)])
    matrix.values[:] = np.arange(12.0)
    np.testing.assert_array_equal(matrix.multiply(np.array([1.0, 0, 0, 0])), [0, 2, 4, 5])


def chain(count: int, seed: int | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets and springs of a chain of blocks of 2, in the order of the chain or mixed."""
    name = np.arange(count) if seed is None else np.random.default_rng(seed).permutation(count)
    kappa = np.stack([2 * name[:-1] + 1, 2 * name[1:] + 1], 1).astype(np.int32)
    return np.array([0, 2 * count]), np.array([2], np.int32), kappa


def test_reorder_finds_the_chain(runtime: Runtime) -> None:
    count = FEWEST_BLOCKS
    boundaries, sizes, kappa = chain(count, seed=1)
    matrix = BlockMatrix(runtime)
    position = matrix.build(boundaries, sizes, [kappa], reorder=True)[0]
    assert matrix.order is not None
    places = matrix.order[(kappa - 1) // 2]
    assert (np.abs(places[:, 0] - places[:, 1]) == 1).all()
    assert ((position[:, 1] & 1).astype(bool) == (places[:, 0] > places[:, 1])).all()

    order = matrix.order
    matrix.build(boundaries, sizes, [kappa[: count // 2]], reorder=True)
    assert matrix.order is order, "chosen once"
    matrix.build(boundaries, sizes, [kappa])
    assert matrix.order is None, "unless it is not wanted any more"
    matrix.build(boundaries, sizes, [chain(count, seed=2)[2]], reorder=True)
    assert matrix.order is not None
    assert not np.array_equal(matrix.order, order), "chosen anew"


@pytest.mark.parametrize(("count", "seed"), [(FEWEST_BLOCKS, None), (50, 1)])
def test_no_new_order_where_it_does_not_help(runtime: Runtime, count: int, seed: int | None) -> None:
    boundaries, sizes, kappa = chain(count, seed)
    matrix = BlockMatrix(runtime)
    matrix.build(boundaries, sizes, [kappa], reorder=True)
    assert matrix.order is None


def test_order_of_a_graph_with_duplicates_and_loose_ends() -> None:
    rows, cols = np.array([0, 5, 5, 0, 3, 1, 9]), np.array([5, 0, 9, 0, 3, 8, 5])
    order = bandwidth_reducing_order(rows, cols, 10)
    assert order is not None
    np.testing.assert_array_equal(np.sort(order), np.arange(10))
    for i, j in zip(rows.tolist(), cols.tolist(), strict=True):
        assert abs(order[i] - order[j]) <= 1
    assert bandwidth_reducing_order(np.zeros(0, np.int32), np.zeros(0, np.int32), 4) is None
