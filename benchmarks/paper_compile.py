"""Compiling section 9.2's scene in the three ways of the paper's figure 28."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from benchmarks.compile_times import empty_cache, generated, one_file, processor_seconds
from benchmarks.measure import Report, Row, Settings
from benchmarks.plots import Bars
from yasps.examples import lever, many_bunnies_on_cloth
from yasps.frontend.commands.environment_report import cpu_model
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, find_compiler
from yasps.runtime.core.library import available_processors

DESCRIPTION = "the paper's figure 28: compiling 9.2 by modules, in parallel and one by one, and monolithic"
DEFAULT_SIZE = 2  # bunnies
PAPER_LEVER = (4.0, 6.0)  # s of NVCC for the inertia of the masses, with and without reuse
NOTES = (
    "--size: bunnies of 9.2, soft and stiff in turn. What is generated does not depend on meshes. Every compile starts "
    "with an empty cache, once; C++ only, without the symbolic stage, the link and the solver runtime.",
    "optimized: each generated object is a file, equal ones once, --threads at a time. no parallel: one by one. "
    "monolithic: for each object that no other one needs (energies with derivatives, values) one file with all that it "
    "needs, so that what several need is compiled several times, one by one. processor: time of all processes.",
    "The figure has no numbers in the text; it says that optimized is significantly faster. For the lever of 10.7 the "
    "paper gives 4 s of NVCC for one energy with reuse and 6 s without; here all of that scene's energies.",
)
_NAME = re.compile(r"yasps_[0-9a-f]{8,}")


def monolithic(sources: Sequence[Source]) -> list[Source]:
    """For each source that no other one refers to, one with all that it refers to, directly or not."""
    by_name = {source.name: source for source in sources}
    needs = {name: _needed(source.text, by_name) - {name} for name, source in by_name.items()}
    inner = set().union(*needs.values()) if needs else set()
    files = []
    for name in by_name:
        if name in inner:
            continue
        wanted, waiting = {name}, [name]
        while waiting:
            new = needs[waiting.pop()] - wanted
            wanted |= new
            waiting += sorted(new)
        # Callees before callers: names are declared in each anyway, but the order should not depend on hashes' sets.
        whole = one_file([source for source in sources if source.name in wanted])
        files.append(replace(whole, name=f"monolithic.{name}"))
    return files


def _needed(text: str, by_name: Mapping[str, Source]) -> set[str]:
    return {name for name in _NAME.findall(text) if name in by_name}


def run(settings: Settings) -> Report:
    """Compiles both scenes in all ways."""
    compiler = find_compiler()
    bunnies = many_bunnies_on_cloth.PROGRAM.options(["--size", "4", "--bunnies", str(settings.size), "--threads", "1"])
    scenes = {
        "9.2": many_bunnies_on_cloth.build(bunnies).scene,
        "lever": lever.build(lever.PROGRAM.options(["--threads", "1"])).scene,
    }
    rows: list[Row] = []
    notes = []
    for name, scene in scenes.items():
        sources = generated(scene, compiler)
        files = monolithic(sources)
        ways = {
            "optimized": (sources, settings.threads),
            "no parallel": (sources, 1),
            "monolithic": (files, 1),
        }
        for way, (given, jobs) in ways.items():
            rows += _rows(f"{name}: {way}", given, compiler, jobs)
        lines = [sum(source.text.count("\n") for source in given) for given in (sources, files)]
        notes.append(
            f"{name}: {len(sources)} modules, {lines[0]:,} lines; {len(files)} monolithic, {lines[1]:,} lines."
        )
    rows.append(Row("lever: optimized", "the paper, one energy", 0, PAPER_LEVER[0], "s"))
    rows.append(Row("lever: monolithic", "the paper, one energy", 0, PAPER_LEVER[1], "s"))
    value = {(row.case, row.unit): row.value for row in rows if row.implementation == "yasps"}
    labels = ("optimized", "no parallel", "monolithic")
    plot = Bars(
        "figure_28",
        "Compiling with an empty cache",
        "processor seconds",
        labels,
        {name: [value[f"{name}: {way}: processor", "s"] for way in labels] for name in scenes},
        log=True,
    )
    machine = f"{cpu_model()}, {available_processors()} processors; {compiler.version}."
    return Report(rows, [machine, *notes, *NOTES], [plot])


def _rows(case: str, sources: Sequence[Source], compiler: Compiler, jobs: int) -> list[Row]:
    with empty_cache():
        start, busy = time.perf_counter(), processor_seconds(of_children=True)
        compile_sources(sources, compiler.for_generated(), jobs)
        seconds, used = time.perf_counter() - start, processor_seconds(of_children=True) - busy
    return [Row(case, "yasps", jobs, seconds, "s"), Row(f"{case}: processor", "yasps", jobs, used, "s")]
