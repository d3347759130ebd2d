"""The device code of whole scenes: it compiles and links, threads need little memory, and it grows linearly."""

from __future__ import annotations

import importlib.util
import math
import re
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import pytest
from device_scenes import SCENES, Parameterisation, affine, cage, contact, free, lever
from small_scenes import soft_tets

from yasps import Scene
from yasps.backend.codegen.object_text import ObjectCode
from yasps.backend.codegen.preludes import without_preludes
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cuda.object import CudaEmitter
from yasps.examples.two_bunnies import two_bunnies
from yasps.frontend.execution.device_report import DeviceCompileReport
from yasps.frontend.execution.emit import SceneEmitter
from yasps.meshes import box
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.build.cuda.report import ModuleRow
from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.build.cuda.toolchain import build_program, find_cuda
from yasps.runtime.build.toolchain import Source
from yasps.runtime.device.gpu import cub_source
from yasps.runtime.device.residency import TYPICAL

EVERYTHING_FOR = "sm_90"
"""All scenes are compiled for this one; for the others, nightly, those that hold the largest kernels of each kind."""
OLDEST = "sm_80"
OTHERS = (OLDEST, "sm_89", "sm_120")
LARGEST = ("caged_contact", "two_bunnies", "levers")
LARGEST_STACK = 4096
"""Bytes of a thread; with an expanded local Hessian the caged contact kernel would take 43 KB (paper, 10.6)."""
MOST_REGISTERS = {2: 255, 3: 168, 4: 128}
"""That so many blocks of 128 threads leave to each, of 65,536; a thread has 255 at most."""
LARGEST_SPILL = 320
"""Bytes stored and loaded by a kernel itself, not by what it calls: those of mollified point-edge contact, with the
threshold of its rest positions and the stiffness of its law, on sm_90."""
LARGEST_ARRAY = 2048
"""Bytes on the stack; of 96 unknowns, a packed triangle has 37 KB."""

needs_cuda = pytest.mark.skipif(
    importlib.util.find_spec("cuda") is None, reason="needs the packages of pip install 'yasps[cuda]'"
)


COMPILED: dict[str, Callable[[], Scene]] = {
    "caged_contact": lambda: contact(cage),
    **SCENES,
    "two_bunnies": lambda: two_bunnies(box(divisions=(1, 1, 1)), Scene("two_bunnies")).scene,
}


@cache
def objects_of(name: str) -> tuple[ObjectCode, ...]:
    """The generated objects of a scene that have entries, before equal ones are shared."""
    return emit(COMPILED[name]())


def emit(scene: Scene) -> tuple[ObjectCode, ...]:
    module = run_pipeline(SceneEmitter(scene.name).emit(scene._energies, scene._targets, []))
    return tuple(code for code in CudaEmitter(SceneView(module)).emit_all() if code.entries)


def body_of(code: ObjectCode) -> str:
    """Without what all objects share."""
    return without_preludes(code.text)


# -- compiled, not run -------------------------------------------------------------------------------------


def check_generated(row: ModuleRow, code: ObjectCode) -> None:
    """What is said of a generated module: of its kernel, if it has one, what it takes after the link."""
    assert row.lines == code.text.count("\n")
    kernels = [function for function in row.functions if function.is_kernel]
    wanted = [f"{code.symbol}_{entry}" for entry in code.entries if entry in ("batch", "derive", "branches")]
    assert sorted(kernel.name for kernel in kernels) == sorted(wanted)
    for kernel in kernels:
        (blocks,) = re.findall(rf"__launch_bounds__\(128, (\d)\) {kernel.name}\(", code.text)
        assert 8 <= kernel.registers <= MOST_REGISTERS[int(blocks)], f"{row.name}: {kernel}"
        assert kernel.spill_bytes <= LARGEST_SPILL, f"{row.name}: {kernel}"
        assert kernel.stack_bytes <= LARGEST_STACK, f"{row.name}: {kernel}"
    for what in ("registers", "stack_bytes", "spill_bytes"):
        assert getattr(row, what) == max((getattr(function, what) for function in row.functions), default=0)


