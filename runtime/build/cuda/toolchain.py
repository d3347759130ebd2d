"""Compiles CUDA text to one linked program per scene, in parallel, in the cache that the CPU's objects are in.

toolchain = find_cuda("sm_90")                              # or find_device().arch, see cuda_driver
program = build_program(toolchain, modules, runtime)        # what to load: program.cubin(); what it takes: program.rows

Generated modules go through NVRTC, which needs no headers and is 3 to 20 times faster than nvcc; the fixed runtime goes
through nvcc, because it may use CUB. nvlink joins the objects. None of this needs a GPU or a driver. NVRTC compiles in
parallel in threads of one process (2 threads take 0.55 of the time of one).

Not nvJitLink, the linker as a library (13.0 to 13.5): where a function is defined twice, or called with other arguments
than it has, it writes that to standard error, reports success and makes a program that is wrong. nvlink fails, as it
should, and costs 10 ms instead of 2.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from yasps.runtime.build.cache import (
    cache_folder,
    digest_of,
    in_parallel,
    keep,
    put,
    put_text,
    safe_name,
    text_in,
    write_text,
)
from yasps.runtime.build.cuda.nvcc import INSTALL_ADVICE, CudaNotFoundError, Nvcc, find_nvcc
from yasps.runtime.build.cuda.report import (
    FunctionResources,
    ModuleRow,
    functions_of_module,
    kernels_of_program,
    linked_functions,
)
from yasps.runtime.build.toolchain import CompilationError, LinkedLibrary, Source

#: Flags of every device compile. As on the CPU: products and sums may be fused, nothing else is approximate.
DEFAULT_FLAGS = ("--std=c++17", "--fmad=true")

_RELOCATABLE = "--relocatable-device-code=true"
_HOST_FLAGS = ("-O2", "-Xcompiler", "-fPIC")
# Kernels have launch bounds, which this flag does not touch. Functions that kernels of other files call have none, and
# the linker refuses a call of one that has more registers than its caller's bounds leave: so they keep to what 4 blocks
# of 128 threads leave of 65,536 (docs/gpu.md). The projections would take 150 and 254.
_FUNCTION_FLAGS = ("--maxrregcount=128",)


@dataclass(frozen=True)
class CudaToolchain:
    """Compilers and linker for one architecture.

    arch: as compilers spell it ("sm_90"). nvrtc: a key of NVRTC, its release and a digest of the library. flags: of
    device code, for NVRTC and nvcc alike.
    """

    arch: str
    nvrtc: str
    nvcc: Nvcc
    flags: tuple[str, ...] = DEFAULT_FLAGS

    def with_flags(self, *flags: str) -> CudaToolchain:
        """The same toolchain with further flags for device code."""
        return replace(self, flags=(*self.flags, *flags))


@dataclass(frozen=True)
class DeviceObject:
    """A relocatable object of device code. `seconds` is the time the compile took now: about 0 where `cached`.

    log: what the compiler said, with the resources of each function. lines: of the source.
    """

    name: str
    path: Path
    seconds: float
    cached: bool
    key: str
    log: str
    lines: int


@dataclass(frozen=True)
class DeviceProgram:
    """Linked device code. `seconds` is the time the link took now: about 0 where `cached`.

    path: of the code. log: what the linker said. host, host_objects: the library of host functions and its parts,
    where there are any.
    """

    path: Path
    seconds: float
    cached: bool
    log: str
    objects: tuple[DeviceObject, ...]
    host_objects: tuple[DeviceObject, ...] = ()
    host: LinkedLibrary | None = None

    def cubin(self) -> bytes:
        """The code, as the driver loads it."""
        return self.path.read_bytes()

    @cached_property
    def rows(self) -> tuple[ModuleRow, ...]:
        """One row per module, in the order of the objects, then of `host_objects`, and "link" for both links.

        Raises ReportFormatError.
        """
        kernels = kernels_of_program(self.log)
        rows = [_row(item, linked_functions(item.log, kernels)) for item in self.objects]
        rows += [_row(item, tuple(functions_of_module(item.log).values())) for item in self.host_objects]
        seconds, cached = self.seconds, self.cached
        if self.host is not None:
            seconds, cached = seconds + self.host.seconds, cached and self.host.cached
        return (*rows, ModuleRow("link", seconds, cached, 0, 0, 0, 0, ()))


def find_cuda(arch: str, nvcc: str | Path | None = None) -> CudaToolchain:
    """Find compilers and linker for an architecture ("sm_90").

    nvcc: see cuda_nvcc.find_nvcc. Raises ValueError for an architecture that the compilers do not know,
    CudaNotFoundError when something is missing, or NVRTC is of a later release than nvcc, whose linker could not join
    its objects, and CompilerNotFoundError without a C++ compiler.
    """
    compiler = find_nvcc(nvcc)
    try:
        from cuda import pathfinder
        from cuda.bindings import nvrtc

        nvrtc_path = Path(pathfinder.load_nvidia_dynamic_lib("nvrtc").abs_path)
    except (ImportError, RuntimeError) as error:  # pathfinder's errors are RuntimeErrors
        raise CudaNotFoundError(f"a part of the CUDA toolkit is missing: {error}\n{INSTALL_ADVICE}") from error
    _, major, minor = nvrtc.nvrtcVersion()
    _check_arch(arch, nvrtc.nvrtcGetSupportedArchs()[1], f"{major}.{minor}")
    latest = compiler.release
    if major != latest[0] or minor > latest[1]:
        raise CudaNotFoundError(
            f"NVRTC ({nvrtc_path}) is of CUDA {major}.{minor}, but nvcc ({compiler.path}) of {latest[0]}.{latest[1]}, "
            f"whose linker joins no other objects than those of {latest[0]}.0 to {latest[0]}.{latest[1]}. Let "
            f"YASPS_NVCC name an nvcc of CUDA {major}.{minor}.\n{INSTALL_ADVICE}"
        )
    return CudaToolchain(arch, f"{major}.{minor} {_fingerprint(nvrtc_path)}", compiler)


def build_program(
    toolchain: CudaToolchain,
    modules: Sequence[Source],
    runtime: Sequence[Source] = (),
    host: Sequence[Source] = (),
    jobs: int | None = None,
) -> DeviceProgram:
    """Compile generated modules, the runtime's device code and its host functions, and link them.

    modules: texts that include nothing, for NVRTC; kernels are `extern "C" __global__`. runtime: device code that may
    include headers of the toolkit (CUB, libcu++). host: functions that call CUB's device-wide algorithms, with device
    code of their own; their library holds the CUDA runtime, which finds the driver when a function is called, so that
    it loads without one.

    `jobs` compile at a time (default: one per processor). Those that take longest begin first: host functions, files
    of the runtime, then modules by length. The program's objects have the order of `modules`, then of `runtime`. Raises
    CompilationError and CacheFolderError.
    """
    folder = cache_folder()
    linked = toolchain.with_flags(*_FUNCTION_FLAGS)
    tasks = [partial(_compile_with_nvrtc, source, linked, folder) for source in modules]
    tasks += [partial(_compile_runtime, source, linked, folder) for source in runtime]
    tasks += [partial(_compile_for_host, source, toolchain, folder) for source in host]
    costs = [(0, len(source.text)) for source in modules] + [(1, 0)] * len(runtime) + [(2, 0)] * len(host)
    order = sorted(range(len(tasks)), key=lambda index: costs[index], reverse=True)
    done = dict(zip(order, in_parallel([tasks[index] for index in order], jobs), strict=True))
    objects = [done[index] for index in range(len(tasks))]
    count = len(tasks) - len(host)
    program = link_program(objects[:count], toolchain)
    if not host:
        return program
    return replace(program, host_objects=tuple(objects[count:]), host=_link_host(objects[count:], toolchain))


def link_program(objects: Sequence[DeviceObject], toolchain: CudaToolchain) -> DeviceProgram:
    """Join objects to a program that a device can load, or find it in the cache.

    Raises CompilationError when a function or variable is missing, defined twice or used as another than it is,
    CacheFolderError, and ValueError for nothing to link.
    """
    if not objects:
        raise ValueError("there are no objects to link")
    start = time.perf_counter()
    name = safe_name(objects[0].name if len(objects) == 1 else "program")
    key = digest_of("link", toolchain.nvcc.key, toolchain.arch, *(item.key for item in objects))
    path = cache_folder() / f"{name}-{key[:32]}.cubin"

    def build(target: Path) -> str:
        paths = [item.path for item in objects]
        names = ", ".join(item.name for item in objects)
        return _run([toolchain.nvcc.linker, f"-arch={toolchain.arch}", "-v", "-o", target, *paths], names, None)

    log, cached = _with_log(path, build)
    return DeviceProgram(path, time.perf_counter() - start, cached, log, tuple(objects))


def _row(item: DeviceObject, functions: tuple[FunctionResources, ...]) -> ModuleRow:
    return ModuleRow(
        item.name,
        item.seconds,
        item.cached,
        registers=max((function.registers for function in functions), default=0),
        stack_bytes=max((function.stack_bytes for function in functions), default=0),
        spill_bytes=max((function.spill_bytes for function in functions), default=0),
        lines=item.lines,
        functions=functions,
    )


def _compile_with_nvrtc(source: Source, toolchain: CudaToolchain, folder: Path) -> DeviceObject:
    flags = (f"--gpu-architecture={toolchain.arch}", _RELOCATABLE, "--ptxas-options=-v", *toolchain.flags)
    key = digest_of("nvrtc", toolchain.nvrtc, *flags, "source", source.text)

    def build(text_path: Path, target: Path) -> str:
        code, log = _run_nvrtc(source, text_path, flags)
        target.write_bytes(code)
        return log

    return _object(source, key, folder, build)


def _compile_runtime(source: Source, toolchain: CudaToolchain, folder: Path) -> DeviceObject:
    """By nvcc where the text includes headers of the toolkit, else by NVRTC, in 0.6 of the time."""
    compile_one = _compile_with_nvcc if "#include <" in source.text else _compile_with_nvrtc
    return compile_one(source, toolchain, folder)


def _compile_with_nvcc(source: Source, toolchain: CudaToolchain, folder: Path) -> DeviceObject:
    flags = (f"-arch={toolchain.arch}", "-cubin", "-rdc=true", "-Xptxas", "-v", *toolchain.flags)
    key = digest_of("nvcc", toolchain.nvcc.key, *flags, "source", source.text)

    def build(text_path: Path, target: Path) -> str:
        return _run_nvcc(toolchain, source.name, text_path, [*flags, "-o", target, text_path])

    return _object(source, key, folder, build)


def _compile_for_host(source: Source, toolchain: CudaToolchain, folder: Path) -> DeviceObject:
    flags = (f"-arch={toolchain.arch}", *_HOST_FLAGS, "-Xptxas", "-v", *toolchain.flags)
    key = digest_of("nvcc host", toolchain.nvcc.key, *flags, "source", source.text)

    def build(text_path: Path, target: Path) -> str:
        return _run_nvcc(toolchain, source.name, text_path, [*flags, "-c", "-o", target, text_path])

    return _object(source, key, folder, build, suffix=".o")


def _link_host(objects: Sequence[DeviceObject], toolchain: CudaToolchain) -> LinkedLibrary:
    start = time.perf_counter()
    name = safe_name(objects[0].name if len(objects) == 1 else "cuda-host")
    key = digest_of("link host", toolchain.nvcc.key, toolchain.arch, *(item.key for item in objects))
    path = cache_folder() / f"{name}-{key[:32]}.so"

    def build(target: Path) -> None:
        # Symbols are bound within the library: those of another, for another architecture, must not take their place.
        options = [f"-arch={toolchain.arch}", "-shared", "-cudart", "static", "-Xlinker", "-Bsymbolic"]
        inputs = [item.path for item in objects]
        names = ", ".join(item.name for item in objects)
        _run_nvcc(toolchain, names, None, [*options, *toolchain.nvcc.library_flags, "-o", target, *inputs])

    cached = keep(path, build)
    return LinkedLibrary(path, time.perf_counter() - start, cached)


def _object(
    source: Source, key: str, folder: Path, build: Callable[[Path, Path], str], suffix: str = ".cubin"
) -> DeviceObject:
    """What `build` makes of the source and says of it, from the cache where it is there."""
    start = time.perf_counter()
    path = folder / f"{safe_name(source.name)}-{key[:32]}{suffix}"
    text_path = path.with_suffix(".cu")

    def build_from_text(target: Path) -> str:
        write_text(text_path, source.text)
        return build(text_path, target)

    log, cached = _with_log(path, build_from_text)
    seconds = time.perf_counter() - start
    return DeviceObject(source.name, path, seconds, cached, key, log, source.text.count("\n"))


def _with_log(path: Path, build: Callable[[Path], str]) -> tuple[str, bool]:
    """Let `build` make a file of the cache, unless it is there; what it said, which is kept, and whether it was."""
    log_path = path.with_suffix(".log")
    log = text_in(log_path)

    def build_with_log(target: Path) -> None:
        nonlocal log
        log = build(target)
        put_text(log_path, log)  # in place before the file is

    cached = log is not None and keep(path, build_with_log)
    if log is None:
        put(path, build_with_log)
    assert log is not None
    return log, cached


def _run_nvrtc(source: Source, text_path: Path, flags: Sequence[str]) -> tuple[bytes, str]:
    """The cubin and what NVRTC said."""
    from cuda.bindings import nvrtc

    def checked(result: tuple[Any, ...], log: str = "") -> Any:
        if result[0] != nvrtc.nvrtcResult.NVRTC_SUCCESS:
            said = log or f"NVRTC: {nvrtc.nvrtcGetErrorString(result[0])[1].decode()}"
            raise CompilationError(source.name, text_path, said, "CUDA")
        return result[1] if len(result) > 1 else None

    text, name = source.text.encode(), f"{source.name}.cu".encode()
    program = checked(nvrtc.nvrtcCreateProgram(text, name, 0, [], []))
    try:
        status = nvrtc.nvrtcCompileProgram(program, len(flags), [flag.encode() for flag in flags])
        buffer = bytearray(checked(nvrtc.nvrtcGetProgramLogSize(program)))
        checked(nvrtc.nvrtcGetProgramLog(program, buffer))
        log = buffer.rstrip(b"\0").decode(errors="replace")
        checked(status, log)
        code = bytearray(checked(nvrtc.nvrtcGetCUBINSize(program)))
        checked(nvrtc.nvrtcGetCUBIN(program, code))
    finally:
        nvrtc.nvrtcDestroyProgram(program)
    return bytes(code), log


def _run_nvcc(toolchain: CudaToolchain, name: str, source: Path | None, arguments: Sequence[str | Path]) -> str:
    """What nvcc said."""
    return _run([toolchain.nvcc.path, *toolchain.nvcc.host_flags, *arguments], name, source)


def _run(command: Sequence[str | Path], name: str, source: Path | None) -> str:
    """What the command said. Raises CompilationError, about the module `name`, when it fails."""
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False, errors="replace")
    except OSError as error:
        raise CompilationError(name, source, f"{command[0]} cannot be started: {error}", "CUDA") from error
    output = result.stderr + result.stdout
    if result.returncode != 0:
        raise CompilationError(name, source, output or f"{command[0]} ended with {result.returncode}", "CUDA")
    return output


def _check_arch(arch: str, numbers: Sequence[int], release: str) -> None:
    known = [f"sm_{number}" for number in numbers]
    if arch not in known:
        raise ValueError(f"CUDA {release} does not compile for arch '{arch}', only for {', '.join(known)}")


def _fingerprint(library: Path) -> str:
    """A digest of the first bytes of an ELF file, where the linker's build id is, and of its size."""
    with library.open("rb") as file:
        beginning = file.read(4096)
    return digest_of(str(library.stat().st_size), beginning.hex())[:32]
