"""Finding the GPU, with a driver made of Python functions, and the sentences where there is none."""

from __future__ import annotations

import ctypes
import importlib.util
import types
from enum import IntEnum

import pytest

from yasps import NoDeviceError
from yasps.runtime.device.driver import CudaDevice, device_of, find_device
from yasps.runtime.device.residency import Residency


class Status(IntEnum):
    CUDA_SUCCESS = 0
    CUDA_ERROR_NO_DEVICE = 100
    CUDA_ERROR_SYSTEM_NOT_READY = 802


class Attribute(IntEnum):
    CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT = 16
    CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_MULTIPROCESSOR = 39
    CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR = 75
    CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR = 76


def driver_of(
    capabilities: list[tuple[int, int]], version: int = 13000, status: Status = Status.CUDA_SUCCESS
) -> types.ModuleType:
    """As `cuda.bindings.driver`, on a machine with GPUs of these compute capabilities."""
    driver = types.ModuleType("driver")

    def attribute_of(attribute: Attribute, device: int) -> tuple[Status, int]:
        major, minor = capabilities[device]
        return Status.CUDA_SUCCESS, {75: major, 76: minor, 16: 132, 39: 2048}[attribute]

    functions = {
        "cuInit": lambda flags: (status,),
        "cuDriverGetVersion": lambda: (Status.CUDA_SUCCESS, version),
        "cuDeviceGetCount": lambda: (Status.CUDA_SUCCESS, len(capabilities)),
        "cuDeviceGet": lambda ordinal: (Status.CUDA_SUCCESS, ordinal),
        "cuDeviceGetName": lambda size, device: (Status.CUDA_SUCCESS, f"GPU {device}".encode().ljust(size, b"\0")),
        "cuDeviceGetAttribute": attribute_of,
    }
    for name, value in {"CUresult": Status, "CUdevice_attribute": Attribute, **functions}.items():
        setattr(driver, name, value)
    return driver


def test_the_architecture_comes_from_the_device() -> None:
    driver = driver_of([(9, 0), (12, 0)], version=13020)
    assert device_of(driver, 0) == CudaDevice(0, "GPU 0", "sm_90", (13, 2), Residency(132, 2048))
    assert device_of(driver, 1) == CudaDevice(1, "GPU 1", "sm_120", (13, 2), Residency(132, 2048))


def test_what_is_missing_is_said() -> None:
    with pytest.raises(NoDeviceError, match="no GPU number 1: the NVIDIA driver sees 1"):
        device_of(driver_of([(9, 0)]), 1)
    with pytest.raises(NoDeviceError, match="no GPU number -1"):
        device_of(driver_of([(9, 0)]), -1)
    with pytest.raises(NoDeviceError, match=r"sees no GPU .*CUDA_VISIBLE_DEVICES.*device='cpu'"):
        device_of(driver_of([], status=Status.CUDA_ERROR_NO_DEVICE), 0)
    with pytest.raises(NoDeviceError, match=r"knows CUDA 12\.8, .*CUDA 13\.0.*580"):
        device_of(driver_of([(9, 0)], version=12080), 0)
    with pytest.raises(NoDeviceError, match="cuInit gave CUDA_ERROR_SYSTEM_NOT_READY; device='cpu' works"):
        device_of(driver_of([(9, 0)], status=Status.CUDA_ERROR_SYSTEM_NOT_READY), 0)


def test_a_missing_driver_gives_one_sentence() -> None:
    if importlib.util.find_spec("cuda") is None:
        pytest.skip("needs the packages of pip install 'yasps[cuda]'")
    try:
        ctypes.CDLL("libcuda.so.1")
    except OSError:
        with pytest.raises(NoDeviceError, match=r"no NVIDIA driver .*device='cpu' works") as caught:
            find_device()
        assert "\n" not in str(caught.value)
    else:
        pytest.skip("there is a driver")
