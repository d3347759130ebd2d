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
    counts = {mutation.title: texts[mutation.file].count(mutation.right) for mutation in ALL}
    assert {title: count for title, count in counts.items() if count != 1} == {}
    assert all(mutation.right != mutation.wrong for mutation in ALL)


def test_titles_differ_and_tests_exist() -> None:
    assert len({mutation.title for mutation in ALL}) == len(ALL) >= 80
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
