"""What it takes to project Hessians of every width that there could be: the paper's figures 23 and 24."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.element_problem import Elements, FloatArray, box_of_tets, cloth_triangles, make_problem
from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.plots import Bars
from benchmarks.projection import CHUNK, Harness, make_harness, packed
from benchmarks.replicated import replicated
from yasps.frontend.commands.environment_report import cpu_model
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import available_processors

UNIT = "ns/instance"

DESCRIPTION_23 = (
    "the paper's figure 23: projection of a point-point barrier in 24, 15, 6 and 3 unknowns, over its Hessian"
)
SIZE_23 = 4_000
PAPER_SPEEDUP = 44.0  # of 6 x 6 over 24 x 24
WIDTHS = {24: "no optimisation: two affine bodies", 15: "block compression: one affine body", 6: "positions", 3: "cut"}
NOTES_23 = (
    "hessian: gradient and Hessian of a pair, gathered, stored by itself, not projected. projection, w x w: of the "
    f"same Hessians expanded to w unknowns, {CHUNK} with one call; nearly all have a negative eigenvalue.",
    "24, 15 and 6 are the paper's; yasps projects the 3 x 3 Hessian in the difference of the points, which the "
    "compiler finds by itself, whatever the points belong to. over hessian: figure 23, of which the text gives one "
    f"number, {PAPER_SPEEDUP:g} times from 24 to 6.",
)

DESCRIPTION_24 = "the paper's figure 24: Hessian and projection of Baraff-Witkin and Neo-Hookean, in positions and in F"
SIZE_24 = 20_000
AMPLITUDES = (0.1, 0.3)  # noise in cells
PAPER_GAIN = {"Baraff-Witkin": 2.0, "stable Neo-Hookean": 1.56}
NOTES_24 = (
    "hessian: gather, gradient, Hessian of each element by itself, not projected (noise of the given amplitude at each "
    "vertex, in cells; in brackets the share with a negative eigenvalue).",
    f"projection in positions: of the same Hessians as they are, 12 x 12 or 9 x 9, {CHUNK} with one call; in F: of "
    "those in the deformation gradient, 9 x 9 or 6 x 6. Both by eigenvalues. projection, yasps: what the kernel takes "
    "longer when it projects, which is in F, by singular values where the energy is proven isotropic.",
    "gain: hessian and projection in positions over those with projection in F (paper: 2 for Baraff-Witkin, 1.56 for "
    "stable Neo-Hookean; its projection takes up to 5 times as long as the Hessian). The paper's user rewrites the "
    "energy for this; here the compiler does it, for both ways of writing.",
)


def run_figure_23(settings: Settings) -> Report:
    """Times all widths."""
    problem = replicated("point_point", settings.size)
    harness = make_harness(find_compiler())
    local = local_hessians(problem.derivatives(), 6)
    peers = [_peer("hessian", settings.size, lambda: problem.compiled.assemble(project=False))]
    for width, what in WIDTHS.items():
        matrices = packed(expanded(local, width))
        peers.append(
            _peer(
                f"projection, {width} x {width} ({what})",
                settings.size,
                _project(harness, matrices, settings.size, width),
            )
        )
    rows = measure(peers, settings.repeats, time.process_time)
    own = rows[0].value
    over = {width: row.value / own for width, row in zip(WIDTHS, rows[1:], strict=True)}
    rows += [Row(f"{row.case}: over hessian", "yasps", 1, row.value / own, "times") for row in rows[1:]]
    rows.append(Row("from 24 x 24 to 6 x 6", "yasps", 1, over[24] / over[6], "times"))
    rows.append(Row("from 24 x 24 to 6 x 6", "the paper", 0, PAPER_SPEEDUP, "times"))
    rows.append(Row("from 24 x 24 to 3 x 3", "yasps", 1, over[24] / over[3], "times"))
    labels = [f"{width} x {width}" for width in WIDTHS]
    plot = Bars(
        "figure_23",
        "Projection of a point-point barrier",
        "time over the Hessian's",
        labels,
        {"ours": list(over.values())},
        log=True,
    )
    return Report(rows, [_about(settings), *NOTES_23], [plot])


def expanded(local: FloatArray, width: int) -> FloatArray:
    """Hessians of two points [n, 6, 6] in so many unknowns: 3 of their difference, 6 of both, 15 or 24 where one or
    both are on an affine body."""
    count = len(local)
    if width == 3:
        return np.ascontiguousarray(local[:, :3, :3])
    if width == 6:
        return local
    rest = np.random.default_rng(1).uniform(0.5, 1.5, (count, 2, 3))
    jacobian = np.zeros((count, 6, width))
    start = 0
    for point, affine in enumerate([width == 24, True]):
        for axis in range(3):
            row = 3 * point + axis
            if affine:
                jacobian[:, row, start + 3 * axis : start + 3 * axis + 3] = rest[:, point]
                jacobian[:, row, start + 9 + axis] = 1.0
            else:
                jacobian[:, row, start + axis] = 1.0
        start += 12 if affine else 3
    return jacobian.transpose(0, 2, 1) @ local @ jacobian


def local_hessians(derivatives: FloatArray, width: int) -> FloatArray:
    """[n, width, width] of gradients and upper triangles side by side."""
    rows, cols = np.triu_indices(width)
    whole = np.empty((len(derivatives), width, width))
    whole[:, rows, cols] = whole[:, cols, rows] = derivatives[:, width:]
    return whole


def run_figure_24(settings: Settings) -> Report:
    """Times both energies, at each amplitude."""
    harness = make_harness(find_compiler())
    rows: list[Row] = []
    parts: dict[str, list[float]] = {"hessian": [], "projection": []}
    labels = []
    kinds = {"Baraff-Witkin": cloth_triangles(settings.size), "stable Neo-Hookean": box_of_tets(settings.size)}
    for name, elements in kinds.items():
        for amplitude in AMPLITUDES:
            found, share = _of_elements(name, elements.exploded(), amplitude, harness, settings.repeats)
            rows += found
            value = {row.case.removeprefix(f"{name}, noise {amplitude:g} ({share}): "): row.value for row in found}
            for how in ("in positions", "in F", "yasps"):
                labels.append(f"{name.split()[-1]} {amplitude:g}, {how}")
                parts["hessian"].append(value["hessian"])
                parts["projection"].append(value[f"projection, {how}"])
        rows.append(Row(f"{name}: gain", "the paper", 0, PAPER_GAIN[name], "times"))
    plot = Bars("figure_24", "Hessian and projection", "ns an element", labels, parts, stacked=True)
    return Report(rows, [_about(settings), *NOTES_24], [plot])


def _of_elements(
    name: str, elements: Elements, amplitude: float, harness: Harness, repeats: int
) -> tuple[list[Row], str]:
    problem, count = make_problem(elements, 1), len(elements)
    problem.deform(amplitude)
    share = f"{100 * problem.projected_share():.0f} %"
    problem.compiled.assemble(project=False)
    width = 3 * elements.corners.shape[1]
    whole = problem.compiled.static_matrix.to_scipy().tobsr((width, width)).data
    small = in_gradient(whole, elements.constants["inverse"])
    case = f"{name}, noise {amplitude:g} ({share})"
    peers = [
        _peer(f"{case}: hessian", count, lambda: problem.compiled.assemble(project=False)),
        _peer(f"{case}: hessian and projection, yasps", count, problem.compiled.assemble),
        _peer(f"{case}: projection, in positions", count, _project(harness, packed(whole), count, width)),
        _peer(f"{case}: projection, in F", count, _project(harness, packed(small), count, width - 3)),
    ]
    rows = measure(peers, repeats, time.process_time)
    hessian, kernel, positions, gradient = (row.value for row in rows)
    own = max(kernel - hessian, 0.0)
    rows.append(Row(f"{case}: projection, yasps", "yasps", 1, own, UNIT))
    rows.append(Row(f"{case}: gain, in F", "yasps", 1, (hessian + positions) / (hessian + gradient), "times"))
    rows.append(Row(f"{case}: gain, yasps", "yasps", 1, (hessian + positions) / kernel, "times"))
    return rows, share


def in_gradient(hessians: FloatArray, inverse: FloatArray) -> FloatArray:
    """Hessians [n, 3 (k + 1), 3 (k + 1)] in the corners of a simplex as those [n, 3 k, 3 k] in F, row-major.

    inverse: [n, k, k], of the rest shape: F = D inverse, with the edges D from corner 0, column by column."""
    count, k, _ = inverse.shape
    back = np.linalg.inv(inverse)  # D = F back, and edge a leads from corner 0 to corner a + 1
    lift = np.zeros((count, 3 * (k + 1), 3 * k))
    for axis in range(3):
        for edge in range(k):
            lift[:, 3 * (edge + 1) + axis, k * axis : k * axis + k] = back[:, :, edge]
    return lift.transpose(0, 2, 1) @ hessians @ lift


def _project(harness: Harness, matrices: FloatArray, count: int, width: int) -> Callable[[], object]:
    target = np.zeros_like(matrices)
    return partial(harness.project, matrices, target, count, width, copy_only=False)


def _peer(case: str, count: int, work: Callable[[], object]) -> Peer:
    return Peer(case, "yasps", 1, work, 1e9 / count, UNIT)


def _about(settings: Settings) -> str:
    return (
        f"about {settings.size:,} instances, one thread, processor time; {cpu_model()}, {available_processors()} "
        f"processors; least of {settings.repeats} rounds."
    )
