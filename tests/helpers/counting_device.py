"""Devices made of the host that note what is asked of them, or refuse it."""

from __future__ import annotations

from typing import Any

from cuda_on_host import HostDevice, HostMemory
from numpy.typing import NDArray

from yasps import DeviceMemoryError


class CountingDevice(HostDevice):
    """Notes where uploads and downloads go, and refuses one allocation."""

    def __init__(self) -> None:
        super().__init__()
        self.uploads: list[int] = []
        """Addresses."""
        self.downloads: list[int] = []
        """Numbers of bytes."""
        self.allocation_count = 0
        self.refused: int | None = None
        """Number of the allocation that there is no room for, however often it is tried; `allocation_count` counts."""

    def upload(self, array: NDArray[Any], address: int) -> None:
        self.uploads.append(address)
        super().upload(array, address)

    def download(self, address: int, array: NDArray[Any]) -> None:
        self.downloads.append(array.nbytes)
        super().download(address, array)

    def allocate(self, size: int, purpose: str) -> HostMemory:
        if self.allocation_count == self.refused:
            raise DeviceMemoryError(f"{purpose}: {size} bytes were asked for, and refused")
        self.allocation_count += 1
        return super().allocate(size, purpose)


class RefusingDevice(HostDevice):
    """Has no room after some allocations."""

    granted = 1000

    def allocate(self, size: int, purpose: str) -> HostMemory:
        """As on the host, as long as it is granted."""
        if self.granted == 0:
            raise DeviceMemoryError(f"no room for {purpose}")
        self.granted -= 1
        return super().allocate(size, purpose)
