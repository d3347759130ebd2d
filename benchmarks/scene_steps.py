"""Whole time steps of the example two_bunnies: where a frame's time goes."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from benchmarks.measure import Report, Row, Settings
from benchmarks.on_device import ON_DEVICE, Where, new_scene
from yasps.examples.two_bunnies import two_bunnies
from yasps.frontend.commands.environment_report import cpu_model
from yasps.meshes import rabbit, read_tetrahedral_mesh
from yasps.meshes.rabbit_shape import FEWEST_VERTICES
from yasps.output import TimeTable
from yasps.runtime.core.library import available_processors
from yasps.runtime.device.protocol import Device
from yasps.simulation import Simulation
from yasps.stepping import NewtonReport

DESCRIPTION = "time steps of two_bunnies: seconds a frame, Newton and CG iterations, share of each stage"
DEFAULT_SIZE = 5_000
FREE_FLIGHT = 5  # frames before the first contact, not timed
FRAMES_PER_ROUND = 3
NOTES = (
    "--size: vertices of each rabbit, about (1,500 or more); --mesh: this mesh in place of the rabbit; --repeats R: "
    f"{FRAMES_PER_ROUND} R frames are timed, after {FREE_FLIGHT} of free flight.",
    "frame: value is the mean, the second number the median. Stages: inner ones are not counted in outer ones; other: "
    "Python between them. The check for intersections and output that `yasps run two_bunnies` does are not in it.",
    "height: of the centre after the last frame, for comparing trajectories of two versions.",
)


def run(settings: Settings) -> Report:
    """Steps the scene with all threads asked for."""
    return _report(settings, [settings.threads])


def run_on_device(settings: Settings, device: Device) -> Report:
    """Steps the scene on all threads, then on the device."""
    report = _report(settings, [settings.threads, device])
    note = f"threads {ON_DEVICE}: on {device.name}; finding contacts stays on the CPU, with all its threads."
    return Report(report.rows, [note, *report.notes])


def _report(settings: Settings, places: Sequence[Where]) -> Report:
    shape = read_tetrahedral_mesh(settings.mesh) if settings.mesh else rabbit(max(settings.size, FEWEST_VERTICES))
    rows: list[Row] = []
    for where in places:
        example = two_bunnies(shape, new_scene("two_bunnies", where))
        rows += _rows_of(example, settings, where if isinstance(where, int) else ON_DEVICE)
    about = (
        f"{len(shape.vertices):,} vertices and {len(shape.tets):,} tets each, "
        f"{FRAMES_PER_ROUND * settings.repeats} frames of {example.stepper.time_step} s; {cpu_model()}, "
        f"{available_processors()} processors."
    )
    return Report(rows, [about, *NOTES])


def _rows_of(example: Simulation, settings: Settings, threads: int) -> list[Row]:
    example.scene.compile()
    for _ in range(FREE_FLIGHT):
        example.stepper.step()
    times = TimeTable()
    example.stepper.times = times
    seconds: list[float] = []
    reports: list[NewtonReport] = []
    for _ in range(FRAMES_PER_ROUND * settings.repeats):
        start = time.perf_counter()
        reports.append(example.stepper.step())
        seconds.append(time.perf_counter() - start)
    stages = times.rows()
    frames = len(seconds)
    newton = sum(report.iterations for report in reports)

    def row(case: str, value: float, unit: str, median: float | None = None) -> Row:
        return Row(case, "yasps", threads, value, unit, median)

    rows = [
        row("frame", float(np.mean(seconds)), "s/frame", float(np.median(seconds))),
        row("longest frame", max(seconds), "s"),
        row("Newton iteration", 1e3 * sum(seconds) / newton, "ms"),
        row("Newton iterations", newton / frames, "1/frame"),
        row("CG iterations", sum(report.cg_iterations for report in reports) / newton, "1/Newton iteration"),
        row("contacts", sum(report.contacts for report in reports) / frames, "pairs, mean"),
    ]
    rows += [row(f"stage: {stage.stage}", 1e3 * stage.total_seconds / frames, "ms/frame") for stage in stages]
    rows += [row(f"share: {stage.stage}", stage.share_percent, "%") for stage in stages]
    for body in example.moving:
        rows.append(row(f"height of the {body.name} body", float(body.positions()[:, 2].mean()), "m"))
    return rows
