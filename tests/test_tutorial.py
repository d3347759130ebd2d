"""docs/tutorial.ipynb runs from its first cell to its last, and shows what it says."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[1] / "docs" / "tutorial.ipynb"


def outputs_of(cell: nbformat.NotebookNode) -> str:
    """All that a cell has shown, as text and as HTML."""
    found = []
    for output in cell.get("outputs", []):
        found.append(output.get("text", ""))
        found += [str(content) for kind, content in output.get("data", {}).items() if kind.startswith("text/")]
    return "\n".join(found)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_the_tutorial_runs() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") for cell in notebook.cells), "the notebook is kept without outputs"
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    shown = [outputs_of(cell) for cell in notebook.cells]
    everything = "\n".join(shown)
    (beads,) = (text for text in shown if "scene hanging" in text)
    for words in (
        "<td>chain.springs</td><td>5</td>",
        "<td>target</td>",
        "computed, energy",
        "JOIN of chain.points.position",
    ):
        assert words in beads
    assert float(re.findall(r"largest error (\S+) m", everything)[0]) < 1e-9
    before, after = (text for text in shown if "simulation of falling_box" in text)
    assert "frame 0, t = 0 s" in before
    assert "frame 25, t = 0.25 s" in after
    assert "<td>box</td><td>SoftBody</td><td>27</td>" in after
    assert "25/25" in everything  # the bar
    assert "the same: True" in everything
    heights = [float(one) for one in re.findall(r"lowest point +(\S+) mm", everything)]
    assert heights[0] == pytest.approx(20.0)
    assert 0 < heights[-1] < 1
