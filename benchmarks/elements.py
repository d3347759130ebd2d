"""Gradient and Hessian of stable Neo-Hookean tets: what one element costs, beside JAX and beside copying memory."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from benchmarks.bandwidth import memory_bandwidth
from benchmarks.element_problem import FloatArray, Problem, box_of_tets, make_problem
from benchmarks.jax_elements import JaxElements, jax_elements
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps.frontend.environment_report import cpu_model
from yasps.runtime.library import available_processors

DESCRIPTION = "gradient and Hessian of stable Neo-Hookean tets, ns per element, beside JAX and memory bandwidth"
DEFAULT_SIZE = 80_000
SHARES = (0.0, 0.09, 0.33, 0.84)  # of tets that need projection
JAX_TETS = 10_000  # its cost per tet does not depend on their number
AGREEMENT = 1e-9  # relative; both work in float64

UNIT = "ns/element"
WHAT_ROWS_HOLD = (
    "structure: placement indices, sparsity and positions; once for each topology, in none of the other rows.",
    "gradient: gather, gradient, added to the global gradient.",
    "derived, stored: gather, gradient, 12x12 Hessian, written for each tet by itself; no projection. yasps: a mesh "
    "whose tets share no vertex, upper triangle in ten 3x3 blocks, memory zeroed first. JAX: full 12x12.",
    "derived, assembled: gather, gradient, Hessian, added to the global gradient and block-sparse matrix, zeroed "
    "first; with several threads, private copies added up; no projection.",
    "projected (share), ...: the same with negative eigenvalues set to zero. yasps: of the 9x9 Hessian in the "
    "deformation gradient, for the tets whose factorisation shows any (the share). JAX: eigh of each 12x12.",
    "The tets to project lie scattered (noise at each vertex): 8 in a pack rarely are all fit or all unfit.",
    "floor: every input byte read once, every result byte written once, at the measured bandwidth.",
)


class PeersDisagreeError(RuntimeError):
    """Two implementations of the same mathematics gave different numbers, so timing them means nothing."""


def run(settings: Settings) -> Report:
    """Times all rows. Raises PeersDisagreeError."""
    tets = box_of_tets(settings.size)
    assembled = [make_problem(tets, threads) for threads in sorted({1, settings.threads})]
    stored = make_problem(tets.exploded(), 1)
    jax = None
    try:
        jax = jax_elements(tets, JAX_TETS)
        about_jax = _check_jax(jax, assembled[0], stored)
    except ImportError as error:
        about_jax = f"No rows for JAX, which is not installed ({error}); to have them: pip install jax"

    rows = measure(_without_projection(assembled, stored, jax), settings.repeats)
    for wanted in SHARES:
        amplitude = assembled[0].amplitude_for(wanted)
        for problem in [*assembled, stored]:
            problem.deform(amplitude)
        share = f"{100 * assembled[-1].projected_share():.1f} %"
        rows += measure(_with_projection(assembled, stored, jax, amplitude, share), settings.repeats)
    rows += _floor(assembled, stored, settings.repeats)
    notes = [
        f"{len(tets.tets):,} tets, {len(tets.vertices):,} vertices; least and median of {settings.repeats} rounds, in "
        "which all rows of a group take turns.",
        f"{cpu_model()}, {available_processors()} processors; {assembled[0].compiled.runtime.compiler.version}; "
        f"OMP_WAIT_POLICY {os.environ.get('OMP_WAIT_POLICY', 'not set')}.",
        about_jax,
        *WHAT_ROWS_HOLD,
    ]
    return Report(rows, notes)


def _peer(problem: Problem, case: str, work: Callable[[], object]) -> Peer:
    return Peer(case, "yasps", problem.threads, work, 1e9 / len(problem.tets.tets), UNIT)


def _jax_peer(jax: JaxElements, case: str, work: Callable[[], object]) -> Peer:
    return Peer(case, "JAX", 1, work, 1e9 / jax.count, UNIT)


def _rebuild(problem: Problem) -> None:
    problem.compiled.connectivity_changed(problem.corners)
    problem.compiled.update_structure()


def _without_projection(assembled: Sequence[Problem], stored: Problem, jax: JaxElements | None) -> list[Peer]:
    peers = [_peer(p, "structure", partial(_rebuild, p)) for p in assembled]
    peers += [_peer(p, "gradient", partial(p.compiled.assemble, hessian=False)) for p in assembled]
    peers.append(_peer(stored, "derived, stored", partial(stored.compiled.assemble, project=False)))
    if jax is not None:
        peers.append(_jax_peer(jax, "derived, stored", partial(jax.derive, assembled[0].tets.deformed(0.0))))
    peers += [_peer(p, "derived, assembled", partial(p.compiled.assemble, project=False)) for p in assembled]
    return peers


def _with_projection(
    assembled: Sequence[Problem], stored: Problem, jax: JaxElements | None, amplitude: float, share: str
) -> list[Peer]:
    name = f"projected ({share})"
    peers = [_peer(stored, f"{name}, stored", stored.compiled.assemble)]
    if jax is not None:
        x = assembled[0].tets.deformed(amplitude)
        peers.append(_jax_peer(jax, f"{name}, stored", partial(jax.derive_projected, x)))
    return peers + [_peer(p, f"{name}, assembled", p.compiled.assemble) for p in assembled]


def _check_jax(jax: JaxElements, shared: Problem, stored: Problem) -> str:
    """Compares gradient and Hessian (times a vector) with yasps'; returns how JAX ran.

    Not compared: projections in 9 unknowns and in 12 give different, equally semidefinite matrices.
    """
    stored.deform(0.1)
    x = shared.tets.deformed(0.1)
    gradient, hessian = jax.derive(x)
    ours = stored.compiled.assemble(project=False).reshape(-1, 12)[: jax.count]
    _check_close("gradient", ours, gradient)
    vector = np.random.default_rng(1).standard_normal(stored.compiled.static_matrix.size)
    product = stored.compiled.static_matrix.multiply(vector).reshape(-1, 12)[: jax.count]
    _check_close("Hessian", product, np.einsum("eij,ej->ei", hessian, vector.reshape(-1, 12)[: jax.count]))

    jax.derive_projected(x)
    wall, cpu = time.perf_counter(), time.process_time()
    jax.derive_projected(x)
    busy = (time.process_time() - cpu) / (time.perf_counter() - wall)
    return (
        f"JAX {jax.version}, float64, {jax.count:,} of the tets, started on one processor (sched_setaffinity): it kept "
        f"{busy:.2f} busy. Its gradient and Hessian agree with yasps'."
    )


def _check_close(what: str, ours: FloatArray, theirs: FloatArray) -> None:
    difference = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
    if not difference < AGREEMENT:
        raise PeersDisagreeError(f"the {what} of yasps and of JAX differ by {difference:.1e} of the largest entry")


def _floor(assembled: Sequence[Problem], stored: Problem, repeats: int) -> list[Row]:
    bandwidths = [memory_bandwidth(problem.threads, repeats) for problem in assembled]
    rows = list(bandwidths)
    for name, problem, copies in (("stored", stored, bandwidths[:1]), ("assembled", assembled[0], bandwidths)):
        moved = bytes_per_element(problem)
        rows.append(Row(f"floor, {name}", "bytes", 1, moved, "B/element"))
        rows += [Row(f"floor, {name}", "copy", copy.threads, moved / copy.value, UNIT) for copy in copies]
    return rows


def bytes_per_element(problem: Problem) -> float:
    """Bytes that an assembly must move for each tet, nothing twice: inputs, placement, gradient, matrix."""
    tets, matrix = problem.tets, problem.compiled.static_matrix
    (term,) = problem.compiled._terms
    assert term.kappas is not None
    assert term.positions is not None
    inputs = tets.vertices.nbytes + tets.tets.nbytes + tets.inverse.nbytes + tets.volume.nbytes
    placement = term.kappas.nbytes + term.positions.nbytes
    results = tets.vertices.nbytes + matrix.values.nbytes
    return (inputs + placement + results) / len(tets.tets)
