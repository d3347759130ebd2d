"""What all tests share: the folder of compiled code, helper modules that can be imported, and what `slow` means."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

# pytest imports test files one by one (importlib mode), and xDSL installs a package `tests` of its own: our helper
# modules are found as plain top-level modules instead.
sys.path.insert(0, str(Path(__file__).parent / "helpers"))

import compiled_code

HERE = Path(__file__).parent
QUICK = ("dialects", "passes", "frontend/language", "golden", "mutations")
"""Folders whose tests are not slow unless they say so; neither are those of the files beside this one."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--update-golden`, of tests/golden."""
    parser.addoption("--update-golden", action="store_true", help="write the files of tests/golden anew")


@pytest.hookimpl(tryfirst=True)  # before -m looks at the markers
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks as slow what is in another folder than QUICK, and what is nightly."""
    for item in items:
        folder = item.path.relative_to(HERE).parent.as_posix()
        is_quick = folder == "." or f"{folder}/".startswith(tuple(f"{name}/" for name in QUICK))
        if not is_quick or item.get_closest_marker("nightly"):
            item.add_marker("slow")


def pytest_collection_finish() -> None:
    """Takes what modules and the list of tests hold from the garbage collector, which a device without memory runs."""
    gc.collect()
    gc.freeze()


def pytest_sessionstart() -> None:
    """Makes room among what earlier runs compiled, once for all workers."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        compiled_code.shrink(compiled_code.folder())


@pytest.fixture(scope="session", autouse=True)
def compiled_code_cache() -> Iterator[Path]:
    """YASPS_CACHE in the folder that all test runs share."""
    folder = compiled_code.folder()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("YASPS_CACHE", str(folder))
        patch.delenv("YASPS_DUMP_IR", raising=False)
        yield folder
