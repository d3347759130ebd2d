"""The choice between conjugate gradients and a direct solver."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers import choice as solver_choice
from yasps.runtime.solvers.choice import LinearSolver
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import StopReason

LENGTH = 200


def chain(runtime: Runtime, hold: float) -> BlockMatrix:
    """A chain of springs, each end held: conjugate gradients take about LENGTH iterations where `hold` is small."""
    matrix = BlockMatrix(runtime)
    ids = np.arange(LENGTH, dtype=np.int32)
    matrix.build(np.array([0, LENGTH]), np.array([1], np.int32), [np.stack([ids[:-1], ids[1:]], 1) + 1])
    group = matrix.groups[0]
    group.values[:, 0, 0] = np.where(group.rows == group.cols, 2.0 + hold, -1.0)
    return matrix


def test_pcg_and_direct_agree_and_say_who_they_are(runtime: Runtime) -> None:
    matrix = chain(runtime, 0.01)
    g = np.random.default_rng(0).standard_normal(LENGTH)
    linear = LinearSolver(runtime)
    x, report = linear.solve([matrix], g, SolveOptions(1e-24, history=True))
    assert (report.solver, report.why, report.direct) == ("pcg", "", False)
    assert report.history is not None
    assert len(report.history) == report.iterations + 1
    y, report = linear.solve([matrix], g, SolveOptions(1e-24, solver="direct"))
    assert report.direct
    assert report.why == "asked for"
    np.testing.assert_allclose(x, y, rtol=1e-8, atol=1e-10)


def test_auto_falls_back_and_comes_again(
    runtime: Runtime, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(solver_choice, "PATIENCE", 20)
    monkeypatch.setattr(solver_choice, "DIRECT_SOLVES", 3)
    hard, easy = chain(runtime, 0.0), chain(runtime, 10.0)
    g = np.ones(LENGTH)
    linear = LinearSolver(runtime)
    with caplog.at_level(logging.INFO, "yasps"):
        reports = [
            linear.solve([matrix], g, SolveOptions(1e-12, solver="auto"))[1]
            for matrix in (easy, hard, hard, easy, easy)
        ]
    assert all(report.converged for report in reports)
    assert [report.direct for report in reports] == [False, True, True, True, False]
    assert "did not converge in 20 iterations" in reports[1].why
    assert "slow not long ago" in reports[2].why
    assert [record.name for record in caplog.records if "solver='auto'" in record.message] == ["yasps"]


def test_auto_takes_no_direct_solver_where_none_can_help(runtime: Runtime) -> None:
    matrix = chain(runtime, -2.5)
    report = LinearSolver(runtime).solve([matrix], np.ones(LENGTH), SolveOptions(solver="auto"))[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    assert not report.direct


def test_max_iterations_below_the_patience_count(runtime: Runtime) -> None:
    matrix = chain(runtime, 0.0)
    g = np.ones(LENGTH)
    assert LinearSolver(runtime).solve([matrix], g, SolveOptions(1e-12, 5))[1].reason is StopReason.MAX_ITERATIONS
    assert LinearSolver(runtime).solve([matrix], g, SolveOptions(1e-12, 5, solver="auto"))[1].direct
