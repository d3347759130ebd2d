"""Many steps in a row, with progress shown."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol

from yasps import SceneError
from yasps.frontend.language.arrays import checked_count
from yasps.output import FrameProgress
from yasps.stepping import NewtonReport

if TYPE_CHECKING:
    from yasps.simulation.checkpoints import Checkpoints
    from yasps.simulation.simulation import Simulation


class Recorder(Protocol):
    """What `run` shows every frame to."""

    def record(self, simulation: Simulation) -> None:
        """Notes the state as it is now."""


def run_frames(
    simulation: Simulation, frames: int, recorder: Recorder | None, checkpoints: Checkpoints | None
) -> list[NewtonReport]:
    """See `Simulation.run`."""
    frames = checked_count(frames, "frames", 0, SceneError)
    reports = []
    with simulation.times.stage("output"):
        if recorder is not None and simulation.frame == 0:
            recorder.record(simulation)
        if checkpoints is not None:
            checkpoints.save(simulation)
    with FrameProgress(frames) as progress:
        for frame in range(1, frames + 1):
            begin = time.perf_counter()
            report = simulation.step()
            seconds = time.perf_counter() - begin
            simulation.check_intersection_free()
            with simulation.times.stage("output"):
                if recorder is not None:
                    recorder.record(simulation)
                if checkpoints is not None:
                    checkpoints.save_if_due(simulation)
            reports.append(report)
            progress.update(
                frame=frame,
                newton_iterations=report.iterations,
                cg_iterations=report.cg_iterations,
                contacts=report.contacts,
                milliseconds=1e3 * seconds,
            )
    if checkpoints is not None:
        with simulation.times.stage("output"):
            checkpoints.save(simulation)
    return reports
