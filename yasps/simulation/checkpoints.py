"""States that a run writes as it goes, so that one that was ended, in whatever way, goes on near where it was."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import TYPE_CHECKING

from yasps import SceneError
from yasps.frontend.language.arrays import checked_count, positive_number
from yasps.simulation.state_files import DamagedStateError

if TYPE_CHECKING:
    from yasps.simulation.simulation import Simulation

LOGGER = logging.getLogger("yasps")

MOST_SHARE = 0.05
"""Most of the time that goes into writing states, where frames are short."""


class Checkpoints:
    """The last two states of a run, FOLDER/NAME.checkpoint.npz and, one earlier, FOLDER/NAME.earlier-checkpoint.npz.

    every: after how many frames a state is written; by default, after the first frame that ends `seconds` or more after
    the last one was written, and so seldom that it costs at most 5 % of the time. A run also writes one at its start
    and at its end.
    """

    def __init__(self, folder: str | Path, name: str, *, every: int | None = None, seconds: float = 10.0) -> None:
        """Writes nothing yet; the folder is made when something is. Raises SceneError."""
        self.folder = Path(folder)
        self.file, self.earlier = (self.folder / f"{name}.{what}checkpoint.npz" for what in ("", "earlier-"))
        self.every = None if every is None else checked_count(every, "every, in frames", 1, SceneError)
        self.seconds = positive_number(seconds, "seconds from one to the next", "s", SceneError)
        self._frame: int | None = None
        self._time, self._took = 0.0, 0.0

    def files(self) -> list[Path]:
        """Those that are there, the last one first. Raises SceneError if there is none."""
        files = [file for file in (self.file, self.earlier) if file.exists()]
        if not files:
            raise SceneError(f"there is no checkpoint to go on from: {self.file} does not exist")
        return files

    def save(self, simulation: Simulation) -> None:
        """Writes the state, unless it is the one that was written last. Raises SceneError."""
        if simulation.frame == self._frame:
            return
        begin = time.monotonic()
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.file.exists():
            self.file.replace(self.earlier)
        simulation.save(self.file)
        self._frame, self._time = simulation.frame, time.monotonic()
        self._took = self._time - begin

    def save_if_due(self, simulation: Simulation) -> None:
        """After a frame."""
        if self._frame is not None:
            waited = time.monotonic() - self._time
            is_due = waited >= max(self.seconds, self._took / MOST_SHARE)
            if not (is_due if self.every is None else simulation.frame - self._frame >= self.every):
                return
        self.save(simulation)

    def resume(self, simulation: Simulation) -> Path:
        """Sets the simulation, just built, to the last state that was written; returns its file. Where that is damaged,
        the logger `yasps` says so, and the earlier one is taken.

        Raises SceneError if there is none, or for a simulation that was built otherwise, see `Simulation.restore`.
        """
        files = self.files()
        for file in files:
            try:
                simulation.restore(file)
            except DamagedStateError as error:
                if file == files[-1]:
                    raise
                LOGGER.warning("%s; the one before it is taken", error)
                continue
            self._frame, self._time = simulation.frame, time.monotonic()
            return file
        raise AssertionError("a file was restored or refused")
