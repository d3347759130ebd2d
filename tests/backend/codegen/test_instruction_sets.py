"""The kernels as processors with narrower registers run them, and block shapes of all kinds."""

from __future__ import annotations

import platform
from collections.abc import Callable

import numpy as np
import pytest
from small_scenes import SCENES

from yasps import Scene
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.build.toolchain import DEFAULT_FLAGS, find_compiler
from yasps.runtime.core.library import load_runtime

Check = Callable[[Scene], CpuScene]


@pytest.mark.skipif(platform.machine() != "x86_64", reason="registers of other widths are an x86 matter")
@pytest.mark.parametrize(
    "flags",
    [
        ("-mno-avx512f",),
        ("-mno-avx", "-O0"),  # packs in registers of two numbers: optimised, the runtime alone takes 20 s to compile
        pytest.param(("-mno-avx",), marks=pytest.mark.nightly),
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("name", SCENES)
def test_scenes(name: str, flags: tuple[str, ...], agrees_with_interpreter: Check) -> None:
    scene = SCENES[name]("clamp")
    scene._runtime = load_runtime(find_compiler((*DEFAULT_FLAGS, *flags)))
    agrees_with_interpreter(scene)


@pytest.mark.parametrize("shape", [(1, 1), (2, 1), (2, 2), (5, 1), (3, 3)])
def test_pairs_of_blocks_of_any_shape(shape: tuple[int, int], agrees_with_interpreter: Check) -> None:
    """Blocks of 3x3 and of this shape's size, off the diagonal in both orders, and slots that are the same unknowns."""
    random = np.random.default_rng(sum(shape))
    rows, cols = shape
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    points, others, elements = (mesh.add_primitive(name, count) for name, count in (("v", 6), ("w", 5), ("e", 19)))
    x = points.add_attribute("x", 3, 1, value=random.random((6, 3, 1)))
    y = others.add_attribute("y", rows, cols, value=random.random((5, rows, cols)))
    ends = elements.add_connectivity("ends", points, random.integers(0, 6, (19, 2)), 2)
    sides = elements.add_connectivity("sides", others, random.integers(0, 5, (19, 2)), 2)
    p = elements.add_attribute("p", through=ends, source=x)
    q = elements.add_attribute("q", through=sides, source=y)
    both = p.row(0).dot(p.row(1)) + p.row(1).sum() ** 2
    mixed = q.row(0).dot(q.row(1)) * p.row(0).sum() + q.row(1).dot(q.row(1)) ** 2
    scene.add_energy(elements.add_attribute("E", computed_attribute=both * both + mixed), projection="none")
    scene.add_minimize_target([x, y])
    agrees_with_interpreter(scene)
