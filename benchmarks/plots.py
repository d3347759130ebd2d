"""Pictures of what benchmarks found, as PNG files: bars and curves. matplotlib draws them; it need not be installed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

INCHES = (7.0, 3.9)
DOTS_PER_INCH = 100
MOST_LEVEL_LABELS = 4
"""More labels than this under bars would run into each other, and so are turned."""


@dataclass(frozen=True)
class Bars:
    """Groups of bars, or bars on top of each other.

    name: of the file, without its ending; labels: one for each group; series: for each colour a value at each label,
    NaN where there is none.
    """

    name: str
    title: str
    unit: str
    labels: Sequence[str]
    series: Mapping[str, Sequence[float]]
    stacked: bool = False
    log: bool = False

    def __post_init__(self) -> None:
        """Raises ValueError unless every series has a value for each label."""
        for name, values in self.series.items():
            if len(values) != len(self.labels):
                raise ValueError(f"{self.name}: {name} has {len(values)} values for {len(self.labels)} labels")

    def draw(self, axes: Any) -> None:
        """On matplotlib's axes."""
        places = np.arange(len(self.labels))
        width = 0.8 if self.stacked else 0.8 / len(self.series)
        below = np.zeros(len(self.labels))
        for k, (name, values) in enumerate(self.series.items()):
            heights = np.asarray(values, float)
            if self.stacked:
                axes.bar(places, np.nan_to_num(heights), width, bottom=below, label=name)
                below += np.nan_to_num(heights)
            else:
                axes.bar(places + (k - 0.5 * (len(self.series) - 1)) * width, heights, width, label=name)
        if len(self.labels) <= MOST_LEVEL_LABELS:
            axes.set_xticks(places, self.labels)
        else:
            axes.set_xticks(places, self.labels, rotation=40, ha="right", fontsize="small")
        axes.set_ylabel(self.unit)
        if self.log:
            axes.set_yscale("log")


@dataclass(frozen=True)
class Curves:
    """Curves through points. name: of the file, without its ending; series: abscissas and ordinates of each curve."""

    name: str
    title: str
    x_unit: str
    unit: str
    series: Mapping[str, tuple[Sequence[float], Sequence[float]]]
    log_x: bool = field(default=False, kw_only=True)
    log: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        """Raises ValueError unless every curve has as many abscissas as ordinates."""
        for name, (x, y) in self.series.items():
            if len(x) != len(y):
                raise ValueError(f"{self.name}: {name} has {len(x)} abscissas and {len(y)} ordinates")

    def draw(self, axes: Any) -> None:
        """On matplotlib's axes."""
        for name, (x, y) in self.series.items():
            axes.plot(x, y, marker="o", markersize=4, label=name)
        axes.set_xlabel(self.x_unit)
        axes.set_ylabel(self.unit)
        if self.log_x:
            axes.set_xscale("log")
        if self.log:
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0.0)


Plot = Bars | Curves


def draw(plots: Sequence[Plot], folder: Path) -> list[Path]:
    """Writes NAME.png for each into the folder, which is made. Raises ImportError where matplotlib is not installed."""
    # Without pyplot, which keeps figures for the whole process and looks for a display.
    figure_class: Any = import_module("matplotlib.figure").Figure
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for plot in plots:
        figure = figure_class(figsize=INCHES, dpi=DOTS_PER_INCH, layout="constrained")
        axes = figure.subplots()
        plot.draw(axes)
        axes.set_title(plot.title, fontsize="medium")
        axes.grid(axis="y", alpha=0.3)
        axes.legend(fontsize="small")
        path = folder / f"{plot.name}.png"
        figure.savefig(path)
        written.append(path)
    return written