@needs_cuda
@pytest.mark.parametrize("arch", [EVERYTHING_FOR, *(pytest.param(arch, marks=pytest.mark.nightly) for arch in OTHERS)])
def test_everything_compiles_and_links(arch: str) -> None:
    """All modules of the scenes and all files of the runtime: one program for each architecture."""
    scenes = list(COMPILED) if arch == EVERYTHING_FOR else LARGEST
    codes = {code.symbol: code for name in reversed(scenes) for code in reversed(objects_of(name))}
    modules = [Source(code.name, code.text) for code in codes.values()]
    runtime = runtime_sources()
    program = build_program(find_cuda(arch), modules, runtime, [cub_source()])
    assert program.cubin()[:4] == b"\x7fELF"
    names = [source.name for source in (*modules, *runtime)]
    assert [row.name for row in program.rows] == [*names, "cub", "link"]
    for row, code in zip(program.rows, codes.values(), strict=False):
        check_generated(row, code)
    for row in program.rows[len(modules) :]:
        for function in row.functions:
            assert function.stack_bytes <= LARGEST_STACK, f"{row.name}: {function}"

    scene = COMPILED["caged_contact"]()
    report = scene.compile(device="cuda", arch=arch)
    assert report.architecture == arch
    assert all(row.cached for row in report.rows if row.name != "link")
    again = scene.compile(device="cuda", arch=arch)
    assert again.compiled == 0
    assert [row.functions for row in again.rows] == [row.functions for row in report.rows]
    check_report(report)


@needs_cuda
def test_the_oldest_architecture_has_all_that_device_code_asks_for() -> None:
    """Texts are the same for all architectures: what a newer one alone understands is seen with few of them."""
    codes = {code.symbol: code for code in objects_of("caged_contact")}
    modules = [Source(code.name, code.text) for code in codes.values()]
    program = build_program(find_cuda(OLDEST), modules, runtime_sources(), [])
    assert program.cubin()[:4] == b"\x7fELF"
    for row, code in zip(program.rows, codes.values(), strict=False):
        check_generated(row, code)


def check_report(report: DeviceCompileReport) -> None:
    """One row for each different module of caged contact, by the name of what it computes; files of the runtime."""
    codes = {code.name: code for code in objects_of("caged_contact")}
    generated = [row for row in report.rows if row.name in codes]
    assert {codes[row.name].text for row in generated} == {code.text for code in codes.values()}
    assert len({codes[row.name].text for row in generated}) == len(generated)
    for row in generated:
        check_generated(row, codes[row.name])
    others = [row.name for row in report.rows if row.name not in codes]
    assert others == [*(source.name for source in runtime_sources()), "cub", "link"]
    (derivative,) = (row for row in generated if row.name == "everything.pairs.barrier.derivative")
    assert derivative.stack_bytes > 1000  # with the work of the projection, which is called in another module
    check_stack_memory(report)
    table = str(report)
    assert table.startswith(f"{report.architecture}: compiled, not run")
    assert all(row.name in table and str(row.stack_bytes) in table for row in report.rows)


def check_stack_memory(report: DeviceCompileReport) -> None:
    """What the driver keeps for stacks is that of the greediest kernel, for as many threads as could run."""
    stack = max(item.stack_bytes for row in report.rows for item in row.functions if item.is_kernel)
    assert report.stack_bytes == stack > 1000
    name, residency = TYPICAL[report.architecture]
    assert report.stack_memory(residency) == residency.multiprocessors * residency.threads_each * stack
    megabytes = f"{residency.threads * stack / 1e6:.0f} MB: {stack:,} bytes for each of {residency.threads:,} threads"
    assert f"On a GPU like {name}, stacks of kernels take {megabytes}" in str(report)


def test_stacks_of_an_h100() -> None:
    name, residency = TYPICAL["sm_90"]
    assert name == "H100"
    assert residency.describe_stacks(2640) == (
        "stacks of kernels take 714 MB: 2,640 bytes for each of 270,336 threads that can run at once"
    )


@needs_cuda
def test_compiling_for_a_device_leaves_the_scene_where_it_is() -> None:
    scene = soft_tets()
    before = scene.gradient()[0]
    compiled = scene.compile()
    scene.compile(device="cuda", arch="sm_90")
    assert scene.compile() is compiled
    assert (scene.gradient()[0] == before).all()


# -- text --------------------------------------------------------------------------------------------------

SIZES = {"double": 8, "long": 8, "int": 4}
_ARRAY = re.compile(
    r"^\s*(?:const )?(double|long|int) (\w+(?:\[\d+\])+(?:, \w+(?:\[\d+\])+)*)(?: = .*)?;$", re.MULTILINE
)


