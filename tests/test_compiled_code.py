"""The folder of compiled code that test runs share keeps to its size."""

from __future__ import annotations

import os
import time
from pathlib import Path

import compiled_code
import pytest


def test_the_oldest_files_go_first(tmp_path: Path) -> None:
    now = time.time()
    for k, age in enumerate((90_000, 50_000, 70_000, 5000, 10)):
        (tmp_path / f"f{k}").write_bytes(bytes(100))
        os.utime(tmp_path / f"f{k}", (now - age, now - age))
    compiled_code.shrink(tmp_path, 500)
    assert len(list(tmp_path.iterdir())) == 5
    compiled_code.shrink(tmp_path, 350)
    assert {path.name for path in tmp_path.iterdir()} == {"f1", "f3", "f4"}
    compiled_code.shrink(tmp_path, 0)
    assert [path.name for path in tmp_path.iterdir()] == ["f4"], "a run may need it"
    compiled_code.shrink(tmp_path / "not there")


def test_it_is_not_the_users(monkeypatch: pytest.MonkeyPatch, compiled_code_cache: Path) -> None:
    assert os.environ["YASPS_CACHE"] == str(compiled_code_cache) == str(compiled_code.folder())
    monkeypatch.delenv("YASPS_TEST_CACHE", raising=False)
    assert compiled_code.folder().name == "yasps-tests"
