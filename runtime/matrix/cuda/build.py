"""What builds of matrices and gradients on a device have in common: index arrays, sorting, and memory for it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from yasps.runtime.device.protocol import Device, DeviceArray

MOST_SOURCES = 2**32 - 1
"""Local blocks, or slots, that one sort can tell apart by uint32 numbers."""


class BuildScratch:
    """Memory that a build needs in passing, kept for the next one.

    Matrices and gradients of one device can share it, since a device does one thing after another. Per local block: 24
    bytes and what the device itself needs to sort.
    """

    def __init__(self, device: Device) -> None:
        """Without memory yet."""
        self.device = device
        #: What is sorted; after that, 8 bytes per item for prefix sums.
        self.keys = DeviceArray(device, np.uint64, "keys of local blocks")
        self.sources = DeviceArray(device, np.uint32, "numbers of local blocks")
        self.sorted_keys = DeviceArray(device, np.uint64, "sorted keys of local blocks")
        self.sorted_sources = DeviceArray(device, np.uint32, "sorted numbers of local blocks")
        #: Of the host: which source is bad (0 = none yet), then (first source, kappa, capacity) of every energy.
        self.request = DeviceArray(device, np.int64, "table of index arrays")
        #: For the host: which source is bad, then counts.
        self.answer = DeviceArray(device, np.int64, "counts of blocks")
        #: Of the host: where results go.
        self.places = DeviceArray(device, np.int64, "table of positions")

    def reserve(self, count: int) -> None:
        """Makes room to sort `count` items."""
        for array in (self.keys, self.sources, self.sorted_keys, self.sorted_sources):
            array.resize(count)

    @property
    def table(self) -> int:
        """Address of the energies' table."""
        return self.request.address + 8

    def send(self, kappas: Sequence[DeviceArray], first_sources: Sequence[int]) -> None:
        """Gives the device the table of all energies, and the place where it notes a bad slot."""
        table = [0]
        for kappa, first in zip(kappas, first_sources, strict=False):
            table += [first, kappa.address, kappa.shape[1]]
        self.request.upload(np.array(table, np.int64))

    def sort(self, count: int, bits: int) -> None:
        """Sorts by the lowest `bits` bits of the keys."""
        keys = (self.keys.address, self.sorted_keys.address)
        self.device.sort_pairs(keys, (self.sources.address, self.sorted_sources.address), count, bits)

    def sum(self, count: int) -> int:
        """Prefix sums of what was written over the unsorted keys, in their place; returns where that is."""
        self.device.exclusive_sum(self.keys.address, self.keys.address, count)
        return self.keys.address


def check_kappas(kappas: Sequence[DeviceArray]) -> None:
    """Raises ValueError unless all are int32 [instances, slots]."""
    for energy, kappa in enumerate(kappas):
        if len(kappa.shape) != 2 or kappa.dtype != np.int32:
            raise ValueError(
                f"kappas[{energy}] has shape {kappa.shape} and type {kappa.dtype}; int32 of shape [instances, slots] "
                "is needed on a device"
            )


def find_first_sources(per_energy: Sequence[int]) -> list[int]:
    """Where each energy's sources begin, and the number of all."""
    firsts = [0]
    for count in per_energy:
        firsts.append(firsts[-1] + count)
    return firsts


def bad_source(code: int) -> int | None:
    """The first source that named no dof block, from what the kernels noted; None where all did."""
    return 2**32 - code if code else None


def describe_slot(kappas: Sequence[DeviceArray], energy: int, instance: int, slot: int) -> str:
    """Which index is wrong; reads it from the device."""
    index = np.zeros(1, np.int32)
    kappa = kappas[energy]
    kappa.device.download(kappa.address + 4 * (instance * kappa.shape[1] + slot), index)
    return f"index {index[0]} in kappas[{energy}][{instance}, {slot}]"
