"""Index arrays that another library made on the device: taken as they are, without a copy."""

from __future__ import annotations

from typing import Any

import numpy as np

from yasps.runtime.device.protocol import Device

CUDA_OF_DLPACK = (2, 13)
"""kDLCUDA and kDLCUDAManaged in dlpack.h."""
_VERSION_WITH_STREAM = 3
"""Of `__cuda_array_interface__`: from this one on, no stream means that nobody has to wait."""


class ForeignArrayError(ValueError):
    """An array on a device that cannot be used as it is; the message says why."""


class DeviceIndices:
    """int32 on a device, C-contiguous, complete for all that the device is asked for from now on.

    shape: as its maker says. address: where it begins. The array is kept alive; its maker must not change it while it
    is in use: give the connectivity a new one instead.
    """

    def __init__(self, shape: tuple[int, ...], address: int, owner: object) -> None:
        self.shape = shape
        self.address = address
        self._owner = owner

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def size(self) -> int:
        """Number of indices."""
        return int(np.prod(self.shape, dtype=np.int64))

    def in_rows_of(self, arity: int) -> DeviceIndices:
        """The same indices, so many in a row."""
        return DeviceIndices((self.size // arity, arity), self.address, self._owner)


def is_on_device(value: object) -> bool:
    """Is it an array on a GPU: of CuPy, PyTorch, JAX, Warp, ...?"""
    return _has_dlpack(value) or _has_interface(value)


def device_indices(value: Any, device: Device) -> DeviceIndices:
    """The array on a device behind DLPack or `__cuda_array_interface__` (version 2 or 3).

    The device waits for the work that fills the array, as far as it was asked for until now. By DLPack the array's
    maker sees to it, and by version 3 of the interface it names its stream. Version 2 (PyTorch's) names none: then the
    host waits for all work on the device.

    Raises ForeignArrayError for another type than int32, for rows that do not lie one after another, for an array with
    a mask, on another GPU, or that its maker does not hand out.
    """
    if _has_dlpack(value):
        shape, dtype, strides, address, owner = _by_dlpack(value, device)
    else:
        shape, dtype, strides, address, owner = _by_interface(value, device)
    if dtype != np.int32:
        raise ForeignArrayError(f"indices on a device must be int32, got {dtype}; convert them there")
    if 0 not in shape:
        if strides is not None and not _is_contiguous(shape, strides):
            raise ForeignArrayError(
                f"indices on a device must be C-contiguous, got shape {shape} with strides {strides}"
            )
        if not device.holds(address):
            raise ForeignArrayError(f"the array is not in the memory of {device.name}, where the scene runs; copy it")
    return DeviceIndices(shape, address, owner)


_Found = tuple[tuple[int, ...], np.dtype[Any], tuple[int, ...] | None, int, object]
"""Shape, type, strides in bytes (None: C-contiguous), address, and what keeps the memory."""


def _has_dlpack(value: object) -> bool:
    if isinstance(value, np.ndarray) or not hasattr(value, "__dlpack_device__"):
        return False
    return int(value.__dlpack_device__()[0]) in CUDA_OF_DLPACK


def _has_interface(value: object) -> bool:
    return hasattr(value, "__cuda_array_interface__")


def _by_dlpack(value: Any, device: Device) -> _Found:
    from cuda.core.utils import StridedMemoryView

    try:
        view = StridedMemoryView.from_dlpack(value, stream_ptr=device.stream_address)
        dtype = np.dtype(view.dtype)
    except (BufferError, NotImplementedError, TypeError) as error:
        raise ForeignArrayError(f"{type(value).__module__} does not hand out its array: {error}") from error
    strides = None if view.strides is None else tuple(step * dtype.itemsize for step in view.strides)
    return tuple(view.shape), dtype, strides, int(view.ptr), view  # the view keeps what was handed out


def _by_interface(value: Any, device: Device) -> _Found:
    interface = value.__cuda_array_interface__
    if interface.get("mask") is not None:
        raise ForeignArrayError("the array has a mask, which would be lost; fill it in there")
    stream = interface.get("stream")
    if stream is not None:
        device.wait_for(int(stream))
    elif interface["version"] < _VERSION_WITH_STREAM:
        device.wait_for_all()
    strides = interface.get("strides")
    return (
        tuple(interface["shape"]),
        np.dtype(interface["typestr"]),
        None if strides is None else tuple(strides),
        int(interface["data"][0]),
        value,
    )


def _is_contiguous(shape: tuple[int, ...], strides: tuple[int, ...]) -> bool:
    """Do rows lie one after another? The stride of an axis of one item says nothing."""
    wanted = [4 * int(np.prod(shape[k + 1 :], dtype=np.int64)) for k in range(len(shape))]
    return all(step == want or extent == 1 for step, want, extent in zip(strides, wanted, shape, strict=True))