def local_arrays(text: str) -> list[int]:
    """Bytes of all arrays on stacks."""
    return [
        SIZES[kind] * math.prod(int(bound) for bound in re.findall(r"\[(\d+)\]", name))
        for kind, names in _ARRAY.findall(text)
        for name in names.split(", ")
    ]


def test_the_arrays_of_a_text_are_found() -> None:
    text = "    double left[3][24];\n double b[3], row[24];\n  const double block[9] = {a[0], a[1]};\n x[3] = y[4];\n"
    text += "  const double t = x[9];\n int to[2];\n"
    assert local_arrays(text) == [576, 24, 192, 72, 8]


@pytest.mark.parametrize("name", COMPILED)
def test_no_local_hessian_is_expanded_on_the_stack(name: str) -> None:
    for code in objects_of(name):
        assert max(local_arrays(body_of(code)), default=0) <= LARGEST_ARRAY, code.name


def test_the_caged_kernel_holds_a_block_row_at_most() -> None:
    """96 unknowns: the largest arrays are the matrix of 12 positions and the work of its projection."""
    (derivative,) = (code for code in objects_of("caged_contact") if code.name == "everything.pairs.barrier.derivative")
    assert "kappa + i * 32;" in derivative.text  # 4 vertices of 8 control points
    assert max(local_arrays(body_of(derivative))) <= 8 * 9 * 11
    assert derivative.workspace == 0


def lines_of(*bodies: Parameterisation) -> dict[str, int]:
    return {code.name: body_of(code).count("\n") for code in emit(contact(*bodies, pairs=0))}


def test_code_grows_linearly_with_parameterisations() -> None:
    """Every further cage adds the same objects, and a branch to those of the union."""
    lines = [lines_of(free, *[cage] * k) for k in (1, 2, 3)]
    totals = [sum(counted.values()) for counted in lines]
    growth = {b - a for a, b in pairwise(totals)}
    assert len(growth) == 1, totals
    assert totals[-1] < 1.5 * totals[0], totals
    derivative = "everything.pairs.barrier.derivative"
    assert len({counted[derivative] for counted in lines}) == 1, "it knows nothing of what is behind a vertex"
    for name in ("everything.vertices.position", "everything.vertices.position.kappa"):
        branches = [counted[name] for counted in lines]
        assert len({b - a for a, b in pairwise(branches)}) == 1
    shared = {code.text for code in emit(contact(free, *[cage] * 3, pairs=0)) if ".position.jacobian" in code.name}
    assert len(shared) == 1, "equal objects are one module"


def test_kinds_of_parameterisations_add_up() -> None:
    """A nonlinear kind adds curvature; the objects of the others stay as they are."""
    alone = lines_of(free, affine, cage)
    together = lines_of(free, affine, cage, lever)
    union = {
        "everything.vertices.position",
        "everything.vertices.position.kappa",
        "everything.pairs.barrier.derivative",
    }
    assert {name: alone[name] for name in alone if name not in union} == {
        name: together[name] for name in alone if name not in union
    }
    assert "body_3.vertices.position.curvature" in together
    assert sum(together.values()) < 2 * sum(alone.values())


def test_generated_texts_need_nothing_else() -> None:
    for name in COMPILED:
        for code in objects_of(name):
            assert "#include" not in code.text
            assert "V" not in re.findall(r"\b\w\b", body_of(code)), "no packs of instances"


def test_numbers_of_neighbouring_threads_stand_side_by_side_in_global_memory() -> None:
    """Entry k of the workspace of thread t at k * threads + t: a warp reads whole lines."""
    found = 0
    for name in COMPILED:
        for code in objects_of(name):
            if code.workspace:
                found += 1
                body = body_of(code)
                assert "sink.workspace + thread" in body
                assert "thread *" not in body
                assert "yasps_project_apart(" in body
                assert "yasps_project(" not in body
    assert found >= 3


def test_every_kernel_has_launch_bounds() -> None:
    """No flag limits its registers."""
    texts = [source.text for source in runtime_sources()]
    texts += [code.text for name in COMPILED for code in objects_of(name)]
    found = 0
    for text in texts:
        kernels = re.findall(r"__global__\s+void\s+(\w+)", text)
        assert set(kernels) <= {"__launch_bounds__"}
        found += len(kernels)
    assert found > 60
