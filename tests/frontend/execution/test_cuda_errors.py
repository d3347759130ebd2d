"""What goes wrong with scenes on a device, how it is said, and that they work again afterwards."""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import re
from collections.abc import Iterator
from functools import partial

import numpy as np
import pytest
from counting_device import CountingDevice
from cuda_on_host import HostDevice
from device_checks import on_device
from device_scenes import BODY, close_pairs, contact, free, held, lever
from small_scenes import mixed_union, soft_tets

from yasps import DataError, DeviceMemoryError, NoDeviceError, Scene, SceneError

has_cuda = pytest.mark.skipif(
    importlib.util.find_spec("cuda") is None, reason="needs the packages of pip install 'yasps[cuda]'"
)


def has_driver() -> bool:
    try:
        ctypes.CDLL("libcuda.so.1")
    except OSError:
        return False
    return True


@pytest.fixture(scope="module")
def device() -> HostDevice:
    return HostDevice()


# -- what cannot be ----------------------------------------------------------------------------------------


@has_cuda
@pytest.mark.skipif(has_driver(), reason="there is a driver")
def test_without_a_driver_there_is_one_sentence() -> None:
    scene = soft_tets()
    scene._device_name = "cuda"
    for work in (scene.gradient, scene.total_energy, lambda: scene.device, scene.m.v["x"].dot(scene.m.v["x"]).compute):
        with pytest.raises(NoDeviceError, match=r"no NVIDIA driver .*device='cpu' works") as caught:
            work()
        assert "\n" not in str(caught.value)
    made = Scene("s", device="cuda:1")  # a scene can be described anywhere
    made.add_mesh("m").add_primitive("v", 2).add_attribute("x", 3, 1)
    with pytest.raises(NoDeviceError):
        _ = made.device


@pytest.mark.parametrize("name", ["gpu", "CUDA", "cuda:", "cuda:-1", "cuda:x", "cuda 0", ""])
def test_devices_that_do_not_exist(name: str) -> None:
    with pytest.raises(SceneError, match=rf"device={name!r}: it must be \"cpu\", \"cuda\", or \"cuda:N\""):
        Scene("s", device=name)


def test_threads_are_the_processors(device: HostDevice) -> None:
    for chosen in ("cuda", device):
        with pytest.raises(SceneError, match="threads=2: a GPU has its own; leave threads out"):
            Scene("s", device=chosen, threads=2)


def test_a_scene_on_the_processor_has_no_device() -> None:
    with pytest.raises(SceneError, match=r"runs on the CPU: make it with device='cuda'"):
        _ = soft_tets().device


@pytest.mark.parametrize("arch", [None, "sm90", "90", "compute_90", "sm_", "", 90])
@pytest.mark.parametrize("name", ["cuda", "cuda:0", "cpu", None])
def test_what_compile_does_not_understand(name: str | None, arch: object) -> None:
    if name is None and arch is None:
        assert soft_tets().compile(device=None, arch=None).report.modules
        return
    with pytest.raises(SceneError, match=re.escape(f"compile(device={name!r}, arch={arch!r})")) as caught:
        # No overload takes these: that is what is tried.
        soft_tets().compile(device=name, arch=arch)  # type: ignore[call-overload]
    assert 'device="cuda", arch="sm_90"' in str(caught.value)


@has_cuda
@pytest.mark.parametrize("arch", ["sm_1", "sm_35", "sm_999"])
def test_architectures_that_the_toolkit_does_not_know(arch: str) -> None:
    with pytest.raises(ValueError, match=rf"{arch}.*sm_90"):
        soft_tets().compile(device="cuda", arch=arch)


def test_the_direct_solver_is_not_on_a_device(device: HostDevice) -> None:
    scene = on_device(mixed_union(), device)
    for work in (scene.solve, scene.minimize_energy):
        with pytest.raises(DataError, match=r"solver='direct' runs on the CPU only: take solver='pcg' or 'auto'"):
            work(solver="direct")
    automatic, usual = scene.solve(solver="auto"), scene.solve()
    assert not automatic.report.direct
    for one, other in zip(automatic.directions, usual.directions, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    with pytest.raises(DataError, match="solver must be one of pcg, direct, auto, got 'cg'"):
        scene.solve(solver="cg")


# -- memory ------------------------------------------------------------------------------------------------


def test_out_of_memory_says_how_much_and_for_what() -> None:
    device = HostDevice()
    scene, reference = on_device(mixed_union(), device), mixed_union()
    scene.compile()
    device.most_bytes = device.used
    messages = []
    while True:
        try:
            solution = scene.solve()
            break
        except DeviceMemoryError as error:
            messages.append(str(error))
        needed, free = (int(number) for number in re.findall(r"\d+", messages[-1])[-2:])
        device.most_bytes += needed - free
    purposes = set()
    for message in messages:
        found = re.fullmatch(r"(.+) needs (\d+) bytes, but only (\d+) are free", message)
        assert found, message
        assert int(found[2]) > int(found[3])
        purposes.add(found[1])
    assert {"storage soft.v.x", "values of the Hessian", "solution of a linear system"} & purposes
    assert len(purposes) > 5
    for one, other in zip(solution.gradient, reference.gradient(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def steps(count: int) -> Iterator[int]:
    """Some of so many allocations: the first, the last, and others between them."""
    yield from sorted({0, 1, count - 1, *range(2, count, 4)})


def test_any_allocation_may_fail_and_the_scene_works_afterwards() -> None:
    device = CountingDevice()

    def make() -> Scene:
        return on_device(held(contact(free, lever, pairs=6), 1.0), device)

    def work(scene: Scene) -> list[np.ndarray]:
        solution = scene.solve(1e-20)
        return [*solution.gradient, *solution.directions, scene.hessian().to_scipy().toarray()]

    def compare(found: list[np.ndarray], wanted: list[np.ndarray]) -> None:
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-7 * np.abs(other).max())

    scene = make()
    scene.compile()
    device.allocation_count = 0
    few = work(scene)
    first_time = device.allocation_count
    more_pairs = close_pairs(5, 40, 2 * BODY)
    scene.everything.pairs.connectivities["corners"].update_value(more_pairs)
    device.allocation_count = 0
    many = work(scene)
    later = device.allocation_count
    assert first_time > 40
    assert later >= 8

    for refused in steps(first_time):
        scene = make()
        scene.compile()
        fail_once(device, refused, partial(work, scene))
        compare(work(scene), few)
    for refused in steps(later):
        scene = make()
        work(scene)
        scene.everything.pairs.connectivities["corners"].update_value(more_pairs)
        fail_once(device, refused, partial(work, scene))
        compare(work(scene), many)


def fail_once(device: CountingDevice, refused: int, work: object) -> None:
    """Works while this allocation and its second attempt are refused."""
    device.allocation_count, device.refused = 0, refused
    assert callable(work)
    with pytest.raises(DeviceMemoryError, match=r"\w: \d+ bytes were asked for"):
        work()
    device.refused = None


def test_memory_of_scenes_that_nobody_uses_is_taken_back_when_there_is_no_other() -> None:
    device = HostDevice()
    first = on_device(mixed_union(), device)
    first.gradient()
    device.most_bytes = device.used + 2000
    second = on_device(mixed_union(), device)
    gc.disable()
    try:
        with pytest.raises(DeviceMemoryError):
            second.gradient()
        del first
        second.gradient()
    finally:
        gc.enable()
