"""The class Gpu where there is none: cuda.bindings as it is, but for the driver's functions, which are stood in for."""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import struct
import sys
import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from yasps import DeviceError, DeviceMemoryError
from yasps.runtime.build.toolchain import Source
from yasps.runtime.device import gpu as cuda_device
from yasps.runtime.device.disposal import Disposal
from yasps.runtime.device.gpu import MOST_ARGUMENTS, Gpu, GpuGraph, GpuKernel
from yasps.runtime.device.protocol import BLOCK, DeviceArray

if importlib.util.find_spec("cuda") is None:
    pytest.skip("needs the packages of pip install 'yasps[cuda]'", allow_module_level=True)

from cuda.bindings import driver
from fake_driver import FUNCTION, STREAM, FakeDriver

OUT_OF_MEMORY = driver.CUresult.CUDA_ERROR_OUT_OF_MEMORY
ILLEGAL_ADDRESS = driver.CUresult.CUDA_ERROR_ILLEGAL_ADDRESS


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeDriver:
    """The driver's functions; monkeypatch refuses names that do not exist."""
    made = FakeDriver()
    monkeypatch.setattr(cuda_device, "_IDLE_STREAMS", {})
    for name in vars(FakeDriver):
        if name.startswith("cu"):
            monkeypatch.setattr(driver, name, made.stand_in(name))
    return made


@pytest.fixture
def gpu(fake: FakeDriver) -> Gpu:
    made = Gpu(1)
    # What is collected after the test meets the stand-ins too.
    made._driver = SimpleNamespace(**{name: getattr(driver, name) for name in dir(driver) if name[:2] in ("cu", "CU")})
    fake.calls.clear()
    return made


def kernel() -> GpuKernel:
    return GpuKernel("k", driver.CUfunction(FUNCTION))


def test_which_gpu_it_is(gpu: Gpu) -> None:
    assert (gpu.name, gpu.architecture, gpu.multiprocessors, gpu.stream_address) == ("GPU 1", "sm_90", 2, STREAM)


def test_the_pool_keeps_what_is_free(fake: FakeDriver) -> None:
    Gpu(1)
    ((_, attribute, value),) = fake.of("cuMemPoolSetAttribute")
    assert attribute == driver.CUmemPool_attribute.CU_MEMPOOL_ATTR_RELEASE_THRESHOLD
    assert int(value) == 2**64 - 1


def test_a_stream_is_used_again(fake: FakeDriver) -> None:
    """It must outlive the memory that was allocated on it, and garbage is collected in any order."""
    first = Gpu(1)
    second = Gpu(1)
    assert len(fake.of("cuStreamCreate")) == 2
    del first
    gc.collect()
    third = Gpu(1)
    assert len(fake.of("cuStreamCreate")) == 2
    assert third.stream_address == second.stream_address == STREAM


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
    said = "values of the Hessian: 0.8 MB were asked for, but of the 1 MB of GPU 1 only 0.6 MB are free"
    assert str(caught.value) == said
    gpu._stack_bytes = 2640
    with pytest.raises(DeviceMemoryError) as caught:
        DeviceArray(gpu, np.float64, "values of the Hessian").resize(100_000)
    assert str(caught.value) == (
        f"{said}; stacks of kernels take 1 MB: 2,640 bytes for each of 512 threads that can run at once"
    )
    del taken
    array = DeviceArray(gpu, np.float64, "values of the Hessian").resize(100)
    array.resize(110_000)  # a quarter more than that is asked for first, for which there is no room
    assert [size for size, _ in fake.of("cuMemAllocAsync")][-3:] == [1_100_000, 1_100_000, 880_000]


def test_what_the_pool_keeps_is_used_before_memory_is_out(gpu: Gpu, fake: FakeDriver) -> None:
    pieces = [DeviceArray(gpu, np.uint8, "a piece").resize(200_000) for _ in range(4)]
    pieces.clear()  # none of them is large enough for what follows
    fake.calls.clear()
    whole = DeviceArray(gpu, np.uint8, "the whole").resize(900_000)
    assert whole.size == 900_000
    assert fake.names() == ["cuMemAllocAsync", "cuCtxSynchronize", "cuMemPoolTrimTo", "cuMemAllocAsync"]


