"""How compile time grows with an energy's length, width, curvature and number: seconds of each stage."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from benchmarks.compile_times import empty_cache, processor_seconds
from benchmarks.large_energies import LARGE_ENERGIES
from benchmarks.measure import Report, Row, Settings
from yasps import Scene
from yasps.backend.codegen.preludes import without_preludes
from yasps.backend.codegen.program import sources_of
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cpp.object import CppEmitter
from yasps.frontend.execution.emit import SceneEmitter
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.build.toolchain import Compiler, compile_sources, find_compiler
from yasps.runtime.core.library import Runtime, load_runtime

DESCRIPTION = (
    "compile time of long, wide, curved and many energies: symbolic stage, emission, C++, cold and warm, seconds"
)
DEFAULT_SIZE = 500
NOTES = (
    "size: cases up to this many steps, points, levels, energies or Gauss points.",
    "Each once. symbolic: expressions to IR and all passes; emission: C++ text; C++: all objects, with an empty cache, "
    "as many at a time as there are processors; cold, warm: scene.compile() with an empty cache but for the "
    "runtime, and of the same scene built again.",
    "processor time: of this process and those it starts; what other programs do is not in it.",
    "lines: of the generated files without the common preludes.",
)


class _Stages:
    """Rows of one case."""

    def __init__(self, case: str, threads: int) -> None:
        self.case = case
        self.threads = threads
        self.rows: list[Row] = []

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Two rows for what happens inside, where nothing of before is left to clear away."""
        gc.collect()
        start, busy = time.perf_counter(), processor_seconds()
        yield
        seconds, used = time.perf_counter() - start, processor_seconds() - busy
        self.add(stage, seconds, "s")
        self.add(f"{stage}, processor time", used, "s")

    def add(self, what: str, value: float, unit: str) -> None:
        self.rows.append(Row(f"{self.case}: {what}", "yasps", self.threads, value, unit))


def run(settings: Settings) -> Report:
    """Compiles all scenes up to the size asked for."""
    runtime = load_runtime(find_compiler(), 1)
    rows: list[Row] = []
    for energy in LARGE_ENERGIES:
        for case, make in energy.scenes(settings.size).items():
            rows += stages(case, make, runtime, settings.threads)
    return Report(rows, list(NOTES))


def stages(case: str, make: Callable[[], Scene], runtime: Runtime, threads: int) -> list[Row]:
    """The stages one by one, then what a user waits for."""
    found = _Stages(case, threads)
    with empty_cache():
        _one_by_one(found, make(), runtime.compiler, threads)
    with empty_cache():
        for state in ("cold", "warm"):
            with found.timed(state):
                _compile(make(), runtime)
    return found.rows


def _one_by_one(found: _Stages, scene: Scene, compiler: Compiler, threads: int) -> None:
    with found.timed("symbolic"):
        module = run_pipeline(SceneEmitter(scene.name).emit(scene._energies, scene._targets, []))
    with found.timed("emission"):
        codes = [code for code in CppEmitter(SceneView(module), compiler.has_vector_math).emit_all() if code.entries]
    sources = sources_of(codes, compiler)
    found.add("lines", float(sum(without_preludes(source.text).count("\n") for source in sources)), "lines")
    with found.timed("C++"):
        compile_sources(sources, compiler.for_generated(), threads)


def _compile(scene: Scene, runtime: Runtime) -> None:
    scene._runtime = runtime
    scene.compile()
