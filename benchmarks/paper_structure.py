"""Indices, structure and Hessians of the static and the dynamic part of one Newton iteration: the paper's figure 27."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.kernel_problem import on_cpu
from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.plots import Bars
from yasps.examples import cloths_on_bunny
from yasps.frontend.commands.environment_report import cpu_model
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.core.library import available_processors

DESCRIPTION = "the paper's figure 27: indices, structure and Hessian of one iteration of 9.1, static and dynamic part"
DEFAULT_SIZE = 32  # cells along the side of a cloth
PAPER_SIZE, PAPER_PAIRS = 100, 840  # of the paper's frame
MOST_FRAMES = 200
INDICES, STRUCTURE, HESSIAN = "indices", "structure", "Hessian"
PARTS = ("static", "dynamic")
PAPER_SHARES = {"static": 46.0, "dynamic": 4.0}
NOTES = (
    f"--size: cells along the side of a cloth, {PAPER_SIZE} in the paper (with --mesh bunny_19k.msh). The state is the "
    f"first at the end of a frame with as many close pairs a vertex as in the paper, {PAPER_PAIRS} at its size.",
    "indices: kappa from connectivities and unions. structure: sorted, unique blocks and where every local block goes "
    "(the paper's compression). Hessian: gradient and projected Hessian, added to the matrix. Processor time.",
    "share: of all six together. The paper's: indices of the static part about 46 %, of the dynamic part about 4 %. "
    "Static ones are made once for each topology, so that an iteration pays for the dynamic ones alone.",
)


def run(settings: Settings) -> Report:
    """Steps to the state and times all parts."""
    simulation = cloths_on_bunny.build(cloths_on_bunny.PROGRAM.options(_flags(settings)))
    wanted, pairs = PAPER_PAIRS * settings.size**2 / PAPER_SIZE**2, 0
    for _ in range(MOST_FRAMES):
        pairs = simulation.step().contacts
        if pairs >= wanted:
            break
    compiled = on_cpu(simulation.scene.compile())
    compiled.assemble()
    peers = [
        Peer(f"{part}: {what}", "yasps", settings.threads, work, 1e3, "ms")
        for part in PARTS
        for what, work in _work(compiled, part == "dynamic", settings.threads).items()
    ]
    rows = measure(peers, settings.repeats, time.process_time)
    total, value = sum(row.value for row in rows), {row.case: row.value for row in rows}
    rows += [Row(f"{case}: share", "yasps", settings.threads, 100 * one / total, "%") for case, one in value.items()]
    rows += [Row(f"{part}: {INDICES}: share", "the paper", 0, share, "%") for part, share in PAPER_SHARES.items()]
    times = {what: [value[f"{part}: {what}"] for part in PARTS] for what in (INDICES, STRUCTURE, HESSIAN)}
    plot = Bars("figure_27", f"One iteration of 9.1 with {pairs} close pairs", "ms", PARTS, times, stacked=True)
    about = (
        f"{pairs} close pairs, {sum(len(body.rest) for body in simulation.moving):,} vertices; {cpu_model()}, "
        f"{available_processors()} processors; least and median of {settings.repeats} rounds."
    )
    return Report(rows, [about, *NOTES], [plot])


def _flags(settings: Settings) -> list[str]:
    mesh = [] if settings.mesh is None else ["--mesh", str(settings.mesh)]
    return ["--size", str(settings.size), "--threads", str(settings.threads), *mesh]


def _work(compiled: CpuScene, dynamic: bool, threads: int) -> dict[str, Callable[[], object]]:
    """What each stage of a part does."""
    matrix = compiled.dynamic_matrix if dynamic else compiled.static_matrix
    terms = compiled._placed_terms(dynamic=dynamic)
    derived = [term for term in compiled._derived_terms() if term.dynamic is dynamic]

    def indices() -> list[NDArray[np.int32]]:
        found = []
        for term in terms:
            assert term.kappa is not None
            found.append(compiled.program.indices(term.kappa, term.count, term.capacity))
        return found

    kappas = indices()

    def structure() -> None:
        order = {"order": compiled.static_matrix.order} if dynamic else {"reorder": True}
        matrix.build(matrix.boundaries, matrix.block_sizes, kappas, threads, **order)

    def hessian() -> None:
        compiled._derive(derived, hessian=True, project=True)

    return {INDICES: indices, STRUCTURE: structure, HESSIAN: hessian}
