"""Gradient and Hessian of contact barriers, every kind of pair, beside the IPC Toolkit and the machine's floor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.contact_problem import CONTACTS, ContactProblem, close_pairs, free_problem, union_problem
from benchmarks.element_rows import check_close
from benchmarks.ipctk_contacts import IpctkPairs, ipctk_pairs
from benchmarks.kernel_problem import FLOOR_NOTES, Machine, floor_rows, measure_machine, projected_share
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps.frontend.commands.environment_report import cpu_model
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import available_processors

DESCRIPTION = "gradient and Hessian of contact barriers, free and affine; peers IPC Toolkit, the machine's floor"
DEFAULT_SIZE = 40_000
PEER_PAIRS = 2_500  # the toolkit's cost per pair does not depend on their number
UNIT = "ns/pair"
UNION = "point_triangle, free and affine"
NOTES = (
    "Two sheets, one close above the other: each upper vertex is in one pair or two, each lower one in up to four.",
    "gradient; derived (gradient and Hessian, no projection); projected (share of the pairs that needed it): gathered, "
    "added to the global gradient and block-sparse matrix, zeroed first. Structure is made before.",
    "free and affine: the lower sheet's vertices are free, the upper sheet is an affine body (12 unknowns).",
    "IPC Toolkit: BarrierPotential with ClampedLogSqBarrier (the same formula), gradient, then hessian as a sparse "
    "matrix, which it builds anew each time; CLAMP of each whole local Hessian; one thread. Its gradient and "
    "unprojected Hessian agree with yasps'.",
    *FLOOR_NOTES,
)


def run(settings: Settings) -> Report:
    """Times all kinds. Raises PeersDisagreeError."""
    threads = sorted({1, settings.threads})
    rows: list[Row] = []
    machine = measure_machine(find_compiler(), threads, settings.repeats)
    for kind in CONTACTS:
        pairs = close_pairs(kind, settings.size)
        few = close_pairs(kind, min(settings.size, PEER_PAIRS))
        peer = ipctk_pairs(few)
        check_ipctk(peer, free_problem(few, 1))
        problems = [free_problem(pairs, t) for t in threads]
        rows += _rows_of(kind, problems, peer, machine, settings.repeats)
        if kind == "point_triangle":
            rows += _rows_of(UNION, [union_problem(pairs, t) for t in threads], None, machine, settings.repeats)
    about = [
        f"{len(pairs.pairs):,} pairs, {peer.count:,} for the toolkit; least and median of {settings.repeats} rounds, "
        "in which all rows of a kind take turns.",
        f"{cpu_model()}, {available_processors()} processors; {problems[0].compiled.runtime.compiler.version}.",
    ]
    return Report(rows + machine.rows, [*about, *NOTES])


def _rows_of(
    label: str, problems: Sequence[ContactProblem], peer: IpctkPairs | None, machine: Machine, repeats: int
) -> list[Row]:
    share = f"{100 * projected_share(problems[0].compiled):.1f} %"
    count = len(problems[0].pairs.pairs)
    cases = {
        "gradient": {"hessian": False},
        "derived": {"project": False},
        f"projected ({share})": {"project": True},
    }
    peers: list[Peer] = []
    for case, how in cases.items():
        for problem in problems:
            work = partial(problem.compiled.assemble, **how)
            peers.append(Peer(f"{label}: {case}", "yasps", problem.threads, work, 1e9 / count, UNIT))
        if peer is not None:
            theirs = peer.gradient if case == "gradient" else partial(peer.assemble, how["project"])
            peers.append(Peer(f"{label}: {case}", "IPC Toolkit", 1, theirs, 1e9 / peer.count, UNIT))
    rows = measure(peers, repeats)
    own = [row for row in rows if row.implementation == "yasps" and not row.case.endswith("gradient")]
    return rows + floor_rows(label, problems[0].compiled, machine, own, UNIT)


def check_ipctk(peer: IpctkPairs, problem: ContactProblem) -> None:
    """Compares gradient and unprojected Hessian. Raises PeersDisagreeError."""
    compiled = problem.compiled
    check_close("gradient", "the IPC Toolkit", compiled.assemble(project=False), peer.gradient())
    vector = np.random.default_rng(1).standard_normal(compiled.static_matrix.size)
    theirs = np.asarray(peer.hessian(False) @ vector)
    check_close("Hessian", "the IPC Toolkit", compiled.static_matrix.multiply(vector), theirs)
