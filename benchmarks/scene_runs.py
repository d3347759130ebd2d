"""Runs of example scenes, each in a process of its own, so that its memory is its own: what stages, iterations and
memory they took.

`python -m benchmarks.scene_runs SCENE FRAMES [FLAG ...]` prints one run as JSON; flags are those of `yasps run SCENE`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Final

from benchmarks.compile_times import empty_cache, processor_seconds
from benchmarks.memory import current_bytes, peak_bytes, reset_peak
from yasps.output import TimeTable

DIFFERENTIATION: Final = "differentiation and assembly"
SOLVER: Final = "linear solver"
COLLISION: Final = "collision detection"
REST: Final = "everything else"
PARTS: Final[Mapping[str, tuple[str, ...]]] = {
    DIFFERENTIATION: ("derivatives and assembly",),
    SOLVER: ("linear solver",),
    COLLISION: ("contact: active set", "contact: CCD", "contact: look ahead"),
}
"""Stages of `TimeTable` in the parts that the paper times; all others are the rest."""
KINDS: Final[Mapping[str, tuple[str, ...]]] = {
    "point-point": ("point_point", "mollified_point_point"),
    "point-edge": ("point_edge", "mollified_point_edge"),
    "point-triangle": ("point_triangle",),
    "edge-edge": ("edge_edge", "mollified_edge_edge"),
}
"""Kinds of close pairs under the paper's names."""
NOTES: Final = (
    "seconds: processor time of all threads, without compiling, checks and output. "
    + "; ".join(f"{part}: {', '.join(stages)}" for part, stages in PARTS.items())
    + f"; {REST}: energies, positions, first guess, residual forces, Python.",
    "memory: resident, less what the process had before the scene was built (Python and its packages). least: after "
    "the first frame, before anything touches in all of these scenes; most: the kernel's high-water mark at the end.",
)


@dataclass(frozen=True)
class SceneRun:
    """What a run took.

    seconds: of each part, over all frames; pairs: the most close pairs of each kind at the end of any frame, most_pairs
    of all kinds together; memory in bytes; compile: processor seconds, with an empty cache if that was asked for;
    modules: object files and links.
    """

    vertices: int
    frames: int
    newton: int
    cg: int
    seconds: dict[str, float]
    pairs: dict[str, int]
    most_pairs: int
    least_memory: int
    most_memory: int
    compile: float
    modules: int

    @property
    def total(self) -> float:
        """Processor seconds of all frames."""
        return sum(self.seconds.values())


def run_here(scene: str, frames: int, flags: Sequence[str]) -> SceneRun:
    """In this process, which must not have run another scene before if memory matters. Raises ValueError for no
    frames, UnsupportedSystemError where the system tells no memory."""
    if frames < 1:
        raise ValueError(f"a run has one frame or more, got {frames}")
    example = import_module(f"yasps.examples.{scene}")
    reset_peak()
    before = current_bytes()
    simulation = example.build(example.PROGRAM.options(["--headless", *flags]))
    start = processor_seconds()
    modules = simulation.scene.compile_report.modules
    compile_seconds = processor_seconds() - start
    # Compilers ran in processes of their own, but emitting code takes memory here, once.
    reset_peak()
    simulation.stepper.times = times = TimeTable(clock=time.process_time)
    newton = cg = most_pairs = least = 0
    pairs: Counter[str] = Counter()
    for frame in range(frames):
        report = simulation.step()
        newton += report.iterations
        cg += report.cg_iterations
        most_pairs = max(most_pairs, report.contacts)
        if simulation.contact is not None:
            found = {name: len(kind) for name, kind in simulation.contact.active.kinds().items()}
            for name, members in KINDS.items():
                pairs[name] = max(pairs[name], sum(found.get(member, 0) for member in members))
        if frame == 0:
            least = current_bytes() - before
    seconds = dict.fromkeys((*PARTS, REST), 0.0)
    part_of = {stage: part for part, stages in PARTS.items() for stage in stages}
    for row in times.rows():
        seconds[part_of.get(row.stage, REST)] += row.total_seconds
    vertices = sum(len(body.rest) for body in simulation.moving)
    most = peak_bytes() - before
    return SceneRun(
        vertices, frames, newton, cg, seconds, dict(pairs), most_pairs, least, most, compile_seconds, len(modules)
    )


def run_apart(scene: str, frames: int, flags: Sequence[str], *, cold: bool = False) -> SceneRun:
    """In a new process; cold: with an empty cache of compiled code. Raises RuntimeError with what went wrong there."""
    command = [sys.executable, "-m", "benchmarks.scene_runs", scene, str(frames), *flags]
    top = Path(__file__).parents[1]

    def result() -> SceneRun:
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=top)
        if done.returncode != 0:
            raise RuntimeError(f"`{' '.join(command)}` failed:\n{done.stderr}")
        return SceneRun(**json.loads(done.stdout))

    if not cold:
        return result()
    with empty_cache():
        return result()


def main(arguments: Sequence[str]) -> int:
    """One run, as JSON on the standard output."""
    scene, frames, *flags = arguments
    print(json.dumps(asdict(run_here(scene, int(frames), flags))))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
