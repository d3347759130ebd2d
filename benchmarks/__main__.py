"""Command line of the benchmarks: `python -m benchmarks [NAME] [options]`, from the top of the repository."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from benchmarks import (
    assembly,
    cloth,
    codegrowth,
    collision,
    compile_growth,
    compile_times,
    contacts,
    elements,
    friction,
    indices,
    lines_of_code,
    mat_twist,
    memory,
    opcounts,
    paper_compile,
    paper_products,
    paper_projection,
    paper_scenes,
    paper_structure,
    parts,
    projection,
    replicated,
    scale,
    scene_steps,
    solver,
    spmv,
    symbolic,
    unions,
)
from benchmarks.device_derivatives import run_contacts, run_elements
from benchmarks.device_systems import run_assembly, run_solver, run_spmv
from benchmarks.measure import Report, Settings, show, write_json
from benchmarks.on_device import open_gpu
from benchmarks.plots import draw
from yasps import NoDeviceError
from yasps.runtime.build.cuda.nvcc import CudaNotFoundError
from yasps.runtime.core.library import available_processors
from yasps.runtime.device.protocol import Device


@dataclass(frozen=True)
class Benchmark:
    """A benchmark as the command line knows it."""

    description: str
    default_size: int
    run: Callable[[Settings], Report]
    takes_mesh: bool = False


@dataclass(frozen=True)
class OnDevice:
    """What a benchmark does with `--device`; default_size: enough to keep a large GPU busy."""

    default_size: int
    run: Callable[[Settings, Device], Report]


ON_DEVICE = {
    "elements": OnDevice(1_000_000, run_elements),
    "contacts": OnDevice(1_000_000, run_contacts),
    "assembly": OnDevice(1_000_000, run_assembly),
    "spmv": OnDevice(200_000, run_spmv),
    "scene": OnDevice(scene_steps.DEFAULT_SIZE, scene_steps.run_on_device),
    "solver": OnDevice(300_000, run_solver),
}
PLOTS = Path("output/benchmarks")
BENCHMARKS = {
    "elements": Benchmark(elements.DESCRIPTION, elements.DEFAULT_SIZE, elements.run, takes_mesh=True),
    "cloth": Benchmark(cloth.DESCRIPTION, cloth.DEFAULT_SIZE, cloth.run),
    "contacts": Benchmark(contacts.DESCRIPTION, contacts.DEFAULT_SIZE, contacts.run),
    "collision": Benchmark(collision.DESCRIPTION, collision.DEFAULT_SIZE, collision.run),
    "unions": Benchmark(unions.DESCRIPTION, unions.DEFAULT_SIZE, unions.run),
    "parts": Benchmark(parts.DESCRIPTION, parts.DEFAULT_SIZE, parts.run),
    "friction": Benchmark(friction.DESCRIPTION, friction.DEFAULT_SIZE, friction.run),
    "assembly": Benchmark(assembly.DESCRIPTION, assembly.DEFAULT_SIZE, assembly.run, takes_mesh=True),
    "spmv": Benchmark(spmv.DESCRIPTION, spmv.DEFAULT_SIZE, spmv.run, takes_mesh=True),
    "index": Benchmark(indices.DESCRIPTION, indices.DEFAULT_SIZE, indices.run),
    "projection": Benchmark(projection.DESCRIPTION, projection.DEFAULT_SIZE, projection.run),
    "scene": Benchmark(scene_steps.DESCRIPTION, scene_steps.DEFAULT_SIZE, scene_steps.run, takes_mesh=True),
    "mat_twist": Benchmark(mat_twist.DESCRIPTION, mat_twist.DEFAULT_SIZE, mat_twist.run),
    "solver": Benchmark(solver.DESCRIPTION, solver.DEFAULT_SIZE, solver.run),
    "scale": Benchmark(scale.DESCRIPTION, scale.DEFAULT_SIZE, scale.run),
    "memory": Benchmark(memory.DESCRIPTION, memory.DEFAULT_SIZE, memory.run),
    "compile": Benchmark(compile_times.DESCRIPTION, compile_times.DEFAULT_SIZE, compile_times.run),
    "compile_growth": Benchmark(compile_growth.DESCRIPTION, compile_growth.DEFAULT_SIZE, compile_growth.run),
    "opcounts": Benchmark(opcounts.DESCRIPTION, 1, opcounts.run),
    "symbolic": Benchmark(symbolic.DESCRIPTION, 1, symbolic.run),
    "codegrowth": Benchmark(codegrowth.DESCRIPTION, 1, codegrowth.run),
    "loc": Benchmark(lines_of_code.DESCRIPTION, 1, lines_of_code.run),
    "figure_23": Benchmark(paper_projection.DESCRIPTION_23, paper_projection.SIZE_23, paper_projection.run_figure_23),
    "figure_24": Benchmark(paper_projection.DESCRIPTION_24, paper_projection.SIZE_24, paper_projection.run_figure_24),
    "figure_25": Benchmark(replicated.DESCRIPTION, replicated.DEFAULT_SIZE, replicated.run),
    "figure_27": Benchmark(
        paper_structure.DESCRIPTION, paper_structure.DEFAULT_SIZE, paper_structure.run, takes_mesh=True
    ),
    "figure_28": Benchmark(paper_compile.DESCRIPTION, paper_compile.DEFAULT_SIZE, paper_compile.run),
    "figure_30": Benchmark(
        paper_products.DESCRIPTION, paper_products.DEFAULT_SIZE, paper_products.run, takes_mesh=True
    ),
    "table_1": Benchmark(paper_scenes.DESCRIPTION_1, paper_scenes.SIZE_1, paper_scenes.run_table_1, takes_mesh=True),
    "table_2": Benchmark(paper_scenes.DESCRIPTION_2, paper_scenes.SIZE_2, paper_scenes.run_table_2),
    "table_3": Benchmark(paper_scenes.DESCRIPTION_3, paper_scenes.SIZE_3, paper_scenes.run_table_3, takes_mesh=True),
    "table_6": Benchmark(paper_scenes.DESCRIPTION_6, paper_scenes.SIZE_6, paper_scenes.run_table_6, takes_mesh=True),
}


def main(arguments: Sequence[str] | None = None, open_device: Callable[[str], Device] = open_gpu) -> int:
    """Lists the benchmarks, or runs one; returns the exit code. open_device: what `--device` names."""
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
    if options.device == "cpu":
        report = benchmark.run(
            Settings(options.size or benchmark.default_size, options.repeats, options.threads, options.mesh)
        )
    else:
        on_device = ON_DEVICE.get(options.name)
        if on_device is None:
            takers = ", ".join(ON_DEVICE)
            print(f"--device: {options.name} runs on the CPU only; these run on a GPU: {takers}", file=sys.stderr)
            return 2
        try:
            device = open_device(options.device)
        except (NoDeviceError, CudaNotFoundError) as error:
            print(f"--device {options.device}: {error}", file=sys.stderr)
            return 1
        size = options.size or on_device.default_size
        report = on_device.run(Settings(size, options.repeats, options.threads, options.mesh), device)
    show(f"{options.name}: {benchmark.description}", report, console)
    if options.json is not None:
        write_json(options.json, report.rows)
    if report.plots:
        try:
            written = draw(report.plots, options.plots)
        except ImportError as error:
            console.print(f"No pictures: {error}; to have them: pip install matplotlib", markup=False, highlight=False)
        else:
            for path in written:
                console.print(f"picture: {path}", markup=False, highlight=False, soft_wrap=True)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks", description="Without a name: lists the benchmarks.")
    parser.add_argument("name", nargs="?", choices=list(BENCHMARKS), help="which benchmark to run")
    parser.add_argument("--device", type=_device, default="cpu", metavar="D", help="cpu (default), cuda or cuda:N")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file")
    parser.add_argument(
        "--plots",
        type=Path,
        metavar="FOLDER",
        default=PLOTS,
        help=f"where pictures go, if there are any ({PLOTS})",
    )
    parser.add_argument("--mesh", type=Path, metavar="FILE", help="tetrahedral mesh, for benchmarks over one")
    parser.add_argument("--size", type=_positive, metavar="N", help="number of elements, about (see each benchmark)")
    parser.add_argument("--repeats", type=_positive, metavar="R", default=9, help="timed rounds (default: 9)")
    threads = available_processors()
    parser.add_argument(
        "--threads", type=_positive, metavar="T", default=threads, help=f"most threads (default: {threads}, all)"
    )
    return parser


def _device(text: str) -> str:
    if not re.fullmatch(r"cpu|cuda(:\d+)?", text):
        raise argparse.ArgumentTypeError(f"{text!r} is neither cpu, nor cuda, nor cuda:N")
    return text


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive whole number")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
