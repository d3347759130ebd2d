"""The numbers of a run, for people and for tables."""

from __future__ import annotations

import json
import resource
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from yasps import __version__
from yasps.program.options import Options
from yasps.simulation import Simulation
from yasps.stepping import NewtonReport


@dataclass(frozen=True)
class RunNumbers:
    """What a run took. Iterations and contacts are those of the frames of this run, from
    `first_frame` on; contacts are close pairs at the end
    of a frame."""

    name: str
    version: str
    command: str
    device: str
    threads: int | None
    seed: int
    size: float | None
    mesh: str | None
    time_step: float
    first_frame: int
    frames: int
    vertices: int
    elements: dict[str, int]
    newton_iterations: float
    cg_iterations: float
    contacts_mean: float
    contacts_most: int
    start_up_seconds: float
    seconds_a_frame: float
    memory_mb: float

    def __str__(self) -> str:
        return (
            f"{self.frames} frames: {self.newton_iterations:.3g} Newton and {self.cg_iterations:.4g} CG iterations and"
            f" {self.seconds_a_frame:.3g} s a frame, {self.contacts_mean:.4g} contacts (most {self.contacts_most});"
            f" start-up {self.start_up_seconds:.3g} s, {self.memory_mb:.4g} MB of memory"
        )

    def write(self, file: Path, end: str, *, passed: bool) -> None:
        """Writes them to a JSON file, with what the check said."""
        file.write_text(json.dumps(asdict(self) | {"passed": passed, "end": end}, indent=1) + "\n", encoding="utf-8")


def numbers_of(
    simulation: Simulation,
    reports: Sequence[NewtonReport],
    options: Options,
    *,
    command: str,
    start_up: float,
    running: float,
) -> RunNumbers:
    """Of a run that took these steps. command: how to run it again. start_up, running: seconds until the first step,
    and of all frames with their checks and files."""
    frames = max(len(reports), 1)
    contacts = [report.contacts for report in reports]
    return RunNumbers(
        name=simulation.scene.name,
        version=__version__,
        command=command,
        device=options.device,
        threads=simulation.scene.runtime.threads if options.device == "cpu" else None,
        seed=options.seed,
        size=options.size,
        mesh=None if options.mesh is None else options.mesh.name,
        time_step=options.dt,
        first_frame=simulation.frame - len(reports),
        frames=len(reports),
        vertices=sum(len(body.rest) for body in simulation.moving),
        elements=_elements(simulation),
        newton_iterations=sum(report.iterations for report in reports) / frames,
        cg_iterations=sum(report.cg_iterations for report in reports) / frames,
        contacts_mean=sum(contacts) / frames,
        contacts_most=max(contacts, default=0),
        start_up_seconds=start_up,
        seconds_a_frame=running / frames,
        memory_mb=_peak_memory_mb(),
    )


def size_of(simulation: Simulation) -> str:
    """A line about how large a simulation is."""
    elements = ", ".join(f"{count} {kind}" for kind, count in _elements(simulation).items()) or "no elements"
    vertices = sum(len(body.rest) for body in simulation.moving)
    unknowns = sum(target.value.size for target in simulation.scene.minimize_targets)
    return f"{len(simulation.moving)} bodies that move, {vertices} vertices, {elements}; {unknowns} unknowns"


def _elements(simulation: Simulation) -> dict[str, int]:
    """How many cells of each kind the bodies that move have."""
    counts: dict[str, int] = {}
    for body in simulation.moving:
        for kind, cells in body.cells.items():
            counts[kind] = counts.get(kind, 0) + len(cells)
    return counts


def _peak_memory_mb() -> float:
    """The most memory that the process had [MB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # in KB on Linux, in bytes on macOS
    return peak / (1e6 if sys.platform == "darwin" else 1e3)
