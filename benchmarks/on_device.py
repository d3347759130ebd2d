"""What benchmarks with `--device cuda` share: the device, its copy bandwidth, timed launches, rows above the floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.measure import Peer, Row, measure
from yasps import Scene
from yasps.frontend.commands.environment_report import cpu_model
from yasps.runtime.core.library import available_processors
from yasps.runtime.device.protocol import Device, DeviceArray

Where = int | Device
"""Threads of this machine's processors, or a device."""

COPIED_BYTES = 1 << 30  # many times the last cache of any GPU, each way
LAUNCHES = 20
"""How often work is asked for before the device is waited for; a time is that of one of them."""

ON_DEVICE = 0
"""Stands for the number of threads in the rows of a device."""

DEVICE_NOTES = (
    f"threads {ON_DEVICE}: on the GPU. Its times are from asking until the device is done, {LAUNCHES} times the "
    "same at once; data is there already, unless a row says that it is copied.",
    "floor, bytes: every input byte read once and every result byte written once, as counted on the CPU, at the "
    "bandwidth of a copy within the GPU's memory in this run (read plus written). share: floor over time.",
)


def new_scene(name: str, where: Where) -> Scene:
    """An empty scene there."""
    return Scene(name, threads=where) if isinstance(where, int) else Scene(name, device=where)


def open_gpu(name: str) -> Device:
    """The GPU that `--device` names: "cuda", or "cuda:1". Raises NoDeviceError, CudaNotFoundError."""
    from yasps.runtime.device.gpu import Gpu

    return Gpu(int(name.partition(":")[2] or 0))


def repeated(device: Device, work: Callable[[], object], times: int = LAUNCHES) -> Callable[[], None]:
    """A function that asks for the work so many times and then waits for it."""

    def run() -> None:
        for _ in range(times):
            work()
        device.synchronize()

    return run


def device_peer(device: Device, peer: Peer, times: int = LAUNCHES) -> Peer:
    """The same, whose `run` only asks the device for work: as often as this, and then the device is waited for."""
    return replace(peer, threads=ON_DEVICE, run=repeated(device, peer.run, times), scale=peer.scale / times)


def copy_bandwidth(device: Device, repeats: int) -> Row:
    """GB/s (1e9) of copies within the device's memory, bytes read plus bytes written."""
    source, target = (DeviceArray(device, np.float64, "the buffers of a copy") for _ in range(2))
    source.upload(np.random.default_rng(0).standard_normal(COPIED_BYTES // 8))
    target.resize(source.size)

    def work() -> None:
        device.copy(source.address, target.address, source.nbytes)

    peer = Peer("memory bandwidth", "copy", ON_DEVICE, work, 1.0, "s")
    (row,) = measure([device_peer(device, peer)], repeats)
    moved = 2 * source.nbytes / 1e9
    assert row.median is not None
    return replace(row, value=moved / row.value, unit="GB/s", median=moved / row.median)


def share_rows(moved: float, bandwidth: Row, rows: Sequence[Row], scale: float) -> list[Row]:
    """The floor under those of the rows that are of a device, where each moves so many bytes, and what share of the
    bandwidth they reach. scale: from seconds to the unit of the rows.
    """
    floor = moved / (1e9 * bandwidth.value) * scale
    found = [Row(f"{rows[0].case}: floor", "bytes", ON_DEVICE, floor, rows[0].unit)]
    return found + [
        Row(f"{row.case}: share of bandwidth", row.implementation, ON_DEVICE, 100 * floor / row.value, "%")
        for row in rows
        if row.threads == ON_DEVICE
    ]


def about_device(device: Device, what: str, repeats: int) -> list[str]:
    """What was timed, and where."""
    return [
        f"{what}; least and median of {repeats} rounds, in which all rows of a group take turns.",
        f"{device.name} ({device.architecture}), beside {cpu_model()}, {available_processors()} processors.",
    ]
