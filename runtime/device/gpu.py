"""An NVIDIA GPU as the runtime uses it (`yasps.runtime.device.protocol.Device`), over the driver's own functions.

Every call of the driver goes through `Gpu.call`, so that every error is one of ours and says the same of it.

Compiled, not run: no machine that this was written on has a GPU. `tools/gpu_check` runs it where there is one.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib.resources import files
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.build.cuda.report import ModuleRow, largest_stack
from yasps.runtime.build.cuda.toolchain import DeviceProgram, build_program, find_cuda
from yasps.runtime.build.toolchain import Source
from yasps.runtime.device.disposal import DISPOSAL
from yasps.runtime.device.driver import CudaDevice, find_device
from yasps.runtime.device.protocol import BLOCK, DeviceArray, DeviceError, DeviceMemoryError, Kernel

MOST_ARGUMENTS = 64
"""Of a kernel."""
_IDLE_STREAMS: dict[int, list[Any]] = {}
"""Streams, by GPU, of scenes that are gone, for scenes to come. They are never destroyed: the garbage collector ends a
scene's objects in any order, and memory is given back on the stream that it was allocated on."""


class GpuMemory:
    """Memory of one allocation, given back to the device's pool when the object goes."""

    def __init__(self, gpu: Gpu, address: int, size: int) -> None:
        self.address, self.size = address, size
        self._gpu = gpu

    def __del__(self) -> None:
        self._gpu.give_up("cuMemFreeAsync", self.address, self._gpu.stream)


@dataclass(frozen=True)
class GpuKernel:
    """A function of a loaded program, which must stay loaded."""

    name: str
    function: Any


class GpuProgram:
    """A program on the device. `report`: what its compilers said."""

    def __init__(self, gpu: Gpu, report: DeviceProgram) -> None:
        """Loads it. Raises DeviceError, DeviceMemoryError."""
        self.report = report
        self._gpu = gpu
        self._kernels: dict[str, GpuKernel] = {}
        self._names = {function.name for row in report.rows for function in row.functions}
        self._library = gpu.call("cuLibraryLoadData", report.cubin(), [], [], 0, [], [], 0)

    @property
    def rows(self) -> Sequence[ModuleRow]:
        """The compile log."""
        return self.report.rows

    def kernel(self, name: str) -> GpuKernel:
        """The kernel of this name. Raises KeyError."""
        if name not in self._kernels:
            if name not in self._names:
                raise KeyError(name)
            handle = self._gpu.call("cuLibraryGetKernel", self._library, name.encode())
            self._kernels[name] = GpuKernel(name, self._gpu.call("cuKernelGetFunction", handle))
        return self._kernels[name]

    def __del__(self) -> None:
        if hasattr(self, "_library"):
            self._gpu.give_up("cuLibraryUnload", self._library)


class GpuGraph:
    """Recorded work."""

    def __init__(self, gpu: Gpu, executable: Any) -> None:
        self._gpu, self._executable = gpu, executable

    def launch(self) -> None:
        """Puts all of it on the stream."""
        self._gpu.call("cuGraphLaunch", self._executable, self._gpu.stream)

    def __del__(self) -> None:
        self._gpu.give_up("cuGraphExecDestroy", self._executable)


class _Arguments(threading.local):
    """Where a thread puts the arguments of a launch, 8 bytes each; the driver copies them before it returns.

    addresses: of the list of their addresses, which is what the driver takes.
    """

    def __init__(self) -> None:
        self.values = (ctypes.c_char * (8 * MOST_ARGUMENTS))()
        first = ctypes.addressof(self.values)
        self._list = (ctypes.c_void_p * MOST_ARGUMENTS)(*range(first, first + 8 * MOST_ARGUMENTS, 8))
        self.addresses = ctypes.addressof(self._list)


@cache
def _writer(*types: type) -> Callable[..., None]:
    """What writes numbers of these types as `long` and `double` to a buffer."""
    return Struct("".join("d" if issubclass(type_, float) else "q" for type_ in types)).pack_into


