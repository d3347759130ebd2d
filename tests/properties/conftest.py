"""Property tests: the hypothesis profiles "ci" and "nightly", and the fast compiler of generated scenes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # the helper modules of this folder, as in tests/conftest.py

from cuda_on_host import FLAGS, HostDevice
from profiles import IS_NIGHTLY, register

from yasps.runtime.build.toolchain import DEFAULT_FLAGS, find_compiler
from yasps.runtime.core.library import Runtime, load_runtime

register()


@pytest.fixture(scope="session")
def runtime() -> Runtime:
    """The solver runtime of all generated scenes.

    ci: without optimisation, because compiling is nearly all the time they take. nightly: with the user's flags.
    """
    flags = DEFAULT_FLAGS if IS_NIGHTLY else ("-O0", *DEFAULT_FLAGS[1:])
    return load_runtime(find_compiler(flags), 2)


@pytest.fixture(scope="session")
def device() -> HostDevice:
    """The device that all scenes for devices run on; flags as for `runtime`."""
    return HostDevice(flags=("-O1", *FLAGS[1:]) if IS_NIGHTLY else FLAGS)
