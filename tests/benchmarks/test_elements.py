"""The benchmark `elements`: its problem is what it says, and a tiny run works with and without JAX."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import elements
from benchmarks.__main__ import BENCHMARKS, main
from benchmarks.element_problem import box_of_tets, make_problem

KEYS = {"case", "implementation", "threads", "value", "unit"}


def test_without_a_name_all_benchmarks_are_listed_one_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{name}: {benchmark.description}" for name, benchmark in BENCHMARKS.items()]
    assert "elements" in BENCHMARKS


@pytest.mark.parametrize("arguments", [["nothing"], ["elements", "--size", "0"], ["elements", "--repeats", "many"]])
def test_wrong_arguments_are_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert f"'{arguments[-1]}'" in capsys.readouterr().err


def test_a_missing_folder_for_the_json_file_is_told_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["elements", "--json", str(tmp_path / "none" / "rows.json")]) == 2
    assert "there is no folder" in capsys.readouterr().err


def tiny_run(path: Path) -> list[dict[str, object]]:
    arguments = ["elements", "--size", "200", "--repeats", "1", "--threads", "2", "--json", str(path)]
    assert main(arguments) == 0
    rows: list[dict[str, object]] = json.loads(path.read_text())
    for row in rows:
        assert set(row) == KEYS
        assert isinstance(row["threads"], int)
        assert isinstance(row["value"], float)
        assert 0 < row["value"] < np.inf
    return rows


def test_tiny_run_without_jax(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)  # makes `import jax` fail as if it were not there
    rows = tiny_run(tmp_path / "rows.json")
    assert "JAX, which is not installed" in capsys.readouterr().out
    found = {(row["implementation"], row["threads"], row["unit"]) for row in rows}
    assert found == {
        ("yasps", 1, "ns/element"),
        ("yasps", 2, "ns/element"),
        ("copy", 1, "GB/s"),
        ("copy", 2, "GB/s"),
        ("copy", 1, "ns/element"),
        ("copy", 2, "ns/element"),
        ("bytes", 1, "B/element"),
    }
    cases = [str(row["case"]) for row in rows if row["implementation"] == "yasps"]
    assert cases[:6] == ["structure", "structure", "gradient", "gradient", "derived, stored", "derived, assembled"]
    assert sum(case.startswith("projected (") for case in cases) == 3 * len(elements.SHARES)


@pytest.mark.skipif(importlib.util.find_spec("jax") is None, reason="JAX is not installed")
def test_tiny_run_with_jax_compares_numbers_and_adds_its_rows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = tiny_run(tmp_path / "rows.json")
    assert "agree with yasps'" in " ".join(capsys.readouterr().out.split())
    jax = [str(row["case"]) for row in rows if row["implementation"] == "JAX"]
    assert jax[0] == "derived, stored"
    assert len(jax) == 1 + len(elements.SHARES)


def test_different_numbers_are_an_error() -> None:
    ours = np.array([[1.0, 2.0]])
    elements._check_close("gradient", ours, ours * (1 + 1e-12))
    with pytest.raises(elements.PeersDisagreeError, match=r"gradient .* differ by 5\.0e-01 of"):
        elements._check_close("gradient", ours, np.array([[2.0, 2.0]]))


def test_share_is_the_share_of_indefinite_hessians() -> None:
    problem = make_problem(box_of_tets(200), 1)
    amplitude = problem.amplitude_for(0.33)
    problem.deform(amplitude)
    share = problem.projected_share()
    assert 0.3 < share < 0.36
    # H = J^T H_F J with a J of full row rank: as many tets are indefinite in x as in F.
    alone = make_problem(problem.tets.exploded(), 1)
    alone.deform(amplitude)
    alone.compiled.assemble(project=False)
    dense = alone.compiled.static_matrix.to_scipy().toarray()
    blocks = np.stack([dense[k : k + 12, k : k + 12] for k in range(0, len(dense), 12)])
    assert np.count_nonzero(dense) == np.count_nonzero(blocks)
    values = np.linalg.eigvalsh(blocks)
    assert np.mean(values[:, 0] < -1e-10 * values[:, -1]) == share


def test_without_noise_nothing_needs_projection() -> None:
    problem = make_problem(box_of_tets(200), 1)
    problem.deform(problem.amplitude_for(0.0))
    assert problem.projected_share() == 0


def test_bytes_per_element_of_stored_tets() -> None:
    stored = make_problem(box_of_tets(48).exploded(), 1)
    inputs = 4 * 3 * 8 + 4 * 4 + 9 * 8 + 8  # corners, their indices, inverse rest edges, volume
    placement = 4 * 4 + 10 * 8
    results = 12 * 8 + 10 * 9 * 8
    assert elements.bytes_per_element(stored) == inputs + placement + results
