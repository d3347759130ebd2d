"""The benchmark `parts`: docs/parts.md has the widths of today, and the parts are not at rest."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from small_scenes import dense_assembly, emit

from benchmarks import parts
from benchmarks.parts import PARTS, PartRow, projected_width
from yasps.passes.pipeline import run_pipeline

DOCUMENT = Path(__file__).parents[2] / "docs" / "parts.md"
IN_EVERY_RUN = ("neo_hookean", "quadratic_bending")


@pytest.mark.parametrize(
    "part",
    [pytest.param(p, marks=[] if p.name in IN_EVERY_RUN else pytest.mark.nightly, id=p.name) for p in PARTS],
)
def test_the_document_has_the_width(part: PartRow) -> None:
    """And where the benchmark measures a part, it has forces and is not projected for nothing."""
    scene, instances = part.scene(12)
    assert instances >= 6
    emitted = emit(scene)
    module = run_pipeline(emitted.module)
    (width,) = re.findall(rf"^\| `{part.name}\(.*\| (\d+) \| \d+ \|$", DOCUMENT.read_text("utf-8"), re.MULTILINE)
    assert projected_width(module) == int(width)
    gradient, hessian = dense_assembly(module, emitted.data)
    assert np.isfinite(hessian).all()
    assert np.abs(gradient).max() > 0


def test_a_small_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "PARTS", PARTS[:1])
    report = parts.run(parts.Settings(6, 1, 1))
    assert [row.implementation for row in report.rows] == ["width of projection", "yasps"]
    assert report.rows[0].value == 9
    assert report.rows[1].value > 0
