"""Cold compiles (paper, figure 28): modules in parallel, one by one, all in one file, other flags and compilers."""

from __future__ import annotations

import ctypes
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.contact_problem import add_barrier, close_pairs
from benchmarks.element_problem import add_elements, box_of_tets, cloth_hinges, cloth_triangles
from benchmarks.kernel_problem import on_cpu
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps import Scene
from yasps.backend.codegen.program import LINK_FLAGS, sources_of
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cpp.object import CppEmitter
from yasps.examples.two_bunnies import two_bunnies
from yasps.frontend.commands.environment_report import cpu_model
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.frontend.execution.emit import SceneEmitter
from yasps.meshes import box
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.build.toolchain import (
    CompiledObject,
    Compiler,
    Source,
    compile_sources,
    find_compiler,
    link,
)
from yasps.runtime.core.library import Runtime, available_processors, load_runtime

DESCRIPTION = "cold compile of two scenes: modular in parallel and one by one, one file, -O1/-O2/-O3, clang, seconds"
DEFAULT_SIZE = 3_000
NOISE = 0.2  # in cells
NOTES = (
    "Every compile starts with an empty cache, once; run: gradient and projected Hessian of all energies, gather to "
    "global matrix, one thread, ns per instance of all elements and pairs (least and median of the rounds).",
    "modular: each generated object is a file of its own, equal ones shared. one file: the same objects in one, each "
    "in a namespace; unlike the paper's monolithic kernels nothing is generated twice.",
    "Link and symbolic stages are not in these seconds; yasps whole: load_runtime and scene.compile() of a first scene "
    "with an empty cache, and scene.compile() of the same scene built again (code cached), all threads.",
    "processor time: of all processes; what seconds would be if nothing else ran, but for parallelism.",
    "four energies: tets, cloth triangles, hinges, point-triangle contact of free vertices.",
)


@dataclass(frozen=True)
class Strategy:
    """A way to compile."""

    name: str
    compiler: Compiler
    jobs: int
    in_one_file: bool = False


@contextmanager
def environment(name: str, value: str | None) -> Iterator[None]:
    """An environment variable has this value inside, or none."""
    before = os.environ.pop(name, None)
    if value is not None:
        os.environ[name] = value
    try:
        yield
    finally:
        os.environ.pop(name, None)
        if before is not None:
            os.environ[name] = before


@contextmanager
def empty_cache() -> Iterator[None]:
    """The toolchain's cache is a new folder inside."""
    with tempfile.TemporaryDirectory(prefix="yasps-benchmark-") as folder, environment("YASPS_CACHE", folder):
        yield


def four_energies(size: int) -> Scene:
    """Tets, triangles and hinges of cloth, contact; about `size` of each, deformed."""
    scene = Scene("four_energies", threads=1)
    targets = []
    for name, elements in {
        "solid": box_of_tets(size),
        "cloth": cloth_triangles(size),
        "bending": cloth_hinges(size),
    }.items():
        position, _ = add_elements(scene, name, elements)
        position.update_value(elements.deformed(NOISE))
        targets.append(position)
    pairs = close_pairs("point_triangle", size)
    mesh = scene.add_mesh("sheets")
    vertices = mesh.add_primitive("vertices", len(pairs.vertices))
    targets.append(vertices.add_attribute("position", 3, 1, value=pairs.vertices))
    add_barrier(mesh, vertices, pairs)
    scene.add_minimize_target(targets)
    return scene


def falling_boxes(size: int) -> Scene:
    """two_bunnies with boxes for rabbits."""
    cells = max(2, round((size / 6) ** (1 / 3)))
    return two_bunnies(box(divisions=(cells, cells, cells)), Scene("two_bunnies", threads=1)).scene


def generated(scene: Scene, compiler: Compiler) -> list[Source]:
    """The scene's C++ files, equal ones once."""
    module = run_pipeline(SceneEmitter(scene.name).emit(scene._energies, scene._targets, []))
    codes = [code for code in CppEmitter(SceneView(module), compiler.has_vector_math).emit_all() if code.entries]
    return sources_of(codes, compiler)


def one_file(sources: Sequence[Source]) -> Source:
    """All in one translation unit. Functions with C linkage are the same ones in every namespace."""
    headers: dict[str, None] = {}
    parts = []
    for number, source in enumerate(sources):
        lines = source.text.splitlines()
        headers |= dict.fromkeys(line for line in lines if line.startswith("#include"))
        body = "\n".join(line for line in lines if not line.startswith("#include"))
        parts.append(f"namespace object_{number} {{\n{body}\n}}\n")
    flags = max((source.flags for source in sources), key=len, default=())
    return Source("one_file", "\n".join([*headers, *parts]), flags)


