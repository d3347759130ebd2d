"""An NVIDIA GPU as the runtime uses it (`yasps.runtime.device.Device`), over cuda.core and the driver's own functions.

Compiled, not run: no machine that this was written on has a GPU. `tools/gpu_check` runs it where there is one.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.cuda_driver import CudaDevice, find_device
from yasps.runtime.cuda_report import ModuleRow
from yasps.runtime.cuda_toolchain import DeviceProgram, build_program, find_cuda
from yasps.runtime.device import BLOCK, DeviceArray, DeviceError, DeviceMemoryError, Kernel
from yasps.runtime.toolchain import Source


class GpuMemory:
    """Memory of one allocation, given back to the device's pool when the object goes."""

    def __init__(self, gpu: Gpu, address: int, size: int) -> None:
        self.address, self.size = address, size
        self._gpu = gpu

    def __del__(self) -> None:
        self._gpu.free(self.address)


@dataclass(frozen=True)
class GpuKernel:
    """A function of a loaded program."""

    name: str
    function: Any


class GpuProgram:
    """A program on the device. `report`: what its compilers said."""

    def __init__(self, report: DeviceProgram) -> None:
        from cuda.core import ObjectCode

        self.report = report
        self._code = ObjectCode.from_cubin(report.cubin())
        self._kernels: dict[str, GpuKernel] = {}

    @property
    def rows(self) -> Sequence[ModuleRow]:
        """The compile log."""
        return self.report.rows

    def kernel(self, name: str) -> GpuKernel:
        """The kernel of this name. Raises KeyError."""
        if name not in self._kernels:
            if name not in {function.name for row in self.report.rows for function in row.functions}:
                raise KeyError(name)
            self._kernels[name] = GpuKernel(name, self._code.get_kernel(name))
        return self._kernels[name]


class GpuGraph:
    """Recorded work."""

    def __init__(self, gpu: Gpu, executable: Any) -> None:
        self._gpu, self._executable = gpu, executable

    def launch(self) -> None:
        """Puts all of it on the stream."""
        self._gpu.call("cuGraphLaunch", self._executable, self._gpu.stream)

    def __del__(self) -> None:
        if not sys.is_finalizing():
            self._gpu.call("cuGraphExecDestroy", self._executable)


