"""Sums of arrays on a device, always in the same order of additions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yasps.runtime.core.sink import THREADS
from yasps.runtime.device.protocol import Device, DeviceArray, LoadedProgram, blocks_for_sum


class DeviceSum:
    """Sums several arrays; the results come to the host together."""

    def __init__(self, device: Device, program: LoadedProgram) -> None:
        """`program` holds the kernels of sum.cu."""
        self._device, self._program = device, program
        self._partial = DeviceArray(device, np.float64, "partial sums")
        self._results = DeviceArray(device, np.float64, "sums")
        self._count = 0

    def begin(self, most: int) -> None:
        """Forgets earlier results and makes room for so many."""
        self._results.resize(most).clear()
        self._count = 0

    def add(self, values: DeviceArray) -> None:
        """Sums this array, float64; it may change afterwards."""
        blocks = blocks_for_sum(self._device, values.size)
        result = self._results.address + 8 * self._count
        self._count += 1
        if blocks == 0:
            return
        partial = self._partial.resize(blocks).address
        parts, finish = self._program.kernel("yasps_sum_parts"), self._program.kernel("yasps_sum_finish")
        self._device.launch(parts, blocks * THREADS, [values.address, values.size, partial], block=THREADS)
        self._device.launch(finish, THREADS, [partial, blocks, result], block=THREADS)

    def results(self) -> NDArray[np.float64]:
        """The sums since `begin`, in order; waits."""
        return self._results.download()[: self._count]
