"""The benchmark `solver`: its systems are what they say, and a tiny run solves them all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.__main__ import main
from benchmarks.solver import PRECONDITIONERS
from benchmarks.solver_problems import PROBLEMS, MakeProblem, in_contact, quasi_static, soft
from yasps.runtime.solvers.direct import LIBRARIES, available_libraries
from yasps.runtime.solvers.pcg import PcgSolver


@pytest.mark.parametrize("make", PROBLEMS)
def test_systems_are_positive_definite_and_of_the_size_asked_for(make: MakeProblem) -> None:
    problem = make(900, 1)
    matrix = sum(part.to_scipy() for part in problem.parts).toarray()
    assert 300 <= len(matrix) == problem.gradient.size <= 2700
    assert np.linalg.eigvalsh(matrix)[0] > 0
    assert problem.gradient.any()


def test_hard_systems_are_harder() -> None:
    iterations = {}
    for make in (soft, quasi_static, in_contact):
        problem = make(2000, 1)
        report = PcgSolver(problem.compiled.runtime).solve(problem.parts, problem.gradient)[1]
        assert report.converged
        iterations[problem.name] = report.iterations
    assert iterations["quasi-static"] > 5 * iterations["soft"]
    assert iterations["in contact"] > 2 * iterations["soft"]
    assert in_contact(2000, 1).contacts > 100


def test_a_tiny_run_times_every_solver(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    assert main(["solver", "--size", "600", "--repeats", "1", "--threads", "1", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())
    assert {row["case"] for row in rows} == {"soft", "stiff", "quasi-static", "in contact"}
    direct = {f"{LIBRARIES[name]}, solve" for name in available_libraries()}
    seconds = {row["implementation"] for row in rows if row["unit"] == "s"}
    ours = {f"yasps PCG, {name}{error}" for name in PRECONDITIONERS for error in ("", ", error 0.1", ", error 0.001")}
    assert {"SciPy cg"} | ours | direct <= seconds
    counts = {(row["case"], row["implementation"]): row["value"] for row in rows if row["unit"] == "iterations"}
    for case in ("soft", "quasi-static"):
        for name in PRECONDITIONERS:
            first, last = (counts[case, f"yasps PCG, {name}, error {error}"] for error in ("0.1", "0.001"))
            assert 1 <= first <= last
    assert all(row["value"] > 0 for row in rows)
