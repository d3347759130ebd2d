"""What a run leaves behind: a ParaView series, and where the machine can draw, a picture and an animation."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.output.animation import Animation
from yasps.output.pictures import OBSTACLE_GREY, PALETTE, FramePictures, PicturesUnavailable, Surface
from yasps.output.vtkhdf import VtkHdfSeries


class Shown(Protocol):
    """A body, as far as output is concerned."""

    name: str
    triangles: NDArray[np.int32]
    cells: Mapping[str, NDArray[np.int32]]

    @property
    def stands_still(self) -> bool:
        """What never moves is in the pictures only."""

    def positions(self) -> NDArray[np.float64]:
        """[n, 3]."""


class Running(Protocol):
    """A simulation, as far as output is concerned."""

    @property
    def time(self) -> float:
        """[s]."""

    @property
    def bodies(self) -> Sequence[Shown]:
        """In a fixed order."""


def _is_level(body: Shown, height: float | None) -> bool:
    """Whether all of it is at this height: what the ground in pictures stands for."""
    return height is not None and bool((body.positions()[:, 2] == height).all())


class FrameRecorder:
    """Records a simulation frame by frame into FOLDER/NAME.vtkhdf, NAME.mp4 and NAME.png.

    pictures: False for the series alone; where the machine can't draw, a line on stderr says so. ground_height: of the
    ground in pictures, which stands for a level obstacle there; None for none. bounds: what the camera sees, [2, 3];
    default: all that moves and the ground below them at the start. frames_per_picture: how many frames one picture of
    the animation stands for.
    """

    def __init__(
        self,
        simulation: Running,
        folder: str | Path,
        name: str,
        *,
        pictures: bool = True,
        ground_height: float | None = 0.0,
        bounds: ArrayLike | None = None,
        frames_per_picture: int = 3,
    ) -> None:
        self.folder, self.name = Path(folder), name
        self.folder.mkdir(parents=True, exist_ok=True)
        self.written: list[Path] = []
        self._bodies = [body for body in simulation.bodies if not body.stands_still]
        self._frames_per_picture = frames_per_picture
        starts = [0, *itertools.accumulate(len(body.positions()) for body in self._bodies)]
        cells: dict[str, list[NDArray[np.int32]]] = {}
        for body, start in zip(self._bodies, starts, strict=False):
            for kind, ids in body.cells.items():
                cells.setdefault(kind, []).append(ids + start)
        self._series = VtkHdfSeries(
            self.folder / f"{name}.vtkhdf", starts[-1], {kind: np.concatenate(ids) for kind, ids in cells.items()}
        )
        self._frames: FramePictures | None = None
        self._animation: Animation | None = None
        if pictures:
            still = [body for body in simulation.bodies if body.stands_still and len(body.triangles)]
            still = [body for body in still if not _is_level(body, ground_height)]
            try:
                self._open_pictures(still, ground_height, bounds)
            except PicturesUnavailable as reason:
                print(f"no pictures: {reason}", file=sys.stderr)

    def _open_pictures(self, still: Sequence[Shown], ground_height: float | None, bounds: ArrayLike | None) -> None:
        surfaces = [
            Surface(body.name, body.positions(), body.triangles, color)
            for body, color in zip(self._bodies, itertools.cycle(PALETTE), strict=False)
        ]
        surfaces += [Surface(body.name, body.positions(), body.triangles, OBSTACLE_GREY) for body in still]
        if bounds is None:
            points = np.concatenate([body.positions() for body in self._bodies])
            if ground_height is not None:
                points = np.vstack([points, [*points[0, :2], ground_height]])
            bounds = [points.min(axis=0), points.max(axis=0)]
        self._frames = FramePictures(surfaces, ground_height=ground_height, bounds=bounds, window_size=(960, 720))
        self._animation = Animation(self.folder / f"{self.name}.mp4")

    def record(self, simulation: Running) -> None:
        """Adds a frame."""
        positions = [body.positions() for body in self._bodies]
        self._series.write_frame(simulation.time, np.concatenate(positions))
        if self._frames is not None and self._animation is not None:
            for body, x in zip(self._bodies, positions, strict=True):
                self._frames.move(body.name, x)
            if (self._series.number_of_frames - 1) % self._frames_per_picture == 0:
                self._animation.add(self._frames.image())

    def close(self) -> None:
        """Finishes all files; `written` names them."""
        self._series.close()
        self.written = [self.folder / f"{self.name}.vtkhdf"]
        if self._frames is not None and self._animation is not None:
            self.written.append(self._frames.save(self.folder / f"{self.name}.png"))
            self._animation.close()
            self.written.append(self._animation.path)
            self._frames.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        for path in self.written:
            print(f"wrote {path}", file=sys.stderr)
