"""Random scenes: what the passes make of them keeps its meaning, and the kernels compute it, also those for devices."""

from __future__ import annotations

from cuda_on_host import HostDevice
from hypothesis import given
from layered_scenes import lever_scene, ring_scene
from profiles import examples
from random_scenes import SceneProgram, scenes
from scene_checks import check_device_kernels, check_kernels, check_passes

from yasps.runtime.core.library import Runtime


@examples(ci=100, nightly=2000)
@given(program=scenes())
def test_passes(program: SceneProgram) -> None:
    check_passes(program.build())


@examples(ci=60, nightly=2000)
@given(program=scenes())
def test_kernels(program: SceneProgram, runtime: Runtime) -> None:
    check_kernels(program.build(), runtime)


@examples(ci=20, nightly=1000)
@given(program=scenes())
def test_kernels_of_devices(program: SceneProgram, device: HostDevice) -> None:
    check_device_kernels(program.build(), device)


def test_layers_of_layers_on_devices(device: HostDevice) -> None:
    """Curvature behind curvature and behind means: few examples have that."""
    check_device_kernels(lever_scene("none", nested=True), device)
    check_device_kernels(ring_scene("mean", nonlinear=True, projection="none"), device)
