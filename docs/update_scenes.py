"""Writes the table of docs/scenes.md anew: `python docs/update_scenes.py [RUN.json ...]`.

Every run of a scene leaves OUTPUT/NAME.json. Those that are named are taken into docs/scenes/, one for each command,
instead of an earlier one; the table has a line for each file there.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

DOCUMENT = Path(__file__).with_name("scenes.md")
RUNS = Path(__file__).with_name("scenes")
BEGIN, END = "<!-- written by docs/update_scenes.py -->\n", "<!-- end -->\n"
COLUMNS = (
    "run",
    "vertices",
    "elements",
    "frames",
    "contacts, mean (most)",
    "Newton a frame",
    "CG a frame",
    "s a frame",
    "threads",
    "MB",
    "what was reached",
)
HEAD = f"| {' | '.join(COLUMNS)} |\n|{'---|' + '---:|' * (len(COLUMNS) - 2) + '---|'}\n"


class RunFileError(Exception):
    """A file that no scene has written, or one of a run that failed its check."""


def read_run(file: Path) -> dict[str, Any]:
    """The numbers of a run. Raises RunFileError."""
    try:
        run: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        line_of(run)
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise RunFileError(f"{file} is not what a scene writes: {problem!r}") from problem
    if not run["passed"]:
        raise RunFileError(f"{file} is of a run that failed its check: {run['end']}")
    return run


def line_of(run: dict[str, Any]) -> str:
    """Its line in the table."""
    kinds = {kind: count for kind, count in run["elements"].items() if kind != "vertex"}
    first, last = run["first_frame"], run["first_frame"] + run["frames"]
    cells = [
        f"`{run['command']}`",
        f"{run['vertices']:,}",
        ", ".join(f"{count:,} {kind}" for kind, count in kinds.items()),
        f"{first + 1} to {last}" if first else str(last),
        f"{run['contacts_mean']:,.0f} ({run['contacts_most']:,})",
        f"{run['newton_iterations']:.1f}",
        f"{run['cg_iterations']:,.0f}" if run["cg_iterations"] else "direct",
        f"{run['seconds_a_frame']:.3g}",
        str(run["threads"]),
        f"{run['memory_mb']:,.0f}",
        run["end"],
    ]
    return f"| {' | '.join(cells)} |\n"


def updated(text: str, runs: list[dict[str, Any]]) -> str:
    """The document with a table of these runs."""
    before, after = text.index(BEGIN) + len(BEGIN), text.index(END)
    lines = [line_of(run) for run in sorted(runs, key=lambda run: (run["name"], run["vertices"]))]
    return text[:before] + HEAD + "".join(lines) + text[after:]


def name_of(run: dict[str, Any]) -> str:
    """Of its file in docs/scenes."""
    words = re.findall(r"[A-Za-z0-9_.]+", run["command"].removeprefix("yasps run "))
    return f"{'-'.join(words)}.json"


def main(files: list[str]) -> int:
    """Takes in the files and writes the table."""
    try:
        new = [read_run(Path(file)) for file in files]
        RUNS.mkdir(exist_ok=True)
        for run in new:
            (RUNS / name_of(run)).write_text(json.dumps(run, indent=1) + "\n", encoding="utf-8")
        runs = [read_run(file) for file in sorted(RUNS.glob("*.json"))]
    except RunFileError as error:
        print(error, file=sys.stderr)
        return 1
    DOCUMENT.write_text(updated(DOCUMENT.read_text(encoding="utf-8"), runs), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
