"""Stand-ins for functions of cuda.bindings, in which the host's memory is the GPU's.

Every stand-in takes the arguments that the real function takes, and gives what that gives.
"""

# ruff: noqa: N802 (the functions are named as the driver's)
from __future__ import annotations

import ctypes
import inspect
from collections.abc import Callable
from typing import Any

from cuda.bindings import driver

SUCCESS = driver.CUresult.CUDA_SUCCESS
CONTEXT, STREAM, GRAPH, EXECUTABLE, POOL, EVENT, LIBRARY = 0x43, 0x51, 0x67, 0x78, 0x70, 0x65, 0x6C
KERNEL, FUNCTION = 0x6B, 0x66
TOTAL = 1_000_000
"""Bytes of the GPU."""
IN_GRAPHS = ("cuLaunchKernel", "cuMemcpyDtoDAsync", "cuMemsetD8Async", "cuStreamEndCapture")
"""What may be asked for while a graph is recorded; all else ends the recording, or becomes a part of it by mistake."""


class FakeDriver:
    """What the stand-ins do.

    calls: names and arguments, but for the context's; memory: bytes by address; kept: sizes of what was freed and the
    pool has not given back; status: of functions that fail, the first `failures` times (None: always).
    """

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple[Any, ...]]] = []
        self.memory: dict[int, Any] = {}
        self.kept: list[int] = []
        self.status: dict[str, driver.CUresult] = {}
        self.failures: int | None = None
        self.recording = False
        self.launches: list[tuple[int, int, list[bytes]]] = []
        """Blocks, threads of each, and what the addresses of arguments point to at that time."""

    def names(self) -> list[str]:
        return [name for name, _ in self.calls]

    def of(self, name: str) -> list[tuple[Any, ...]]:
        """The arguments of all calls of a function."""
        return [arguments for called, arguments in self.calls if called == name]

    def free_bytes(self) -> int:
        return TOTAL - sum(len(buffer) for buffer in self.memory.values()) - sum(self.kept)

    # Each returns what follows the status, or the status of an error.

    def cuInit(self, flags: int) -> None:
        """Nothing to do."""

    def cuDriverGetVersion(self) -> int:
        return 13000

    def cuDeviceGetCount(self) -> int:
        return 2

    def cuDeviceGet(self, ordinal: int) -> int:
        return ordinal

    def cuDeviceGetName(self, size: int, device: int) -> bytes:
        return f"GPU {device}".encode().ljust(size, b"\0")

    def cuDeviceGetAttribute(self, attribute: driver.CUdevice_attribute, device: int) -> int:
        del device
        name = attribute.name.removeprefix("CU_DEVICE_ATTRIBUTE_")
        return {"COMPUTE_CAPABILITY_MAJOR": 9, "MULTIPROCESSOR_COUNT": 2, "MAX_THREADS_PER_MULTIPROCESSOR": 256}.get(
            name, 0
        )

    def cuDevicePrimaryCtxRetain(self, device: int) -> driver.CUcontext:
        assert device == 1
        return driver.CUcontext(CONTEXT)

    def cuCtxSetCurrent(self, context: driver.CUcontext) -> None:
        assert int(context) == CONTEXT

    def cuCtxSynchronize(self) -> None:
        """Everything is done."""

    def cuStreamCreate(self, flags: int) -> driver.CUstream:
        assert flags == driver.CUstream_flags.CU_STREAM_NON_BLOCKING.value
        return driver.CUstream(STREAM)

    def cuDeviceGetMemPool(self, device: int) -> driver.CUmemoryPool:
        assert device == 1
        return driver.CUmemoryPool(POOL)

    def cuMemPoolSetAttribute(
        self, pool: driver.CUmemoryPool, attribute: driver.CUmemPool_attribute, value: driver.cuuint64_t
    ) -> None:
        assert int(pool) == POOL
        driver._HelperCUmemPool_attribute(attribute, value)

    def cuMemPoolTrimTo(self, pool: driver.CUmemoryPool, least: int) -> None:
        assert (int(pool), least) == (POOL, 0)
        self.kept.clear()

    def cuMemAllocAsync(self, size: int, stream: driver.CUstream) -> int | driver.CUresult:
        assert int(stream) == STREAM
        fitting = [kept for kept in self.kept if kept >= size]
        if fitting:
            self.kept.remove(fitting[0])
        elif size > self.free_bytes():
            return driver.CUresult.CUDA_ERROR_OUT_OF_MEMORY
        buffer = ctypes.create_string_buffer(b"\xff" * size, size)
        self.memory[ctypes.addressof(buffer)] = buffer
        return ctypes.addressof(buffer)

    def cuMemFreeAsync(self, address: int, stream: driver.CUstream) -> None:
        assert int(stream) == STREAM
        self.kept.append(len(self.memory.pop(address)))

    def cuMemGetInfo(self) -> tuple[int, int]:
        return self.free_bytes(), TOTAL

    def cuPointerGetAttribute(self, attribute: driver.CUpointer_attribute, address: int) -> int | driver.CUresult:
        assert attribute == driver.CUpointer_attribute.CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL
        if any(begin <= address < begin + len(b) for begin, b in self.memory.items()):
            return 1
        return driver.CUresult.CUDA_ERROR_INVALID_VALUE

    def cuMemcpyHtoDAsync(self, to: int, source: int, size: int, stream: driver.CUstream) -> None:
        self.move(to, source, size, stream, to)

    def cuMemcpyDtoHAsync(self, to: int, source: int, size: int, stream: driver.CUstream) -> None:
        self.move(to, source, size, stream, source)

    def cuMemcpyDtoDAsync(self, to: int, source: int, size: int, stream: driver.CUstream) -> None:
        self.check_inside(source, size)
        self.move(to, source, size, stream, to)

    def cuMemsetD8Async(self, address: int, value: int, size: int, stream: driver.CUstream) -> None:
        assert int(stream) == STREAM
        self.check_inside(address, size)
        ctypes.memset(address, value, size)

    def cuStreamSynchronize(self, stream: driver.CUstream) -> None:
        assert int(stream) == STREAM

    def cuStreamBeginCapture(self, stream: driver.CUstream, mode: driver.CUstreamCaptureMode) -> None:
        assert int(stream) == STREAM
        assert isinstance(mode, driver.CUstreamCaptureMode)
        self.recording = True

    def cuStreamEndCapture(self, stream: driver.CUstream) -> driver.CUgraph:
        assert int(stream) == STREAM
        return driver.CUgraph(GRAPH)

    def cuGraphInstantiate(self, graph: driver.CUgraph, flags: int) -> driver.CUgraphExec:
        assert (int(graph), flags) == (GRAPH, 0)
        return driver.CUgraphExec(EXECUTABLE)

    def cuGraphDestroy(self, graph: driver.CUgraph) -> None:
        assert int(graph) == GRAPH

    def cuGraphLaunch(self, executable: driver.CUgraphExec, stream: driver.CUstream) -> None:
        assert (int(executable), int(stream)) == (EXECUTABLE, STREAM)

    def cuGraphExecDestroy(self, executable: driver.CUgraphExec) -> None:
        assert int(executable) == EXECUTABLE

    def cuEventCreate(self, flags: int) -> driver.CUevent:
        assert flags == driver.CUevent_flags.CU_EVENT_DISABLE_TIMING.value
        return driver.CUevent(EVENT)

    def cuEventRecord(self, event: driver.CUevent, stream: driver.CUstream) -> None:
        assert int(event) == EVENT

    def cuStreamWaitEvent(self, stream: driver.CUstream, event: driver.CUevent, flags: int) -> None:
        assert (int(stream), int(event), flags) == (STREAM, EVENT, 0)

    def cuEventDestroy(self, event: driver.CUevent) -> None:
        assert int(event) == EVENT

    def cuLibraryLoadData(self, code: bytes, *options: Any) -> driver.CUlibrary:
        assert code[:4] == b"\x7fELF"
        assert options == ([], [], 0, [], [], 0)
        return driver.CUlibrary(LIBRARY)

    def cuLibraryUnload(self, library: driver.CUlibrary) -> None:
        assert int(library) == LIBRARY

    def cuLibraryGetKernel(self, library: driver.CUlibrary, name: bytes) -> driver.CUkernel:
        assert int(library) == LIBRARY
        assert isinstance(name, bytes)
        return driver.CUkernel(KERNEL)

    def cuKernelGetFunction(self, kernel: driver.CUkernel) -> driver.CUfunction:
        assert int(kernel) == KERNEL
        return driver.CUfunction(FUNCTION)

    def cuLaunchKernel(self, function: driver.CUfunction, *rest: Any) -> None:
        grid, block = rest[:3], rest[3:6]
        shared, stream, addresses, extra = rest[6:]
        assert isinstance(function, driver.CUfunction)
        assert (int(function), int(stream)) == (FUNCTION, STREAM)
        assert (grid[1:], block[1:], shared, extra) == ((1, 1), (1, 1), 0, 0)
        assert driver._HelperKernelParams(addresses).ckernelParams == addresses
        places = (ctypes.c_void_p * 64).from_address(addresses)
        self.launches.append((grid[0], block[0], [ctypes.string_at(place or 0, 8) for place in places]))

    def move(self, to: int, source: int, size: int, stream: driver.CUstream, on_device: int) -> None:
        assert int(stream) == STREAM
        self.check_inside(on_device, size)
        ctypes.memmove(to, source, size)

    def check_inside(self, address: int, size: int) -> None:
        assert any(begin <= address and address + size <= begin + len(b) for begin, b in self.memory.items())

    def _failure_of(self, name: str) -> driver.CUresult | None:
        if name not in self.status or self.failures == 0:
            return None
        if self.failures is not None:
            self.failures -= 1
        return self.status[name]

    def stand_in(self, name: str) -> Callable[..., tuple[Any, ...]]:
        """For the driver's function of this name."""
        signature = inspect.signature(getattr(driver, name))
        gives = inspect.signature(getattr(self, name)).return_annotation
        nothing = () if gives == "None" else (None,) * (gives.count(",") + 1)

        def function(*arguments: Any) -> tuple[Any, ...]:
            signature.bind(*arguments)
            if name != "cuCtxSetCurrent":
                self.calls.append((name, arguments))
                assert not self.recording or name in IN_GRAPHS, f"{name} while a graph is recorded"
            if name == "cuStreamEndCapture":
                self.recording = False
            values = self._failure_of(name) or getattr(self, name)(*arguments)
            if isinstance(values, driver.CUresult):  # as the bindings do
                return (values, *nothing)
            return (SUCCESS, *(() if values is None else values if isinstance(values, tuple) else (values,)))

        return function
