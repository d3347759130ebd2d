"""The class Gpu where there is none: cuda.bindings and cuda.core as they are, but for functions stood in for."""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from yasps.runtime.cuda_device import Gpu, GpuKernel
from yasps.runtime.device import BLOCK, DeviceArray, DeviceError, DeviceMemoryError
from yasps.runtime.toolchain import Source

if importlib.util.find_spec("cuda") is None:
    pytest.skip("needs the packages of pip install 'yasps[cuda]'", allow_module_level=True)

from cuda import core
from cuda.bindings import driver
from cuda.core._kernel_arg_handler import ParamHolder
from fake_driver import STREAM, FakeCore, FakeDriver


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeDriver:
    """The driver's functions; monkeypatch refuses names that do not exist."""
    made = FakeDriver()
    for name in vars(FakeDriver):
        if name.startswith("cu"):
            monkeypatch.setattr(driver, name, made.stand_in(name))
    return made


@pytest.fixture
def fake_core(monkeypatch: pytest.MonkeyPatch) -> FakeCore:
    made = FakeCore()
    real = {name: hasattr(core.Device, name) for name in ("set_current", "create_stream")}
    assert all(real.values())
    assert hasattr(core.Stream, "handle")
    monkeypatch.setattr(core, "Device", made.device)
    return made


@pytest.fixture
def gpu(fake: FakeDriver, fake_core: FakeCore) -> Gpu:
    made = Gpu(1)
    made._launch = fake_core.launch
    # What is collected after the test meets the stand-ins too.
    made._driver = SimpleNamespace(**{name: getattr(driver, name) for name in dir(driver) if name[:2] in ("cu", "CU")})
    fake.calls.clear()
    return made


def test_which_gpu_it_is(gpu: Gpu, fake_core: FakeCore) -> None:
    assert (gpu.name, gpu.architecture) == ("GPU 1", "sm_90")
    assert set(fake_core.current) == {1}


# -- memory ------------------------------------------------------------------------------------------------


def test_numbers_go_there_and_come_back(gpu: Gpu, fake: FakeDriver) -> None:
    numbers = np.random.default_rng(0).standard_normal((5, 3))
    first = DeviceArray(gpu, np.float64, "numbers").upload(numbers)
    second = DeviceArray(gpu, np.float64, "others").resize(5, 3)
    gpu.copy(first.address, second.address, first.nbytes)
    np.testing.assert_array_equal(second.download(), numbers)
    assert fake.names()[-2:] == ["cuMemcpyDtoHAsync", "cuStreamSynchronize"]  # waits after the copy
    second.clear()
    np.testing.assert_array_equal(second.download(), np.zeros((5, 3)))
    np.testing.assert_array_equal(first.download(), numbers)
    assert sorted(len(buffer) for buffer in fake.memory.values()) == [120, 120]


def test_memory_is_given_back(gpu: Gpu, fake: FakeDriver) -> None:
    array = DeviceArray(gpu, np.int32, "indices").resize(10)
    before = array.address
    array.resize(5)
    assert array.address == before
    assert not fake.of("cuMemFreeAsync")
    array.resize(100)
    assert fake.names()[-2:] == ["cuMemFreeAsync", "cuMemAllocAsync"], "old and new need not fit together"
    assert [len(buffer) for buffer in fake.memory.values()] == [500]
    del array
    assert not fake.memory


def test_out_of_memory_says_how_much_for_what(gpu: Gpu, fake: FakeDriver) -> None:
    taken = DeviceArray(gpu, np.uint8, "something").resize(400_000)
    with pytest.raises(DeviceMemoryError) as caught:
        DeviceArray(gpu, np.float64, "values of the Hessian").resize(100_000)
    assert str(caught.value) == (
        "values of the Hessian: 0.8 MB were asked for, but of the 1 MB of GPU 1 only 0.6 MB are free"
    )
    del taken
    array = DeviceArray(gpu, np.float64, "values of the Hessian").resize(100)
    array.resize(110_000)  # a quarter more than that is asked for first, for which there is no room
    assert [size for size, _ in fake.of("cuMemAllocAsync")][-2:] == [1_100_000, 880_000]


