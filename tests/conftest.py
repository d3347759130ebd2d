"""What all tests share: a cache of compiled code of this run's own, and helper modules that can be imported."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

# pytest imports test files one by one (importlib mode), and xDSL installs a package `tests` of its own: our helper
# modules are found as plain top-level modules instead.
sys.path.insert(0, str(Path(__file__).parent / "helpers"))


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--update-golden`, of tests/golden."""
    parser.addoption("--update-golden", action="store_true", help="write the files of tests/golden anew")


@pytest.fixture(scope="session", autouse=True)
def compiled_code_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """YASPS_CACHE in this run's temporary folder, shared by all its tests and by the workers of pytest-xdist; in the
    folder that YASPS_TEST_CACHE names where several runs shall share it (tests/mutations/check.py)."""
    base = tmp_path_factory.getbasetemp()
    own = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "compiled-code"
    folder = Path(os.environ.get("YASPS_TEST_CACHE", own))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("YASPS_CACHE", str(folder))
        patch.delenv("YASPS_DUMP_IR", raising=False)
        yield folder
