"""The benchmark `unions`: pinning vertices changes what moves and not the energy, and a tiny run works."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import unions
from benchmarks.__main__ import main


@pytest.mark.nightly
def test_pinned_vertices_are_unknowns_no_more() -> None:
    for kinds in unions.problems(20).values():
        free, pinned = (kinds[kind]() for kind in ("free", "pinned"))
        assert pinned.total_energy() == pytest.approx(free.total_energy(), rel=1e-12)
        assert free.static_matrix.size - pinned.static_matrix.size == 3 * unions.PINNED


@pytest.mark.nightly
def test_tiny_run(tmp_path: Path) -> None:
    assert main(["unions", "--size", "20", "--repeats", "1", "--json", str(tmp_path / "rows.json")]) == 0
    rows = json.loads((tmp_path / "rows.json").read_text())
    for energy in ("hinge", "Baraff-Witkin", "point-triangle"):
        assert {row["case"].split(": ")[0] for row in rows if row["case"].startswith(energy)} >= {
            f"{energy}, free",
            f"{energy}, pinned",
        }
    assert sum(row["case"].startswith("compile") and row["case"].endswith(": cold") for row in rows) == 5
