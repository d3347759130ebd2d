"""Random scenes: what the passes make of them keeps its meaning, and the kernels compute it."""

from __future__ import annotations

from hypothesis import given
from profiles import examples
from random_scenes import SceneProgram, scenes
from scene_checks import check_kernels, check_passes

from yasps.runtime.library import Runtime


@examples(ci=100, nightly=2000)
@given(program=scenes())
def test_passes(program: SceneProgram) -> None:
    check_passes(program.build())


@examples(ci=60, nightly=2000)
@given(program=scenes())
def test_kernels(program: SceneProgram, runtime: Runtime) -> None:
    check_kernels(program.build(), runtime)
