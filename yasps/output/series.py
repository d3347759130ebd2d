"""Reading a results file back."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from yasps.output.recorded_bodies import RecordedBody, from_datasets
from yasps.output.view import View, view_of
from yasps.output.vtkhdf_layout import BESIDE, CELL_KINDS, OutputFileError, reading, step_times

Floats = NDArray[np.float64]
T = TypeVar("T")


class Series:
    """The frames of a results file. Arrays are read when they are asked for, so a file may be larger than the memory;
    one that a simulation still writes has the frames that were there when it was opened.

    Attributes:
        path: of the file.
        name: that the run gave it.
        bodies: in the order of the simulation.
        times: of the frames [s], [frames], growing.
        fields: names of the numbers at each vertex.
        view: how pictures look at it.
        version: of the yasps that wrote it.
        units: what -> unit, "up" -> the axis that points up.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Raises OutputFileError for a file that is not there, damaged, or was not written by a `FrameRecorder`."""
        self.path = Path(path)
        with reading(self.path) as file:
            self.times: Floats = step_times(file, self.path)
            if BESIDE not in file:
                raise OutputFileError(
                    f"'{self.path}' says nothing about bodies: it was written by another program or without a "
                    "FrameRecorder. ParaView can show it."
                )
            beside = file[BESIDE]
            description = json.loads(beside["description"].asstr()[()])
            self.name, self.units = str(description["name"]), dict(description["units"])
            look = json.loads(beside["look"].asstr()[()])
            self.bodies = from_datasets(description, look, beside)
            self.view: View = view_of(look["view"])
            self.version = str(beside["version"].asstr()[()])
            self.number_of_points = int(file["VTKHDF/NumberOfPoints"][0])
            data = file["VTKHDF"].get("PointData", {})
            self.fields = tuple(name for name in data if name != "body")
            if sum(body.count for body in self.bodies) != self.number_of_points:
                raise OutputFileError(
                    f"'{self.path}' is damaged: its bodies don't have its {self.number_of_points} points."
                )

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        return f"<Series {self.name!r}, {len(self)} frames of {len(self.bodies)} bodies>"

    def body(self, name: str) -> RecordedBody:
        """The body of this name. Raises OutputFileError if there is none."""
        for body in self.bodies:
            if body.name == name:
                return body
        known = ", ".join(body.name for body in self.bodies)
        raise OutputFileError(f"'{self.path}' has no body '{name}'; it has {known}.")

    def positions(self, frame: int) -> Floats:
        """Of the vertices of all bodies [m], [n, 3]; frame -1 is the last. Raises OutputFileError."""
        return self._rows("Points", frame, (3,))

    def field(self, name: str, frame: int) -> Floats:
        """Numbers at the vertices, [n] or [n, components]. Raises OutputFileError for one that is not there."""
        if name not in self.fields:
            known = ", ".join(self.fields) or "none"
            raise OutputFileError(f"'{self.path}' has no field '{name}'; it has {known}.")
        return self._rows(f"PointData/{name}", frame, None)

    def all_positions(self) -> Iterator[Floats]:
        """Frame after frame."""
        return (self.positions(frame) for frame in range(len(self)))

    def box(self, frames: Iterable[int] | None = None) -> Floats:
        """Lowest and highest corner of what moves in these frames, by default in all [m], [2, 3]; of obstacles if
        nothing else is there."""
        rows = self.moving_vertices()
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for frame in range(len(self)) if frames is None else frames:
            x = self.positions(frame)[rows]
            low, high = np.minimum(low, x.min(axis=0)), np.maximum(high, x.max(axis=0))
        return np.stack([low, high])

    def moving_vertices(self) -> NDArray[np.int64]:
        """The vertices of all bodies that don't stand still, or of all bodies if none does, [k]."""
        moving = [body for body in self.bodies if body.count and not body.stands_still]
        return np.concatenate([np.arange(self.number_of_points)[body.vertices] for body in moving or self.bodies])

    def cells(self) -> dict[str, NDArray[np.int64]]:
        """Kind of cell -> vertex numbers, [m, vertices of such a cell]."""
        with reading(self.path) as file:
            root = file["VTKHDF"]
            types, corners = root["Types"][:], root["Connectivity"][:]
            offsets = root["Offsets"][:]
        found = {}
        for kind, (number, arity) in CELL_KINDS.items():
            of_kind = np.flatnonzero(types == number)
            if len(of_kind):
                found[kind] = np.asarray(corners[offsets[of_kind][:, None] + np.arange(arity)], np.int64)
        return found

    def nearest_frame(self, time: float) -> int:
        """The frame whose time is nearest [s]."""
        return int(np.argmin(np.abs(self.times - time)))

    def _rows(self, dataset: str, frame: int, shape: tuple[int, ...] | None) -> Floats:
        if not -len(self) <= frame < len(self):
            raise OutputFileError(f"'{self.path}' has the frames 0 to {len(self) - 1}, not {frame}.")
        first = (frame % len(self)) * self.number_of_points
        with reading(self.path) as file:
            rows = np.asarray(file["VTKHDF"][dataset][first : first + self.number_of_points], np.float64)
        if len(rows) != self.number_of_points or (shape is not None and rows.shape[1:] != shape):
            raise OutputFileError(f"'{self.path}' is damaged: its {dataset} have shape {list(rows.shape)}.")
        if not np.isfinite(rows).all():
            raise OutputFileError(f"'{self.path}' is damaged: {dataset} of frame {frame} are not finite.")
        return rows


def read_series(path: str | os.PathLike[str]) -> Series:
    """A results file that a `FrameRecorder` wrote. Raises OutputFileError for any other file, or a damaged one."""
    return Series(path)
