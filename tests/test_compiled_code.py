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


def test_files_that_another_run_takes_away_are_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(3):
        (tmp_path / f"f{k}").write_bytes(bytes(100))
        os.utime(tmp_path / f"f{k}", (1.0, 1.0))
    (tmp_path / "gone").symlink_to(tmp_path / "nothing")
    real = os.DirEntry.stat
    scan = os.scandir

    class Entry:
        """Of a file that is deleted before it is looked at."""

        def __init__(self, entry: os.DirEntry[str]) -> None:
            self.path, self._entry = entry.path, entry

        def is_file(self, *, follow_symlinks: bool) -> bool:
            return self._entry.is_file(follow_symlinks=follow_symlinks)

        def stat(self) -> os.stat_result:
            if self.path.endswith("f1"):
                raise FileNotFoundError(self.path)
            return real(self._entry)

    class Entries:
        def __init__(self, folder: Path) -> None:
            self._scan = scan(folder)

        def __enter__(self) -> list[Entry]:
            return [Entry(entry) for entry in self._scan]

        def __exit__(self, *_: object) -> None:
            self._scan.close()

    with monkeypatch.context() as patch:
        patch.setattr(os, "scandir", Entries)
        compiled_code.shrink(tmp_path, 0)
    assert sorted(os.listdir(tmp_path)) == ["f1", "gone"]


def test_it_is_not_the_users(monkeypatch: pytest.MonkeyPatch, compiled_code_cache: Path) -> None:
    assert os.environ["YASPS_CACHE"] == str(compiled_code_cache) == str(compiled_code.folder())
    monkeypatch.delenv("YASPS_TEST_CACHE", raising=False)
    assert compiled_code.folder().name == "yasps-tests"
