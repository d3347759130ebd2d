"""The coarse space beside block Jacobi."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from net_systems import VERTICES, dense_of, nets
from numpy.typing import NDArray

from yasps.runtime.core.library import DETERMINISTIC_PIECES, Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, PreconditionerChoice, StopReason


def prolongation(part: BlockMatrix) -> NDArray[np.float64]:
    """P, from the aggregates: a column moves one scalar of all blocks of one."""
    aggregates = part.aggregates()
    starts = np.flatnonzero(part.block_size_at)
    within = np.arange(part.size) - np.repeat(starts, part.block_size_at[starts])
    used = aggregates >= 0
    names, columns = np.unique(np.stack([aggregates[used], within[used]]), axis=1, return_inverse=True)
    p = np.zeros((part.size, names.shape[1]))
    p[np.flatnonzero(used), columns.reshape(-1)] = 1.0
    return p


def test_aggregates_are_connected_parts_of_one_body(runtime: Runtime) -> None:
    static = nets(runtime)[0]
    aggregates = static.aggregates()
    of_vertices = aggregates[: 3 * VERTICES].reshape(-1, 3)
    assert (of_vertices == of_vertices[:, :1]).all()
    first, second = np.split(of_vertices[:, 0], 2)
    assert set(first).isdisjoint(second)
    assert set(aggregates[3 * VERTICES :]).isdisjoint(of_vertices[:, 0])
    assert 4 <= len(np.unique(of_vertices)) <= VERTICES // 4
    coupled = static.to_scipy()[: 3 * VERTICES : 3, : 3 * VERTICES : 3].toarray() != 0
    for number in np.unique(of_vertices):
        members = np.flatnonzero(of_vertices[:, 0] == number)
        reached = np.linalg.matrix_power(coupled[np.ix_(members, members)].astype(float), len(members)) > 0
        assert reached.all(), number


@pytest.mark.parametrize("threads", [1, 2])
def test_iterations_are_those_of_textbook_pcg(runtime: Runtime, threads: int) -> None:
    parts = nets(runtime)
    dense, p = dense_of(parts), prolongation(parts[0])
    d = np.zeros_like(dense)
    starts = np.flatnonzero(parts[0].block_size_at)
    for start, q in zip(starts, parts[0].block_size_at[starts], strict=True):
        d[start : start + q, start : start + q] = dense[start : start + q, start : start + q]
    inverse = np.linalg.inv(d) + p @ np.linalg.inv(p.T @ dense @ p) @ p.T
    g = np.random.default_rng(1).standard_normal(len(dense))
    x, r = np.zeros_like(g), g.copy()
    direction = z = inverse @ r
    expected = [1.0]
    for _ in range(6):
        q = dense @ direction
        step, before = r @ z / (direction @ q), r @ z
        x, r = x + step * direction, r - step * q
        z = inverse @ r
        direction = z + r @ z / before * direction
        expected.append(r @ np.linalg.solve(d, r) / (g @ np.linalg.solve(d, g)))
    options = SolveOptions(0.0, 6, history=True, preconditioner="two-level")
    found, report = PcgSolver(runtime).solve(parts, g, options, threads=threads)
    assert report.two_level
    np.testing.assert_allclose(found, x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(report.history, expected, rtol=1e-8)


def test_halves_the_iterations_of_a_stiff_system(runtime: Runtime) -> None:
    parts = nets(runtime)
    g = np.random.default_rng(1).standard_normal(parts[0].size)
    solver = PcgSolver(runtime)
    reports = {
        name: solver.solve(parts, g, SolveOptions(1e-8, preconditioner=name))[1] for name in ("jacobi", "two-level")
    }
    assert all(report.converged for report in reports.values())
    assert 2 * reports["two-level"].iterations < reports["jacobi"].iterations
    assert not reports["jacobi"].two_level
    assert "with two levels" in str(reports["two-level"])


def test_same_bits_for_any_number_of_threads(runtime: Runtime) -> None:
    parts = nets(runtime)
    g = np.random.default_rng(1).standard_normal(parts[0].size)
    solver = PcgSolver(runtime, deterministic=True)
    options = SolveOptions(1e-16, history=True, preconditioner="two-level")
    results = [solver.solve(parts, g, options, threads=threads) for threads in (1, 2, 5, DETERMINISTIC_PIECES + 3)]
    for x, report in results[1:]:
        np.testing.assert_array_equal(x, results[0][0])
        assert report == results[0][1]


def test_fixed_unknowns_stay(runtime: Runtime) -> None:
    """Also where the residual of their neighbours would move the whole aggregate."""
    parts = nets(runtime)
    fixed = np.zeros(parts[0].size, bool)
    for vertex in (0, 1, 40, 100):
        fixed[3 * vertex : 3 * vertex + 3] = True
    fixed[3 * VERTICES :] = True
    for part in parts:
        part.fix(fixed)
    g = np.where(fixed, 0.0, 1.0)
    x, report = PcgSolver(runtime).solve(parts, g, SolveOptions(1e-24, preconditioner="two-level"))
    assert report.converged
    assert report.two_level
    np.testing.assert_array_equal(x[fixed], 0.0)
    np.testing.assert_allclose(x, np.linalg.solve(dense_of(parts), g), rtol=1e-8, atol=1e-10)


def test_breakdown_is_said_and_block_jacobi_goes_on(runtime: Runtime, caplog: pytest.LogCaptureFixture) -> None:
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 2]), np.array([1], np.int32), [np.array([[1, 2]], np.int32)])
    matrix.values[:] = [2, 4, 2]  # indefinite, and positive along (1, 1)
    with caplog.at_level(logging.WARNING, "yasps"):
        x, report = PcgSolver(runtime).solve([matrix], np.ones(2), SolveOptions(1e-20, preconditioner="two-level"))
    assert report.converged
    assert report.coarse_broke_down
    assert not report.two_level
    np.testing.assert_allclose(x, [1 / 6, 1 / 6])
    assert "block Jacobi goes on alone" in caplog.text
    report = PcgSolver(runtime).solve([matrix], np.array([1.0, -1.0]), SolveOptions(preconditioner="two-level"))[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE


def test_more_bodies_than_the_coarse_space_has_room_for(runtime: Runtime) -> None:
    """The largest take part."""
    count = 600
    matrix = BlockMatrix(runtime)
    pairs = np.arange(0, 100, dtype=np.int32).reshape(-1, 2)
    matrix.build(np.array([0, 3 * count]), np.array([3], np.int32), [3 * pairs + 1])
    for group in matrix.groups:
        same = group.rows == group.cols
        group.values[:] = np.where(same[:, None, None], 3.0, -1.0) * np.eye(3)
    aggregates = matrix.aggregates()[::3]
    assert (aggregates >= 0).sum() > 300
    assert len(np.unique(aggregates[aggregates >= 0])) * 3 <= 1000
    assert (aggregates[:100] >= 0).all()
    g = np.random.default_rng(0).standard_normal(3 * count)
    x, report = PcgSolver(runtime).solve([matrix], g, SolveOptions(1e-24, preconditioner="two-level"))
    assert report.two_level
    np.testing.assert_allclose(matrix.to_scipy() @ x, g, rtol=1e-9, atol=1e-9)


def test_auto_takes_it_where_block_jacobi_is_slow(runtime: Runtime, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PreconditionerChoice, "FEWEST_BLOCKS", 100)
    hard, easy = nets(runtime), nets(runtime, stiffness=1e-4)
    easy[1].values[:] = 0.0
    g = np.random.default_rng(1).standard_normal(hard[0].size)
    solver = PcgSolver(runtime)
    options = SolveOptions(1e-12, history=True, preconditioner="auto")
    first, second, third, fourth = (solver.solve(parts, g, options)[1] for parts in (hard, hard, easy, easy))
    assert all(report.converged for report in (first, second, third, fourth))
    assert first.iterations > PreconditionerChoice.SLOW
    assert (first.two_level, second.two_level, third.two_level, fourth.two_level) == (True, True, True, False)
    assert second.iterations < first.iterations
    alone = solver.solve(hard, g, SolveOptions(1e-12, history=True, preconditioner="jacobi"))[1]
    assert first.history is not None
    assert alone.history is not None
    assert first.history[: PreconditionerChoice.SLOW + 1] == alone.history[: PreconditionerChoice.SLOW + 1]
    x, _ = solver.solve(hard, g, SolveOptions(1e-26))
    np.testing.assert_allclose(x, np.linalg.solve(dense_of(hard), g), rtol=1e-9, atol=1e-10)


def test_auto_leaves_small_systems_alone(runtime: Runtime) -> None:
    parts = nets(runtime)
    options = SolveOptions(1e-20, preconditioner="auto")
    assert not PcgSolver(runtime).solve(parts, np.ones(parts[0].size), options)[1].two_level


def test_aggregates_follow_the_structure(runtime: Runtime) -> None:
    """What was found for one sparsity is not taken for the next."""
    matrix = BlockMatrix(runtime)
    solver = PcgSolver(runtime)
    for count in (200, 90, 300):
        ids = np.arange(count, dtype=np.int32)
        matrix.build(np.array([0, 3 * count]), np.array([3], np.int32), [3 * np.stack([ids[:-1], ids[1:]], 1) + 1])
        group = matrix.groups[0]
        group.values[:] = np.where((group.rows == group.cols)[:, None, None], 2.01, -1.0) * np.eye(3)
        g = np.ones(matrix.size)
        x, report = solver.solve([matrix], g, SolveOptions(1e-26, preconditioner="two-level"))
        assert report.two_level
        np.testing.assert_allclose(matrix.to_scipy() @ x, g, rtol=1e-9, atol=1e-9)
