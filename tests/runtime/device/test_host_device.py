"""The device that the host plays refuses, while a graph is recorded, what CUDA refuses."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext

import numpy as np
import pytest
from cuda_on_host import HostDevice

from yasps import DeviceError
from yasps.runtime.device.disposal import DISPOSAL
from yasps.runtime.device.protocol import DeviceArray

CALLS: dict[str, Callable[[HostDevice, DeviceArray], object]] = {
    "allocate": lambda device, array: device.allocate(8, "more"),
    "upload": lambda device, array: array.upload(np.zeros(4)),
    "download": lambda device, array: array.download(),
    "load": lambda device, array: device.load([]),
    "record": lambda device, array: device.record(lambda: None),
    "sort_pairs": lambda device, array: device.sort_pairs((array.address,) * 2, (array.address,) * 2, 0, 1),
    "exclusive_sum": lambda device, array: device.exclusive_sum(array.address, array.address, 0),
    "wait_for": lambda device, array: device.wait_for(1),
    "wait_for_all": lambda device, array: device.wait_for_all(),
    "synchronize": lambda device, array: device.synchronize(),
}


@pytest.mark.parametrize("call", CALLS)
def test_refuses_while_recording(call: str) -> None:
    device = HostDevice()
    array = DeviceArray(device, np.float64, "numbers").upload(np.ones(4))

    def work() -> None:
        array.clear()
        CALLS[call](device, array)

    with pytest.raises(DeviceError, match=rf"^{call}\b.* was called while a graph was recorded, which CUDA refuses$"):
        device.record(work)
    np.testing.assert_array_equal(array.download(), np.ones(4))  # and the device goes on
    graph = device.record(array.clear)
    graph.launch()
    np.testing.assert_array_equal(array.download(), np.zeros(4))


def test_memory_that_goes_while_recording_is_freed_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    device = HostDevice()
    left = [device.allocate(8, "one"), device.allocate(8, "two")]
    device.record(left.clear)
    assert device.used == 0
    monkeypatch.setattr(DISPOSAL, "recording", nullcontext)
    left = [device.allocate(8, "one"), device.allocate(8, "two")]
    with pytest.raises(DeviceError, match="freed while a graph was recorded, which CUDA refuses: two, one"):
        device.record(left.clear)
    device.record(lambda: None)
