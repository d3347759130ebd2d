"""Compiling and linking CUDA code with the packages of `yasps[cuda]`, none of which needs a GPU or a driver."""

from __future__ import annotations

import ctypes
import importlib.util
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from yasps import CompilationError
from yasps.backend.cuda.object import BLOCKS_AT_ONCE
from yasps.runtime.build.cuda.nvcc import CudaNotFoundError, find_nvcc
from yasps.runtime.build.cuda.toolchain import (
    CudaToolchain,
    DeviceObject,
    build_program,
    find_cuda,
    link_program,
)
from yasps.runtime.build.toolchain import Source
from yasps.runtime.core import sink

ARCHITECTURES = ("sm_80", "sm_89", "sm_90", "sm_120")

# The kernel keeps 200 numbers on its stack, and the function it calls in another module 300.
CALLER = Source(
    "energies/caller: a",
    """\
extern "C" __device__ double callee(double x, const double* numbers);
static __device__ __noinline__ double twin(double x) { return x + 1.0; }
extern "C" __global__ void caller(double* p, int n) {
    double numbers[200];
    int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= n) return;
    for (int k = 0; k < 200; ++k) numbers[k] = p[(i * k) % n];
    p[i] = callee(p[i], numbers) + twin(numbers[i % 200]);
}
""",
)
CALLEE = Source(
    "runtime.callee",
    """\
static __device__ __noinline__ double twin(double x) { return x - 1.0; }
extern "C" __device__ double callee(double x, const double* numbers) {
    double products[300];
    for (int k = 0; k < 300; ++k) products[k] = numbers[(k * 7) % 200] * x;
    return twin(x) + products[static_cast<int>(x) % 300];
}
""",
)
SCALE = Source("scale", 'extern "C" __global__ void scale(double* p) { p[threadIdx.x] *= FACTOR; }\n')
HALVE = Source("halve", 'extern "C" __global__ void halve(double* p) { p[threadIdx.x] *= 0.5; }\n')
BLOCK_SUM = Source(
    "block_sum",
    """\
#include <cub/block/block_reduce.cuh>
extern "C" __global__ void block_sum(const double* p, double* sums) {
    using Reduce = cub::BlockReduce<double, 128>;
    __shared__ typename Reduce::TempStorage storage;
    double sum = Reduce(storage).Sum(p[blockIdx.x * 128 + threadIdx.x]);
    if (threadIdx.x == 0) sums[blockIdx.x] = sum;
}
""",
)
DEVICE_WIDE = Source(
    "device_wide",
    """\
#include <cub/device/device_radix_sort.cuh>
extern "C" int device_count(int* count) { return cudaGetDeviceCount(count); }
extern "C" int sort_keys(void* scratch, size_t* bytes, const unsigned* in, unsigned* out, int n) {
    return cub::DeviceRadixSort::SortKeys(scratch, *bytes, in, out, n);
}
""",
)


def compiled(sources: list[Source], toolchain: CudaToolchain) -> list[DeviceObject]:
    """Objects of generated modules, of a program that is linked too."""
    return list(build_program(toolchain, sources).objects)


def compiled_as_runtime(sources: list[Source], toolchain: CudaToolchain) -> list[DeviceObject]:
    """The same of files of the runtime."""
    return list(build_program(toolchain, [], sources).objects)


@pytest.fixture(scope="module")
def cuda() -> CudaToolchain:
    """The toolchain for sm_90; where its packages are installed, it has to be found."""
    if importlib.util.find_spec("cuda") is None:
        pytest.skip("needs the packages of pip install 'yasps[cuda]'")
    return find_cuda("sm_90")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of its own for the test."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("YASPS_CACHE", str(folder))
    return folder


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_objects_of_both_compilers_are_linked(cuda: CudaToolchain, cache: Path, arch: str) -> None:
    toolchain = replace(cuda, arch=arch)
    program = build_program(toolchain, [CALLER], [CALLEE])
    assert program.cubin()[:4] == b"\x7fELF"
    assert program.path.parent == cache
    assert b"caller" in program.cubin()
    caller, callee, link = program.rows
    assert (caller.name, callee.name, link.name) == (CALLER.name, CALLEE.name, "link")
    assert not any(row.cached for row in program.rows)
    assert caller.lines == CALLER.text.count("\n")
    # Local arrays, and after the link also those of the function it calls.
    assert callee.stack_bytes >= 300 * 8
    assert caller.stack_bytes >= 200 * 8 + callee.stack_bytes
    assert 16 <= caller.registers <= 255
    kernels = [function.name for row in program.rows for function in row.functions if function.is_kernel]
    assert kernels == ["caller"]


