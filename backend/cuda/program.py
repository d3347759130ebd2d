"""The device code of one scene: compiled, linked with the runtime, loaded and bound to arrays on the device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from yasps.backend.codegen.object_text import Binding
from yasps.backend.codegen.program import CompiledModule
from yasps.backend.codegen.scene_code import SceneCode
from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.build.toolchain import Source
from yasps.runtime.core.sink import DEVICE_FIELDS, THREADS
from yasps.runtime.device.protocol import Device, DeviceArray, LoadedProgram
from yasps.runtime.matrix.cuda.build import BuildScratch

MOST_THREADS_WITH_WORKSPACE = 1 << 14
"""Threads of a kernel whose threads need global memory of their own; each then takes several instances."""
MOST_WORKSPACE = 1 << 29
"""Doubles of that memory, unless one block of threads needs more: 4 GiB, which small Hessians never need."""
NONE_BAD = np.uint64(2**64 - 1)


@dataclass(frozen=True)
class DerivativeLaunch:
    """One run of an energy's derivatives; addresses on the device, 0 for none.

    symbol: the object with the entry `derive`; count: instances n; gradient, blocks: what is added to; kappa: int32
    [n, c]; position: int64 [n, c (c + 1) / 2]; gradient_at: int64 [n, c]; block_size_at: int32 [scalars]; order: uint32
    [n], the instances as threads take them; mode: of the projection; outcome: uint64 [2], the first instance that is
    not finite and the number of projected Hessians.
    """

    symbol: str
    count: int
    gradient: int
    blocks: int
    kappa: int
    position: int
    gradient_at: int
    block_size_at: int
    order: int
    mode: int
    outcome: int


class CudaProgram:
    """The device code of one scene and the pointers it runs on."""

    def __init__(self, code: SceneCode, device: Device) -> None:
        self.code = code
        self.device = device
        self.modules = modules_of(code)
        self.loaded: LoadedProgram = device.load(self.modules, runtime_sources())
        self._starts: dict[str, int] = {}
        """Where each object's pointers begin in the array of all."""
        total = 0
        for name, object_code in code.codes.items():
            self._starts[name] = total
            total += max(1, len(object_code.bindings))
        self._pointers = np.zeros(total, np.uint64)
        self._arguments = DeviceArray(device, np.uint64, "the kernels' arguments").resize(total)
        self._workspace = DeviceArray(device, np.float64, "the workspace of projections")

    @property
    def log(self) -> list[CompiledModule]:
        """One line for each file that was compiled, and the link."""
        return [CompiledModule(row.name, row.seconds, row.cached, row.lines) for row in self.loaded.rows]

    def bind(self, address_of: Callable[[Binding], int]) -> None:
        """Points all objects to arrays on the device; again whenever one has moved."""
        for name, code in self.code.codes.items():
            for k, binding in enumerate(code.bindings):
                is_object = binding.kind == "arguments"
                self._pointers[self._starts[name] + k] = (
                    self.arguments(binding.name) if is_object else address_of(binding)
                )
        self._arguments.upload(self._pointers)

    def arguments(self, name: str) -> int:
        """Address of an object's pointers."""
        return self._arguments.address + 8 * self._starts[name]

    def launch_batch(self, name: str, count: int, out: DeviceArray) -> None:
        """Writes an attribute's values on `count` instances to `out`."""
        kernel = self.loaded.kernel(f"{self.code.codes[name].symbol}_batch")
        self.device.launch(kernel, count, [self.arguments(name), count, out.address])

    def sort_by_branches(self, name: str, count: int, scratch: BuildScratch, order: DeviceArray) -> bool:
        """Writes to `order`, uint32, an order of an energy's `count` instances in which those that take the same
        branches of UNIONs follow each other, else as they are; False where all take the same.

        name: of the energy's derivatives. Threads of a warp that take several branches wait for each other.
        """
        code = self.code.codes[name]
        if not code.branches:
            return False
        order.resize(count)
        if count == 0:
            return True
        scratch.reserve(count)
        kernel = self.loaded.kernel(f"{code.symbol}_branches")
        arguments = [self.arguments(name), count, scratch.keys.address, scratch.sources.address]
        self.device.launch(kernel, count, arguments)
        keys = (scratch.keys.address, scratch.sorted_keys.address)
        bits = min((code.branches - 1).bit_length(), 64)
        self.device.sort_pairs(keys, (scratch.sources.address, order.address), count, bits)
        return True

    def launch_derivative(self, run: DerivativeLaunch) -> None:
        """Adds an energy's derivatives to what they are added to."""
        code = self.code.codes[run.symbol]
        threads = run.count
        if code.workspace:
            with_room = max(THREADS, MOST_WORKSPACE // code.workspace // THREADS * THREADS)
            threads = min(threads, MOST_THREADS_WITH_WORKSPACE, with_room)
            in_blocks = -(-threads // THREADS) * THREADS
            if self._workspace.size < code.workspace * in_blocks:
                self._workspace.resize(code.workspace * in_blocks)
        fields = {**vars(run), "workspace": self._workspace.address}
        arguments = [self.arguments(run.symbol), run.count, *(fields[name] for _, name in DEVICE_FIELDS)]
        self.device.launch(self.loaded.kernel(f"{code.symbol}_derive"), threads, arguments)


def modules_of(code: SceneCode) -> list[Source]:
    """The generated files of a scene, each once, named after what the first of its objects computes."""
    names = {item.symbol: name for name, item in reversed(code.codes.items())}
    texts = {item.symbol: item.text for item in code.codes.values()}
    return [Source(names[symbol], text) for symbol, text in texts.items()]