class Gpu:
    """One GPU and a stream of its own; see `yasps.runtime.device.protocol.Device`.

    Every scene has its own, so that two on one GPU do not wait for each other; they share the GPU's context and its
    pool of memory with whatever else the process runs there (PyTorch, CuPy).
    """

    def __init__(self, ordinal: int = 0) -> None:
        """Raises NoDeviceError, CudaNotFoundError, DeviceError."""
        self.found: CudaDevice = find_device(ordinal)
        from cuda.bindings import driver

        self._driver = driver
        self._context: Any = None
        self._pool: Any = None
        self._recording = False
        self._arguments = _Arguments()
        self._stack_bytes = 0
        """The largest stack of a kernel loaded so far, for which the driver keeps memory."""
        self._cub: ctypes.CDLL | None = None
        device = self.call("cuDeviceGet", ordinal)
        self._context = self.call("cuDevicePrimaryCtxRetain", device)
        self._idle_streams = _IDLE_STREAMS.setdefault(ordinal, [])
        # By default, memory that is free goes back to the system whenever somebody waits, and comes back slowly.
        self._pool = self.call("cuDeviceGetMemPool", device)
        threshold = driver.CUmemPool_attribute.CU_MEMPOOL_ATTR_RELEASE_THRESHOLD
        self.call("cuMemPoolSetAttribute", self._pool, threshold, driver.cuuint64_t(2**64 - 1))
        # Unlike the default stream it waits for no other, and no other for it.
        flags = driver.CUstream_flags.CU_STREAM_NON_BLOCKING.value
        self.stream = self._idle_streams.pop() if self._idle_streams else self.call("cuStreamCreate", flags)
        self._scratch = DeviceArray(self, np.uint8, "the scratch memory of sorts")

    def __del__(self) -> None:
        if hasattr(self, "stream"):
            self._idle_streams.append(self.stream)

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

    @property
    def multiprocessors(self) -> int:
        """How many there are."""
        return self.found.residency.multiprocessors

    # -- calls of the driver -------------------------------------------------------------------------------

    def call(self, function: str, *arguments: Any, purpose: str = "") -> Any:
        """What a function of the driver gives; once more, with all room that can be made, where memory was used up.

        purpose: what for, in messages. Raises DeviceError, DeviceMemoryError.
        """
        status, value = self._try(function, *arguments)
        if status == self._driver.CUresult.CUDA_ERROR_OUT_OF_MEMORY and self._make_room():
            status, value = self._try(function, *arguments)
        if status != self._driver.CUresult.CUDA_SUCCESS:
            raise self._error(purpose or function, function, status)
        return value

    def give_up(self, function: str, *arguments: Any) -> None:
        """Calls a function that frees something, after any recording. Nothing is raised: an error shows in the next
        call."""
        DISPOSAL.give_up(partial(self._try, function, *arguments))

    def _try(self, function: str, *arguments: Any) -> tuple[Any, Any]:
        """Status and value."""
        if self._context is not None:
            self._driver.cuCtxSetCurrent(self._context)  # what is wrong with it the next call says
        status, *values = getattr(self._driver, function)(*arguments)
        return status, values[0] if len(values) == 1 else tuple(values)

    def _make_room(self) -> bool:
        """Waits for all memory that is being freed and gives what the pool keeps to whoever asks next.

        False where that cannot be: while a graph is recorded, and before the device is open.
        """
        if self._recording or self._pool is None:
            return False
        for function, arguments in (("cuCtxSynchronize", ()), ("cuMemPoolTrimTo", (self._pool, 0))):
            status, _ = self._try(function, *arguments)
            if status != self._driver.CUresult.CUDA_SUCCESS:
                raise self._error(function, function, status)
        return True

    def _error(self, what: str, function: str, status: Any) -> DeviceError | DeviceMemoryError:
        """What to raise."""
        if status == self._driver.CUresult.CUDA_ERROR_OUT_OF_MEMORY:
            _, (free, total) = self._try("cuMemGetInfo")
            stacks = f"; {self.found.residency.describe_stacks(self._stack_bytes)}" if self._stack_bytes else ""
            if total is None:
                return DeviceMemoryError(f"{what}: {self.name} has no memory left for it")
            return DeviceMemoryError(
                f"{what}, but of the {total / 1e6:.0f} MB of {self.name} only {free / 1e6:.1f} MB are free{stacks}"
            )
        return DeviceError(
            f"the GPU {self.name} failed in {function if what == function else f'{function} ({what})'}: {status.name}. "
            "After an error like an illegal address nothing more can run on it in this process; compute-sanitizer says "
            "which kernel it was"
        )

    def _check_not_recording(self, what: str) -> None:
        """What a graph would repeat wrongly, or what ends a recording with an error that names nothing."""
        if self._recording:
            raise DeviceError(f"{what} was asked for while a graph was recorded")

    # -- memory --------------------------------------------------------------------------------------------

    def allocate(self, size: int, purpose: str) -> GpuMemory:
        """Memory of the device's pool. Raises DeviceMemoryError."""
        self._check_not_recording(f"memory for {purpose}")
        asked = f"{purpose}: {size / 1e6:.1f} MB were asked for"
        return GpuMemory(self, int(self.call("cuMemAllocAsync", max(size, 1), self.stream, purpose=asked)), size)

    def holds(self, address: int) -> bool:
        """Asks the driver."""
        attribute = self._driver.CUpointer_attribute.CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL
        status, ordinal = self._try("cuPointerGetAttribute", attribute, address)
        if status == self._driver.CUresult.CUDA_ERROR_INVALID_VALUE:
            return False  # it knows nothing of this address
        if status != self._driver.CUresult.CUDA_SUCCESS:
            raise self._error("cuPointerGetAttribute", "cuPointerGetAttribute", status)
        return int(ordinal) == self.found.ordinal

    def upload(self, array: NDArray[Any], address: int) -> None:
        """Copies to the device."""
        self._check_not_recording("a copy to the device")
        self.call("cuMemcpyHtoDAsync", address, array.ctypes.data, array.nbytes, self.stream)

    def download(self, address: int, array: NDArray[Any]) -> None:
        """Copies from the device and waits."""
        self._check_not_recording("a copy from the device")
        self.call("cuMemcpyDtoHAsync", array.ctypes.data, address, array.nbytes, self.stream)
        self.synchronize()

    def copy(self, source: int, address: int, size: int) -> None:
        """Copies within the device."""
        self.call("cuMemcpyDtoDAsync", address, source, size, self.stream)

    def clear(self, address: int, size: int) -> None:
        """Sets bytes to zero."""
        self.call("cuMemsetD8Async", address, 0, size, self.stream)

    # -- programs ------------------------------------------------------------------------------------------

    def load(self, modules: Sequence[Source], runtime: Sequence[Source]) -> GpuProgram:
        """Compiles for this GPU and loads."""
        self._check_not_recording("a program")
        report = build_program(find_cuda(self.architecture), modules, runtime, [cub_source()])
        assert report.host is not None
        self._cub = ctypes.CDLL(str(report.host.path))
        self._stack_bytes = max(self._stack_bytes, largest_stack(report.rows))
        return GpuProgram(self, report)

    def launch(self, kernel: Kernel, threads: int, arguments: Sequence[int | float], *, block: int = BLOCK) -> None:
        """Runs a kernel on this device's stream."""
        if threads <= 0:
            return
        assert isinstance(kernel, GpuKernel)
        buffer = self._arguments
        _writer(*map(type, arguments))(buffer.values, 0, *arguments)
        self.call(
            "cuLaunchKernel",
            *(kernel.function, -(-threads // block), 1, 1, block, 1, 1),  # no shared memory of a size chosen now
            *(0, self.stream, buffer.addresses, 0),
            purpose=kernel.name,
        )

    def record(self, work: Callable[[], None]) -> GpuGraph:
        """Captures the stream."""
        self._check_not_recording("another graph")
        with DISPOSAL.recording():
            # Of this thread alone: other threads may use the device as they like meanwhile.
            mode = self._driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_THREAD_LOCAL
            self.call("cuStreamBeginCapture", self.stream, mode)
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
        return self.call("cuStreamEndCapture", self.stream)

    # -- CUB -----------------------------------------------------------------------------------------------

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
        self._check_not_recording("a sort or a sum")
        numbers = [ctypes.c_long(a) if isinstance(a, int) else a for a in arguments]
        stream, size = ctypes.c_void_p(int(self.stream)), ctypes.c_size_t(0)
        self._call_cub(function, None, ctypes.byref(size), *numbers, stream)
        scratch = self._scratch.resize(max(size.value, 1)).address
        self._call_cub(function, scratch, ctypes.byref(size), *numbers, stream)

    def _call_cub(self, function: str, scratch: int | None, *arguments: Any) -> None:
        assert self._cub is not None, "a program is loaded first"
        self._driver.cuCtxSetCurrent(self._context)
        known = self._driver.CUresult
        call = partial(getattr(self._cub, function), ctypes.c_void_p(scratch), *arguments)
        number = call()
        if number == known.CUDA_ERROR_OUT_OF_MEMORY and self._make_room():
            number = call()
        if number:  # of the CUDA runtime, which numbers such errors as the driver does
            raise self._error(function, function, known(number))

    # -- order ---------------------------------------------------------------------------------------------

    def wait_for(self, stream: int) -> None:
        """By an event; the host does not wait."""
        self._check_not_recording("to wait for another stream")
        event = self.call("cuEventCreate", self._driver.CUevent_flags.CU_EVENT_DISABLE_TIMING.value)
        try:
            self.call("cuEventRecord", event, self._driver.CUstream(stream))
            self.call("cuStreamWaitEvent", self.stream, event, 0)
        finally:
            self.give_up("cuEventDestroy", event)

    def wait_for_all(self) -> None:
        """Of the context."""
        self._check_not_recording("to wait for all work")
        self.call("cuCtxSynchronize")

    def synchronize(self) -> None:
        """Waits for the stream."""
        self._check_not_recording("to wait")
        self.call("cuStreamSynchronize", self.stream)


def cub_source() -> Source:
    """The functions that call CUB's device-wide algorithms."""
    return Source("cub", files("yasps.runtime.device").joinpath("cuda", "host", "cub.cu").read_text(encoding="utf-8"))
