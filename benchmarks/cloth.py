"""Gradient and Hessian of cloth: Baraff-Witkin triangles and hinges, beside JAX and the machine's floor."""

from __future__ import annotations

from benchmarks.element_problem import NOISY, Elements, cloth_hinges, cloth_triangles
from benchmarks.element_rows import WHAT_ROWS_HOLD, make_contest
from benchmarks.elements import about
from benchmarks.kernel_problem import FLOOR_NOTES, Machine, floor_rows, measure_machine
from benchmarks.measure import Report, Row, Settings, measure
from yasps.runtime.build.toolchain import find_compiler

DESCRIPTION = "gradient and Hessian of Baraff-Witkin triangles and hinges; peers JAX, PyTorch, the machine's floor"
DEFAULT_SIZE = 80_000
NOISE = (0.0, NOISY)  # in cells
JAX_ELEMENTS = 10_000


def run(settings: Settings) -> Report:
    """Times both kinds of element. Raises PeersDisagreeError."""
    kinds = {"Baraff-Witkin": cloth_triangles(settings.size), "hinge": cloth_hinges(settings.size)}
    machine = measure_machine(find_compiler(), sorted({1, settings.threads}), settings.repeats)
    rows = machine.rows
    notes: list[str] = []
    for name, elements in kinds.items():
        found, told = _of_kind(name, elements, settings, machine)
        rows += found
        notes += told
    return Report(rows, [*notes, *WHAT_ROWS_HOLD, *FLOOR_NOTES])


def _of_kind(name: str, elements: Elements, settings: Settings, machine: Machine) -> tuple[list[Row], list[str]]:
    threads = sorted({1, settings.threads})
    contest = make_contest(f"{name}: ", elements, threads, JAX_ELEMENTS)
    rows = measure(contest.without_projection(), settings.repeats)
    for amplitude in NOISE:
        share = contest.deform(amplitude)
        rows += measure(contest.with_projection(amplitude, share), settings.repeats)
    compiled = contest.assembled[0].compiled
    assembled = [row for row in rows if row.case.endswith(", assembled")]
    rows += floor_rows(name, compiled, machine, assembled)
    told = [f"{name}: {line}" for line in [*about(elements, settings, contest.assembled[0]), *contest.about_peers]]
    return rows, told