def test_a_launch_for_which_there_was_no_memory_is_tried_once_more(gpu: Gpu, fake: FakeDriver) -> None:
    """Stacks get their memory at a kernel's first launch."""
    fake.status, fake.failures = {"cuLaunchKernel": OUT_OF_MEMORY}, 1
    gpu.launch(kernel(), 5, [1])
    assert fake.names() == ["cuLaunchKernel", "cuCtxSynchronize", "cuMemPoolTrimTo", "cuLaunchKernel"]
    assert len(fake.launches) == 1
    fake.failures = 2
    with pytest.raises(DeviceMemoryError, match="k, but of the 1 MB of GPU 1 only"):
        gpu.launch(kernel(), 5, [1])
    fake.status, fake.failures = {"cuLaunchKernel": OUT_OF_MEMORY, "cuCtxSynchronize": ILLEGAL_ADDRESS}, None
    with pytest.raises(DeviceError, match="failed in cuCtxSynchronize: CUDA_ERROR_ILLEGAL_ADDRESS"):
        gpu.launch(kernel(), 5, [1])


def test_every_error_names_the_function_and_says_what_to_do(gpu: Gpu, fake: FakeDriver) -> None:
    array = DeviceArray(gpu, np.int32, "indices").resize(10)
    graph = gpu.record(lambda: None)
    gpu._cub = FakeCub(status=ILLEGAL_ADDRESS.value)  # type: ignore[assignment]
    asked = {
        "cuMemAllocAsync": lambda: gpu.allocate(10, "indices"),
        "cuMemcpyHtoDAsync": lambda: array.upload(np.zeros(10)),
        "cuMemcpyDtoHAsync": array.download,
        "cuMemcpyDtoDAsync": lambda: gpu.copy(array.address, array.address + 8, 4),
        "cuMemsetD8Async": array.clear,
        "cuLaunchKernel": lambda: gpu.launch(kernel(), 1, [1]),
        "cuStreamBeginCapture": lambda: gpu.record(lambda: None),
        "cuGraphLaunch": graph.launch,
        "cuEventRecord": lambda: gpu.wait_for(1),
        "cuStreamWaitEvent": lambda: gpu.wait_for(1),
        "cuCtxSynchronize": gpu.wait_for_all,
        "cuStreamSynchronize": gpu.synchronize,
        "cuPointerGetAttribute": lambda: gpu.holds(5),
        "yasps_sort_pairs": lambda: gpu.sort_pairs((1, 2), (3, 4), 5, 6),
    }
    for function, work in asked.items():
        fake.status = {function: ILLEGAL_ADDRESS}
        with pytest.raises(DeviceError) as caught:
            work()
        message = str(caught.value)
        assert message.startswith(f"the GPU GPU 1 failed in {function}"), message
        assert "CUDA_ERROR_ILLEGAL_ADDRESS. After an error like an illegal address nothing more can run" in message
    fake.status = {"cuMemFreeAsync": ILLEGAL_ADDRESS}
    fake.calls.clear()
    array.resize(20)  # where an error could only be printed
    assert fake.names() == ["cuMemFreeAsync", "cuMemAllocAsync"]


def test_errors_of_a_new_device(fake: FakeDriver) -> None:
    for function in ("cuDevicePrimaryCtxRetain", "cuStreamCreate", "cuDeviceGetMemPool", "cuMemPoolSetAttribute"):
        fake.status = {function: driver.CUresult.CUDA_ERROR_NOT_SUPPORTED}
        with pytest.raises(DeviceError, match=rf"GPU 1 failed in {function}: CUDA_ERROR_NOT_SUPPORTED\. After"):
            Gpu(1)
    fake.status = {"cuDevicePrimaryCtxRetain": OUT_OF_MEMORY}  # before there is a pool to trim
    with pytest.raises(DeviceMemoryError, match="cuDevicePrimaryCtxRetain, but of the 1 MB of GPU 1 only 1"):
        Gpu(1)
    fake.status["cuMemGetInfo"] = driver.CUresult.CUDA_ERROR_INVALID_CONTEXT
    with pytest.raises(DeviceMemoryError, match="cuDevicePrimaryCtxRetain: GPU 1 has no memory left for it"):
        Gpu(1)


def test_nothing_is_freed_when_the_process_ends(gpu: Gpu, fake: FakeDriver, monkeypatch: pytest.MonkeyPatch) -> None:
    array = DeviceArray(gpu, np.int32, "indices").resize(10)
    graph = gpu.record(lambda: None)
    fake.calls.clear()
    monkeypatch.setattr(sys, "is_finalizing", lambda: True)
    del array, graph
    assert not fake.calls


# -- launches ----------------------------------------------------------------------------------------------