class Gpu:
    """One GPU and a stream of its own; see `yasps.runtime.device.Device`.

    Every scene has its own, so that two on one GPU do not wait for each other; they share the GPU's context with
    whatever else the process runs there (PyTorch, CuPy).
    """

    def __init__(self, ordinal: int = 0) -> None:
        """Raises NoDeviceError, CudaNotFoundError."""
        self.found: CudaDevice = find_device(ordinal)
        from cuda import core
        from cuda.bindings import driver

        self._driver = driver
        self._launch, self._config = core.launch, core.LaunchConfig
        self._device = core.Device(ordinal)
        self._device.set_current()
        self._core_stream = self._device.create_stream()
        self.stream = driver.CUstream(int(self._core_stream.handle))
        self._recording = False
        self._freed: list[int] = []
        """Addresses whose memory was given back while a graph was recorded."""
        self._cub: ctypes.CDLL | None = None
        self._scratch = DeviceArray(self, np.uint8, "the scratch memory of sorts")

    @property
    def name(self) -> str:
        """As its maker calls it."""
        return self.found.name

    @property
    def architecture(self) -> str:
        """As compilers spell it."""
        return self.found.arch

    @property
    def stream_address(self) -> int:
        """The stream's handle."""
        return int(self.stream)

    def call(self, function: str, *arguments: Any) -> Any:
        """What a function of the driver gives. Raises DeviceError."""
        self._device.set_current()
        status, *values = getattr(self._driver, function)(*arguments)
        if status != self._driver.CUresult.CUDA_SUCCESS:
            raise DeviceError(
                f"the GPU {self.name} failed in {function}: {status.name}. After an error like an illegal address "
                "nothing more can run on it in this process; compute-sanitizer says which kernel it was"
            )
        return values[0] if len(values) == 1 else tuple(values)

    def allocate(self, size: int, purpose: str) -> GpuMemory:
        """Memory of the device's pool. Raises DeviceMemoryError."""
        if self._recording:
            raise DeviceError(f"memory for {purpose} was asked for while a graph was recorded")
        self._device.set_current()
        status, address = self._driver.cuMemAllocAsync(max(size, 1), self.stream)
        if status == self._driver.CUresult.CUDA_ERROR_OUT_OF_MEMORY:
            free, total = self.call("cuMemGetInfo")
            raise DeviceMemoryError(
                f"{purpose}: {size / 1e6:.1f} MB were asked for, but of the {total / 1e6:.0f} MB of {self.name} only "
                f"{free / 1e6:.1f} MB are free"
            )
        if status != self._driver.CUresult.CUDA_SUCCESS:
            raise DeviceError(f"the GPU {self.name} has no memory for {purpose}: {status.name}")
        return GpuMemory(self, int(address), size)

    def free(self, address: int) -> None:
        """Gives memory back once the work before is done. Nothing is raised: an error shows in the next call."""
        if sys.is_finalizing():
            return  # the process gives everything back
        if self._recording:
            self._freed.append(address)  # on the stream now it would become a part of the graph
            return
        self._device.set_current()
        self._driver.cuMemFreeAsync(address, self.stream)

    def upload(self, array: NDArray[Any], address: int) -> None:
        """Copies to the device."""
        self.call("cuMemcpyHtoDAsync", address, array.ctypes.data, array.nbytes, self.stream)

    def download(self, address: int, array: NDArray[Any]) -> None:
        """Copies from the device and waits."""
        self.call("cuMemcpyDtoHAsync", array.ctypes.data, address, array.nbytes, self.stream)
        self.synchronize()

    def copy(self, source: int, address: int, size: int) -> None:
        """Copies within the device."""
        self.call("cuMemcpyDtoDAsync", address, source, size, self.stream)

    def clear(self, address: int, size: int) -> None:
        """Sets bytes to zero."""
        self.call("cuMemsetD8Async", address, 0, size, self.stream)

    def load(self, modules: Sequence[Source], runtime: Sequence[Source]) -> GpuProgram:
        """Compiles for this GPU and loads."""
        self._device.set_current()
        report = build_program(find_cuda(self.architecture), modules, runtime, [cub_source()])
        assert report.host is not None
        self._cub = ctypes.CDLL(str(report.host.path))
        return GpuProgram(report)

    def launch(self, kernel: Kernel, threads: int, arguments: Sequence[int | float], *, block: int = BLOCK) -> None:
        """Runs a kernel on this device's stream."""
        if threads <= 0:
            return
        assert isinstance(kernel, GpuKernel)
        self._device.set_current()
        numbers = [np.float64(a) if isinstance(a, float) else np.int64(a) for a in arguments]
        config = self._config(grid=-(-threads // block), block=block)
        self._launch(self._core_stream, config, kernel.function, *numbers)

    def record(self, work: Callable[[], None]) -> GpuGraph:
        """Captures the stream."""
        # Of this thread alone: other threads may use the device as they like meanwhile.
        self.call(
            "cuStreamBeginCapture", self.stream, self._driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_THREAD_LOCAL
        )
        self._recording = True
        try:
            work()
        except BaseException:
            with suppress(DeviceError):  # what went wrong in `work` is what to tell
                self.call("cuGraphDestroy", self._end_recording())
            raise
        graph = self._end_recording()
        try:
            executable = self.call("cuGraphInstantiate", graph, 0)
        finally:
            self.call("cuGraphDestroy", graph)
        return GpuGraph(self, executable)

    def _end_recording(self) -> Any:
        """The graph of what was recorded."""
        self._recording = False
        try:
            return self.call("cuStreamEndCapture", self.stream)
        finally:
            freed, self._freed = self._freed, []
            for address in freed:
                self.free(address)

    def sort_pairs(self, keys: tuple[int, int], values: tuple[int, int], count: int, bits: int) -> None:
        """By CUB's radix sort."""
        if count:
            self._with_scratch("yasps_sort_pairs", *map(ctypes.c_void_p, (*keys, *values)), count, ctypes.c_int(bits))

    def exclusive_sum(self, source: int, address: int, count: int) -> None:
        """By CUB's scan."""
        if count:
            self._with_scratch("yasps_exclusive_sum", ctypes.c_void_p(source), ctypes.c_void_p(address), count)

    def _with_scratch(self, function: str, *arguments: Any) -> None:
        """Calls a function of cub.cu: first to learn how much memory it needs, then with that."""
        assert self._cub is not None, "a program is loaded first"
        self._device.set_current()
        call = getattr(self._cub, function)
        numbers = [ctypes.c_long(a) if isinstance(a, int) else a for a in arguments]
        stream, size = ctypes.c_void_p(int(self.stream)), ctypes.c_size_t(0)
        for address in (None, self._scratch):
            scratch = ctypes.c_void_p(address.address if address is not None else None)
            status = call(scratch, ctypes.byref(size), *numbers, stream)
            if status:
                raise DeviceError(f"the GPU {self.name} failed in {function}: CUDA error {status}")
            self._scratch.resize(max(size.value, 1))

    def wait_for(self, stream: int) -> None:
        """By an event; the host does not wait."""
        event = self.call("cuEventCreate", self._driver.CUevent_flags.CU_EVENT_DISABLE_TIMING.value)
        self.call("cuEventRecord", event, self._driver.CUstream(stream))
        self.call("cuStreamWaitEvent", self.stream, event, 0)
        self.call("cuEventDestroy", event)

    def synchronize(self) -> None:
        """Waits for the stream."""
        self.call("cuStreamSynchronize", self.stream)


def cub_source() -> Source:
    """The functions that call CUB's device-wide algorithms."""
    return Source("cub", files("yasps.runtime").joinpath("cuda", "host", "cub.cu").read_text(encoding="utf-8"))
