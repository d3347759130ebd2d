"""What the CUDA runtime asks of a device: memory, copies, kernels, graphs, and two algorithms of CUB.

`yasps.runtime.device.gpu` implements it on an NVIDIA GPU. The tests implement it on the host, where they run the text
of the same kernels, so that everything above this line is executed also where there is no GPU.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.build.cuda.report import ModuleRow
from yasps.runtime.build.toolchain import Source
from yasps.runtime.core.sink import THREADS

BLOCK = THREADS
"""Threads of a block where a kernel does not ask for another number."""
BLOCKS_AT_ONCE = 8
"""Of a kernel with a sum over all its threads on a multiprocessor: as many as the launch bounds of pcg.cu leave room
for, and enough to keep the memory busy."""


class Memory(Protocol):
    """Memory on a device, freed when the object goes."""

    @property
    def address(self) -> int:
        """Where it begins, aligned to 256 bytes."""

    @property
    def size(self) -> int:
        """Bytes."""


class Kernel(Protocol):
    """A `__global__` function of a loaded program."""

    @property
    def name(self) -> str: ...


class LoadedProgram(Protocol):
    """Linked device code on its device."""

    @property
    def rows(self) -> Sequence[ModuleRow]:
        """The compile log: one row for each module, and one for the link."""

    def kernel(self, name: str) -> Kernel:
        """The `extern "C" __global__` function of this name. Raises KeyError."""


class Graph(Protocol):
    """Launches that were recorded once and run again as one."""

    def launch(self) -> None:
        """Puts all of them on the device's stream."""


class Device(Protocol):
    """A device and one stream of work on it: whatever is asked for happens in the order it was asked for.

    Addresses are plain integers. Only `download`, `synchronize` and `wait_for_all` wait.
    """

    @property
    def name(self) -> str:
        """For messages."""

    @property
    def architecture(self) -> str:
        """As compilers spell it, `sm_90`."""

    @property
    def multiprocessors(self) -> int:
        """Parts that run blocks of threads beside each other."""

    @property
    def stream_address(self) -> int:
        """The stream, for other libraries; 0 where there is none."""

    def allocate(self, size: int, purpose: str) -> Memory:
        """`size` bytes. Raises DeviceMemoryError that says how many were asked for, and for what."""

    def holds(self, address: int) -> bool:
        """Is this an address in memory of this device, whoever allocated it?"""

    def upload(self, array: NDArray[Any], address: int) -> None:
        """Copies a C-contiguous array to the device; the array may be changed as soon as this returns."""

    def download(self, address: int, array: NDArray[Any]) -> None:
        """Fills a C-contiguous array from the device, after all that was asked for before."""

    def copy(self, source: int, address: int, size: int) -> None:
        """Copies bytes within the device; the two ranges must not overlap."""

    def clear(self, address: int, size: int) -> None:
        """Sets bytes to zero."""

    def load(self, modules: Sequence[Source], runtime: Sequence[Source]) -> LoadedProgram:
        """Compiles generated modules and files of the runtime, links them and loads the program."""

    def launch(self, kernel: Kernel, threads: int, arguments: Sequence[int | float], *, block: int = BLOCK) -> None:
        """Runs at least so many threads in blocks of `block`; nothing for 0 threads.

        An int is passed as `long` or pointer, a float as `double`; kernels take nothing else.
        """

    def record(self, work: Callable[[], None]) -> Graph:
        """The launches, copies on the device and clears that `work` asks for, as a graph; they do not run yet."""

    def sort_pairs(self, keys: tuple[int, int], values: tuple[int, int], count: int, bits: int) -> None:
        """Sorts `count` uint64 keys by their lowest `bits` bits, with their uint32 values; stable.

        Addresses of input and output of each.
        """

    def exclusive_sum(self, source: int, address: int, count: int) -> None:
        """Prefix sums of `count` int64 numbers, the first 0; they may replace the numbers (`address` is `source`)."""

    def wait_for(self, stream: int) -> None:
        """Lets what is asked for from now on wait for the work now on another stream (1: the default one)."""

    def wait_for_all(self) -> None:
        """Waits until all work on the device is done that this process asked for, on whatever stream."""

    def synchronize(self) -> None:
        """Waits until all is done. Raises DeviceError if something failed."""


class DeviceError(RuntimeError):
    """The device refused or failed."""


class DeviceMemoryError(MemoryError):
    """No room on the device."""


def blocks_for_sum(device: Device, items: int) -> int:
    """How many blocks of BLOCK threads go through so many items and leave one number of a sum each.

    No more than run at once: threads go on to further items in a loop. Every block of the next kernel reads all those
    numbers, so that b blocks cost b^2 reads: 9 MB from the L2 cache of an H100 with its 1,056 blocks.
    """
    return min(-(-items // BLOCK), BLOCKS_AT_ONCE * device.multiprocessors)


class DeviceArray:
    """An array on a device that keeps its memory when it shrinks, and grows by a quarter more than it must.

    Contents are lost when it has to grow. Other libraries take it without a copy (`__cuda_array_interface__`).
    """

    def __init__(self, device: Device, dtype: Any, purpose: str) -> None:
        """An empty array; `purpose` is for messages."""
        self.device = device
        self.dtype = np.dtype(dtype)
        self.purpose = purpose
        self.shape: tuple[int, ...] = (0,)
        self._memory: Memory | None = None

    @property
    def size(self) -> int:
        """Number of items."""
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        """Bytes of all items."""
        return self.size * int(self.dtype.itemsize)

    @property
    def address(self) -> int:
        """Where it begins; 0 while it never had an item."""
        return self._memory.address if self._memory is not None else 0

    def resize(self, *shape: int) -> DeviceArray:
        """Makes room; returns itself. Raises DeviceMemoryError, the array is then empty."""
        wanted = math.prod(shape) * self.dtype.itemsize
        if self._memory is None or self._memory.size < wanted:
            grown = wanted if self._memory is None else wanted + wanted // 4
            self._memory, self.shape = None, (0,)  # frees first: old and new need not fit together
            if wanted:
                self._memory = self._allocate(grown, wanted)
        self.shape = shape
        return self

    def _allocate(self, size: int, least: int) -> Memory:
        try:
            return self.device.allocate(size, self.purpose)
        except DeviceMemoryError:
            # Scenes are cycles of objects: those that nobody uses any more may not have given their memory back yet.
            gc.collect()
        return self.device.allocate(least, self.purpose)

    def upload(self, values: NDArray[Any]) -> DeviceArray:
        """Takes shape and numbers of a host array; returns itself."""
        array = np.ascontiguousarray(values, self.dtype)
        self.resize(*array.shape)
        if array.size:
            self.device.upload(array, self.address)
        return self

    def download(self) -> NDArray[Any]:
        """A copy on the host, after all work asked for before."""
        array = np.empty(self.shape, self.dtype)
        if array.size:
            self.device.download(self.address, array)
        return array

    def clear(self) -> DeviceArray:
        """Sets all items to zero; returns itself."""
        if self.nbytes:
            self.device.clear(self.address, self.nbytes)
        return self

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        """Version 3: who reads the array waits for the stream that fills it."""
        return {
            "shape": self.shape,
            "typestr": self.dtype.str,
            "data": (self.address, False),
            "strides": None,
            "stream": self.device.stream_address or None,
            "version": 3,
        }
