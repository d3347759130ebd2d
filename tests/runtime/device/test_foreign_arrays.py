"""Index arrays of other libraries: who waits for whom, and what is refused. The host's memory plays the device's."""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import weakref
from typing import Any

import numpy as np
import pytest
from cuda_on_host import HostDevice
from numpy.typing import NDArray

from yasps.runtime.device.foreign_arrays import ForeignArrayError, device_indices, is_on_device
from yasps.runtime.device.protocol import DeviceArray

PAIRS = np.array([[0, 1], [2, 3], [4, 5]], np.int32)
STREAM = 0x51

needs_cuda = pytest.mark.skipif(
    importlib.util.find_spec("cuda") is None, reason="needs the packages of pip install 'yasps[cuda]'"
)


class WaitingDevice(HostDevice):
    """Notes what it waits for: a stream, or "all"."""

    name = "the device of this test"
    stream_address = STREAM

    def __init__(self) -> None:
        super().__init__()
        self.waits: list[int | str] = []
        self.is_elsewhere = False

    def wait_for(self, stream: int) -> None:
        self.waits.append(stream)

    def wait_for_all(self) -> None:
        self.waits.append("all")

    def holds(self, address: int) -> bool:
        return not self.is_elsewhere


class WithInterface:
    """As PyTorch's and CuPy's arrays describe themselves, version 2 and 3."""

    def __init__(self, array: NDArray[Any], version: int = 3, **more: Any) -> None:
        self.array = array
        self.__cuda_array_interface__ = {
            "shape": array.shape,
            "typestr": array.dtype.str,
            "data": (array.ctypes.data, False),
            "strides": array.strides,
            "version": version,
            **more,
        }


class WithDLPack:
    """Hands out what NumPy does, as memory of a GPU; notes for which stream."""

    def __init__(self, array: NDArray[Any], device: int = 2) -> None:
        self.array, self.device = array, device
        self.streams: list[object] = []
        self.error: Exception | None = None

    def __dlpack_device__(self) -> tuple[int, int]:
        return self.device, 0

    def __dlpack__(self, *, stream: object = None, **options: Any) -> object:
        if self.error is not None:
            raise self.error
        self.streams.append(stream)
        capsule = self.array.__dlpack__()
        get = ctypes.pythonapi.PyCapsule_GetPointer
        get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
        tensor = get(capsule, b"dltensor")
        ctypes.c_int32.from_address(tensor + 8).value = self.device  # behind the pointer to the data
        return capsule


class WithBoth(WithDLPack, WithInterface):
    """As PyTorch's tensors."""

    def __init__(self, array: NDArray[Any]) -> None:
        WithDLPack.__init__(self, array)
        WithInterface.__init__(self, array, version=2)


@needs_cuda
def test_the_maker_of_an_array_is_asked_to_let_our_stream_wait() -> None:
    """DLPack goes first: version 2 of the interface, which PyTorch has too, names no stream."""
    for made in (WithDLPack(PAIRS), WithDLPack(PAIRS, device=13), WithBoth(PAIRS)):
        device = WaitingDevice()
        assert is_on_device(made)
        found = device_indices(made, device)
        assert made.streams == [STREAM]
        assert device.waits == []
        assert (found.shape, found.address) == ((3, 2), PAIRS.ctypes.data)


def test_the_device_waits_for_the_stream_that_an_array_names_or_for_all() -> None:
    for version, more, waits in (
        (3, {"stream": 7}, [7]),
        (3, {"stream": 1}, [1]),
        (3, {"stream": None}, []),  # its maker says that nobody needs to
        (3, {}, []),
        (2, {}, ["all"]),
    ):
        device = WaitingDevice()
        array = WithInterface(PAIRS, version, **more)
        assert is_on_device(array)
        found = device_indices(array, device)
        assert (found.shape, found.address, len(found), found.size) == ((3, 2), PAIRS.ctypes.data, 3, 6)
        assert device.waits == waits


def test_our_own_arrays_name_their_stream() -> None:
    device = WaitingDevice()
    array = DeviceArray(device, np.int32, "pairs").upload(PAIRS)
    interface = array.__cuda_array_interface__
    assert (interface["version"], interface["stream"]) == (3, STREAM)
    device_indices(array, device)
    assert device.waits == [STREAM]
    on_host = DeviceArray(HostDevice(), np.int32, "pairs").upload(PAIRS)
    assert on_host.__cuda_array_interface__["stream"] is None, "0 is no stream, says version 3"


def test_what_cannot_be_read_as_it_is() -> None:
    wide = np.zeros((3, 4), np.int32)
    for array, message in (
        (WithInterface(PAIRS.astype(np.int64)), "must be int32, got int64; convert them there"),
        (WithInterface(PAIRS.astype(">i4")), "must be int32"),
        (WithInterface(PAIRS.astype(np.uint32)), "must be int32, got uint32"),
        (WithInterface(PAIRS.T), r"C-contiguous, got shape \(2, 3\) with strides \(4, 8\)"),
        (WithInterface(wide[:, :2]), r"C-contiguous, got shape \(3, 2\) with strides \(16, 4\)"),
        (WithInterface(PAIRS, mask=WithInterface(PAIRS)), "mask"),
    ):
        with pytest.raises(ForeignArrayError, match=message):
            device_indices(array, WaitingDevice())
    device = WaitingDevice()
    device.is_elsewhere = True
    with pytest.raises(ForeignArrayError, match="not in the memory of the device of this test"):
        device_indices(WithInterface(PAIRS), device)
    nothing = WithInterface(np.zeros((0, 2), np.int32), data=(0, False))
    assert device_indices(nothing, device).size == 0, "no address either"
    one_row = WithInterface(wide[:1, :2])  # the stride from row to row says nothing
    assert device_indices(one_row, WaitingDevice()).shape == (1, 2)


@needs_cuda
def test_what_cannot_be_read_by_dlpack() -> None:
    with pytest.raises(ForeignArrayError, match="int64"):
        device_indices(WithDLPack(PAIRS.astype(np.int64)), WaitingDevice())
    with pytest.raises(ForeignArrayError, match=r"strides \(4, 8\)"):
        device_indices(WithDLPack(PAIRS.T), WaitingDevice())
    refusing = WithDLPack(PAIRS)
    refusing.error = BufferError("it requires a gradient")
    with pytest.raises(ForeignArrayError, match="does not hand out its array: it requires a gradient"):
        device_indices(refusing, WaitingDevice())


def test_arrays_of_the_host_are_none() -> None:
    for value in (PAIRS, PAIRS.tolist(), None, WithDLPack(PAIRS, device=1)):
        assert not is_on_device(value)


@needs_cuda
def test_what_was_handed_out_is_kept() -> None:
    """Some makers hand out a copy, which lives as long as the capsule that holds it."""

    class Copying(WithDLPack):
        def __dlpack__(self, **options: Any) -> object:
            copy = self.array.copy().view(Watched)
            alive.append(weakref.ref(copy))
            self.array = copy
            capsule = super().__dlpack__(**options)
            self.array = PAIRS
            return capsule

    class Watched(np.ndarray):
        """Can be referred to weakly."""

    alive: list[weakref.ref[Any]] = []
    found = device_indices(Copying(PAIRS), WaitingDevice()).in_rows_of(2)
    gc.collect()
    assert alive[0]() is not None
    read = np.ctypeslib.as_array((ctypes.c_int32 * 6).from_address(found.address))
    np.testing.assert_array_equal(read.reshape(3, 2), PAIRS)
    del found
    gc.collect()
    assert alive[0]() is None
