"""Command line of the benchmarks: `python -m benchmarks [NAME] [options]`, from the top of the repository."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from benchmarks import (
    assembly,
    cloth,
    codegrowth,
    compile_times,
    contacts,
    elements,
    indices,
    memory,
    opcounts,
    projection,
    scene_steps,
    solver,
    spmv,
    symbolic,
)
from benchmarks.measure import Report, Settings, show, write_json
from yasps.runtime.library import available_processors


@dataclass(frozen=True)
class Benchmark:
    """A benchmark as the command line knows it."""

    description: str
    default_size: int
    run: Callable[[Settings], Report]
    takes_mesh: bool = False


BENCHMARKS = {
    "elements": Benchmark(elements.DESCRIPTION, elements.DEFAULT_SIZE, elements.run, takes_mesh=True),
    "cloth": Benchmark(cloth.DESCRIPTION, cloth.DEFAULT_SIZE, cloth.run),
    "contacts": Benchmark(contacts.DESCRIPTION, contacts.DEFAULT_SIZE, contacts.run),
    "assembly": Benchmark(assembly.DESCRIPTION, assembly.DEFAULT_SIZE, assembly.run, takes_mesh=True),
    "spmv": Benchmark(spmv.DESCRIPTION, spmv.DEFAULT_SIZE, spmv.run, takes_mesh=True),
    "index": Benchmark(indices.DESCRIPTION, indices.DEFAULT_SIZE, indices.run),
    "projection": Benchmark(projection.DESCRIPTION, projection.DEFAULT_SIZE, projection.run),
    "scene": Benchmark(scene_steps.DESCRIPTION, scene_steps.DEFAULT_SIZE, scene_steps.run, takes_mesh=True),
    "solver": Benchmark(solver.DESCRIPTION, solver.DEFAULT_SIZE, solver.run),
    "memory": Benchmark(memory.DESCRIPTION, memory.DEFAULT_SIZE, memory.run),
    "compile": Benchmark(compile_times.DESCRIPTION, compile_times.DEFAULT_SIZE, compile_times.run),
    "opcounts": Benchmark(opcounts.DESCRIPTION, 1, opcounts.run),
    "symbolic": Benchmark(symbolic.DESCRIPTION, 1, symbolic.run),
    "codegrowth": Benchmark(codegrowth.DESCRIPTION, 1, codegrowth.run),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Lists the benchmarks, or runs one; returns the exit code."""
    options = _parser().parse_args(arguments)
    # Rows are as wide as they need to be: a table written to a file must not be cut.
    console = Console(width=None if sys.stdout.isatty() else 140)
    if options.name is None:
        for name, benchmark in BENCHMARKS.items():
            console.print(f"{name}: {benchmark.description}", markup=False, highlight=False, soft_wrap=True)
        return 0
    if options.json is not None and not options.json.absolute().parent.is_dir():
        print(f"--json {options.json}: there is no folder {options.json.absolute().parent}", file=sys.stderr)
        return 2
    if options.mesh is not None and not options.mesh.is_file():
        print(f"--mesh {options.mesh}: there is no such file", file=sys.stderr)
        return 2
    benchmark = BENCHMARKS[options.name]
    if options.mesh is not None and not benchmark.takes_mesh:
        takers = ", ".join(name for name, one in BENCHMARKS.items() if one.takes_mesh)
        print(f"--mesh: {options.name} is not over a mesh of yours; these are: {takers}", file=sys.stderr)
        return 2
    settings = Settings(options.size or benchmark.default_size, options.repeats, options.threads, options.mesh)
    report = benchmark.run(settings)
    show(f"{options.name}: {benchmark.description}", report, console)
    if options.json is not None:
        write_json(options.json, report.rows)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks", description="Without a name: lists the benchmarks.")
    parser.add_argument("name", nargs="?", choices=list(BENCHMARKS), help="which benchmark to run")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file")
    parser.add_argument("--mesh", type=Path, metavar="FILE", help="tetrahedral mesh, for benchmarks over one")
    parser.add_argument("--size", type=_positive, metavar="N", help="number of elements, about (see each benchmark)")
    parser.add_argument("--repeats", type=_positive, metavar="R", default=9, help="timed rounds (default: 9)")
    threads = available_processors()
    parser.add_argument(
        "--threads", type=_positive, metavar="T", default=threads, help=f"most threads (default: {threads}, all)"
    )
    return parser


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive whole number")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
