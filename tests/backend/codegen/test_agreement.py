"""What kernels and the runtime agree on is said once, in runtime/core/sink.h."""

from __future__ import annotations

import ctypes
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import yasps.backend
import yasps.runtime
from yasps.backend.codegen.preludes import PRELUDES, without_preludes
from yasps.backend.codegen.slots import packed_place
from yasps.backend.cuda.program import DerivativeLaunch
from yasps.runtime.build.toolchain import Source, compile_sources, find_compiler, link
from yasps.runtime.core import sink

PLACE = 'extern "C" long place(long n, long r, long c) { return packed_place(n, r, c); }\n'


def test_a_packed_triangle_has_one_order() -> None:
    compiler = find_compiler()
    linked = link(compile_sources([Source("test.place", sink.TEXT + PLACE)], compiler), compiler)
    place = ctypes.CDLL(str(linked.path)).place
    for n in range(1, 7):
        expected = np.zeros((n, n), int)
        expected[np.triu_indices(n)] = np.arange(n * (n + 1) // 2)
        expected = np.maximum(expected, expected.T)
        for r, c in np.ndindex(n, n):
            assert packed_place(n, r, c) == place(n, r, c) == expected[r, c]


def test_a_launch_says_what_a_kernel_of_derivatives_is_given() -> None:
    given = {field.name for field in fields(DerivativeLaunch)} - {"symbol", "count"}
    assert {name for _, name in sink.DEVICE_FIELDS} == given | {"workspace"}
    assert all(type_.endswith("*") or name == "mode" for type_, name in sink.DEVICE_FIELDS)


@pytest.mark.parametrize("package", [yasps.backend, yasps.runtime])
def test_nobody_else_declares_it(package: object) -> None:
    for path in Path(package.__path__[0]).rglob("*"):  # type: ignore[attr-defined]
        if path.suffix in {".h", ".cuh", ".cpp", ".cu", ".py"} and path.name != "sink.h":
            text = path.read_text(encoding="utf-8")
            for once in ("struct yasps_sink {", "- 1) / 2 + c - r", "- 1) / 2 + q - p", "TileBits ="):
                assert once not in text, f"{path}: {once}"


def test_preludes_are_named_where_they_are_left_out() -> None:
    path = "backend/cpp/preludes/kernel.h"
    assert without_preludes(f"{PRELUDES[path]}rest") == f"// {path} stands here\nrest"