def test_launches_cover_all_threads(gpu: Gpu, fake: FakeDriver) -> None:
    for threads, block, grid in ((1, BLOCK, 1), (128, BLOCK, 1), (129, BLOCK, 2), (1000, 32, 32)):
        gpu.launch(kernel(), threads, [1], block=block)
        assert fake.launches[-1][:2] == (grid, block)
    count = len(fake.launches)
    gpu.launch(kernel(), 0, [1])
    assert len(fake.launches) == count


def test_arguments_are_64_bits_wide(gpu: Gpu, fake: FakeDriver) -> None:
    """At the addresses that the driver gets; numbers of NumPy too, and of another thread."""
    given: list[int | float] = [0x7F0000001000, -1, 2.5, 0, 1.0, 2**62]
    launches: list[list[int | float]] = [given, given[::-1], [np.int32(7), np.float64(0.5), True], []]
    launches.append([*range(MOST_ARGUMENTS)])
    for arguments in launches:
        gpu.launch(kernel(), 5, arguments)
        wanted = [struct.pack("d" if isinstance(a, float) else "q", a) for a in arguments]
        assert fake.launches[-1][2][: len(arguments)] == wanted

    (here,) = {arguments[9] for arguments in fake.of("cuLaunchKernel")}  # no launch makes a list of its own
    thread = threading.Thread(target=lambda: gpu.launch(kernel(), 5, [3, 4]))
    thread.start()
    thread.join()
    assert fake.of("cuLaunchKernel")[-1][9] != here, "two threads write to the same place"
    assert [int.from_bytes(number, "little") for number in fake.launches[-1][2][:2]] == [3, 4]
    with pytest.raises(struct.error):
        gpu.launch(kernel(), 5, [np.float32(2.5)])  # type: ignore[list-item]
    with pytest.raises(struct.error):
        gpu.launch(kernel(), 5, [1] * (MOST_ARGUMENTS + 1))


def test_programs_are_compiled_for_the_gpu_and_loaded(gpu: Gpu, fake: FakeDriver) -> None:
    text = 'extern "C" __global__ void halve(double* p) { p[threadIdx.x] *= 0.5; }\n'
    program = gpu.load([Source("halve", text)], [])
    assert [row.name for row in program.rows] == ["halve", "cub", "link"]
    ((code, *_),) = fake.of("cuLibraryLoadData")
    assert b"halve" in code
    found = program.kernel("halve")
    assert (found.name, int(found.function)) == ("halve", FUNCTION)
    assert program.kernel("halve") is found
    assert fake.of("cuLibraryGetKernel")[0][1] == b"halve"
    with pytest.raises(KeyError, match="third"):
        program.kernel("third")
    assert gpu._stack_bytes == max(row.stack_bytes for row in program.rows)
    assert gpu._cub is not None
    assert gpu._cub.yasps_sort_pairs
    assert gpu._cub.yasps_exclusive_sum
    del program
    assert fake.names()[-1] == "cuLibraryUnload"
    for status, error in ((ILLEGAL_ADDRESS, DeviceError), (OUT_OF_MEMORY, DeviceMemoryError)):
        fake.status = {"cuLibraryLoadData": status}
        with pytest.raises(error, match="cuLibraryLoadData"):
            gpu.load([Source("halve", text)], [])


# -- graphs ------------------------------------------------------------------------------------------------


def test_a_graph_is_recorded_once_and_launched_often(gpu: Gpu, fake: FakeDriver) -> None:
    array = DeviceArray(gpu, np.float64, "numbers").upload(np.ones(4))
    fake.calls.clear()

    def work() -> None:
        array.clear()
        gpu.launch(kernel(), 4, [array.address])

    graph = gpu.record(work)
    recorded = ["cuStreamBeginCapture", "cuMemsetD8Async", "cuLaunchKernel", "cuStreamEndCapture"]
    assert fake.names() == [*recorded, "cuGraphInstantiate", "cuGraphDestroy"]
    assert fake.of("cuStreamBeginCapture")[0][1] == driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_THREAD_LOCAL
    assert len(fake.launches) == 1
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


def garbage(gpu: Gpu) -> list[Any]:
    """Cycles of objects that hold a graph and memory: what is left of a scene that nobody uses any more."""
    left: list[Any] = [gpu.record(lambda: None), DeviceArray(gpu, np.float64, "numbers").resize(4)]
    left.append(left)
    return left


