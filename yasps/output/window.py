"""A results file in a window that the mouse turns, with pyvista."""

from __future__ import annotations

import os
import sys
from typing import Any, Final

from yasps.output.motion_pictures import MotionPictures
from yasps.output.picture_errors import PicturesUnavailable, quiet, require_packages
from yasps.output.series import Series, read_series

_TICK: Final = 30
"""Between two looks at the clock while it plays [ms]."""
_LONG: Final = 10**8
"""Ticks of a timer that goes on."""


def show_window(file: str | os.PathLike[str] | Series, *, field: str | None = None) -> None:
    """Opens a window and returns when it is closed. A slider chooses the frame, the space bar plays and pauses, the
    mouse turns, shifts and zooms.

    Args:
        file: that a `FrameRecorder` wrote, or a series that is open.
        field: of the file, by whose size bodies are coloured.

    Raises:
        OutputFileError, PictureError: as `make_picture`.
        PicturesUnavailable: there is no display, or pyvista is not installed.
    """
    series = file if isinstance(file, Series) else read_series(file)
    require_packages()
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise PicturesUnavailable(
            "No window: this machine has no display (neither DISPLAY nor WAYLAND_DISPLAY is set). `yasps view "
            f"{series.path}` without --window writes a page for a browser, which may be on another machine."
        )
    with MotionPictures(series, list(range(len(series))), field=field, window=True) as pictures:
        Player(series, pictures).show()


class Player:
    """A slider and a clock for pictures in a window."""

    def __init__(self, series: Series, pictures: MotionPictures) -> None:
        self._series, self._pictures = series, pictures
        self._plotter: Any = pictures.frames.plotter
        self._frame = -1
        self._playing = False
        self._clock = 0.0
        self._slider: Any = None
        if len(series) > 1:
            self._slider = self._plotter.add_slider_widget(
                lambda value: self.show_frame(round(value)),
                [0, len(series) - 1],
                value=0,
                title="frame",
                fmt="%.0f",
                pointa=(0.2, 0.08),
                pointb=(0.8, 0.08),
                style="modern",
            )
            self._plotter.add_key_event("space", self.toggle)
            self._plotter.add_timer_event(_LONG, _TICK, self.tick)
        self.show_frame(0)

    @property
    def frame(self) -> int:
        """The one that is shown."""
        return self._frame

    def show(self) -> None:
        """Shows the window until it is closed."""
        with quiet():
            self._plotter.show(title=self._series.name)

    def show_frame(self, frame: int) -> None:
        """Draws a frame, if it is not there yet."""
        if frame == self._frame:
            return
        self._frame = frame
        self._pictures.move(frame)
        self._plotter.add_text(f"{self._series.times[frame]:.3f} s", name="time", font_size=10, color="#30343c")
        if self._slider is not None:
            self._slider.GetRepresentation().SetValue(frame)

    def toggle(self) -> None:
        """Plays or pauses; at the end it begins anew."""
        self._playing = not self._playing
        times = self._series.times
        self._clock = float(times[0] if self._frame == len(times) - 1 else times[self._frame])

    def tick(self, _: int) -> None:
        """Time goes on by a tick."""
        if not self._playing:
            return
        self._clock += 1e-3 * _TICK * self._series.view.speed
        self.show_frame(self._series.nearest_frame(self._clock))
        if self._frame == len(self._series) - 1:
            self._playing = False
        self._plotter.render()
