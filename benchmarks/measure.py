"""What all benchmarks share: rows, timing of peers in turn, the printed table and the JSON file."""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.plots import Plot


@dataclass(frozen=True)
class Settings:
    """What the command line asks of a benchmark.

    size: what each benchmark says it is (elements, about, for most); repeats: timed rounds; threads: the most threads
    that yasps uses; mesh: a tetrahedral mesh file instead of the mesh the benchmark makes itself.
    """

    size: int
    repeats: int
    threads: int
    mesh: Path | None = None


@dataclass(frozen=True)
class Row:
    """One figure. For a timing `value` is the least of all rounds, and the table shows the median beside it."""

    case: str
    implementation: str
    threads: int
    value: float
    unit: str
    median: float | None = None


@dataclass(frozen=True)
class Report:
    """What a benchmark found, what a reader must know to read it, and pictures of it."""

    rows: list[Row]
    notes: list[str]
    plots: Sequence[Plot] = ()


@dataclass(frozen=True)
class Peer:
    """A piece of work to time: `run` does it once, and seconds * `scale` are in `unit`."""

    case: str
    implementation: str
    threads: int
    run: Callable[[], object]
    scale: float
    unit: str


def measure(peers: Sequence[Peer], repeats: int, clock: Callable[[], float] = time.perf_counter) -> list[Row]:
    """Times all peers in turn, `repeats` times over, after one run of each to warm up.

    Taking turns spreads what else the machine does over all of them, so that ratios hold where times do not.
    """
    for peer in peers:
        peer.run()
    seconds: list[list[float]] = [[] for _ in peers]
    for _ in range(repeats):
        for peer, samples in zip(peers, seconds, strict=True):
            start = clock()
            peer.run()
            samples.append(clock() - start)
    return [
        Row(
            peer.case,
            peer.implementation,
            peer.threads,
            min(samples) * peer.scale,
            peer.unit,
            statistics.median(samples) * peer.scale,
        )
        for peer, samples in zip(peers, seconds, strict=True)
    ]


def show(title: str, report: Report, console: Console) -> None:
    """Prints the rows as a table, and the notes below it."""
    table = Table("case", "implementation", title=title, title_justify="left")
    for heading in ("threads", "minimum", "median"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    for row in report.rows:
        median = "" if row.median is None else _rounded(row.median)
        table.add_row(row.case, row.implementation, str(row.threads), _rounded(row.value), median, row.unit)
    console.print(table)
    for note in report.notes:
        console.print(f"- {note}", markup=False, highlight=False)


def write_json(path: Path, rows: Sequence[Row]) -> None:
    """Writes a list of objects with the keys case, implementation, threads, value (the minimum) and unit."""
    keys = ("case", "implementation", "threads", "value", "unit")
    text = json.dumps([{key: getattr(row, key) for key in keys} for row in rows], indent=1)
    path.write_text(text + "\n", encoding="utf-8")


def _rounded(value: float) -> str:
    """Three digits are what a timing is good for."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