def test_programs_are_cached_by_text_flags_and_architecture(cuda: CudaToolchain, cache: Path) -> None:
    toolchain = cuda.with_flags("-DFACTOR=2.0")
    first = build_program(toolchain, [SCALE, HALVE], jobs=2)
    again = build_program(toolchain, [SCALE, HALVE], jobs=1)
    assert not first.cached
    assert not any(item.cached for item in first.objects)
    assert again.cached
    assert all(row.cached for row in again.rows)
    assert again.path == first.path
    assert [row.functions for row in again.rows] == [row.functions for row in first.rows]
    assert [row.name for row in again.rows] == ["scale", "halve", "link"]
    assert not [path for path in cache.iterdir() if path.name.startswith(".")], "temporary files are left"

    others = (
        cuda.with_flags("-DFACTOR=3.0"),
        replace(toolchain, arch="sm_80"),
        replace(toolchain, nvrtc="another NVRTC"),
        replace(toolchain, nvcc=replace(toolchain.nvcc, key="another nvcc")),
    )
    programs = [build_program(other, [SCALE, HALVE]) for other in others]
    assert len({program.path for program in (first, *programs)}) == 5
    assert [all(item.cached for item in program.objects) for program in programs] == [False, False, False, True]
    changed = Source("scale", SCALE.text.replace("*=", "+="))
    assert [item.cached for item in compiled([changed, HALVE], toolchain)] == [False, True]

    key = replace(toolchain.nvcc, key="another nvcc")
    assert compiled_as_runtime([SCALE], replace(toolchain, nvcc=key))[0].cached, (
        "it includes nothing: NVRTC compiles it"
    )
    by_nvcc = Source("scale", "#include <cuda/std/cstdint>\n" + SCALE.text)
    assert not compiled_as_runtime([by_nvcc], toolchain)[0].cached
    assert compiled_as_runtime([by_nvcc], toolchain)[0].cached
    assert not compiled_as_runtime([by_nvcc], replace(toolchain, nvcc=key))[0].cached


@pytest.mark.usefixtures("cache")
def test_an_empty_object_left_by_a_crash_is_rebuilt(cuda: CudaToolchain) -> None:
    item = compiled([HALVE], cuda)[0]
    content = item.path.read_bytes()
    item.path.write_bytes(b"")
    assert not compiled([HALVE], cuda)[0].cached
    assert len(item.path.read_bytes()) == len(content)


CROWD = 300
"""Doubles that live at once in `crowded`, where 255 registers hold 127."""


def crowded(head: str) -> str:
    """A function that needs more registers than there are."""
    loads = "".join(f"double v{i} = p[{i} * n + threadIdx.x];\n" for i in range(CROWD))
    sums = "".join(f"s = s * v{i} + v{(i * 7) % CROWD};\n" for i in range(CROWD))
    stores = "".join(f"p[{i} * n + threadIdx.x] = s + v{i};\n" for i in range(CROWD))
    return f'extern "C" {head}(double* p, int n) {{\n{loads}double s = 0.0;\n{sums}{stores}}}\n'


@pytest.mark.usefixtures("cache")
def test_functions_have_as_many_registers_as_their_callers_may(cuda: CudaToolchain) -> None:
    """Else the linker refuses the call: a kernel of 4 blocks at once has 128 at most."""
    bounds = f"__launch_bounds__({sink.THREADS}, {BLOCKS_AT_ONCE})"
    caller = f"""extern "C" __device__ void crowded(double* p, int n);
extern "C" __global__ void {bounds} caller(double* p, int n) {{ crowded(p, n); }}
"""
    sources = [Source("caller", caller), Source("crowded", crowded("__device__ void crowded"))]
    for modules, runtime in ((sources, []), (sources[:1], sources[1:])):
        row = build_program(cuda, modules, runtime).rows[0]
        assert 100 < row.registers <= 65536 // (sink.THREADS * BLOCKS_AT_ONCE) == 128


