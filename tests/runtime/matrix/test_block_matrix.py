"""Structure, positions and products of the block-sparse matrix, against brute force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix

THREADS = (1, 2)


def add_local(matrix: BlockMatrix, position: int, block: np.ndarray) -> None:
    """Add one local block as generated code does, from its place in PositionInData."""
    offset, flags = position >> 2, position & 3
    target = matrix.values[offset : offset + block.size]
    if flags & 1:
        block = block.T
    if flags & 2:
        block = block + block.T
    target += block.reshape(-1)


def assemble_randomly(scene: Any, matrix: BlockMatrix, positions: list[np.ndarray], seed: int = 0) -> np.ndarray:
    """Add random symmetric local Hessians into the matrix; returns the dense global sum."""
    rng = np.random.default_rng(seed)
    dense = np.zeros((scene.size, scene.size))
    for kappa, position in zip(scene.kappas, positions, strict=True):
        for i in range(kappa.shape[0]):
            slots = [(a, int(k)) for a, k in enumerate(kappa[i]) if k > 0]
            widths = [scene.size_of(k) for _, k in slots]
            local = rng.standard_normal((sum(widths), sum(widths)))
            local += local.T
            starts = np.concatenate([[0], np.cumsum(widths)])
            dofs = np.concatenate(
                [np.arange(k - 1, k - 1 + w) for (_, k), w in zip(slots, widths, strict=True)] or [[]]
            ).astype(int)
            np.add.at(dense, (dofs[:, None], dofs), local)
            pair = {slot: m for m, (slot, _) in enumerate(slots)}
            k = 0
            for a in range(kappa.shape[1]):
                for b in range(a, kappa.shape[1]):
                    if a in pair and b in pair:
                        m, n = pair[a], pair[b]
                        block = local[starts[m] : starts[m + 1], starts[n] : starts[n + 1]]
                        add_local(matrix, int(position[i, k]), block)
                    else:
                        assert position[i, k] == -1
                    k += 1
    return dense


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("with_diagonal", [True, False])
def test_assembled_matrix_is_the_dense_sum(runtime: Runtime, scene: Any, threads: int, with_diagonal: bool) -> None:
    matrix = BlockMatrix(runtime, with_diagonal)
    positions = matrix.build(scene.boundaries, scene.block_sizes, scene.kappas, threads)
    dense = assemble_randomly(scene, matrix, positions)
    np.testing.assert_allclose(matrix.to_scipy().toarray(), dense, rtol=1e-13, atol=1e-13)
    x = np.random.default_rng(3).standard_normal(scene.size)
    np.testing.assert_allclose(matrix.multiply(x, threads), dense @ x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("with_diagonal", [True, False])
def test_groups_hold_each_block_once_in_order(runtime: Runtime, scene: Any, with_diagonal: bool) -> None:
    matrix = BlockMatrix(runtime, with_diagonal)
    matrix.build(scene.boundaries, scene.block_sizes, scene.kappas)
    expected = set()
    for kappa in scene.kappas:
        for row in kappa:
            used = sorted(int(k) - 1 for k in row if k > 0)
            expected |= {(i, j) for i in used for j in used if i <= j}
    if with_diagonal:
        expected |= {(int(i), int(i)) for i in np.flatnonzero(matrix.block_size_at)}
    shapes = [(group.r, group.c) for group in matrix.groups]
    assert shapes == sorted(set(shapes))
    found = set()
    for group in matrix.groups:
        coordinates = list(zip(group.rows.tolist(), group.cols.tolist(), strict=True))
        assert coordinates == sorted(set(coordinates))
        assert all(scene.size_of(i + 1) == group.r and scene.size_of(j + 1) == group.c for i, j in coordinates)
        assert group.values.shape == (len(coordinates), group.r, group.c)
        found |= set(coordinates)
    assert found == expected
    assert matrix.block_count == len(expected)


def test_positions_do_not_depend_on_threads(runtime: Runtime, scene: Any) -> None:
    one, three = BlockMatrix(runtime), BlockMatrix(runtime)
    first = one.build(scene.boundaries, scene.block_sizes, scene.kappas, threads=1)
    second = three.build(scene.boundaries, scene.block_sizes, scene.kappas, threads=3)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


def test_product_is_the_same_bit_for_bit(runtime: Runtime, scene: Any) -> None:
    matrix = BlockMatrix(runtime)
    matrix.build(scene.boundaries, scene.block_sizes, scene.kappas)
    rng = np.random.default_rng(5)
    matrix.values[:] = rng.standard_normal(matrix.values.size)
    x = rng.standard_normal(scene.size)
    first = matrix.multiply(x, 2)
    for _ in range(5):
        np.testing.assert_array_equal(matrix.multiply(x, 2), first)


def test_product_where_few_rows_reach_far(runtime: Runtime) -> None:
    rng = np.random.default_rng(3)
    boundaries, sizes = np.array([0, 270, 810], np.int64), np.array([3, 9], np.int32)
    starts = np.concatenate([3 * np.arange(90), 270 + 9 * np.arange(60)])
    matrix = BlockMatrix(runtime)
    for _ in range(3):  # each time other pairs: what was reached before is forgotten
        near = np.stack([starts[:-1], starts[1:]], 1)
        far = np.sort(rng.choice(starts, (12, 2)), 1)
        matrix.build(boundaries, sizes, [(near + 1).astype(np.int32), (far + 1).astype(np.int32)])
        for group in matrix.groups:
            group.values[:] = rng.standard_normal(group.values.shape)
            for block in np.flatnonzero((group.rows == group.cols) & (group.r == group.c)):
                group.values[block] += group.values[block].T.copy()
        for threads in (1, 2, 7):
            x = rng.standard_normal(matrix.size)
            for deterministic in (False, True):
                found = matrix.multiply(x, threads, deterministic=deterministic)
                np.testing.assert_allclose(found, matrix.to_scipy() @ x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rows", [1, 2, 3, 6, 7, 9, 12, 70])
@pytest.mark.parametrize("cols", [1, 3, 5, 6, 9, 12, 67])
def test_product_of_every_shape(runtime: Runtime, rows: int, cols: int) -> None:
    """Two targets with two blocks each, all coupled; not a number beyond a block must not leak into others."""
    boundaries = np.array([0, 2 * rows, 2 * rows + 2 * cols])
    kappa = np.array([[1, rows + 1, 2 * rows + 1, 2 * rows + cols + 1]], np.int32)
    matrix = BlockMatrix(runtime)
    matrix.build(boundaries, np.array([rows, cols], np.int32), [kappa])
    rng = np.random.default_rng(rows * 100 + cols)
    matrix.values[:] = rng.standard_normal(matrix.values.size)
    for group in matrix.groups:
        if group.r != group.c:
            continue
        diagonal = group.rows == group.cols
        group.values[diagonal] += group.values[diagonal].transpose(0, 2, 1)
    x = rng.standard_normal(matrix.size)
    np.testing.assert_allclose(matrix.multiply(x, 2), matrix.to_scipy() @ x, rtol=1e-12, atol=1e-12)

    last = matrix.groups[-1]
    last.values[-1] = np.nan
    touched = np.zeros(matrix.size, bool)
    touched[last.rows[-1] : last.rows[-1] + last.r] = True
    touched[last.cols[-1] : last.cols[-1] + last.c] = True
    np.testing.assert_array_equal(np.isnan(matrix.multiply(x, 1)), touched)


def test_build_again_reuses_and_clears(runtime: Runtime, scene: Any) -> None:
    matrix = BlockMatrix(runtime, with_diagonal=False)
    positions = matrix.build(scene.boundaries, scene.block_sizes, scene.kappas)
    dense = assemble_randomly(scene, matrix, positions)
    for kappas in ([], [scene.kappas[3]], scene.kappas):
        matrix.build(scene.boundaries, scene.block_sizes, kappas)
        assert not matrix.values.any()
        assert matrix.to_scipy().shape == (scene.size, scene.size)
        assert not matrix.multiply(np.ones(scene.size)).any()
    positions = matrix.build(scene.boundaries, scene.block_sizes, scene.kappas)
    np.testing.assert_allclose(
        assemble_randomly(scene, matrix, positions), dense, err_msg="the random sum is not repeatable"
    )
    np.testing.assert_allclose(matrix.to_scipy().toarray(), dense, rtol=1e-13, atol=1e-13)


def test_many_columns_in_one_row(runtime: Runtime) -> None:
    """A block that is coupled to all others, as the variables of a whole mesh are."""
    n = 300
    boundaries = np.array([0, 3 * n])
    others = np.random.default_rng(1).permutation(np.arange(1, n))
    kappa = np.stack([3 * others + 1, np.ones(n - 1, int)], 1).astype(np.int32)
    matrix = BlockMatrix(runtime)
    position = matrix.build(boundaries, np.array([3], np.int32), [kappa])[0]
    group = matrix.groups[0]
    np.testing.assert_array_equal(group.cols[:n], 3 * np.arange(n))
    assert ((position[:, 1] & 3) == 1).all(), "the second slot comes first in the matrix"


def test_no_unknowns(runtime: Runtime) -> None:
    matrix = BlockMatrix(runtime)
    assert matrix.size == 0
    assert matrix.groups == []
    assert matrix.multiply(np.zeros(0)).shape == (0,)
    assert matrix.to_scipy().shape == (0, 0)
    assert repr(matrix) == "BlockMatrix(0 x 0, blocks: none)"


@pytest.mark.parametrize("slot", [2, 3, 10, -2])
def test_wrong_index_is_refused_and_changes_nothing(runtime: Runtime, slot: int) -> None:
    matrix = BlockMatrix(runtime)
    boundaries, sizes = np.array([0, 9]), np.array([3], np.int32)
    good = np.array([[1, 4], [4, 7]], np.int32)
    matrix.build(boundaries, sizes, [good])
    matrix.values[:] = 1.0
    before = matrix.to_scipy().toarray()
    bad = np.array([[1, 4], [4, slot]], np.int32)
    with pytest.raises(ValueError, match=rf"index {slot} in kappas\[1\]\[1, 1\] is not .* offset of a dof block"):
        matrix.build(boundaries, sizes, [good, bad])
    np.testing.assert_array_equal(matrix.to_scipy().toarray(), before)
    np.testing.assert_allclose(matrix.multiply(np.ones(9)), before.sum(1))


@pytest.mark.parametrize(
    ("boundaries", "sizes", "message"),
    [
        ([0, 9], [3, 3], "T targets need"),
        ([1, 9], [3], "start at 0"),
        ([0, 9, 6], [3, 3], "never fall"),
        ([0, 9], [0], "at least one scalar"),
        ([0, 10], [3], "target 0 has 10 scalars"),
    ],
)
def test_contradicting_layout_is_refused(
    runtime: Runtime, boundaries: list[int], sizes: list[int], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        BlockMatrix(runtime).build(np.array(boundaries), np.array(sizes, np.int32), [])


def test_wrong_kappa_and_vector_shapes_are_refused(runtime: Runtime) -> None:
    matrix = BlockMatrix(runtime)
    with pytest.raises(ValueError, match=r"kappas\[0\] has shape"):
        matrix.build(np.array([0, 3]), np.array([3], np.int32), [np.array([1, 1], np.int32)])
    matrix.build(np.array([0, 3]), np.array([3], np.int32), [])
    with pytest.raises(ValueError, match=r"x has shape \(4,\)"):
        matrix.multiply(np.zeros(4))
    with pytest.raises(ValueError, match="threads is 0"):
        matrix.multiply(np.zeros(3), threads=0)


@pytest.mark.parametrize("with_diagonal", [True, False])
def test_fixed_rows_and_columns_follow_what_is_fixed_and_the_sparsity(runtime: Runtime, with_diagonal: bool) -> None:
    matrix = BlockMatrix(runtime, with_diagonal)
    first, second = np.repeat([True, False, False, False], 3), np.repeat([False, False, True, False], 3)
    chain, star = np.array([[1, 4], [4, 7], [7, 10]], np.int32), np.array([[1, 7], [7, 10], [4, 10]], np.int32)
    for kappa, fixed in ((chain, first), (chain, second), (star, second), (star, second)):
        if not matrix.size or kappa is star:
            matrix.build(np.array([0, 12]), np.array([3], np.int32), [kappa])
        matrix.values[:] = np.arange(1.0, 1.0 + matrix.values.size)
        expected = matrix.to_scipy().toarray()
        expected[fixed] = 0.0
        expected[:, fixed] = 0.0
        if with_diagonal:
            expected[fixed, fixed] = 1.0
        matrix.fix(fixed)
        np.testing.assert_array_equal(matrix.to_scipy().toarray(), expected)