def test_other_errors_name_the_function_and_the_error(gpu: Gpu, fake: FakeDriver) -> None:
    fake.status["cuMemAllocAsync"] = driver.CUresult.CUDA_ERROR_ILLEGAL_ADDRESS
    with pytest.raises(DeviceError, match="no memory for indices: CUDA_ERROR_ILLEGAL_ADDRESS"):
        DeviceArray(gpu, np.int32, "indices").resize(10)
    fake.status = {"cuStreamSynchronize": driver.CUresult.CUDA_ERROR_ILLEGAL_ADDRESS}
    with pytest.raises(DeviceError, match=r"GPU 1 failed in cuStreamSynchronize: CUDA_ERROR_ILLEGAL_ADDRESS\. After"):
        gpu.synchronize()
    array = DeviceArray(gpu, np.int32, "indices").resize(10)
    fake.status = {"cuMemFreeAsync": driver.CUresult.CUDA_ERROR_ILLEGAL_ADDRESS}
    del array  # where an error could only be printed
    assert fake.names()[-1] == "cuMemFreeAsync"


def test_nothing_is_freed_when_the_process_ends(gpu: Gpu, fake: FakeDriver, monkeypatch: pytest.MonkeyPatch) -> None:
    array = DeviceArray(gpu, np.int32, "indices").resize(10)
    graph = gpu.record(lambda: None)
    fake.calls.clear()
    monkeypatch.setattr(sys, "is_finalizing", lambda: True)
    del array, graph
    assert not fake.calls


# -- launches ----------------------------------------------------------------------------------------------


def test_launches_cover_all_threads(gpu: Gpu, fake_core: FakeCore) -> None:
    kernel = GpuKernel("k", object())
    for threads, block, grid in ((1, BLOCK, 1), (128, BLOCK, 1), (129, BLOCK, 2), (1000, 32, 32)):
        gpu.launch(kernel, threads, [1], block=block)
        stream, config, function, _ = fake_core.launches[-1]
        assert int(stream.handle) == STREAM
        assert function is kernel.function
        assert isinstance(config, core.LaunchConfig)
        assert (config.grid, config.block) == ((grid, 1, 1), (block, 1, 1))
    count = len(fake_core.launches)
    gpu.launch(kernel, 0, [1])
    assert len(fake_core.launches) == count


def test_arguments_are_64_bits_wide(gpu: Gpu, fake_core: FakeCore) -> None:
    """As cuda.core lays them out for the driver: an address of each."""
    given: list[int | float] = [0x7F0000001000, -1, 2.5, 0, 1.0, 2**62]
    gpu.launch(GpuKernel("k", object()), 5, given)
    holder = ParamHolder(fake_core.launches[-1][3])
    places = (ctypes.c_void_p * len(given)).from_address(holder.ptr)
    for place, argument in zip(places, given, strict=True):
        c_type = ctypes.c_double if isinstance(argument, float) else ctypes.c_int64
        assert c_type.from_address(place or 0).value == argument