@pytest.mark.usefixtures("cache")
def test_spilling_kernels_say_so(cuda: CudaToolchain) -> None:
    text = crowded("__global__ void __launch_bounds__(128) crowded")
    wide, halve, _ = build_program(cuda, [Source("crowded", text), HALVE]).rows
    assert wide.registers == 255, "its launch bounds count"
    assert wide.spill_bytes >= 8 * (CROWD - 127)
    assert wide.stack_bytes > 0
    assert (halve.spill_bytes, halve.stack_bytes) == (0, 0)
    assert 0 < halve.registers < 32


@pytest.mark.parametrize("compile_with", [compiled, compiled_as_runtime])
@pytest.mark.usefixtures("cache")
def test_compile_error_names_module_source_and_reason(cuda: CudaToolchain, compile_with: object) -> None:
    assert callable(compile_with)
    broken = Source("spring", "__device__ int f() { return undeclared_thing; }\n")
    with pytest.raises(CompilationError, match="CUDA module 'spring' did not compile") as caught:
        compile_with([HALVE, broken], cuda)
    assert "undeclared_thing" in str(caught.value)
    assert caught.value.source is not None
    assert caught.value.source.read_text() == broken.text
    assert compile_with([HALVE], cuda)[0].cached, "the good module is kept"
    with pytest.raises(CompilationError, match="no-such-flag"):
        compile_with([HALVE], cuda.with_flags("--no-such-flag"))


@pytest.mark.usefixtures("cache")
def test_link_errors_name_the_function(cuda: CudaToolchain) -> None:
    with pytest.raises(CompilationError, match="callee") as caught:
        build_program(cuda, [CALLER])
    assert CALLER.name in str(caught.value)
    for second in (Source("second", HALVE.text), Source("halve", f"{HALVE.text}// changed\n")):
        with pytest.raises(CompilationError, match="Multiple definition of 'halve'"):
            build_program(cuda, [HALVE, second])
    other_arguments = Source("other", 'extern "C" __device__ double callee(int i, double* p) { return p[i]; }\n')
    with pytest.raises(CompilationError, match="Prototype doesn't match for 'callee'"):
        build_program(cuda, [CALLER, other_arguments])
    with pytest.raises(ValueError, match="no objects"):
        link_program([], cuda)


@pytest.mark.usefixtures("cache")
def test_cub_in_device_and_in_host_code(cuda: CudaToolchain) -> None:
    program = build_program(cuda, [HALVE], [BLOCK_SUM], [DEVICE_WIDE])
    rows = {row.name: row for row in program.rows}
    assert rows["block_sum"].functions[0].shared_bytes >= 8 * 128 // 32
    assert rows["device_wide"].registers > 0
    assert program.host is not None
    alone = build_program(cuda, [HALVE], host=[DEVICE_WIDE]).host
    assert alone is not None
    assert alone.path == program.host.path
    library = ctypes.CDLL(str(program.host.path))
    no_gpu = library.device_count(ctypes.byref(ctypes.c_int()))
    assert no_gpu in (0, 35, 100), "success, a driver that is missing or too old, no device"
    size = ctypes.c_size_t()
    status = library.sort_keys(None, ctypes.byref(size), None, None, 1000)
    assert (status == 0 and size.value >= 4 * 1000) or no_gpu


def test_an_unknown_architecture_is_refused(cuda: CudaToolchain) -> None:
    assert cuda.arch == "sm_90"
    with pytest.raises(ValueError, match=r"'sm_1'.* sm_80.* sm_120"):
        find_cuda("sm_1")


def test_an_nvcc_that_cannot_join_the_objects_of_nvrtc_is_refused(cuda: CudaToolchain, tmp_path: Path) -> None:
    for release in ("12.9", "14.0"):
        other = fake_nvcc(tmp_path / release, release)
        with pytest.raises(CudaNotFoundError, match=rf"nvcc \(.*\) of {release}, whose linker"):
            find_cuda("sm_90", nvcc=other)
    later = find_cuda("sm_90", nvcc=fake_nvcc(tmp_path / "later", "13.99"))
    assert later.nvcc.release == (13, 99)
    assert later.nvrtc == cuda.nvrtc


