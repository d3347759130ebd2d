"""Memory that assembly and solution need beyond matrix, vectors and indices, for each tet and each contact pair.

Measured in processes of their own: `python -m benchmarks.memory KIND SIZE THREADS` prints one measurement.
"""

from __future__ import annotations

import ctypes
import gc
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.contact_problem import close_pairs, union_scene
from benchmarks.element_problem import box_of_tets, elements_scene
from benchmarks.measure import Report, Row, Settings
from yasps import Scene
from yasps.runtime.solvers.options import SolveOptions

DESCRIPTION = "peak memory for each tet and contact pair beyond matrix, vectors and indices, bytes"
DEFAULT_SIZE = 200_000
SMALLER = 4  # the second size is so many times smaller
WARM_UP = 15_000  # tets or pairs
NOISE = 0.2  # in cells; some tets need projection
VECTORS = 7  # gradient, solution, and five of the conjugate gradients
STATUS = Path("/proc/self/status")
CLEAR_PEAK = Path("/proc/self/clear_refs")
NOTES = (
    "Slopes between two sizes, each in a process of its own: what does not grow is not in them. The peak is the "
    "kernel's VmHWM, reset once scene and machine code are there, less VmRSS at that time.",
    "indices: kappa and PositionInData. matrix: values, and 8 bytes a block for row and column. vectors: gradient, "
    f"solution and {VECTORS - 2} of the conjugate gradients, and an inverted diagonal block for each vertex.",
    "peak of structure / with assembly / with solution: highest so far after each, in this order. extra: the last less "
    "indices, matrix and vectors; with several threads it holds copies of the gradient and of what they share of the "
    "matrix.",
    "tets: stable Neo-Hookean, a box. contact pairs: point-triangle over free vertices and an affine body.",
)


class UnsupportedSystemError(RuntimeError):
    """This system does not tell a process its peak memory as Linux does."""


@dataclass(frozen=True)
class Measurement:
    """Bytes, but for count."""

    count: int
    indices: int
    matrix: int
    vectors: int
    structure_peak: int
    assembly_peak: int
    solver_peak: int


def tets(size: int, threads: int) -> Scene:
    """A box of tets, deformed."""
    elements = box_of_tets(size)
    made = elements_scene(elements, threads)
    made.position.update_value(elements.deformed(NOISE))
    return made.scene


def contact_pairs(size: int, threads: int) -> Scene:
    """Two sheets of cloth, the upper one an affine body."""
    return union_scene(close_pairs("point_triangle", size), threads)


KINDS: dict[str, Callable[[int, int], Scene]] = {"tet": tets, "pair": contact_pairs}


def measure_here(kind: str, size: int, threads: int) -> Measurement:
    """In this process, which must not have done such a thing before. Raises UnsupportedSystemError."""
    # What is imported or allocated once must not hide in a peak; enough to be reordered, which imports SciPy.
    first = KINDS[kind](WARM_UP, threads).compile()
    first.solve_linear(first.assemble(), SolveOptions(0.0, 3))
    del first
    compiled = KINDS[kind](size, threads).compile()
    compiled.bind()
    reset_peak()
    before = current_bytes()
    compiled.update_structure()
    structure = peak_bytes() - before
    gradient = compiled.assemble()
    assembly = peak_bytes() - before
    # As far as it gets: without inertia the matrix is singular.
    compiled.solve_linear(gradient, SolveOptions(0.0, 3))
    solver = peak_bytes() - before
    (term,) = compiled._terms
    placement = compiled.placements[term.symbol]
    matrix = compiled.static_matrix
    diagonal = int((compiled.static_matrix.block_size_at.astype(int) ** 2).sum()) * 8
    return Measurement(
        term.count,
        placement.kappas.nbytes + placement.positions.nbytes,
        matrix.values.nbytes + 8 * matrix.block_count,
        8 * VECTORS * matrix.size + diagonal,
        structure,
        assembly,
        solver,
    )


def current_bytes() -> int:
    """Resident memory of this process. Raises UnsupportedSystemError."""
    return _status("VmRSS")


def peak_bytes() -> int:
    """The most that was resident since `reset_peak`. Raises UnsupportedSystemError."""
    return _status("VmHWM")


def reset_peak() -> None:
    """Gives freed memory back to the system and lets its high-water mark begin anew. Raises UnsupportedSystemError."""
    gc.collect()
    # Or freed memory would serve what is measured: GNU's C library keeps it.
    library = ctypes.CDLL(None)
    if hasattr(library, "malloc_trim"):
        library.malloc_trim(0)
    try:
        CLEAR_PEAK.write_text("5", encoding="ascii")
    except OSError as error:
        raise UnsupportedSystemError(f"the peak memory cannot be reset here: {error}") from error


def _status(name: str) -> int:
    """Bytes of this entry of the process' status."""
    if not STATUS.exists():
        raise UnsupportedSystemError(f"there is no {STATUS}: this benchmark needs Linux")
    for line in STATUS.read_text(encoding="ascii").splitlines():
        if line.startswith(f"{name}:"):
            return 1024 * int(line.split()[1])
    raise UnsupportedSystemError(f"{STATUS} has no {name}")


def measure_apart(kind: str, size: int, threads: int) -> Measurement:
    """In a new process. Raises UnsupportedSystemError."""
    if not STATUS.exists():
        raise UnsupportedSystemError(f"there is no {STATUS}: this benchmark needs Linux")
    command = [sys.executable, "-m", "benchmarks.memory", kind, str(size), str(threads)]
    top = Path(__file__).parents[1]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=top)
    if result.returncode != 0:
        raise UnsupportedSystemError(f"`{' '.join(command)}` failed:\n{result.stderr}")
    return Measurement(**json.loads(result.stdout))


def run(settings: Settings) -> Report:
    """Measures tets and pairs at two sizes. Raises UnsupportedSystemError."""
    rows: list[Row] = []
    for kind in KINDS:
        for threads in sorted({1, settings.threads}):
            measure_apart(kind, settings.size // SMALLER, threads)  # fills the cache of compiled code
            small = measure_apart(kind, settings.size // SMALLER, threads)
            large = measure_apart(kind, settings.size, threads)
            rows += slopes(kind, threads, small, large)
    sizes = f"about {settings.size // SMALLER:,} and {settings.size:,} tets or pairs"
    return Report(rows, [sizes, *NOTES])


def slopes(kind: str, threads: int, small: Measurement, large: Measurement) -> list[Row]:
    """Bytes for each further tet or pair."""
    more = large.count - small.count
    slope = {name: (value - asdict(small)[name]) / more for name, value in asdict(large).items() if name != "count"}
    extra = slope["solver_peak"] - slope["indices"] - slope["matrix"] - slope["vectors"]
    named = {
        "indices": slope["indices"],
        "matrix": slope["matrix"],
        "vectors": slope["vectors"],
        "peak of structure": slope["structure_peak"],
        "peak with assembly": slope["assembly_peak"],
        "peak with solution": slope["solver_peak"],
        "extra": extra,
    }
    return [Row(f"{kind}: {name}", "yasps", threads, value, f"B/{kind}") for name, value in named.items()]


def main(arguments: list[str]) -> int:
    """One measurement, as JSON on the standard output."""
    kind, size, threads = arguments
    print(json.dumps(asdict(measure_here(kind, int(size), int(threads)))))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