def test_garbage_that_is_collected_while_a_graph_is_recorded(gpu: Gpu, fake: FakeDriver) -> None:
    """The stand-in for the driver refuses what frees something then."""
    garbage(gpu)
    fake.calls.clear()
    enabled: list[bool] = []

    def work() -> None:
        enabled.append(gc.isenabled())
        gc.collect()
        gpu.launch(kernel(), 4, [1])

    graph = gpu.record(work)
    assert enabled == [False], "a collection may begin by itself"
    assert gc.isenabled()
    names = fake.names()
    end = names.index("cuStreamEndCapture")
    assert {"cuGraphExecDestroy", "cuMemFreeAsync"} <= set(names[end:])
    assert names[:end] == ["cuStreamBeginCapture", "cuLaunchKernel"]
    assert not fake.memory
    graph.launch()


def test_another_thread_gives_up_what_it_has_while_a_graph_is_recorded(gpu: Gpu, fake: FakeDriver) -> None:
    arrays = [DeviceArray(gpu, np.float64, "numbers").resize(4)]

    def work() -> None:
        thread = threading.Thread(target=arrays.clear)
        thread.start()
        thread.join()

    gpu.record(work)
    assert fake.names()[-1] in ("cuMemFreeAsync", "cuGraphDestroy", "cuGraphExecDestroy")
    assert not fake.memory


def test_collection_stays_as_it_was(gpu: Gpu) -> None:
    gc.disable()
    try:
        gpu.record(lambda: None)
        assert not gc.isenabled()
    finally:
        gc.enable()
    disposal = Disposal()
    with disposal.recording():
        with disposal.recording():
            pass
        assert not gc.isenabled(), "the outer one goes on"
    assert gc.isenabled()
    done: list[int] = []

    def fail() -> None:
        with disposal.recording():
            disposal.give_up(lambda: done.append(1))
            raise KeyError("wrong")

    with pytest.raises(KeyError):
        fail()
    assert (done, gc.isenabled()) == ([1], True)


def test_what_cannot_be_recorded_is_refused_by_name(gpu: Gpu, fake: FakeDriver) -> None:
    array = DeviceArray(gpu, np.float64, "numbers").resize(4)
    gpu._cub = FakeCub()  # type: ignore[assignment]
    refused = {
        "memory for numbers": lambda: gpu.allocate(5, "numbers"),
        "a copy to the device": lambda: array.upload(np.zeros(4)),
        "a copy from the device": array.download,
        "a sort or a sum": lambda: gpu.exclusive_sum(1, 2, 3),
        "to wait": gpu.synchronize,
        "to wait for another stream": lambda: gpu.wait_for(1),
        "to wait for all work": gpu.wait_for_all,
        "another graph": lambda: gpu.record(lambda: None),
        "a program": lambda: gpu.load([], []),
    }
    for what, work in refused.items():
        with pytest.raises(DeviceError, match=f"^{what} was asked for while a graph was recorded$"):
            gpu.record(work)
        assert not gpu._recording
    assert isinstance(gpu.record(array.clear), GpuGraph)


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
    with pytest.raises(DeviceError, match="GPU 1 failed in yasps_sort_pairs: CUDA_ERROR_ILLEGAL_ADDRESS"):
        gpu.sort_pairs((1, 2), (3, 4), 5, 6)
    gpu._cub = FakeCub(status=OUT_OF_MEMORY.value)  # type: ignore[assignment]
    fake.calls.clear()
    with pytest.raises(DeviceMemoryError, match="yasps_sort_pairs, but of the 1 MB of GPU 1"):
        gpu.sort_pairs((1, 2), (3, 4), 5, 6)
    assert fake.names() == ["cuCtxSynchronize", "cuMemPoolTrimTo", "cuMemGetInfo"]


# -- order -------------------------------------------------------------------------------------------------


def test_waiting_for_another_stream(gpu: Gpu, fake: FakeDriver) -> None:
    gpu.wait_for(1)
    assert fake.names() == ["cuEventCreate", "cuEventRecord", "cuStreamWaitEvent", "cuEventDestroy"]
    assert int(fake.of("cuEventRecord")[0][1]) == 1
    fake.status = {"cuEventRecord": driver.CUresult.CUDA_ERROR_INVALID_HANDLE}
    fake.calls.clear()
    with pytest.raises(DeviceError, match="cuEventRecord: CUDA_ERROR_INVALID_HANDLE"):
        gpu.wait_for(77)
    assert fake.names()[-1] == "cuEventDestroy"
