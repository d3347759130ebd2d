"""The benchmark `collision`: the IPC Toolkit finds the same, other results are an error, and a tiny run works."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import collision
from benchmarks.__main__ import main
from benchmarks.element_rows import PeersDisagreeError


def test_other_results_are_an_error() -> None:
    cloth = collision.sheets(400)
    ours, theirs = collision.stages_of_yasps(cloth, 1), collision.stages_of_ipctk(cloth, 1)
    collision.check(ours, theirs)
    assert ours.close > 300
    for other in (
        replace(theirs, nearest=1.001 * theirs.nearest),
        replace(theirs, close=theirs.close // 2),
        replace(theirs, bound=0.4 * ours.bound),
    ):
        with pytest.raises(PeersDisagreeError, match="IPC Toolkit"):
            collision.check(ours, other)


def test_tiny_run(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    assert main(["collision", "--size", "200", "--repeats", "1", "--threads", "2", "--json", str(path)]) == 0
    rows = json.loads(path.read_text())
    assert {(row["case"], row["implementation"], row["threads"]) for row in rows} == {
        (case, who, threads)
        for case in ("candidates", "active set", "step bound")
        for who in ("yasps", "IPC Toolkit")
        for threads in (1, 2)
    }
    assert all(row["value"] > 0 and row["unit"] == "ms" for row in rows)