def run(settings: Settings) -> Report:
    """Compiles both scenes in all ways and runs what came out."""
    scenes: dict[str, Callable[[], Scene]] = {
        "two_bunnies": partial(falling_boxes, settings.size),
        "four energies": partial(four_energies, settings.size),
    }
    compiler = find_compiler()
    strategies, about_clang = strategies_for(compiler, settings.threads)
    runtime = load_runtime(compiler, 1)
    rows: list[Row] = []
    notes = []
    for name, make in scenes.items():
        rows += _rows_of(name, make, runtime, strategies, settings.repeats)
        rows += _whole(name, make, settings.threads)
        sources = generated(make(), compiler)
        lines = sum(source.text.count("\n") for source in sources)
        notes.append(f"{name}: {len(sources)} files, {lines:,} lines with the common preludes.")
    machine = f"{cpu_model()}, {available_processors()} processors; {compiler.version}; {about_clang}"
    return Report(rows, [machine, *notes, *NOTES])


def strategies_for(compiler: Compiler, jobs: int) -> tuple[list[Strategy], str]:
    """All ways to compile here, and what is said of clang."""
    normal = f"modular, {jobs} at a time"
    found = [
        Strategy(f"{normal}, -O2", compiler, jobs),
        Strategy("modular, one by one, -O2", compiler, 1),
        Strategy("one file, -O2", compiler, 1, in_one_file=True),
    ]
    found += [Strategy(f"{normal}, {level}", _optimized(compiler, level), jobs) for level in ("-O1", "-O3")]
    clang = _clang()
    if clang is None:
        return found, "no clang++ on the PATH, so no rows for it"
    return [*found, Strategy(f"{normal}, clang -O2", clang, jobs)], f"clang: {clang.version}"


def _optimized(compiler: Compiler, level: str) -> Compiler:
    flags = tuple(level if flag.startswith("-O") else flag for flag in compiler.flags)
    return replace(compiler, flags=flags)


def _clang() -> Compiler | None:
    if shutil.which("clang++") is None:
        return None
    with environment("YASPS_CXX", "clang++"):
        return find_compiler()


def _rows_of(
    name: str, make: Callable[[], Scene], runtime: Runtime, strategies: Sequence[Strategy], repeats: int
) -> list[Row]:
    """Compiles, then runs all that came out in turn."""
    sources = generated(make(), runtime.compiler)
    rows, runs = [], []
    for strategy in strategies:
        case = f"{name}: {strategy.name}"
        with empty_cache():
            start, busy = time.perf_counter(), processor_seconds(of_children=True)
            given = [one_file(sources)] if strategy.in_one_file else sources
            objects = compile_sources(given, strategy.compiler.for_generated(), strategy.jobs)
            seconds, used = time.perf_counter() - start, processor_seconds(of_children=True) - busy
            rows.append(Row(case, "yasps", strategy.jobs, seconds, "s"))
            rows.append(Row(f"{case}: processor time", "yasps", strategy.jobs, used, "s"))
            if strategy.in_one_file:
                library = _linked(objects, strategy.compiler)
            else:
                compiled = _compiled(make(), replace(runtime, compiler=strategy.compiler))
        if strategy.in_one_file:
            compiled = _compiled(make(), runtime)  # from the user's cache
            _exchange(compiled, library)
        instances = sum(term.count for term in compiled._terms)
        runs.append(Peer(f"{case}: run", "yasps", 1, compiled.assemble, 1e9 / instances, "ns/instance"))
    return rows + measure(runs, repeats)


def processor_seconds(*, of_children: bool = False) -> float:
    """Of this process and all that it has started and that have ended, or of these alone."""
    times = os.times()
    children = times.children_user + times.children_system
    return children if of_children else children + times.user + times.system


def _compiled(scene: Scene, runtime: Runtime) -> CpuScene:
    """The scene compiled by the compiler of this runtime; the runtime itself stays as it is."""
    scene._runtime = runtime
    return on_cpu(scene.compile())


def _linked(objects: Sequence[CompiledObject], compiler: Compiler) -> ctypes.CDLL:
    """As `Program` links."""
    math = ("-lmvec", "-lm") if compiler.has_vector_math else ("-lm",)
    return ctypes.CDLL(str(link(objects, compiler, (*LINK_FLAGS, *math)).path))


def _exchange(compiled: CpuScene, library: ctypes.CDLL) -> None:
    """The scene runs on this library, which has the same functions. Raises ValueError if they do something else."""
    expected = compiled.assemble()
    compiled.program._library = library
    compiled.program._functions.clear()  # addresses in the library before
    owner = compiled.targets[0].owner
    assert owner is not None
    compiled.arrays_moved(owner)
    if not np.allclose(compiled.assemble(), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max()):
        raise ValueError("objects compiled in one file give another gradient")


def _whole(name: str, make: Callable[[], Scene], threads: int) -> list[Row]:
    """What a user waits for, with an empty cache and with a filled one."""
    rows = []

    @contextmanager
    def timed(what: str) -> Iterator[None]:
        start, busy = time.perf_counter(), processor_seconds()
        yield
        seconds, used = time.perf_counter() - start, processor_seconds() - busy
        case = f"{name}: yasps whole, {what}"
        rows.append(Row(case, "yasps", threads, seconds, "s"))
        rows.append(Row(f"{case}: processor time", "yasps", threads, used, "s"))

    with empty_cache():
        with timed("runtime, cold"):
            runtime = load_runtime(find_compiler(), 1)
        for state in ("cold", "warm"):
            scene = make()
            scene._runtime = runtime
            with timed(f"scene.compile, {state}"):
                scene.compile()
    return rows
