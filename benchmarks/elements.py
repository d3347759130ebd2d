"""Gradient and Hessian of stable Neo-Hookean tets: what one costs, beside JAX, SymPy and the machine's floor."""

from __future__ import annotations

import os
from functools import partial

import numpy as np

from benchmarks.element_problem import Elements, Problem, box_of_tets, first_of, make_problem, tets_of
from benchmarks.element_rows import WHAT_ROWS_HOLD, check_close, make_contest
from benchmarks.kernel_problem import FLOOR_NOTES, UNIT, floor_rows, measure_machine
from benchmarks.measure import Peer, Report, Settings, measure
from benchmarks.sympy_kernel import SympyTets, sympy_tets
from yasps.frontend.commands.environment_report import cpu_model
from yasps.meshes import read_tetrahedral_mesh
from yasps.runtime.core.library import available_processors

DESCRIPTION = "gradient and Hessian of stable Neo-Hookean tets; peers JAX, PyTorch, SymPy + Eigen, the machine's floor"
DEFAULT_SIZE = 80_000
SHARES = (0.0, 0.09, 0.33, 0.84)  # of tets that need projection
PEER_TETS = 10_000  # their cost per tet does not depend on the number of tets


def tets_for(settings: Settings) -> Elements:
    """The tets of the mesh file, or a box of them."""
    if settings.mesh is not None:
        return tets_of(read_tetrahedral_mesh(settings.mesh))
    return box_of_tets(settings.size)


def run(settings: Settings) -> Report:
    """Times all rows. Raises PeersDisagreeError."""
    tets = tets_for(settings)
    threads = sorted({1, settings.threads})
    contest = make_contest("", tets, threads, PEER_TETS)
    first = contest.assembled[0].compiled
    sympy = None
    try:
        sympy = sympy_tets(first_of(tets, PEER_TETS), first.runtime.compiler)
        about_sympy = _check_sympy(sympy, contest.assembled[0])
    except ImportError as error:
        about_sympy = f"No rows for SymPy + Eigen: {error}; to have them: pip install sympy cmeel-eigen"

    rows = measure(contest.without_projection() + _sympy_peers(sympy, "derived", 0.0, False), settings.repeats)
    for wanted in SHARES:
        amplitude = contest.assembled[0].amplitude_for(wanted)
        share = contest.deform(amplitude)
        peers = contest.with_projection(amplitude, share)
        peers += _sympy_peers(sympy, f"projected ({share})", amplitude, True)
        rows += measure(peers, settings.repeats)
    machine = measure_machine(first.runtime.compiler, threads, settings.repeats)
    rows += machine.rows
    stored = [row for row in rows if row.case == "derived, stored" and row.implementation == "yasps"]
    assembled = [row for row in rows if row.case.endswith(", assembled")]
    rows += floor_rows("stored", contest.stored.compiled, machine, stored)
    rows += floor_rows("assembled", first, machine, assembled)
    return Report(rows, [*about(tets, settings, contest.assembled[0]), *contest.about_peers, about_sympy, *NOTES])


NOTES = (
    *WHAT_ROWS_HOLD,
    "SymPy + Eigen: Psi(F) derived by SymPy, cse, C compiled as yasps' kernels are; a plain loop over tets, "
    "SelfAdjointEigenSolver of the 9x9, dense J^T H J, added to a block matrix.",
    *FLOOR_NOTES,
)


def about(elements: Elements, settings: Settings, problem: Problem) -> list[str]:
    """What was timed, and on which machine."""
    return [
        f"{len(elements):,} elements, {len(elements.vertices):,} vertices; least and median of {settings.repeats} "
        "rounds, in which all rows of a group take turns.",
        f"{cpu_model()}, {available_processors()} processors; {problem.compiled.runtime.compiler.version}; "
        f"OMP_WAIT_POLICY {os.environ.get('OMP_WAIT_POLICY', 'not set')}.",
    ]


def _sympy_peers(sympy: SympyTets | None, case: str, amplitude: float, project: bool) -> list[Peer]:
    if sympy is None:
        return []
    work = partial(sympy.assemble, sympy.elements.deformed(amplitude), project)
    return [Peer(f"{case}, assembled", "SymPy + Eigen", 1, work, 1e9 / len(sympy.elements), UNIT)]


def _check_sympy(sympy: SympyTets, problem: Problem) -> str:
    """Compares gradient and Hessian (times a vector), projected and not, on the tets that SymPy's loop is over."""
    same = problem if len(problem.elements) == len(sympy.elements) else make_problem(sympy.elements, 1)
    same.deform(0.2)
    vector = np.random.default_rng(1).standard_normal(same.compiled.static_matrix.size)
    for project in (False, True):
        sympy.assemble(sympy.elements.deformed(0.2), project)
        gradient = same.compiled.assemble(project=project)
        check_close("gradient", "SymPy + Eigen", gradient, sympy.gradient.reshape(-1))
        what = "projected Hessian" if project else "Hessian"
        check_close(what, "SymPy + Eigen", same.compiled.static_matrix.multiply(vector), sympy.multiply(vector))
    return (
        f"SymPy {sympy.version}, {len(sympy.elements):,} of the tets, one thread. Its gradient and Hessian, projected "
        "and not, agree with yasps'."
    )
