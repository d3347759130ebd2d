"""What a run shows while it works (frames on stderr) and at its end (a table of where the time went)."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Final, Self, TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from yasps import DataError, YaspsError

Clock = Callable[[], float]

# Where stderr is a file: a line for every tenth of the frames, or every five seconds of a long run.
_SHARE_BETWEEN_LINES: Final = 0.1
_SECONDS_BETWEEN_LINES: Final = 5.0
# In a notebook, from one state of the bar to the next.
_SECONDS_BETWEEN_PICTURES: Final = 0.2


class FrameProgress:
    """Progress over the frames of a run: a live bar on a terminal and in a notebook, a few plain lines elsewhere.

    Args:
        total_frames: how many frames the run has, at least 0.
        title: what stands before the bar.
        stream: where to write; `sys.stderr` if None, so that a program's own output stays clean.
        clock: monotonic seconds; only tests need another one.

    Raises:
        DataError: `total_frames` is negative.
    """

    def __init__(
        self,
        total_frames: int,
        *,
        title: str = "frames",
        stream: TextIO | None = None,
        clock: Clock = time.monotonic,
    ) -> None:
        if total_frames < 0:
            raise DataError(f"total_frames is {total_frames}, but must be 0 or more.")
        self.total_frames = total_frames
        self.title = title
        self._stream = sys.stderr if stream is None else stream
        self._clock = clock
        self._last_line_frame = 0
        self._last_line_time = clock()
        self._bar: Progress | None = None
        self._shown: Any = None
        """In a notebook: what the bar is shown by."""
        in_notebook = stream is None and Console().is_jupyter
        if in_notebook or self._stream.isatty():
            self._bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
                TextColumn("{task.fields[numbers]}"),
                console=None if in_notebook else Console(file=self._stream),
            )
            self._task = self._bar.add_task(title, total=total_frames, numbers="")
        if in_notebook:
            from IPython.display import display

            show: Any = display
            self._shown = show(self._bar, display_id=True)  # rich's own live bar needs ipywidgets

    def update(
        self,
        *,
        frame: int,
        newton_iterations: int,
        cg_iterations: int,
        contacts: int,
        milliseconds: float,
    ) -> None:
        """Reports that `frame` frames (counted from 1) are done, with the numbers of the last one."""
        numbers = f"{newton_iterations} Newton, {cg_iterations} CG, {contacts} contacts, {milliseconds:.0f} ms"
        if self._bar is not None:
            self._bar.update(self._task, completed=frame, numbers=numbers)
            is_due = self._clock() - self._last_line_time >= _SECONDS_BETWEEN_PICTURES or frame >= self.total_frames
            if self._shown is not None and is_due:
                self._shown.update(self._bar)
                self._last_line_time = self._clock()
            return
        now = self._clock()
        if (
            frame - self._last_line_frame >= _SHARE_BETWEEN_LINES * self.total_frames
            or now - self._last_line_time >= _SECONDS_BETWEEN_LINES
            or (frame >= self.total_frames and frame != self._last_line_frame)
        ):
            print(f"{self.title} {frame}/{self.total_frames}: {numbers}", file=self._stream, flush=True)
            self._last_line_frame = frame
            self._last_line_time = now

    def __enter__(self) -> Self:
        if self._bar is not None and self._shown is None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None and self._shown is None:
            self._bar.stop()


class TimeTableError(YaspsError):
    """A stage of a `TimeTable` that can't be named so."""


@dataclass(frozen=True)
class TimeRow:
    """The time of one stage, without the stages inside it."""

    stage: str
    calls: int
    total_seconds: float
    share_percent: float

    @property
    def mean_milliseconds(self) -> float:
        """Mean time of a call; 0 for a row without calls ("other")."""
        return 1e3 * self.total_seconds / self.calls if self.calls else 0.0


class TimeTable:
    """Adds up the wall time of named stages.

    Time belongs to the innermost stage that runs, so nested stages are not counted twice and the rows, with
    the row "other" for the time in no stage, add up to the wall time since the table was made. For one
    thread.

    Args:
        clock: monotonic seconds; only tests need another one.
    """

    OTHER: Final = "other"

    def __init__(self, *, clock: Clock = time.perf_counter) -> None:
        self._clock = clock
        self._running: list[str] = []
        self._seconds: dict[str, float] = {}
        self._calls: dict[str, int] = {}
        self._seconds_other = 0.0
        self._charged_until = clock()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts the time of the `with` block for the stage `name`.

        Raises:
            TimeTableError: the name is empty or "other".
        """
        if not name or name == self.OTHER:
            raise TimeTableError(f"A stage can't be named '{name}': '{self.OTHER}' is the time outside all stages.")
        self._charge()
        self._seconds.setdefault(name, 0.0)
        self._calls[name] = self._calls.get(name, 0) + 1
        self._running.append(name)
        try:
            yield
        finally:
            self._charge()
            self._running.pop()

    def rows(self) -> list[TimeRow]:
        """The stages in the order of their first call, then "other"; running stages count up to now."""
        self._charge()
        wall = sum(self._seconds.values()) + self._seconds_other
        stages = [(name, self._calls[name], seconds) for name, seconds in self._seconds.items()]
        return [
            TimeRow(name, calls, seconds, 100 * seconds / wall if wall > 0 else 0.0)
            for name, calls, seconds in [*stages, (self.OTHER, 0, self._seconds_other)]
        ]

    def print(self, *, title: str = "time", stream: TextIO | None = None) -> None:
        """Prints the rows as a table to `stream` (stderr if None)."""
        table = Table(title=title)
        table.add_column("stage")
        for heading in ("calls", "total s", "share %", "mean ms"):
            table.add_column(heading, justify="right")
        rows = self.rows()
        for row in rows:
            last = row.stage == self.OTHER
            table.add_row(
                row.stage,
                "" if last else str(row.calls),
                f"{row.total_seconds:.3f}",
                f"{row.share_percent:.1f}",
                "" if last else f"{row.mean_milliseconds:.3f}",
                end_section=last,
            )
        table.add_row("wall time", "", f"{sum(row.total_seconds for row in rows):.3f}", "100.0", "")
        Console(file=sys.stderr if stream is None else stream).print(table)

    def _charge(self) -> None:
        """Gives the time since the last change of stage to the stage that ran."""
        now = self._clock()
        elapsed, self._charged_until = now - self._charged_until, now
        if self._running:
            self._seconds[self._running[-1]] += elapsed
        else:
            self._seconds_other += elapsed
