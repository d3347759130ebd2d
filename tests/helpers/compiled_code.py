"""The folder of compiled code that all test runs share: files there are named by their content, so none is out of date.

It is never the user's own (`YASPS_CACHE`).
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import platformdirs

MOST_BYTES = 1 << 30
"""A run after every change of the headers that all kernels include adds about 100 MB."""
_IN_USE = 3600.0
"""Seconds for which a file may be needed by a run that made it."""


def folder() -> Path:
    """What YASPS_TEST_CACHE names, else `yasps-tests` among the user's caches."""
    return Path(os.environ.get("YASPS_TEST_CACHE") or platformdirs.user_cache_dir("yasps-tests")).absolute()


def shrink(folder: Path, most_bytes: int = MOST_BYTES) -> None:
    """Deletes the oldest files until the folder holds at most so many bytes; what is less than an hour old stays."""
    if not folder.is_dir():
        return
    files = []
    with os.scandir(folder) as entries:
        for entry in entries:
            try:
                if entry.is_file(follow_symlinks=False):
                    files.append((entry.stat(), entry.path))
            except FileNotFoundError:  # another run was faster: its temporary file has its name now, or it shrinks too
                continue
    total = sum(stat.st_size for stat, _ in files)
    newest = time.time() - _IN_USE
    for stat, path in sorted(files, key=lambda file: file[0].st_mtime):
        if total <= most_bytes or stat.st_mtime > newest:
            return
        Path(path).unlink(missing_ok=True)
        total -= stat.st_size
