"""What a bug report should say about the machine: `yasps info`."""

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Final

from yasps.runtime.build import toolchain
from yasps.runtime.build.cuda.nvcc import CudaNotFoundError
from yasps.runtime.device.driver import NoDeviceError, find_device

PACKAGES: Final = ("numpy", "scipy", "xdsl", "ipctk", "meshio", "h5py", "pyvista")


def environment_report() -> dict[str, str]:
    """Versions, processor, compiler and folders, each as one line of text, in the order to print them.

    Nothing here needs a compiler or imports the packages it names, and nothing raises: what is missing is
    said in the text.
    """
    report = {
        "yasps": package_version("yasps"),
        "Python": f"{platform.python_version()} ({platform.python_implementation()})",
        "operating system": platform.platform(),
        "CPU": f"{cpu_model()}, {_usable_cores()} cores usable of {os.cpu_count() or 'an unknown number'}",
        "C++ compiler": _compiler(),
        "cache folder": _cache_folder(),
    }
    report |= {name: package_version(name) for name in PACKAGES}
    report["GPU"] = _gpu()
    return report


def package_version(name: str) -> str:
    """The version of an installed distribution, or "not installed"; the package is not imported."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def cpu_model(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """The processor's name from Linux's `cpuinfo`, elsewhere what Python's `platform` knows."""
    try:
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    for line in lines:
        key, _, value = line.partition(":")
        if key.strip() == "model name":
            return value.strip()
    return platform.processor() or platform.machine() or "unknown"


def _usable_cores() -> int:
    """Cores this process may run on, which in containers are fewer than the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _gpu() -> str:
    try:
        device = find_device()
    except (NoDeviceError, CudaNotFoundError) as error:
        return str(error)
    return f"{device.name}, {device.arch}, driver for CUDA {device.driver[0]}.{device.driver[1]}"


def _compiler() -> str:
    try:
        compiler = toolchain.find_compiler()
    except (toolchain.CompilerNotFoundError, toolchain.CacheFolderError) as error:
        return str(error)
    return f"{compiler.path}: {compiler.version}"


def _cache_folder() -> str:
    try:
        return str(toolchain.cache_folder())
    except toolchain.CacheFolderError as error:
        return str(error)
