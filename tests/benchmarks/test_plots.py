"""Pictures of benchmarks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import plots
from benchmarks.plots import Bars, Curves, draw


def test_pictures_are_drawn_into_a_new_folder(tmp_path: Path) -> None:
    bars = Bars("bars", "Bars", "s", ["a", "b"], {"one": [1.0, 2.0], "other": [np.nan, 3.0]}, stacked=True)
    curves = Curves("curves", "Curves", "vertices", "s", {"one": ([1, 10], [2.0, 3.0])}, log_x=True, log=True)
    written = draw([bars, curves], tmp_path / "new" / "folder")
    assert [path.name for path in written] == ["bars.png", "curves.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written)


def test_other_groups_of_bars_stand_side_by_side() -> None:
    class Axes:
        def __init__(self) -> None:
            self.drawn: list[tuple[list[float], float]] = []

        def bar(self, places: np.ndarray, heights: np.ndarray, width: float, **_: object) -> None:
            self.drawn.append((places.tolist(), width))

        def __getattr__(self, name: str) -> object:
            return lambda *_: None

    axes = Axes()
    Bars("bars", "Bars", "s", ["a", "b"], {"one": [1.0, 2.0], "other": [2.0, 3.0]}).draw(axes)
    assert axes.drawn == [([-0.2, 0.8], 0.4), ([0.2, 1.2], 0.4)]


def test_numbers_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="bars: one has 1 values for 2 labels"):
        Bars("bars", "Bars", "s", ["a", "b"], {"one": [1.0]})
    with pytest.raises(ValueError, match="curves: one has 2 abscissas and 1 ordinates"):
        Curves("curves", "Curves", "x", "s", {"one": ([1, 2], [1.0])})


def test_without_matplotlib_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str) -> object:
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(plots, "import_module", nothing)
    with pytest.raises(ImportError, match=r"matplotlib\.figure"):
        draw([], tmp_path)
