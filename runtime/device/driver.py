"""Which NVIDIA GPU there is, asked of the driver; and one clear sentence where there is none."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

from yasps.runtime.build.cuda.nvcc import INSTALL_ADVICE, CudaNotFoundError
from yasps.runtime.device.residency import Residency

OLDEST_DRIVER = (13, 0)
"""The CUDA release that a driver must know, to load what the toolkit of `yasps[cuda]` compiles: drivers from 580 on."""

_CPU_ADVICE = "device='cpu' works without a GPU"


class NoDeviceError(RuntimeError):
    """There is no GPU to run on; the message says what is missing."""


@dataclass(frozen=True)
class CudaDevice:
    """A GPU: `ordinal` counts from 0, `arch` as compilers spell it ("sm_90"), `driver` its CUDA release."""

    ordinal: int
    name: str
    arch: str
    driver: tuple[int, int]
    residency: Residency


def find_device(ordinal: int = 0) -> CudaDevice:
    """The GPU with this number, in the order of CUDA_VISIBLE_DEVICES. Nothing is allocated on it.

    Raises NoDeviceError without a driver, without that GPU and with a driver that is too old, and CudaNotFoundError
    where cuda-bindings is not installed.
    """
    try:
        from cuda.bindings import driver
    except ImportError as error:
        raise CudaNotFoundError(f"the package cuda-bindings is not installed.\n{INSTALL_ADVICE}") from error
    return device_of(driver, ordinal)


def device_of(driver: ModuleType, ordinal: int) -> CudaDevice:
    """As `find_device`, with the functions of `cuda.bindings.driver`."""
    # The only way in which a missing libcuda shows: the first call raises RuntimeError.
    try:
        (status,) = driver.cuInit(0)
    except RuntimeError as error:
        raise NoDeviceError(
            f"there is no NVIDIA driver on this machine ({error}); {_CPU_ADVICE}, and scene.compile(device='cuda', "
            "arch='sm_90') compiles for a GPU without one"
        ) from error
    if status == driver.CUresult.CUDA_ERROR_NO_DEVICE:
        raise NoDeviceError(f"the NVIDIA driver sees no GPU (is CUDA_VISIBLE_DEVICES empty?); {_CPU_ADVICE}")
    _check(driver, status, "cuInit")
    number = _ask(driver, "cuDriverGetVersion")
    release = (number // 1000, number % 1000 // 10)
    if release < OLDEST_DRIVER:
        raise NoDeviceError(
            f"the NVIDIA driver knows CUDA {release[0]}.{release[1]}, but yasps compiles with CUDA "
            f"{OLDEST_DRIVER[0]}.{OLDEST_DRIVER[1]}, for drivers from 580 on; update the driver. {_CPU_ADVICE}"
        )
    count = _ask(driver, "cuDeviceGetCount")
    if not 0 <= ordinal < count:
        raise NoDeviceError(f"there is no GPU number {ordinal}: the NVIDIA driver sees {count}, counted from 0")
    device = _ask(driver, "cuDeviceGet", ordinal)
    name = _ask(driver, "cuDeviceGetName", 256, device)
    attribute = driver.CUdevice_attribute
    major, minor, multiprocessors, threads = (
        _ask(driver, "cuDeviceGetAttribute", getattr(attribute, f"CU_DEVICE_ATTRIBUTE_{what}"), device)
        for what in (
            "COMPUTE_CAPABILITY_MAJOR",
            "COMPUTE_CAPABILITY_MINOR",
            "MULTIPROCESSOR_COUNT",
            "MAX_THREADS_PER_MULTIPROCESSOR",
        )
    )
    clear_name = name.partition(b"\0")[0].decode(errors="replace")
    return CudaDevice(ordinal, clear_name, f"sm_{major}{minor}", release, Residency(multiprocessors, threads))


def _ask(driver: ModuleType, function: str, *arguments: object) -> Any:
    """The value that a function of the driver gives."""
    status, value = getattr(driver, function)(*arguments)
    _check(driver, status, function)
    return value


def _check(driver: ModuleType, status: Any, function: str) -> None:
    if status != driver.CUresult.CUDA_SUCCESS:
        raise NoDeviceError(f"the NVIDIA driver does not work: {function} gave {status.name}; {_CPU_ADVICE}")