def test_programs_are_compiled_for_the_gpu_and_loaded(gpu: Gpu, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[bytes] = []

    class FakeCode:
        """As cuda.core.ObjectCode."""

        @staticmethod
        def from_cubin(code: bytes) -> FakeCode:
            loaded.append(code)
            return FakeCode()

        def get_kernel(self, name: str) -> str:
            return f"function {name}"

    assert all(hasattr(core.ObjectCode, name) for name in ("from_cubin", "get_kernel"))
    monkeypatch.setattr(core, "ObjectCode", FakeCode)
    module = Source("halve", 'extern "C" __global__ void halve(double* p) { p[threadIdx.x] *= 0.5; }\n')
    program = gpu.load([module], [])
    assert [row.name for row in program.rows] == ["halve", "cub", "link"]
    assert loaded[0][:4] == b"\x7fELF"
    assert b"halve" in loaded[0]
    kernel = program.kernel("halve")
    assert (kernel.name, kernel.function) == ("halve", "function halve")
    assert program.kernel("halve") is kernel
    with pytest.raises(KeyError, match="third"):
        program.kernel("third")
    assert gpu._cub is not None
    assert gpu._cub.yasps_sort_pairs
    assert gpu._cub.yasps_exclusive_sum


# -- graphs ------------------------------------------------------------------------------------------------


def test_a_graph_is_recorded_once_and_launched_often(gpu: Gpu, fake: FakeDriver, fake_core: FakeCore) -> None:
    array = DeviceArray(gpu, np.float64, "numbers").upload(np.ones(4))
    fake.calls.clear()

    def work() -> None:
        array.clear()
        gpu.launch(GpuKernel("k", object()), 4, [array.address])

    graph = gpu.record(work)
    recorded = ["cuStreamBeginCapture", "cuMemsetD8Async", "cuStreamEndCapture", "cuGraphInstantiate", "cuGraphDestroy"]
    assert fake.names() == recorded
    assert fake.of("cuStreamBeginCapture")[0][1] == driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_THREAD_LOCAL
    assert len(fake_core.launches) == 1
    fake.calls.clear()
    graph.launch()
    graph.launch()
    assert fake.names() == ["cuGraphLaunch"] * 2
    del graph
    assert fake.names()[-1] == "cuGraphExecDestroy"


def test_an_error_while_a_graph_is_recorded(gpu: Gpu, fake: FakeDriver) -> None:
    """It is what is told; the stream records no longer, and nothing is left behind."""

    array = DeviceArray(gpu, np.float64, "numbers")

    def work() -> None:
        raise KeyError("wrong")

    def grow() -> None:
        array.resize(4)

    for status in ({}, {"cuStreamEndCapture": driver.CUresult.CUDA_ERROR_STREAM_CAPTURE_INVALIDATED}):
        fake.calls.clear()
        fake.status = status
        with pytest.raises(KeyError, match="wrong"):
            gpu.record(work)
        rest = [] if status else ["cuGraphDestroy"]
        assert fake.names() == ["cuStreamBeginCapture", "cuStreamEndCapture", *rest]
    fake.status = {}
    with pytest.raises(DeviceError, match="memory for numbers was asked for while a graph was recorded"):
        gpu.record(grow)
    gpu.record(lambda: None)
    fake.status = {"cuGraphInstantiate": driver.CUresult.CUDA_ERROR_INVALID_VALUE}
    with pytest.raises(DeviceError, match="cuGraphInstantiate: CUDA_ERROR_INVALID_VALUE"):
        gpu.record(lambda: None)
    assert fake.names()[-1] == "cuGraphDestroy"
    fake.status = {}
    grow()
    assert array.size == 4


def test_memory_freed_while_a_graph_is_recorded_is_given_back_afterwards(gpu: Gpu, fake: FakeDriver) -> None:
    arrays = [DeviceArray(gpu, np.float64, "numbers").resize(4)]
    fake.calls.clear()
    gpu.record(arrays.clear)
    assert fake.names().index("cuMemFreeAsync") > fake.names().index("cuStreamEndCapture")
    assert not fake.memory


# -- CUB ---------------------------------------------------------------------------------------------------


class FakeCub:
    """As the library of cub.cu: asks for 1000 bytes of scratch memory, then notes what it works on."""

    def __init__(self, status: int = 0) -> None:
        self.status = status
        self.worked: list[tuple[Any, ...]] = []

    def yasps_sort_pairs(self, scratch: Any, size: Any, *arguments: Any) -> int:
        return self.work(scratch, size, arguments)

    def yasps_exclusive_sum(self, scratch: Any, size: Any, *arguments: Any) -> int:
        return self.work(scratch, size, arguments)

    def work(self, scratch: Any, size: Any, arguments: tuple[Any, ...]) -> int:
        if scratch.value is None:
            size._obj.value = 1000
        else:
            assert size._obj.value == 1000
            self.worked.append((scratch.value, *arguments))
        return self.status


def test_sorts_and_sums_get_the_memory_they_ask_for(gpu: Gpu, fake: FakeDriver) -> None:
    cub = FakeCub()
    gpu._cub = cub  # type: ignore[assignment]
    gpu.sort_pairs((1, 2), (3, 4), 5, 6)
    gpu.exclusive_sum(7, 7, 8)
    assert [size for size, _ in fake.of("cuMemAllocAsync")] == [1000]  # kept for the second
    (scratch,) = fake.memory
    sort, total = cub.worked
    assert [sort[0], *(argument.value for argument in sort[1:])] == [scratch, 1, 2, 3, 4, 5, 6, STREAM]
    assert [type(argument) for argument in sort[5:7]] == [ctypes.c_long, ctypes.c_int]  # as cub.cu declares them
    assert [total[0], *(argument.value for argument in total[1:])] == [scratch, 7, 7, 8, STREAM]
    gpu.sort_pairs((1, 2), (3, 4), 0, 6)
    gpu.exclusive_sum(7, 7, 0)
    assert len(cub.worked) == 2, "nothing to do"
    gpu._cub = FakeCub(status=700)  # type: ignore[assignment]
    with pytest.raises(DeviceError, match="GPU 1 failed in yasps_sort_pairs: CUDA error 700"):
        gpu.sort_pairs((1, 2), (3, 4), 5, 6)