def test_without_the_packages_the_message_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "cuda"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cuda", None)
    with pytest.raises(CudaNotFoundError, match=r"pip install 'yasps\[cuda\]'"):
        find_cuda("sm_90", nvcc=fake_nvcc(tmp_path, "13.0"))
    monkeypatch.delenv("YASPS_NVCC", raising=False)
    monkeypatch.delenv("CUDA_HOME", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    with pytest.raises(CudaNotFoundError) as caught:
        find_nvcc()
    for place in ("YASPS_NVCC", "CUDA_HOME", "PATH", "nvidia-cuda-nvcc", "pip install 'yasps[cuda]'"):
        assert place in str(caught.value)
    monkeypatch.setenv("CUDA_HOME", "/opt/no-cuda")
    with pytest.raises(CudaNotFoundError, match=r"/opt/no-cuda/bin"):
        find_nvcc()


def test_nvcc_is_looked_for_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    places = {name: fake_nvcc(tmp_path / name, "13.0") for name in ("argument", "variable", "home", "path")}
    monkeypatch.setenv("YASPS_NVCC", str(places["variable"]))
    monkeypatch.setenv("CUDA_HOME", str(places["home"].parent.parent))
    monkeypatch.setenv("PATH", str(places["path"].parent), prepend=":")
    assert find_nvcc(places["argument"]).path == places["argument"]
    assert find_nvcc().path == places["variable"]
    monkeypatch.delenv("YASPS_NVCC")
    assert find_nvcc().path == places["home"]
    monkeypatch.delenv("CUDA_HOME")
    assert find_nvcc().path == places["path"]
    assert find_nvcc().release == (13, 0)
    # nvcc looks for its headers next to the path it is called by: links are followed.
    link = tmp_path / "links" / "nvcc"
    link.parent.mkdir()
    link.symlink_to(places["home"])
    assert find_nvcc(link).path == places["home"]
    assert find_nvcc(link).key == find_nvcc(places["home"]).key != find_nvcc(places["path"]).key


def test_flags_from_the_environment_are_part_of_nvccs_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nvcc = fake_nvcc(tmp_path, "13.0")
    keys = [find_nvcc(nvcc).key]
    for variable in ("NVCC_PREPEND_FLAGS", "NVCC_APPEND_FLAGS"):
        with monkeypatch.context() as patch:
            patch.setenv(variable, "-lineinfo")
            keys.append(find_nvcc(nvcc).key)
    assert len(set(keys)) == 3


def test_the_packaged_nvcc_is_found_last(cuda: CudaToolchain, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    if importlib.util.find_spec("nvidia") is None:
        pytest.skip("needs nvcc from pip")
    assert cuda.nvcc.path.name == "nvcc"
    monkeypatch.delenv("YASPS_NVCC", raising=False)
    monkeypatch.delenv("CUDA_HOME", raising=False)
    (tmp_path / "g++").symlink_to("/usr/bin/g++")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("CXX", "/usr/bin/c++")
    assert "nvidia" in find_nvcc().path.parts


def test_a_setting_that_names_no_nvcc_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YASPS_NVCC", "/no/such/nvcc")
    with pytest.raises(CudaNotFoundError, match="YASPS_NVCC names '/no/such/nvcc'"):
        find_nvcc()
    with pytest.raises(CudaNotFoundError, match="argument nvcc names '/nor/this'"):
        find_nvcc("/nor/this")
    broken = script(tmp_path / "broken" / "nvcc", "echo no licence >&2; exit 3")
    with pytest.raises(CudaNotFoundError, match="no licence"):
        find_nvcc(broken)
    with pytest.raises(CudaNotFoundError, match="is no nvcc"):
        find_nvcc(script(tmp_path / "other" / "nvcc", "echo hello"))
    alone = fake_nvcc(tmp_path / "alone", "13.0")
    alone.with_name("nvlink").unlink()
    monkeypatch.setenv("PATH", "/usr/bin")
    with pytest.raises(CudaNotFoundError, match="no device linker nvlink next to"):
        find_nvcc(alone)


def test_importing_yasps_imports_no_cuda_package() -> None:
    modules = "yasps, yasps.runtime.build.cuda.toolchain, yasps.runtime.device.driver"
    program = f"import sys, {modules}; print([name for name in sys.modules if name.partition('.')[0] == 'cuda'])"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def fake_nvcc(folder: Path, release: str) -> Path:
    """A program that says it is nvcc."""
    script(folder / "bin" / "nvlink", "exit 1")
    return script(folder / "bin" / "nvcc", f"echo 'Cuda compilation tools, release {release}, V{release}.88'")


def script(path: Path, commands: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{commands}\n")
    path.chmod(0o755)
    return path
