"""The projection as other processors run it, and with so little memory that rotations are multiplied out."""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps.runtime.build.toolchain import Compiler, compile_sources, link
from yasps.runtime.core.library import LANES, runtime_sources

Project = Callable[[NDArray[np.float64], int], int]

BUILDS = {
    "few rotations": ["-DYASPS_ROTATIONS=0", "-O1"],
    "AVX2": ["-mno-avx512f", "-O1"],
    "SSE2": ["-mno-avx", "-O1"],
}


@pytest.fixture(scope="module", params=BUILDS)
def project(request: pytest.FixtureRequest, compiler: Compiler) -> Project:
    """Projects all matrices of packs of a width."""
    flags = BUILDS[request.param]
    if flags[0].startswith("-m") and platform.machine() != "x86_64":
        pytest.skip("registers of other widths are an x86 matter")
    wanted = {"runtime.projection", "runtime.negative_part"}
    sources = [source for source in runtime_sources() if source.name in wanted]
    assert len(sources) == len(wanted)
    other = compiler.with_flags(*flags)
    library = ctypes.CDLL(str(link(compile_sources(sources, other), other, ("-lm",)).path))
    function = library.yasps_project
    function.restype = ctypes.c_long
    function.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.c_int]

    def run(packed: NDArray[np.float64], width: int) -> int:
        return int(function(packed.ctypes.data, width, packed.shape[0] * LANES, 0))

    return run


@pytest.mark.parametrize("width", [1, 2, 3, 5, 6, 9, 12, 17])
def test_agrees_with_numpy(project: Project, width: int) -> None:
    rng = np.random.default_rng(width)
    count = 7 * LANES
    matrices = rng.standard_normal((count, width, width))
    matrices += matrices.swapaxes(1, 2)
    fit = rng.random(count) < 0.4
    matrices[fit] = np.linalg.matrix_power(matrices[fit], 2) + np.eye(width)
    rows, cols = np.triu_indices(width)
    packed = np.ascontiguousarray(matrices[:, rows, cols].reshape(-1, LANES, len(rows)).transpose(0, 2, 1))
    values, vectors = np.linalg.eigh(matrices)
    assert project(packed, width) == (values[:, 0] < 0).sum()
    expected = ((vectors * np.maximum(values, 0)[:, None, :]) @ vectors.swapaxes(1, 2))[:, rows, cols]
    result = packed.transpose(0, 2, 1).reshape(count, -1)
    assert (result[fit] == matrices[fit][:, rows, cols]).all()
    scale = np.abs(values).max(axis=1, keepdims=True)
    np.testing.assert_allclose(result / scale, expected / scale, rtol=0, atol=2e-14)


def test_not_finite_is_reported(project: Project) -> None:
    packed = np.zeros((5, 21, LANES))
    packed[3, 4, 6] = np.nan
    assert project(packed, 6) == -(1 + 3 * LANES + 6)
