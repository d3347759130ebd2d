"""Lines of code: what counts as one, and how few lines the paper's scenes add to each other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.lines_of_code import (
    OTHER_PART,
    PAPER,
    PARTS,
    SCENES,
    CodeLine,
    added,
    added_lines,
    by_part,
    code_lines,
    scene_lines,
)

ROOT = Path(__file__).resolve().parents[2]
SOURCE = '''"""A module
of two lines."""

import os  # a comment

# --- Collision ---
def f(x):
    """One line."""

    # another comment
    text = """text
    is code"""
    return (
        x
    )

# --- Program ---
class A:
    "Also a docstring."
    b = 1
'''


def test_comments_blank_lines_and_docstrings_are_no_code() -> None:
    assert code_lines(SOURCE) == [
        CodeLine("setup", "import os"),
        *(CodeLine("collision", text) for text in ("def f(x):", 'text = """text', 'is code"""', "return (", "x", ")")),
        CodeLine("program", "class A:"),
        CodeLine("program", "b = 1"),
    ]
    assert by_part(code_lines(SOURCE)) == {"setup": 1, "collision": 6, "program": 2}


def test_a_part_that_there_is_not() -> None:
    with pytest.raises(ValueError, match="line 2: there is no part 'Colision'"):
        code_lines("a = 1\n# --- Colision ---\nb = 2\n")


def test_new_and_changed_lines_are_added() -> None:
    before = code_lines("a = 1\nb = 2\nc = 3\n")
    after = code_lines("a = 1  # as before\nif a:\n    b = 2\nc = 4\nd = 5\n")
    assert [line.text for line in added(before, after)] == ["if a:", "c = 4", "d = 5"]


@pytest.mark.parametrize("by_hand", [False, True])
@pytest.mark.parametrize("scene", SCENES)
def test_every_line_of_the_scenes_is_in_a_part(scene: str, by_hand: bool) -> None:
    counts = by_part(scene_lines(scene, by_hand=by_hand))
    assert counts.total() == counts[OTHER_PART] + sum(counts[part] for part in PARTS)
    assert counts["setup"] > 5
    assert counts["integration"] > 10
    assert counts["initialisation"] > 5


@pytest.mark.parametrize(
    ("scene", "by_hand", "most"), [("9.2", False, 15), ("9.3", False, 30), ("9.2", True, 60), ("9.3", True, 80)]
)
def test_a_kind_of_body_costs_few_lines(scene: str, by_hand: bool, most: int) -> None:
    """The paper: 130 and 140."""
    lines = added_lines(scene, by_hand=by_hand)
    assert 10 <= len(lines) <= most, "\n".join(line.text for line in lines)
    added_energies = [line for line in lines if line.part == "energy definition"]
    assert bool(added_energies) is by_hand
    assert not [line for line in lines if line.part in ("collision", "newton iteration")][1:]


def test_the_document_says_how_many() -> None:
    text = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    for by_hand, which in ((False, "with the kit"), (True, "by hand")):
        for scene in SCENES:
            counts = by_part(scene_lines(scene, by_hand=by_hand))
            cells = [str(counts[part] or "") for part in PARTS]
            cells.append("" if scene == "9.1" else str(len(added_lines(scene, by_hand=by_hand))))
            cells.append(str(PAPER[scene]) if by_hand and scene in PAPER else "")
            row = re.sub("  +", " ", f"| {scene} {which} | {' | '.join(cells)} |")
            assert row in text, row
