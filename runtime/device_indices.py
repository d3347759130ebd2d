"""Index arrays that another library made on the device: taken as they are, without a copy."""

from __future__ import annotations

from typing import Any

import numpy as np

CUDA_OF_DLPACK = 2
"""kDLCUDA in dlpack.h."""


class ForeignArrayError(ValueError):
    """An array on a device that cannot be used as it is; the message says why."""


class DeviceIndices:
    """int32 on a device, C-contiguous.

    shape: as its maker says. address: where it begins. stream: of the work that fills it, or None when that is done.
    The array is kept alive; its maker must not change it while it is in use: give the connectivity a new one instead.
    """

    def __init__(self, shape: tuple[int, ...], address: int, stream: int | None, owner: object) -> None:
        self.shape = shape
        self.address = address
        self.stream = stream
        self._owner = owner

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def size(self) -> int:
        """Number of indices."""
        return int(np.prod(self.shape, dtype=np.int64))

    def in_rows_of(self, arity: int) -> DeviceIndices:
        """The same indices, so many in a row."""
        return DeviceIndices((self.size // arity, arity), self.address, self.stream, self._owner)


def is_on_device(value: object) -> bool:
    """Is it an array on a GPU: of CuPy, PyTorch, JAX, Warp, ...?"""
    if hasattr(value, "__cuda_array_interface__"):
        return True
    if isinstance(value, np.ndarray) or not hasattr(value, "__dlpack_device__"):
        return False
    return bool(int(value.__dlpack_device__()[0]) == CUDA_OF_DLPACK)


def device_indices(value: Any, stream: int) -> DeviceIndices:
    """The array on a device behind `__cuda_array_interface__` (version 2 or 3) or DLPack.

    stream: the one it is going to be read on, for makers that let it wait for theirs (DLPack).

    Raises ForeignArrayError for another type than int32 and for rows that do not lie one after another.
    """
    if hasattr(value, "__cuda_array_interface__"):
        interface = value.__cuda_array_interface__
        shape, dtype = tuple(interface["shape"]), np.dtype(interface["typestr"])
        strides, filled_by = interface.get("strides"), interface.get("stream")
        address = int(interface["data"][0])
    else:
        from cuda.core.utils import StridedMemoryView

        view = StridedMemoryView.from_dlpack(value, stream_ptr=stream)
        shape, dtype, filled_by = tuple(view.shape), np.dtype(view.dtype), None
        strides = None if view.strides is None else tuple(step * dtype.itemsize for step in view.strides)
        address = int(view.ptr)
    if dtype != np.int32:
        raise ForeignArrayError(f"indices on a device must be int32, got {dtype}; convert them there")
    if strides is not None and tuple(strides) != _contiguous_strides(shape):
        raise ForeignArrayError(f"indices on a device must be C-contiguous, got shape {shape} with strides {strides}")
    return DeviceIndices(shape, address, filled_by, value)


def _contiguous_strides(shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(4 * int(np.prod(shape[k + 1 :], dtype=np.int64)) for k in range(len(shape)))
