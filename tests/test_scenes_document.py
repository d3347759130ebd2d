"""docs/scenes.md: its table is what its tool makes of the runs, and its scene runs."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from yasps.program import CheckFailedError

ROOT = Path(__file__).parents[1]
DOCUMENT = ROOT / "docs" / "scenes.md"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    """docs/update_scenes.py."""
    spec = importlib.util.spec_from_file_location("update_scenes", ROOT / "docs" / "update_scenes.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def program() -> dict[str, Any]:
    """The scene of the document."""
    (code,) = re.findall(r"^```python\n(.*?)^```", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {"__name__": "falling_box"}
    exec(compile(code, "falling_box.py", "exec"), names)
    return names


def test_the_table_is_that_of_the_runs(tool: ModuleType) -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    runs = [tool.read_run(file) for file in sorted((ROOT / "docs" / "scenes").glob("*.json"))]
    assert text == tool.updated(text, runs), "run `python docs/update_scenes.py`"


@pytest.mark.slow
def test_the_scene_of_the_document_runs_and_gets_a_line(
    program: dict[str, Any],
    tool: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    flags = ["--size", "1", "--frames", "20", "--headless", "--threads", "1", "--output", str(tmp_path / "out")]
    assert program["main"](flags) == 0
    assert "the box lies on the ground" in capsys.readouterr().out
    for place, where in (("RUNS", "scenes"), ("DOCUMENT", "scenes.md")):
        monkeypatch.setattr(tool, place, tmp_path / where)
    shutil.copy(DOCUMENT, tmp_path / "scenes.md")
    run = tmp_path / "out" / "falling_box.json"
    assert tool.main([str(run)]) == 0
    line = "| `yasps run falling_box --size 1 --frames 20` | 8 | 6 tetra | 20 | "
    text = (tmp_path / "scenes.md").read_text(encoding="utf-8")
    assert text.count(line) == 1
    assert [file.name for file in (tmp_path / "scenes").iterdir()] == ["falling_box-size-1-frames-20.json"]
    assert tool.main([str(run)]) == 0
    assert (tmp_path / "scenes.md").read_text(encoding="utf-8") == text
    assert tool.main([str(tmp_path / "none.json")]) == 1
    assert "none.json is not what a scene writes" in capsys.readouterr().err
    run.write_text(json.dumps(json.loads(run.read_text(encoding="utf-8")) | {"passed": False}), encoding="utf-8")
    assert tool.main([str(run)]) == 1
    assert "is of a run that failed its check" in capsys.readouterr().err
    assert (tmp_path / "scenes.md").read_text(encoding="utf-8") == text


@pytest.mark.slow
def test_its_check_can_fail(program: dict[str, Any]) -> None:
    options = program["PROGRAM"].options(["--size", "1"])
    with pytest.raises(CheckFailedError, match=r"after 0.00 s the box is 20.00 mm above the ground"):
        program["check"](program["build"](options), options)
