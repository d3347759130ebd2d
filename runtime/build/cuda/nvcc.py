"""Finds nvcc, the CUDA compiler for code with C++ headers and for the host's part of CUB, and the device linker."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from yasps.runtime.build.cache import digest_of
from yasps.runtime.build.toolchain import find_compiler

INSTALL_ADVICE = "To install everything for device='cuda' from PyPI: pip install 'yasps[cuda]'"

_RELEASE = re.compile(r"release (\d+)\.(\d+)")


class CudaNotFoundError(RuntimeError):
    """A part of the CUDA toolkit is missing or does not fit; the message says what and how to install it."""


@dataclass(frozen=True)
class Nvcc:
    """The compiler nvcc, and nvlink, the device linker that comes with it.

    release: (13, 0). key: a digest of its version, its CUB, the host's compiler and the flags that environment
    variables add. host_flags: name that compiler.
    library_flags: where the toolkit's libraries are, for a link on the host.
    """

    path: Path
    linker: Path
    release: tuple[int, int]
    key: str
    host_flags: tuple[str, ...]
    library_flags: tuple[str, ...]


def find_nvcc(setting: str | Path | None = None) -> Nvcc:
    """Find nvcc: `setting` (a path or a program on the PATH), YASPS_NVCC, CUDA_HOME, the PATH, packages of pip.

    Raises CudaNotFoundError when there is none, naming all places; when the one that `setting` or YASPS_NVCC names is
    not there; and when it does not run. Raises CompilerNotFoundError without a C++ compiler, which nvcc needs.
    """
    path = _real_path(_find_path(setting))
    version = _version_of(path)
    release = _RELEASE.search(version)
    if release is None:
        raise CudaNotFoundError(f"{path} does not say its release, it is no nvcc: {version.strip()[:300]!r}")
    linker = shutil.which("nvlink", path=str(path.parent)) or shutil.which("nvlink")
    if linker is None:
        raise CudaNotFoundError(f"there is no device linker nvlink next to {path}, nor on the PATH.\n{INSTALL_ADVICE}")
    root = path.parent.parent
    host_flags, host_key = _host_compiler()
    libraries = tuple(f"-L{root / name}" for name in ("lib64", "lib") if (root / name / "libcudart_static.a").is_file())
    added = [os.environ.get(name, "") for name in ("NVCC_PREPEND_FLAGS", "NVCC_APPEND_FLAGS")]
    key = digest_of(str(path), linker, version, _cub_version(root), host_key, *added)
    return Nvcc(path, Path(linker), (int(release[1]), int(release[2])), key, host_flags, libraries)


def _find_path(setting: str | Path | None) -> Path:
    variable = os.environ.get("YASPS_NVCC", "").strip()
    for name, origin in ((setting, "the argument nvcc"), (variable, "the environment variable YASPS_NVCC")):
        if name:
            program = shutil.which(Path(name).expanduser())
            if program is None:
                raise CudaNotFoundError(f"{origin} names '{name}', but there is no such program.\n{INSTALL_ADVICE}")
            return Path(program)
    home = os.environ.get("CUDA_HOME", "").strip()
    in_home = shutil.which("nvcc", path=str(Path(home, "bin"))) if home else None
    program = in_home or shutil.which("nvcc") or _packaged()
    if program is not None:
        return Path(program)
    raise CudaNotFoundError(
        "found no CUDA compiler nvcc. Looked for it in the environment variable YASPS_NVCC (not set), in "
        f"{f'{home}/bin (CUDA_HOME)' if home else 'CUDA_HOME (not set)'}, on the PATH, and in pip's package "
        f"nvidia-cuda-nvcc of this Python.\n{INSTALL_ADVICE}"
    )


def _packaged() -> str | None:
    """The nvcc that pip or conda installed for this Python."""
    try:
        from cuda import pathfinder
    except ImportError:
        return None
    path: str | None = pathfinder.find_nvidia_binary_utility("nvcc")
    return path


def _real_path(path: Path) -> Path:
    """nvcc finds its headers next to the path it is called by. A link to ccache must stay, though."""
    real = path.resolve()
    return real if real.name == path.name else path


def _version_of(path: Path) -> str:
    try:
        result = subprocess.run([path, "--version"], capture_output=True, text=True, check=False, errors="replace")
    except OSError as error:
        raise CudaNotFoundError(f"the CUDA compiler {path} cannot be started: {error}.\n{INSTALL_ADVICE}") from error
    if result.returncode != 0:
        raise CudaNotFoundError(
            f"the CUDA compiler {path} does not work: `nvcc --version` failed with\n"
            f"  {result.stderr.strip() or result.stdout.strip()}\n{INSTALL_ADVICE}"
        )
    return result.stdout


def _cub_version(root: Path) -> str:
    """The text that holds CUB's version; CUB comes in a package of its own."""
    places = (root / "include" / "cccl" / "cub" / "version.cuh", root / "include" / "cub" / "version.cuh")
    return next((place.read_text(encoding="utf-8") for place in places if place.is_file()), "")


def _host_compiler() -> tuple[tuple[str, ...], str]:
    """Flags that make nvcc use the C++ compiler of the CPU backend, and a digest of it.

    NVCC_CCBIN, which nvcc itself reads, goes first; and nvcc takes no compiler that is a command of several words.
    """
    own = os.environ.get("NVCC_CCBIN", "").strip()
    compiler = find_compiler()
    if own or len(compiler.command) > 1:
        return (), digest_of(own, compiler.key())
    return ("-ccbin", str(compiler.path)), compiler.key()
