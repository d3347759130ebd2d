"""The benchmark `mat_twist`: a small run works, and its rows are what they say."""

from __future__ import annotations

import pytest

from benchmarks import mat_twist
from benchmarks.measure import Row, Settings


@pytest.mark.slow
def test_tiny_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mat_twist, "SPEED", 400.0)
    monkeypatch.setattr(mat_twist, "TIMES_AS_MANY", (1, 4))
    report = mat_twist.run(Settings(size=36, repeats=6, threads=1))
    rows: dict[tuple[str, str], Row] = {(row.case, row.unit): row for row in report.rows}
    assert rows["apart, 36 vertices: contacts", "1/vertex"].value == 0
    assert rows["touching, 144 vertices: contacts", "1/vertex"].value > 0
    both = sum(rows[f"{phase}, 144 vertices: frames", ""].value for phase in ("apart", "touching"))
    assert both == 12
    for stage in ("energy", "linear solver", "candidates of a whole step", "other"):
        small, large = (rows[f"touching, {stage}, {n} vertices", "us/vertex"].value for n in (36, 144))
        assert small > 0
        assert rows[f"touching, {stage}, 144 vertices", "x"].value == pytest.approx(large / small)
