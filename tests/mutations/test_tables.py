"""The tables of mutations fit the code; with -m nightly, every mutation is seen by its tests."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from tables import AREAS

ROOT = Path(__file__).resolve().parents[2]
ALL = [mutation for mutations in AREAS.values() for mutation in mutations]


def test_every_right_text_stands_once_in_its_file() -> None:
    texts = {mutation.file: (ROOT / mutation.file).read_text(encoding="utf-8") for mutation in ALL}
    wrong = [(mutation.title, count) for mutation in ALL if (count := texts[mutation.file].count(mutation.right)) != 1]
    assert wrong == []
    assert all(mutation.right != mutation.wrong for mutation in ALL)


def test_titles_differ_and_tests_exist() -> None:
    for area, mutations in AREAS.items():
        assert len({mutation.title for mutation in mutations}) == len(mutations) > 0, area
    for name in {test for mutation in ALL for test in mutation.tests}:
        file, _, function = name.partition("::")
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert not function or function.partition("[")[0] in functions, name


@pytest.mark.nightly
@pytest.mark.parametrize("area", AREAS)
def test_every_mutation_is_seen(area: str) -> None:
    command = [sys.executable, str(Path(__file__).with_name("check.py")), area]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
