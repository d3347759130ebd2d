"""What each stage costs a vertex, in time and in memory, as meshes grow to a million vertices or tetrahedra.

Each size runs in a process of its own: `python -m benchmarks.scale KIND SIZE THREADS REPEATS STEPS` prints one of them.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.kernel_problem import on_cpu
from benchmarks.measure import Report, Row, Settings
from benchmarks.memory import current_bytes, peak_bytes, reset_peak
from benchmarks.plots import Curves
from yasps import Scene
from yasps.bodies import SoftBody
from yasps.examples import mat_twist
from yasps.frontend.commands.environment_report import cpu_model
from yasps.meshes import box
from yasps.runtime.core.library import available_processors
from yasps.runtime.solvers.options import SolveOptions
from yasps.simulation import Simulation

DESCRIPTION = "time and memory a vertex of each stage, cloths and soft boxes from 10,000 vertices or tets to the size"
DEFAULT_SIZE = 40_000
SMALLEST = 10_000
LARGEST_STEPPED = 40_000
STEPS = 3
ITERATIONS = 20
PRODUCTS = 10
STRUCTURE, ASSEMBLY, PRODUCT, ENERGY = "structure", "evaluation and assembly", "matrix product", "energy"
ITERATION, STEP = "CG iteration", "time step"
FLAT = 20  # %
NOTES = (
    f"--size N: vertices of the largest cloth and tets of the largest box; from {SMALLEST:,} on each is 4 times as "
    "large as the one before. 1,000,000 takes two minutes and 4 GB.",
    "cloth: the example mat_twist, flat, with contact, two pinned rows of vertices, a UNION. box: stable Neo-Hookean "
    "tets with inertia, without contact. All is per vertex, of boxes too.",
    f"time: processor time, the least of some rounds. {STRUCTURE}: sparsity and positions from placement indices, for "
    f"the order of unknowns that the first one has found. {ASSEMBLY}: gradient and projected Hessian of all energies. "
    f"{ITERATION}: a {ITERATIONS}th of so many. {STEP}: mean of {STEPS} whole steps, up to {LARGEST_STEPPED:,}; how "
    "many iterations they take depends on the resolution.",
    "memory: most resident in and after the stage, less what the process had before the scene was built; so each holds "
    "those before it. scene: what the user gave, and compiled code. Nothing of this is freed between stages.",
    f"x: over the smallest size; wanted: within {FLAT} %. A matrix that fits in the last cache is multiplied faster "
    "than one that comes from memory, whatever the code.",
)


@dataclass(frozen=True)
class Sized:
    """One mesh. seconds: of a call of each stage; memory: bytes after each stage."""

    vertices: int
    elements: int
    seconds: dict[str, float]
    memory: dict[str, int]


def cloth(size: int, threads: int) -> Simulation:
    """About so many vertices."""
    flags = ["--size", str(size), "--speed", "20", "--threads", str(threads)]
    return mat_twist.build(mat_twist.PROGRAM.options(flags))


def soft_box(size: int, threads: int) -> Simulation:
    """About so many tets, at least 6."""
    cells = max(1, round((size / 6) ** (1 / 3)))
    scene = Scene("soft_box", threads=threads)
    body = SoftBody(scene, "box", box((1.0, 1.0, 1.0), (cells,) * 3), youngs_modulus=1e5, poisson_ratio=0.4)
    return Simulation(scene, [body], contact=False)


KINDS: Final[dict[str, Callable[[int, int], Simulation]]] = {"cloth": cloth, "box": soft_box}


def sizes_to(largest: int) -> list[int]:
    """Each 4 times the one before, from the smallest on, and the largest at the end."""
    sizes = [min(SMALLEST, largest)]
    while 4 * sizes[-1] < largest:
        sizes.append(4 * sizes[-1])
    return sizes if sizes[-1] == largest else [*sizes, largest]


def measure_here(kind: str, size: int, threads: int, repeats: int, steps: int) -> Sized:
    """In this process, which must not have measured anything before. Raises UnsupportedSystemError."""
    reset_peak()
    before = current_bytes()
    simulation = KINDS[kind](size, threads)
    compiled = on_cpu(simulation.scene.compile())
    compiled.bind()
    memory = {"scene": current_bytes() - before}
    seconds: dict[str, float] = {}

    def timed(stage: str, work: Callable[[], object], calls: int = 1, rounds: int = repeats) -> None:
        samples = []
        reset_peak()
        for _ in range(rounds):
            start = time.process_time()
            for _ in range(calls):
                work()
            samples.append((time.process_time() - start) / calls)
        seconds[stage] = min(samples)
        memory[stage] = peak_bytes() - before

    compiled.update_structure()
    matrix = compiled.static_matrix
    kappas = [compiled.placements[term.symbol].kappas for term in compiled._terms if term.symbol in compiled.placements]
    timed(STRUCTURE, lambda: matrix.build(matrix.boundaries, matrix.block_sizes, kappas, threads, reorder=True))
    gradient = compiled.assemble()
    timed(ASSEMBLY, compiled.assemble)
    x = np.random.default_rng(0).standard_normal(matrix.size)
    timed(PRODUCT, lambda: matrix.multiply(x, threads), PRODUCTS)
    options = SolveOptions(0.0, ITERATIONS, solver="pcg")
    gradient = gradient if gradient.any() else x
    timed(ITERATION, lambda: compiled.solve_linear(gradient, options))
    seconds[ITERATION] /= ITERATIONS
    timed(ENERGY, compiled.total_energy)
    if steps > 0:
        timed(STEP, simulation.step, steps, 1)
    (body,) = simulation.moving
    elements = sum(len(cells) for cells in body.cells.values())
    return Sized(len(body.rest), elements, seconds, memory)


def measure_apart(kind: str, size: int, threads: int, repeats: int, steps: int) -> Sized:
    """In a new process. Raises RuntimeError with what went wrong there."""
    command = [sys.executable, "-m", "benchmarks.scale", kind, *map(str, (size, threads, repeats, steps))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[1])
    if done.returncode != 0:
        raise RuntimeError(f"`{' '.join(command)}` failed:\n{done.stderr}")
    return Sized(**json.loads(done.stdout))


def run(settings: Settings) -> Report:
    """Measures all sizes of both kinds."""
    rows: list[Row] = []
    plots = []
    for kind in KINDS:
        found = []
        for size in sizes_to(settings.size):
            steps = STEPS if size <= LARGEST_STEPPED else 0
            found.append(measure_apart(kind, size, settings.threads, settings.repeats, steps))
        rows += rows_of(kind, settings.threads, found)
        vertices = [one.vertices for one in found]
        stages = [stage for stage in found[0].seconds if stage != STEP]
        time_of = {stage: (vertices, [1e9 * one.seconds[stage] / one.vertices for one in found]) for stage in stages}
        bytes_of = {
            stage: (vertices, [one.memory[stage] / one.vertices for one in found]) for stage in ["scene", *stages]
        }
        title = f"{kind}, {settings.threads} thread{'s' * (settings.threads > 1)}"
        plots.append(Curves(f"scale_{kind}_time", title, "vertices", "ns a vertex", time_of, log_x=True, log=True))
        plots.append(Curves(f"scale_{kind}_memory", title, "vertices", "bytes a vertex", bytes_of, log_x=True))
    about = f"{cpu_model()}, {available_processors()} processors; least of {settings.repeats} rounds."
    return Report(rows, [about, *NOTES], plots)


def rows_of(kind: str, threads: int, found: list[Sized]) -> list[Row]:
    """Stage by stage, size by size."""
    rows = []
    first = found[0]
    for stage in first.seconds:
        for one in found:
            if stage not in one.seconds:
                continue
            case = f"{kind}, {stage}, {one.vertices:,} vertices"
            cost, least = one.seconds[stage] / one.vertices, first.seconds[stage] / first.vertices
            rows.append(Row(case, "yasps", threads, 1e9 * cost, "ns/vertex"))
            if one is not first:
                rows.append(Row(case, "yasps", threads, cost / least, "x"))
    for stage in first.memory:
        for one in found:
            if stage not in one.memory:
                continue
            case = f"{kind}, memory to {stage}, {one.vertices:,} vertices"
            rows.append(Row(case, "yasps", threads, one.memory[stage] / one.vertices, "B/vertex"))
    return rows


def main(arguments: list[str]) -> int:
    """One size, as JSON on the standard output."""
    kind, *numbers = arguments
    size, threads, repeats, steps = map(int, numbers)
    print(json.dumps(asdict(measure_here(kind, size, threads, repeats, steps))))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
