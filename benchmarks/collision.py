"""Which pieces of two sheets of cloth are close, and how far a step may go, beside the IPC Toolkit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import ipctk
import numpy as np
from numpy.typing import NDArray

from benchmarks.contact_problem import CELL, close_pairs
from benchmarks.element_rows import PeersDisagreeError
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps.contact import CollisionGeometry
from yasps.frontend.commands.environment_report import cpu_model
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import available_processors, load_runtime

DESCRIPTION = "candidates, active set and step bound of cloth on cloth; peer IPC Toolkit"
DEFAULT_SIZE = 60_000  # triangles
REACH = 0.35 * CELL  # of the barrier; the sheets are 0.3 cells apart
SHIFT, SHAKE = 0.2 * CELL, 0.03 * CELL  # of the way: of all vertices together, of each by itself
NOTES = (
    "Two sheets, one 0.3 cells above the other, active up to 0.5 cells. All vertices move by 0.5 cells together, and "
    "each by about 0.1 cells by itself, so that the step has to be cut.",
    "candidates: pairs that may come within the activation distance on the way, trees included; ns of each. active "
    "set: of all candidates, at the start, the distances of what is close, sorted by formula. step bound: of all "
    "candidates. With arrays for Python.",
    "IPC Toolkit: Candidates.build with its default broad phase; NormalCollisions.build of these candidates; "
    "compute_collision_free_stepsize with AdditiveCCD. Both find as many close pairs, and its bound is no larger.",
)
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Sheets:
    """triangles: [m, 3]; start, end: [n, 3] of a way."""

    triangles: NDArray[np.int32]
    start: FloatArray
    end: FloatArray


def sheets(size: int) -> Sheets:
    """Two sheets of about `size` triangles in all, and where they go."""
    pairs = close_pairs("point_triangle", max(size // 4, 4))
    random = np.random.default_rng(1)
    way = SHIFT * np.array([1.0, 0.3, 0.0]) + SHAKE * random.standard_normal(pairs.vertices.shape)
    return Sheets(pairs.triangles, pairs.vertices, pairs.vertices + way)


@dataclass(frozen=True)
class Stages:
    """What is timed, by its name; and what each gave: numbers of pairs and close ones, their least distance, bound."""

    work: dict[str, Callable[[], object]]
    candidates: int
    close: int
    nearest: float
    bound: float


def stages_of_yasps(cloth: Sheets, threads: int) -> Stages:
    """Ours, with so many threads."""
    runtime = load_runtime(find_compiler(), threads)
    geometry = CollisionGeometry(cloth.start, cloth.triangles, REACH, runtime=runtime)
    candidates = geometry.candidates(cloth.start, cloth.end)
    work = {
        "candidates": partial(geometry.candidates, cloth.start, cloth.end),
        "active set": partial(geometry.active_set, cloth.start, candidates),
        "step bound": partial(geometry.step_bound, cloth.start, cloth.end, candidates, start_is_free=True),
    }
    bound = geometry.step_bound(cloth.start, cloth.end, candidates, start_is_free=True)
    active = geometry.active_set(cloth.start, candidates)
    return Stages(work, len(candidates), len(active), active.minimum_distance, bound)


def stages_of_ipctk(cloth: Sheets, threads: int) -> Stages:
    """The toolkit's, with so many threads."""
    start, end = np.asfortranarray(cloth.start), np.asfortranarray(cloth.end)
    faces = np.asfortranarray(cloth.triangles)
    mesh = ipctk.CollisionMesh(start, ipctk.edges(faces), faces)
    found, ccd = ipctk.Candidates(), ipctk.AdditiveCCD()

    def candidates() -> None:
        ipctk.set_num_threads(threads)
        found.build(mesh, start, end, inflation_radius=REACH / 2)

    def active_set() -> ipctk.NormalCollisions:
        ipctk.set_num_threads(threads)
        collisions = ipctk.NormalCollisions()
        collisions.build(found, mesh, start, REACH)
        return collisions

    def step_bound() -> float:
        ipctk.set_num_threads(threads)
        return float(found.compute_collision_free_stepsize(mesh, start, end, narrow_phase_ccd=ccd))

    candidates()
    work = {"candidates": candidates, "active set": active_set, "step bound": step_bound}
    close = active_set()
    return Stages(work, len(found), len(close), float(close.compute_minimum_distance(mesh, start)) ** 0.5, step_bound())


def check(ours: Stages, theirs: Stages) -> None:
    """Both find the same nearest pair, and nearly as many close ones: which formula nearly parallel edges have, and so
    which become one, is a matter of rounding. Their bounds differ by the gap they keep. Raises PeersDisagreeError."""
    if abs(ours.nearest - theirs.nearest) > 1e-9 * theirs.nearest:
        raise PeersDisagreeError(f"the nearest pair is {ours.nearest} apart, {theirs.nearest} for the IPC Toolkit")
    if abs(ours.close - theirs.close) > 0.01 * theirs.close:
        raise PeersDisagreeError(f"yasps finds {ours.close} close pairs, the IPC Toolkit {theirs.close}")
    if not 0.5 * ours.bound <= theirs.bound <= 1.2 * ours.bound:
        raise PeersDisagreeError(f"yasps bounds the step by {ours.bound:.4g}, the IPC Toolkit by {theirs.bound:.4g}")


def run(settings: Settings) -> Report:
    """Times both with one thread and with all. Raises PeersDisagreeError."""
    cloth = sheets(settings.size)
    threads = sorted({1, settings.threads})
    sides = {"yasps": stages_of_yasps, "IPC Toolkit": stages_of_ipctk}
    all_stages = {name: {count: of(cloth, count) for count in threads} for name, of in sides.items()}
    ours, theirs = all_stages["yasps"][1], all_stages["IPC Toolkit"][1]
    check(ours, theirs)
    rows: list[Row] = []
    for case in ours.work:
        peers = [
            Peer(case, name, count, stages.work[case], 1e3, "ms")
            for name, by_threads in all_stages.items()
            for count, stages in by_threads.items()
        ]
        rows += measure(peers, settings.repeats)
    about = [
        f"{len(cloth.triangles):,} triangles, {len(cloth.start):,} vertices; {ours.candidates:,} candidates, "
        f"{theirs.candidates:,} of the toolkit; {ours.close:,} close pairs; step bound {ours.bound:.3f}, the toolkit's "
        f"{theirs.bound:.3f}.",
        f"{cpu_model()}, {available_processors()} processors; {find_compiler().version}.",
    ]
    return Report(rows, [*about, *NOTES])
