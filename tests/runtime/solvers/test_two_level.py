"""The coarse space beside block Jacobi."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
import pytest
from net_systems import VERTICES, dense_of, nets
from numpy.typing import NDArray

from yasps.runtime.core.library import DETERMINISTIC_PIECES, IntArray, LongArray, Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, PreconditionerChoice, SolveReport, StopReason


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


def test_auto_takes_what_was_cheaper_in_a_trial(runtime: Runtime, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("FEWEST_BLOCKS", 100), ("SLOW", 5), ("SETUP", 0.0), ("ITERATION", 0.1)):
        monkeypatch.setattr(PreconditionerChoice, name, value)
    parts = nets(runtime)
    g = np.random.default_rng(1).standard_normal(parts[0].size)
    alone = {
        name: PcgSolver(runtime).solve(parts, g, SolveOptions(1e-12, history=True, preconditioner=name))
        for name in ("gauss-seidel", "two-level")
    }
    solver = PcgSolver(runtime)
    options = SolveOptions(1e-12, history=True, preconditioner="auto")
    for name, other in (("gauss-seidel", alone["two-level"][1].iterations), ("two-level", 0)):
        x, report = solver.solve(parts, g, options)
        np.testing.assert_array_equal(x, alone[name][0])
        assert report.history == alone[name][1].history
        assert report.two_level == (name == "two-level")
        assert report.trial_iterations == other
        assert report.all_iterations == report.iterations + other


class Systems:
    """Stands in for systems that take so many iterations with block Jacobi and with two levels."""

    def __init__(self, jacobi: int, two_level: int) -> None:
        self.iterations = {False: jacobi, True: two_level}
        self.breaks_down = False
        self.choice = PreconditionerChoice()
        self.part = BlocksAlone(np.array([0, 3 * PreconditionerChoice.FEWEST_BLOCKS]), np.array([3], np.int32))
        self.cost = 0.0

    def solve(self, count: int = 1, most: int = 10_000) -> list[SolveReport]:
        options = SolveOptions(max_iterations=most, preconditioner="auto")
        return [self.choice.solve(options, self.part, self.run)[1] for _ in range(count)]

    def run(self, two_level: bool, most: int) -> tuple[None, SolveReport]:
        coarse = two_level and not self.breaks_down
        needed = self.iterations[coarse]
        reason = StopReason.CONVERGED if needed <= most else StopReason.MAX_ITERATIONS
        report = SolveReport(reason, min(needed, most), 0.0, None, None)
        self.cost += PreconditionerChoice.SETUP if two_level else 0.0
        self.cost += report.iterations * (PreconditionerChoice.ITERATION if coarse else 1.0)
        return None, replace(report, two_level=coarse, coarse_broke_down=two_level and not coarse)


@dataclass
class BlocksAlone:
    boundaries: LongArray
    block_sizes: IntArray


@pytest.mark.parametrize(("jacobi", "two_level", "better"), [(100, 60, True), (100, 85, False), (41, 38, False)])
def test_auto_loses_little_to_the_better_one(jacobi: int, two_level: int, better: bool) -> None:
    systems = Systems(jacobi, two_level)
    reports = systems.solve(400)
    assert [report.two_level for report in reports[1:]] == [better] * 399
    costs = float(jacobi), PreconditionerChoice.SETUP + PreconditionerChoice.ITERATION * two_level
    cheaper, dearer = min(costs), max(costs)
    assert cheaper * 400 < systems.cost <= 1.05 * cheaper * 400 + dearer


def test_auto_does_not_wait_for_block_jacobi_for_ever() -> None:
    systems = Systems(2400, 970)
    first, second = systems.solve(2)
    assert first.converged
    assert first.two_level
    assert (first.iterations, first.trial_iterations) == (970, PreconditionerChoice.PATIENCE)
    assert (second.iterations, second.trial_iterations, second.two_level) == (970, 0, True)
    systems = Systems(2400, 5000)
    assert [report.two_level for report in systems.solve(11)[-2:]] == [True, False]  # found out in the first trial


def test_auto_follows_systems_that_change() -> None:
    systems = Systems(100, 60)
    assert systems.solve(100)[-1].two_level
    systems.iterations = {False: 20, True: 15}
    wait = systems.choice.wait
    assert wait == PreconditionerChoice.LONGEST_WAIT
    assert not systems.solve(3 * wait)[-1].two_level
    assert not any(report.trial_iterations for report in systems.solve(200))  # too easy to be worth one
    systems.iterations = {False: 1000, True: 2000}
    (report,) = systems.solve()
    assert report.trial_iterations == int((1250 - PreconditionerChoice.SETUP) / PreconditionerChoice.ITERATION)
    assert not systems.choice.two_level


def test_auto_gives_up_a_coarse_space_that_breaks_down() -> None:
    systems = Systems(100, 60)
    assert systems.solve(2)[-1].two_level
    systems.breaks_down = True
    assert not systems.solve(30)[-1].coarse_broke_down


def test_auto_tries_nothing_after_a_failure() -> None:
    systems = Systems(100, 60)
    (report,) = systems.solve(most=50)
    assert report.reason is StopReason.MAX_ITERATIONS
    assert report.trial_iterations == 0
    (report,) = systems.solve(most=100)
    assert report.trial_iterations == 60


def test_what_auto_has_learned_goes_on_elsewhere() -> None:
    systems, other = Systems(100, 60), Systems(100, 60)
    systems.solve(20)
    other.choice.set_numbers(systems.choice.numbers())
    assert other.choice == systems.choice
    assert other.solve(30) == systems.solve(30)


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
