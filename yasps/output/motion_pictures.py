"""Pictures and animations of a results file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from yasps.output.animation import Animation
from yasps.output.camera import box_corners, camera_position, distance_to_see
from yasps.output.picture_errors import PictureError
from yasps.output.pictures import ColorScale, FramePictures, Image, Surface
from yasps.output.recorded_bodies import RecordedBody
from yasps.output.series import Series, read_series
from yasps.output.tubes import Tubes
from yasps.output.view import View

Floats = NDArray[np.float64]

FORCES: Final = "contact_force"
_SEEN: Final = 3000
"""Vertices that the camera is fitted to, of each frame at most."""
_SLOW: Final = 10
"""Frames over which a camera that follows is smoothed."""


def make_picture(
    file: str | os.PathLike[str] | Series,
    path: str | os.PathLike[str],
    *,
    frame: int = -1,
    field: str | None = None,
    forces: bool | None = None,
    view: View | None = None,
    size: tuple[int, int] = (960, 720),
) -> Path:
    """Draws one frame of a results file.

    Args:
        file: that a `FrameRecorder` wrote, or a series that is open.
        path: ends in `.png` or `.jpg`.
        frame: from 0; -1 is the last.
        field: of the file, by whose size bodies are coloured, with a scale of all its frames.
        forces: draw the field `contact_force` as arrows; None: if it is there.
        view: instead of the file's own.
        size: width and height in pixels, even.

    Raises:
        OutputFileError, PictureError, PicturesUnavailable.
    """
    series = file if isinstance(file, Series) else read_series(file)
    number = range(len(series))[_checked_frame(series, frame)]
    with MotionPictures(series, [number], field=field, forces=forces, view=view, size=size) as pictures:
        pictures.show(0)
        return pictures.frames.save(path)


def make_animation(
    file: str | os.PathLike[str] | Series | Sequence[str | os.PathLike[str] | Series],
    path: str | os.PathLike[str],
    *,
    field: str | None = None,
    forces: bool | None = None,
    view: View | None = None,
    size: tuple[int, int] = (960, 720),
    frames_per_second: float = 30.0,
) -> Path:
    """Draws a results file, or several that follow each other, as a video whose time runs as that of the world, times
    `view.speed`.

    Args:
        path: ends in `.mp4`, `.gif` or `.webp`; see `Animation`.
        frames_per_second: at most; no frame of the file is shown twice.
        file: as in `make_picture`; or the `files` of a `FrameRecorder`, whose times grow from one to the next.
        field, forces, view, size: as in `make_picture`.

    Returns:
        The file, which is a `.gif` if there is no ffmpeg for an `.mp4`.

    Raises:
        OutputFileError, PictureError, PicturesUnavailable.
    """
    given = [file] if isinstance(file, str | os.PathLike | Series) else list(file)
    parts = [one if isinstance(one, Series) else read_series(one) for one in given]
    times = np.concatenate([series.times for series in parts])
    if (np.diff(times) <= 0).any():
        raise PictureError("Files of one animation follow each other, but the times of these don't grow.")
    view = parts[0].view if view is None else view
    chosen, pace = frames_to_show(times, view.speed, frames_per_second)
    starts = np.cumsum([0, *(len(series) for series in parts)])
    shown = [[k - start for k in chosen if start <= k < end] for start, end in pairwise(starts.tolist())]
    if len(parts) > 1:
        boxes = np.array([seen_box(series, range(len(series)), view) for series in parts])
        view = replace(view, camera="whole", bounds=(tuple(boxes[:, 0].min(axis=0)), tuple(boxes[:, 1].max(axis=0))))
    with Animation(path, pace) as animation:
        for series, frames in zip(parts, shown, strict=True):
            if frames:
                with MotionPictures(series, frames, field=field, forces=forces, view=view, size=size) as pictures:
                    for k in range(len(frames)):
                        animation.add(pictures.show(k))
    return animation.path


def frames_to_show(times: Floats, speed: float, frames_per_second: float) -> tuple[list[int], float]:
    """The frames of an animation that runs `speed` times as fast as the world, and how many a second it shows: as many
    as asked for, or as there are."""
    if not 0 < frames_per_second < np.inf:
        raise PictureError(f"frames_per_second is {frames_per_second}, but must be positive.")
    if len(times) == 1:
        return [0], frames_per_second
    step = float(np.median(np.diff(times))) / speed  # of the video's time
    stride = max(1, int(np.ceil(1.0 / (frames_per_second * step) - 1e-9)))
    pace = 1.0 / (stride * step)
    count = round((times[-1] - times[0]) / speed * pace) + 1
    wanted = times[0] + speed * np.arange(count) / pace
    nearest = [int(np.argmin(np.abs(times - time))) for time in wanted]
    return list(dict.fromkeys([*nearest, len(times) - 1])), pace


class MotionPictures:
    """Frames of a results file, drawn: bodies in their colours, rods as tubes, what is level and stands still as the
    ground.

    chosen: the frames that `show` draws, in order. window: on the screen, see `FramePictures`. The others as in
    `make_picture`.
    """

    def __init__(
        self,
        series: Series,
        chosen: list[int],
        *,
        field: str | None = None,
        forces: bool | None = None,
        view: View | None = None,
        size: tuple[int, int] = (960, 720),
        window: bool = False,
    ) -> None:
        forces = FORCES in series.fields if forces is None else forces
        for wanted in {field, FORCES if forces else None} - {None, *series.fields}:
            raise PictureError(
                f"'{series.path}' has no field '{wanted}'; it has {', '.join(series.fields) or 'none'}. Record it with "
                f"FrameRecorder(..., fields=[{', '.join(map(repr, (*series.fields, wanted)))}])."
            )
        self._series, self._chosen, self._field = series, chosen, field
        view = series.view if view is None else view
        aspect = size[0] / size[1]
        ground = ground_body(series)
        self._drawn = [body for body in series.bodies if body.count and body is not ground]
        height = None if ground is None else level_height(series, ground)
        self._cameras = cameras(series, chosen, view, aspect, height)
        box = seen_box(series, chosen, view)
        diagonal = float(np.linalg.norm(box[1] - box[0])) or 1.0
        x = series.positions(0)  # which tells creases of the shape from folds that come later
        self._tubes: dict[str, Tubes] = {}
        surfaces: list[Surface] = []
        for body in self._drawn:
            surfaces += self._surfaces_of(body, x[body.vertices], 2e-3 * diagonal)
        if not surfaces:
            raise PictureError(f"'{series.path}' has no surface, rod or loose vertex to draw.")
        planes = [
            b.plane for b in series.bodies if b.plane is not None and b is not ground and b.plane.normal[2] > -0.5
        ]
        scale = None if field is None else _scale(series, field)
        self._force_scale = _arrow_scale(series, diagonal) if forces else 0.0
        self._least_force = 0.02 * _largest(series, FORCES) if forces else 0.0
        self.frames = FramePictures(
            surfaces,
            ground_height=height,
            bounds=box,
            window_size=size,
            view_direction=view.direction,
            planes=planes,
            scale=scale,
            window=window,
        )
        self.frames.look(*self._cameras[0])

    def show(self, k: int) -> Image:
        """The picture of the k-th of the chosen frames, [height, width, 3]."""
        self.move(k)
        self.frames.look(*self._cameras[k])
        return self.frames.image()

    def move(self, k: int) -> None:
        """Moves all to the k-th of the chosen frames; the camera stays."""
        series, frame = self._series, self._chosen[k]
        x = series.positions(frame)
        values = None if self._field is None else sizes(series.field(self._field, frame))
        for body in self._drawn:
            here = x[body.vertices]
            numbers = None if values is None else values[body.vertices]
            if len(body.triangles):
                self.frames.move(body.name, here, numbers)
            if body.name in self._tubes:
                skin, _, source = self._tubes[body.name].surface(here)
                self.frames.move(_tube_name(body), skin, None if numbers is None else numbers[source])
        if self._force_scale:
            vectors = series.field(FORCES, frame)
            strong = np.linalg.norm(vectors, axis=1) > self._least_force
            self.frames.show_arrows(x[strong], self._force_scale * vectors[strong])
        self.frames.cast_shadows()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.frames.close()

    def _surfaces_of(self, body: RecordedBody, x: Floats, thin: float) -> Iterator[Surface]:
        if len(body.triangles):
            yield Surface(
                body.name,
                x,
                body.triangles,
                body.color,
                patterned=body.is_driven,
                open=body.two_sided,
                opacity=body.opacity,
            )
        if len(body.edges) or len(body.points):
            self._tubes[body.name] = Tubes(body.edges, body.points, body.radii, thin)
            skin, triangles, _ = self._tubes[body.name].surface(x)
            yield Surface(_tube_name(body), skin, triangles, body.color)


def sizes(values: Floats) -> Floats:
    """Numbers as they are, [n], and lengths of vectors, [n, c]."""
    return values if values.ndim == 1 else np.asarray(np.linalg.norm(values, axis=1))


def ground_body(series: Series) -> RecordedBody | None:
    """The lowest body that is level, looks up and stands still: the ground of pictures."""
    level = [(height, body) for body in series.bodies if (height := level_height(series, body)) is not None]
    return min(level, key=lambda one: one[0])[1] if level else None


def level_height(series: Series, body: RecordedBody) -> float | None:
    """z of a level half-space or obstacle; None for any other body."""
    if body.plane is not None:
        return body.plane.point[2] if body.plane.normal[2] > 1 - 1e-9 else None
    if not body.stands_still or not len(body.triangles):
        return None
    z = series.positions(0)[body.vertices, 2]
    return float(z[0]) if np.ptp(z) == 0 else None


def seen_box(series: Series, frames: Sequence[int], view: View) -> Floats:
    """Lowest and highest corner of what a picture shows [m], [2, 3]: what moves, and obstacles that are not much
    larger."""
    if view.bounds is not None:
        return np.array(view.bounds)
    if view.camera == "follow":
        boxes = np.array([series.box([frame]) for frame in frames])
        largest = np.ptp(boxes, axis=1).max(axis=0)
        middle = boxes[0].mean(axis=0)
        return np.array([middle - 0.5 * largest, middle + 0.5 * largest])
    box = series.box(frames)
    x = series.positions(0)
    for body in _small_obstacles(series, box):
        here = x[body.vertices]
        box = np.array([np.minimum(box[0], here.min(axis=0)), np.maximum(box[1], here.max(axis=0))])
    return box


def _small_obstacles(series: Series, box: Floats) -> list[RecordedBody]:
    x = series.positions(0)
    reach = 1.5 * float(np.linalg.norm(box[1] - box[0]))
    still = [body for body in series.bodies if body.stands_still and body.count]
    return [
        body
        for body in still
        if np.linalg.norm(np.ptp(x[body.vertices], axis=0)) < reach
        and (np.abs(x[body.vertices].mean(axis=0) - box.mean(axis=0)) < reach).all()
    ]


def cameras(
    series: Series, chosen: list[int], view: View, aspect: float, height: float | None
) -> list[tuple[Floats, Floats]]:
    """Eye and focus for each chosen frame."""
    if view.bounds is not None and view.camera == "whole":
        return [camera_position(box_corners(np.array(view.bounds)), view.direction, aspect)] * len(chosen)
    rows = series.moving_vertices()
    rows = rows[:: max(1, len(rows) // _SEEN)]
    if view.camera == "whole":
        still = _small_obstacles(series, series.box(chosen))
        parts = [series.positions(0)[body.vertices] for body in still]
        parts += [series.positions(frame)[rows] for frame in chosen]
        points = np.concatenate(parts)
        if height is not None:  # the ground right below, so that one sees what bodies stand or will fall on
            points = np.vstack([points, [*points.mean(axis=0)[:2], height]])
        return [camera_position(points, view.direction, aspect)] * len(chosen)
    seen = [series.positions(frame)[rows] for frame in chosen]
    focus = _smooth(np.array([camera_position(x, view.direction, aspect)[1] for x in seen]))
    away = [distance_to_see(x, place, view.direction, aspect) for x, place in zip(seen, focus, strict=True)]
    distance = _smooth(ndimage.maximum_filter1d(away, 4 * _SLOW + 1, mode="nearest"))
    towards = np.array(view.direction) / np.linalg.norm(view.direction)
    return [(place + far * towards, place) for place, far in zip(focus, distance, strict=True)]


def _smooth(values: Floats) -> Floats:
    """Values of frames, [frames, ...], without what is quick; at the ends they go on as they came."""
    if len(values) == 1:
        return values
    width = [(4 * _SLOW, 4 * _SLOW)] + [(0, 0)] * (values.ndim - 1)
    longer = np.pad(values, width, mode="reflect", reflect_type="odd")
    return np.asarray(ndimage.gaussian_filter1d(longer, _SLOW, axis=0)[4 * _SLOW : -4 * _SLOW])


def _largest(series: Series, field: str) -> float:
    return max(float(sizes(series.field(field, frame)).max(initial=0.0)) for frame in range(len(series)))


def _scale(series: Series, field: str) -> ColorScale:
    """From the smallest to the largest value of all frames; vectors from 0."""
    numbers = [series.field(field, frame) for frame in range(len(series))]
    low = 0.0 if numbers[0].ndim == 2 else min(float(x.min()) for x in numbers)
    high = max(float(sizes(x).max()) for x in numbers)
    unit = series.units.get(field)
    title = field.replace("_", " ") + (f" [{unit}]" if unit else "")
    return ColorScale(title, low, high if high > low else low + 1.0)


def _arrow_scale(series: Series, diagonal: float) -> float:
    """Length of an arrow for a force of 1 N: that of the largest is a sixth of the diagonal."""
    return diagonal / 6 / (_largest(series, FORCES) or 1.0)


def _checked_frame(series: Series, frame: int) -> int:
    if not -len(series) <= frame < len(series):
        raise PictureError(f"'{series.path}' has the frames 0 to {len(series) - 1}, not {frame}.")
    return frame


def _tube_name(body: RecordedBody) -> str:
    return f"{body.name} (rods)"
