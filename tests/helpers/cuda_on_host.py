"""A device made of the host: the text of device code, compiled by the C++ compiler and run as loops and fibers.

So indexing, arithmetic and scatter of all kernels are executed where there is no GPU, and their races are found if that
is asked for. Memory models of devices are not what is executed.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import race_detector
from numpy.typing import NDArray
from race_detector import Barrier

from yasps import DeviceError, DeviceMemoryError
from yasps.runtime.build.cuda.report import ModuleRow
from yasps.runtime.build.cuda.sources import with_includes
from yasps.runtime.build.toolchain import Source, compile_sources, find_compiler, link
from yasps.runtime.device.disposal import DISPOSAL
from yasps.runtime.device.protocol import BLOCK, Kernel

HEADER = Path(__file__).resolve().with_name("cuda_on_host.h")
FLAGS = (
    "-O0",
    "-std=c++17",
    "-fPIC",
    "-U_FORTIFY_SOURCE",
    "-Wall",
    "-Wextra",
    "-Wno-unused-function",
    "-Wno-unused-variable",
)
"""Without optimisation: it costs more time than small scenes take to run."""
_BOUNDS = r"__launch_bounds__\([\w, ]+\)"
_KERNEL = re.compile(rf'extern "C" __global__ (?:void (?:{_BOUNDS}\s)?\s*|{_BOUNDS} void )(\w+)\(([^)]*)\)\s*\{{')
_WAITS = re.compile(r"__sync|_sync\(")
"""Where threads wait for others of their warp or block."""
_PART_OF_A_WARP = re.compile(r"(?:_sync|__syncwarp)\((?!~0u|\))")
MOST_BYTES = 1 << 33
"""Where this device says that its memory is used up."""


class HostMemory:
    """Memory, filled with a value nobody should read."""

    def __init__(self, device: HostDevice, size: int, purpose: str) -> None:
        self.size = size
        self._array = np.full(size + 256, 0xFF, np.uint8)  # as double: NaN
        self.address = (self._array.ctypes.data + 255) // 256 * 256
        self._device = device
        device.allocations[self.address] = size, purpose

    def __del__(self) -> None:
        if hasattr(self, "_device"):
            DISPOSAL.give_up(partial(self._device.free, self.address))


@dataclass(frozen=True)
class HostKernel:
    name: str
    function: Any
    library: ctypes.CDLL


class HostProgram:
    def __init__(self, library: ctypes.CDLL, rows: Sequence[ModuleRow] = ()) -> None:
        self._library, self.rows = library, rows

    def kernel(self, name: str) -> HostKernel:
        try:
            return HostKernel(name, getattr(self._library, f"{name}_launch"), self._library)
        except AttributeError as error:
            raise KeyError(name) from error


class HostGraph:
    def __init__(self) -> None:
        self.work: list[Callable[[], object]] = []

    def launch(self) -> None:
        for step in self.work:
            step()


class HostDevice:
    """Implements `yasps.runtime.device.protocol.Device`.

    While a graph is recorded it refuses what CUDA refuses: every call that gives or takes memory, waits, compiles, or
    reads and writes memory of the host. Sorts and sums need memory of their own. It raises DeviceError.
    """

    name = "the host, as a device"
    architecture = "sm_90"
    stream_address = 0
    multiprocessors = 4

    def __init__(
        self,
        most_bytes: int = MOST_BYTES,
        *,
        backwards: bool = False,
        flags: Sequence[str] = FLAGS,
        find_races: bool = False,
        left_out: Barrier | None = None,
    ) -> None:
        """backwards: the last thread runs first, so that sums whose order is left to the device come out otherwise.

        flags: of the C++ compiler, for generated code. find_races: a launch that has a race raises DataRaceError; it
        takes about ten times as long. left_out: a barrier that its launches do without.
        """
        self.most_bytes = most_bytes
        self.allocations: dict[int, tuple[int, str]] = {}
        """Size and purpose by address."""
        self.backwards, self.flags = backwards, tuple(flags)
        self.find_races, self.left_out = find_races, left_out
        self._recording: HostGraph | None = None
        self._freed_while_recording: list[str] = []
        self.launches: list[str] = []
        """Names of the kernels launched, for tests."""

    @property
    def used(self) -> int:
        """Bytes."""
        return sum(size for size, _ in self.allocations.values())

    def _check_not_recording(self, call: str) -> None:
        if self._recording is not None:
            raise DeviceError(f"{call} was called while a graph was recorded, which CUDA refuses")

    def allocate(self, size: int, purpose: str) -> HostMemory:
        self._check_not_recording(f"allocate ({purpose})")
        if self.used + size > self.most_bytes:
            raise DeviceMemoryError(f"{purpose} needs {size} bytes, but only {self.most_bytes - self.used} are free")
        return HostMemory(self, size, purpose)

    def free(self, address: int) -> None:
        """Of an object that went; who lets it go can be told nothing, so `record` raises what there is to say."""
        _, purpose = self.allocations.pop(address)
        if self._recording is not None:
            self._freed_while_recording.append(purpose)

    def holds(self, address: int) -> bool:
        """Nobody can tell."""
        return True

    def _do(self, work: Callable[[], object]) -> None:
        if self._recording is None:
            work()
        else:
            self._recording.work.append(work)

    def upload(self, array: NDArray[Any], address: int) -> None:
        assert array.flags.c_contiguous
        self._check_not_recording("upload, a copy of memory of the host,")
        ctypes.memmove(address, array.ctypes.data, array.nbytes)

    def download(self, address: int, array: NDArray[Any]) -> None:
        assert array.flags.c_contiguous
        self._check_not_recording("download, which waits,")
        ctypes.memmove(array.ctypes.data, address, array.nbytes)

    def copy(self, source: int, address: int, size: int) -> None:
        self._do(lambda: ctypes.memmove(address, source, size))

    def clear(self, address: int, size: int) -> None:
        self._do(lambda: ctypes.memset(address, 0, size))

    def load(self, modules: Sequence[Source | str], runtime: Sequence[Source | str] = ()) -> HostProgram:
        """A program of these files of device code; a plain text can include runtime/cuda's."""
        self._check_not_recording("load")
        return HostProgram(ctypes.CDLL(str(build([*modules, *runtime], self.flags, find_races=self.find_races))))

    def launch(self, kernel: Kernel, threads: int, arguments: Sequence[int | float], *, block: int = BLOCK) -> None:
        if threads <= 0:
            return
        assert isinstance(kernel, HostKernel)
        numbers = [ctypes.c_double(a) if isinstance(a, float) else ctypes.c_long(a) for a in arguments]
        grid = -(-threads // block)

        def run() -> None:
            pointers = (ctypes.c_void_p * max(1, len(numbers)))(*(ctypes.addressof(number) for number in numbers))
            self.launches.append(kernel.name)
            if self.find_races:
                race_detector.begin(kernel.library, self.left_out)
            kernel.function(ctypes.c_uint(grid), ctypes.c_uint(block), pointers, ctypes.c_bool(self.backwards))
            if self.find_races:
                race_detector.end(kernel.library, kernel.name, self.allocations)

        self._do(run)

    def record(self, work: Callable[[], None]) -> HostGraph:
        self._check_not_recording("record")
        with DISPOSAL.recording():
            graph = self._recording = HostGraph()
            try:
                work()
            finally:
                self._recording = None
                freed, self._freed_while_recording = self._freed_while_recording, []
        if freed:
            raise DeviceError(f"memory was freed while a graph was recorded, which CUDA refuses: {', '.join(freed)}")
        return graph

    def sort_pairs(self, keys: tuple[int, int], values: tuple[int, int], count: int, bits: int) -> None:
        self._check_not_recording("sort_pairs")
        source = _view(keys[0], count, ctypes.c_uint64)
        order = np.argsort(source & np.uint64((1 << bits) - 1), kind="stable")
        _view(keys[1], count, ctypes.c_uint64)[:] = source[order]
        _view(values[1], count, ctypes.c_uint32)[:] = _view(values[0], count, ctypes.c_uint32)[order]

    def exclusive_sum(self, source: int, address: int, count: int) -> None:
        self._check_not_recording("exclusive_sum")
        numbers = _view(source, count, ctypes.c_int64)
        _view(address, count, ctypes.c_int64)[:] = np.cumsum(numbers) - numbers

    def wait_for(self, stream: int) -> None:
        """There is one thread and no stream."""
        self._check_not_recording("wait_for")

    def wait_for_all(self) -> None:
        """As `wait_for`."""
        self._check_not_recording("wait_for_all")

    def synchronize(self) -> None:
        """Everything is done when it is asked for."""
        self._check_not_recording("synchronize")


def _view(address: int, count: int, c_type: Any) -> NDArray[Any]:
    return np.ctypeslib.as_array((c_type * count).from_address(address)) if count else np.zeros(0, c_type)


def build(texts: Sequence[Source | str], flags: Sequence[str] = FLAGS, *, find_races: bool = False) -> Path:
    """A shared library of these files of device code; every kernel X gets a function X_launch.

    Files whose threads do not wait for each other, as generated ones, are compiled as one, each in a namespace: a scene
    has dozens, and most of their time is the compiler's start.
    """
    compiler = find_compiler(tuple(flags))
    items = [Source(f"on_host_{k}", item) if isinstance(item, str) else item for k, item in enumerate(texts)]
    wholes = [Source(item.name, with_includes(item.text)) for item in items]
    sources = [Source(item.name, on_host([item], fibers=True)) for item in wholes if _WAITS.search(item.text)]
    plain = [item for item in wholes if not _WAITS.search(item.text)]
    if plain:
        sources.append(Source("on_host", on_host(plain, fibers=False)))
    if find_races:
        objects = compile_sources(sources, compiler.with_flags(*race_detector.FLAGS))
        objects += race_detector.compile_hooks(compiler.with_flags("-O2"))
    else:
        objects = compile_sources(sources, compiler)
    return link(objects, compiler, ("-Wl,-Bsymbolic", "-lm")).path


def on_host(files: Sequence[Source], *, fibers: bool) -> str:
    """The C++ text of files of device code, with the functions that launch their kernels.

    Namespaces have different names in all texts that are linked: what they define is not that of another.
    """
    lines = ["" if fibers else "#define NO_FIBERS", HEADER.read_text(encoding="utf-8")]
    for k, file in enumerate(files):
        if _PART_OF_A_WARP.search(file.text):
            raise ValueError(f"{file.name}: the host knows no part of a warp; write ~0u, or no mask")
        name = re.sub(r"\W", "_", file.name)
        lines += [
            f"namespace file_{k}_{name} {{",
            f'#line 1 "{file.name}"',
            file.text,
            *(_launcher(*found) for found in kernels_of(file.text)),
            "}",
        ]
    return "\n".join(lines)


def kernels_of(text: str) -> list[tuple[str, str]]:
    """Names and parameters of the kernels in a text of device code."""
    return [(match.group(1), match.group(2)) for match in _KERNEL.finditer(text)]


def _launcher(name: str, parameters: str) -> str:
    types = [parameter.strip().rsplit(" ", 1)[0] for parameter in parameters.split(",") if parameter.strip()]
    passed = ", ".join(f"*({type_}*)a[{k}]" for k, type_ in enumerate(types))
    return (
        f"static void {name}_thread(void* given) {{ void** const a = (void**)given; (void)a; {name}({passed}); }}\n"
        f'extern "C" __attribute__((visibility("default"))) '
        f"void {name}_launch(unsigned grid, unsigned block, void** a, bool backwards) "
        f"{{ fibers::launch({name}_thread, a, grid, block, backwards); }}\n"
    )
