"""The flags that all scene programs have."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any


class Options(argparse.Namespace):
    """What a program was asked for: the flags of all programs, and its own by their names."""

    frames: int
    """Time steps."""
    dt: float
    """Length of a time step [s]."""
    device: str
    """Of `Scene`."""
    threads: int | None
    """Of `Scene`."""
    mesh: Path | None
    """A file to take instead of the program's own shape."""
    size: Any
    """How large the scene is, in the program's own terms: an int where its default is one, else a float."""
    output: Path
    """Folder for all files."""
    headless: bool
    """No picture and no animation."""
    resume: bool
    """Go on from the last checkpoint in the folder."""
    seed: int
    """0: as designed; else the number of a start that is jittered."""


def add_common(
    parser: argparse.ArgumentParser,
    name: str,
    *,
    frames: int | None,
    time_step: float,
    size: float | None,
    size_means: str,
    mesh_means: str,
) -> None:
    """Adds the flags of all programs; those that this one has no use for are hidden from --help, see `refuse`."""

    def told(text: str, is_used: bool = True) -> str:
        return text if is_used else argparse.SUPPRESS

    steps = frames is not None
    parser.add_argument("--frames", type=int, default=frames, metavar="N", help=told(f"time steps ({frames})", steps))
    parser.add_argument(
        "--dt", type=float, default=time_step, metavar="SECONDS", help=told(f"length of one ({time_step})", steps)
    )
    parser.add_argument("--device", default="cpu", metavar="D", help="cpu (default), cuda, or cuda:N for GPU number N")
    parser.add_argument("--threads", type=int, metavar="N", help="threads of the CPU (default: one a processor)")
    parser.add_argument("--mesh", type=Path, metavar="FILE", help=told(mesh_means, bool(mesh_means)))
    parser.add_argument(
        "--size",
        type=float if isinstance(size, float) else int,
        default=size,
        metavar="N",
        help=told(f"{size_means} ({size})", size is not None),
    )
    parser.add_argument(
        "--output", type=Path, default=Path("output") / name, metavar="FOLDER", help=told(f"output/{name}", steps)
    )
    parser.add_argument("--headless", action="store_true", help=told("no picture and no animation", steps))
    parser.add_argument(
        "--resume", action="store_true", help=told("go on from the last checkpoint in the folder", steps)
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="jitters the start, reproducibly; 0 (default) does not"
    )


def refuse(parser: argparse.ArgumentParser, name: str, options: Options, *, mesh_means: str) -> None:
    """Ends the program by `parser.error` if a flag has a value that can't be, or one that means nothing here."""
    for flag in ("frames", "dt", "output", "headless", "resume"):
        if parser.get_default("frames") is None and getattr(options, flag) != parser.get_default(flag):
            parser.error(f"--{flag}: {name} has no time steps and writes no files")
    if parser.get_default("size") is None and options.size is not None:
        parser.error(f"--size: {name} has one size")
    if not mesh_means and options.mesh is not None:
        parser.error(f"--mesh: {name} makes its shapes itself and takes none from a file")
    if options.frames is not None and options.frames < 0:
        parser.error(f"--frames is a number of time steps, 0 or more, got {options.frames}")
    if not (math.isfinite(options.dt) and options.dt > 0):
        parser.error(f"--dt is the length of a time step in seconds, more than 0, got {options.dt}")
    if options.size is not None and not (math.isfinite(options.size) and options.size > 0):
        parser.error(f"--size is more than 0, got {options.size}")
    if options.seed < 0:
        parser.error(f"--seed is 0 or more, got {options.seed}")
    if options.mesh is not None and not options.mesh.is_file():
        parser.error(f"--mesh: there is no file {options.mesh}")
    for folder in (options.output, *options.output.parents):
        if folder.exists() and not folder.is_dir():
            parser.error(f"--output is a folder, but {folder} is a file")
