"""The example mat_twist at three sizes: what each stage of a step costs a vertex."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import Report, Row, Settings
from yasps.contact import CollisionGeometry
from yasps.examples import mat_twist
from yasps.frontend.commands.environment_report import cpu_model
from yasps.output import TimeTable
from yasps.runtime.core.library import available_processors
from yasps.stepping import NewtonReport

DESCRIPTION = "mat_twist at one, four and 25 times as many vertices: what each stage of a step costs a vertex"
DEFAULT_SIZE = 2_500
TIMES_AS_MANY = (1, 4, 25)
SPEED = 20.0  # rad/s of each end: the mat meets itself in about the 60th frame
FRAMES_PER_ROUND = 2
Positions = NDArray[np.float64]
Found = TypeVar("Found")
SOLVER = "linear solver"
NOTES = (
    "--size N: vertices of the smallest mat; 10,000 makes three rows of the paper's table 2, of 10,000, 40,000 and "
    f"250,000. --repeats R: the first {FRAMES_PER_ROUND} R frames; from about the 60th on the mat meets itself.",
    "apart: frames without contacts; touching: the others. us/vertex: processor time (of all threads) of a call of the "
    "stage, mean; of the linear solver of an iteration of conjugate gradients; `other` is what is in no stage, of a "
    "Newton iteration. x: that over the smallest mat's.",
    "contact: CCD has the search for candidates in it only where earlier ones do not serve any more, and that is more "
    "often on finer mats, whose activation distance is smaller. `of a whole step`: each of its parts alone, on the "
    "way from the beginning of the step to its end.",
)


@dataclass
class Phase:
    """What some frames of one mat took; seconds of the processor, and calls, by stage."""

    vertices: int
    frames: int = 0
    newton: int = 0
    cg: int = 0
    contacts: int = 0
    seconds: Counter[str] = field(default_factory=Counter)
    calls: Counter[str] = field(default_factory=Counter)

    def add(self, report: NewtonReport, times: TimeTable) -> None:
        """Counts one more frame."""
        self.frames += 1
        self.newton += report.iterations
        self.cg += report.cg_iterations
        self.contacts += report.contacts
        for row in times.rows():
            self.seconds[row.stage] += row.total_seconds
            self.calls[row.stage] += row.calls
        self.calls[SOLVER], self.calls[TimeTable.OTHER] = self.cg, self.newton

    def add_searches(self, geometry: CollisionGeometry, start: Positions, end: Positions) -> None:
        """Times the parts of collision detection on the way of a step."""

        def timed(part: str, work: Callable[[], Found]) -> Found:
            begin = time.process_time()
            found = work()
            stage = f"{part} of a whole step"
            self.seconds[stage] += time.process_time() - begin
            self.calls[stage] += 1
            return found

        candidates = timed("candidates", lambda: geometry.candidates(start, end))
        timed("step bound", lambda: geometry.step_bound(start, end, candidates))

    def cost(self, stage: str) -> float:
        """Of a call [us/vertex]."""
        return 1e6 * self.seconds[stage] / self.calls[stage] / self.vertices


def run(settings: Settings) -> Report:
    """Twists each mat."""
    phases: dict[str, list[Phase]] = {"apart": [], "touching": []}
    for times_as_many in TIMES_AS_MANY:
        for name, phase in twist(settings, times_as_many * settings.size).items():
            if phase.frames:
                phases[name].append(phase)
    rows = [row for name, found in phases.items() for row in _rows_of(name, found, settings.threads)]
    frames = FRAMES_PER_ROUND * settings.repeats
    about = f"{frames} frames of 1 ms, {SPEED:g} rad/s; {cpu_model()}, {available_processors()} processors."
    return Report(rows, [about, *NOTES])


def twist(settings: Settings, size: int) -> dict[str, Phase]:
    """The frames of a mat of about so many vertices."""
    options = mat_twist.PROGRAM.options(
        ["--size", str(size), "--speed", str(SPEED), "--threads", str(settings.threads)]
    )
    simulation = mat_twist.build(options)
    simulation.scene.compile()
    vertices = len(simulation.moving[0].rest)
    phases = {"apart": Phase(vertices), "touching": Phase(vertices)}
    contact = simulation.contact
    assert contact is not None
    for _ in range(FRAMES_PER_ROUND * settings.repeats):
        start = contact.positions()
        simulation.stepper.times = times = TimeTable(clock=time.process_time)
        report = simulation.step()
        phase = phases["touching" if report.contacts else "apart"]
        phase.add(report, times)
        phase.add_searches(contact.geometry, start, contact.positions())
    return phases


def _rows_of(name: str, phases: list[Phase], threads: int) -> list[Row]:
    rows = []
    for phase in phases:
        case, vertices = f"{name}, {phase.vertices:,} vertices", phase.vertices
        rows += [
            Row(f"{case}: frames", "yasps", threads, phase.frames, ""),
            Row(f"{case}: Newton iterations", "yasps", threads, phase.newton / phase.frames, "1/frame"),
            Row(f"{case}: CG iterations", "yasps", threads, phase.cg / phase.newton, "1/Newton iteration"),
            Row(f"{case}: contacts", "yasps", threads, phase.contacts / phase.frames / vertices, "1/vertex"),
        ]
    for stage in phases[0].seconds if phases else ():
        for phase in phases:
            case = f"{name}, {stage}, {phase.vertices:,} vertices"
            rows.append(Row(case, "yasps", threads, phase.cost(stage), "us/vertex"))
            if phase is not phases[0]:
                rows.append(Row(case, "yasps", threads, phase.cost(stage) / phases[0].cost(stage), "x"))
    return rows
