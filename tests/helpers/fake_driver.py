"""Stand-ins for functions of cuda.bindings and cuda.core, in which the host's memory is the GPU's.

Every stand-in takes the arguments that the real function takes, and gives what that gives.
"""

# ruff: noqa: N802 (the functions are named as the driver's)
from __future__ import annotations

import ctypes
import inspect
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from cuda import core
from cuda.bindings import driver

SUCCESS = driver.CUresult.CUDA_SUCCESS
STREAM, GRAPH, EXECUTABLE = 0x51, 0x67, 0x78
TOTAL = 1_000_000
"""Bytes of the GPU."""


class FakeDriver:
    """What the stand-ins do; `calls`: their names and arguments, `memory`: bytes by address."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple[Any, ...]]] = []
        self.memory: dict[int, Any] = {}
        self.status: dict[str, driver.CUresult] = {}
        """Of functions that fail."""

    def names(self) -> list[str]:
        return [name for name, _ in self.calls]

    def of(self, name: str) -> list[tuple[Any, ...]]:
        """The arguments of all calls of a function."""
        return [arguments for called, arguments in self.calls if called == name]

    def free_bytes(self) -> int:
        return TOTAL - sum(len(buffer) for buffer in self.memory.values())

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
        return 9 if attribute.name.endswith("MAJOR") else 0

    def cuMemAllocAsync(self, size: int, stream: driver.CUstream) -> int | driver.CUresult:
        assert int(stream) == STREAM
        if size > self.free_bytes():
            return driver.CUresult.CUDA_ERROR_OUT_OF_MEMORY
        buffer = ctypes.create_string_buffer(b"\xff" * size, size)
        self.memory[ctypes.addressof(buffer)] = buffer
        return ctypes.addressof(buffer)

    def cuMemFreeAsync(self, address: int, stream: driver.CUstream) -> None:
        assert int(stream) == STREAM
        del self.memory[address]

    def cuMemGetInfo(self) -> tuple[int, int]:
        return self.free_bytes(), TOTAL

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

    def move(self, to: int, source: int, size: int, stream: driver.CUstream, on_device: int) -> None:
        assert int(stream) == STREAM
        self.check_inside(on_device, size)
        ctypes.memmove(to, source, size)

    def check_inside(self, address: int, size: int) -> None:
        assert any(begin <= address and address + size <= begin + len(b) for begin, b in self.memory.items())

    def stand_in(self, name: str) -> Callable[..., tuple[Any, ...]]:
        """For the driver's function of this name."""
        signature = inspect.signature(getattr(driver, name))
        gives = inspect.signature(getattr(self, name)).return_annotation
        nothing = () if gives == "None" else (None,) * (gives.count(",") + 1)

        def function(*arguments: Any) -> tuple[Any, ...]:
            signature.bind(*arguments)
            self.calls.append((name, arguments))
            values = self.status.get(name) or getattr(self, name)(*arguments)
            if isinstance(values, driver.CUresult):  # as the bindings do
                return (values, *nothing)
            return (SUCCESS, *(() if values is None else values if isinstance(values, tuple) else (values,)))

        return function


class FakeCore:
    """As cuda.core.Device, and what launches are asked for."""

    def __init__(self) -> None:
        self.current: list[int] = []
        self.launches: list[tuple[Any, ...]] = []

    def device(self, ordinal: int) -> SimpleNamespace:
        stream = SimpleNamespace(handle=driver.CUstream(STREAM))
        return SimpleNamespace(set_current=lambda: self.current.append(ordinal), create_stream=lambda: stream)

    def launch(self, stream: Any, config: core.LaunchConfig, kernel: Any, *arguments: Any) -> None:
        inspect.signature(core.launch).bind(stream, config, kernel, *arguments)
        self.launches.append((stream, config, kernel, arguments))
