"""`yasps view`, `yasps picture` and `yasps export`: what can be made of a results file."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    Parsers = argparse._SubParsersAction[argparse.ArgumentParser]

OUTPUT: Final = "yasps.output"
"""Imported by name when it is needed: it is part of the kit, which is built on what is here."""
COMMANDS: Final = ("view", "picture", "export")


def add_parsers(commands: Parsers) -> None:
    """Adds the three commands."""
    viewer = _add(commands, "view", "show a results file: in a page for a browser, FILE.html, or in a window")
    viewer.add_argument("--output", type=Path, metavar="PAGE", help="of the page (default: FILE with the ending .html)")
    viewer.add_argument(
        "--megabytes",
        type=float,
        default=20.0,
        help="of the page at most; frames are left out until it fits (default 20)",
    )
    viewer.add_argument("--every", type=int, default=1, metavar="N", help="only every N-th frame")
    viewer.add_argument("--window", action="store_true", help="open a window on this machine instead")
    viewer.add_argument("--field", help="in a window: colour bodies by it, e.g. velocity")

    drawer = _add(commands, "picture", "draw a results file: .png, .jpg of one frame, .mp4, .gif, .webp of the motion")
    drawer.add_argument("output", type=Path, nargs="?", metavar="OUT", help="default: FILE with the ending .png")
    drawer.add_argument("--frame", type=int, default=-1, metavar="N", help="of a picture; from 0, default the last")
    drawer.add_argument("--field", help="colour bodies by it, e.g. velocity")
    drawer.add_argument("--no-forces", action="store_true", help="no arrows for contact forces that are in the file")
    drawer.add_argument("--camera", choices=("whole", "follow"), help="stand still and see all, or go along")
    drawer.add_argument(
        "--direction", type=float, nargs=3, metavar=("X", "Y", "Z"), help="from the scene to the camera"
    )
    drawer.add_argument("--speed", type=float, help="of an animation, in that of the world")
    drawer.add_argument("--fps", type=float, default=30.0, help="frames a second of an animation at most (default 30)")
    drawer.add_argument("--size", type=int, nargs=2, default=(960, 720), metavar=("WIDTH", "HEIGHT"), help="in pixels")

    writer = _add(commands, "export", "write a results file in a format of other programs: USD, glTF, OBJ, PLY, STL")
    writer.add_argument(
        "output",
        type=Path,
        metavar="OUT",
        help=".usd, .usda, .usdc: the motion; .glb: one frame; .obj, .ply, .stl: a file a frame",
    )
    writer.add_argument("--every", type=int, default=1, metavar="N", help="only every N-th frame")
    writer.add_argument("--frame", type=int, metavar="N", help="this one alone; from 0, -1 is the last")


def run(chosen: argparse.Namespace) -> None:
    """Does what one of the commands asks for. Raises YaspsError."""
    output = importlib.import_module(OUTPUT)
    if chosen.command == "view":
        _view(output, chosen)
    elif chosen.command == "picture":
        _picture(output, chosen)
    else:
        files = output.export_series(chosen.file, chosen.output, every=chosen.every, frame=chosen.frame)
        print(f"wrote {files[0]}" if len(files) == 1 else f"wrote {files[0]} to {files[-1].name}", file=sys.stderr)


def _view(output: Any, chosen: argparse.Namespace) -> None:
    if chosen.window:
        output.show_window(chosen.file, field=chosen.field)
        return
    page = output.write_page(
        chosen.file,
        chosen.output or chosen.file.with_suffix(".html"),
        megabytes=chosen.megabytes,
        every=chosen.every,
    )
    print(f"wrote {page.path}, {page.megabytes:.1f} MB, for any browser", file=sys.stderr)
    if len(page.frames) < page.total:
        print(f"it has {len(page.frames)} of {page.total} frames (see --megabytes and --every)", file=sys.stderr)


def _picture(output: Any, chosen: argparse.Namespace) -> None:
    series = output.read_series(chosen.file)
    view = series.view.changed(camera=chosen.camera, direction=chosen.direction, speed=chosen.speed)
    path = chosen.output or chosen.file.with_suffix(".png")
    options = {
        "field": chosen.field,
        "forces": False if chosen.no_forces else None,
        "view": view,
        "size": tuple(chosen.size),
    }
    if path.suffix.lower() in output.PICTURES:
        written = output.make_picture(series, path, frame=chosen.frame, **options)
    else:
        written = output.make_animation(series, path, frames_per_second=chosen.fps, **options)
    print(f"wrote {written}, {written.stat().st_size / 1e6:.2f} MB", file=sys.stderr)


def _add(
    commands: argparse._SubParsersAction[argparse.ArgumentParser], name: str, what: str
) -> argparse.ArgumentParser:
    parser = commands.add_parser(name, help=what, description=what)
    parser.add_argument("file", type=Path, metavar="FILE", help="NAME.vtkhdf that a run wrote")
    return parser
