"""What a run leaves behind: one results file, and made from that, a picture and an animation."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import __version__
from yasps.output.motion_pictures import make_animation, make_picture
from yasps.output.recorded_bodies import Floats, Shown, as_datasets, recorded_bodies, told_look
from yasps.output.series import read_series
from yasps.output.view import View, checked_view
from yasps.output.vtkhdf import VtkHdfSeries
from yasps.output.vtkhdf_layout import OutputFileError


class Forces(Protocol):
    """Forces of contact."""

    def on_vertices(self) -> Floats:
        """On each vertex of all bodies [N], [n, 3]."""


class Running(Protocol):
    """A simulation, as far as output is concerned."""

    @property
    def time(self) -> float:
        """[s]."""

    @property
    def bodies(self) -> Sequence[Any]:
        """`Shown`, in a fixed order."""

    @property
    def contact(self) -> object:
        """None without contact."""

    def velocity_of(self, body: Any) -> Floats:
        """Of its vertices [m/s], [n, 3]."""

    def contact_forces(self) -> Forces:
        """At the present positions."""


class FrameRecorder:
    """Records a simulation frame by frame into FOLDER/NAME.vtkhdf, and makes NAME.png and NAME.mp4 of that at the end.

    The file holds the positions of all bodies that have vertices, obstacles too, and what `RecordedBody` says of them;
    ParaView reads it, and so do `read_series` and the commands `yasps view`, `yasps picture` and `yasps export`.

    A file has one mesh. Where a body gets another one (`Simulation.remesh`), the frames from then on are in
    FOLDER/NAME.mesh-2.vtkhdf, and so on; `files` has all of them. The picture is of the last one, the animation of all.

    Args:
        simulation: all its bodies are recorded; none can be added while that goes on. One that is removed stays where
            it was last.
        folder: is made if it is not there.
        name: of the files, without ending.
        pictures: False for the results file alone. Where the machine can't draw, a line on stderr says so.
        fields: numbers at each vertex that go with the positions: "velocity" [m/s], "contact_force" [N].
        colors: name of a body -> "#rrggbb", or "#rrggbbaa" for glass.
        camera, view_direction, bounds, speed: see `View`; kept in the file for pictures that are made later, too.
        resume: go on in the last file that is there, behind its frames up to the present time of the simulation; if
            there is none, begin one. Colours and the view may be others than before.

    Raises:
        OutputFileError: wrong arguments, or a file to resume that is damaged or of another scene.
    """

    def __init__(
        self,
        simulation: Running,
        folder: str | Path,
        name: str,
        *,
        pictures: bool = True,
        fields: Sequence[str] = ("velocity",),
        colors: Mapping[str, str] | None = None,
        camera: str = "whole",
        view_direction: ArrayLike = View.direction,
        bounds: ArrayLike | None = None,
        speed: float = View.speed,
        resume: bool = False,
    ) -> None:
        self.folder, self.name = Path(folder), name
        self.file = self.folder / f"{name}.vtkhdf"
        self.written: list[Path] = []
        self._pictures = pictures
        self._fields = _checked_fields(fields, simulation)
        self._bodies: list[Shown] = list(simulation.bodies)
        self._last = [body.positions() for body in self._bodies]
        self._view, self._colors = checked_view(camera, view_direction, bounds, speed), colors
        self.files = [self.file]
        self._earlier_frames = 0
        while (
            resume and (following := self._next_file()).exists() and read_series(following).times[0] <= simulation.time
        ):
            self._earlier_frames += len(read_series(self.files[-1]))
            self.files.append(following)
        self._series = self._begin(simulation.time if resume else None)

    def _next_file(self) -> Path:
        """For another mesh."""
        return self.folder / f"{self.name}.mesh-{len(self.files) + 1}.vtkhdf"

    def _begin(self, resume_at: float | None) -> VtkHdfSeries:
        """A series of the bodies with the meshes that they have now, in the last of the files."""
        bodies = recorded_bodies(self._bodies, self._colors)
        cells: dict[str, list[NDArray[np.int32]]] = {}
        owners: dict[str, list[NDArray[np.int32]]] = {}
        for number, (body, shown) in enumerate(zip(self._bodies, bodies, strict=True)):
            for kind, ids in body.cells.items():
                cells.setdefault(kind, []).append(ids + shown.first)
                owners.setdefault(kind, []).append(np.full(len(ids), number, np.int32))
        of_points = np.repeat(np.arange(len(bodies), dtype=np.int32), [body.count for body in bodies])
        self.folder.mkdir(parents=True, exist_ok=True)
        self._meshes = [dict(body.cells) for body in self._bodies]
        return VtkHdfSeries(
            self.files[-1],
            len(of_points),
            {kind: np.concatenate(ids) for kind, ids in cells.items()},
            static_point_data={"body": of_points},
            static_cell_data={"body": np.concatenate([part for parts in owners.values() for part in parts])},
            beside=as_datasets(bodies, {"name": self.name, "units": _UNITS}),
            notes={"look": told_look(bodies, self._view.told()), "version": __version__},
            resume_at=resume_at,
        )

    @property
    def number_of_frames(self) -> int:
        """How many frames are recorded; of a resumed file, those up to the present time."""
        return self._earlier_frames + self._series.number_of_frames

    def record(self, simulation: Running) -> None:
        """Adds a frame. Raises OutputFileError for a body that was not there at the beginning, or for a state that
        can't be written."""
        there, known = {id(body) for body in simulation.bodies}, {id(body) for body in self._bodies}
        for body in simulation.bodies:
            if id(body) not in known:
                raise OutputFileError(
                    f"The body '{body.name}' came while '{self.file.name}' was recorded, whose bodies are those at the "
                    "beginning. Add all bodies before the FrameRecorder, or make another one under another name."
                )
        for number, body in enumerate(self._bodies):
            if id(body) in there:
                self._last[number] = body.positions()
        if not all(_same_mesh(body.cells, mesh) for body, mesh in zip(self._bodies, self._meshes, strict=True)):
            self._series.close()
            if self._series.number_of_frames:
                self._earlier_frames += self._series.number_of_frames
                self.files.append(self._next_file())
            self._series = self._begin(None)
        data = {field: _FIELDS[field](simulation, self._bodies).astype(np.float32) for field in self._fields}
        self._series.write_frame(simulation.time, np.concatenate(self._last), point_data=data)

    def close(self) -> None:
        """Ends the results file and makes pictures of it; `written` names all files."""
        self._series.close()
        if not self.number_of_frames:
            return
        self.written = list(self.files)
        if self._pictures:
            self._pictures = False
            self._make_pictures()

    def _make_pictures(self) -> None:
        try:
            self.written.append(make_picture(self.files[-1], self.file.with_suffix(".png")))
            self.written.append(make_animation(self.files, self.file.with_suffix(".mp4")))
        except Exception as reason:  # noqa: BLE001 - whatever drawing does, the run is safe in its file and goes on
            print(f"no pictures: {reason}", file=sys.stderr)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None and not issubclass(kind, Exception):
            self._pictures = False  # Ctrl-C: whoever wants to leave does not wait for pictures
        self.close()
        for path in self.written:
            print(f"wrote {path}", file=sys.stderr)


def _same_mesh(cells: Mapping[str, NDArray[np.int32]], other: Mapping[str, NDArray[np.int32]]) -> bool:
    return cells.keys() == other.keys() and all(np.array_equal(ids, other[kind]) for kind, ids in cells.items())


_UNITS: Final = {"length": "m", "time": "s", "up": "z", "velocity": "m/s", "contact_force": "N"}


def _velocities(simulation: Running, bodies: Sequence[Shown]) -> Floats:
    there = {id(body) for body in simulation.bodies}
    return np.concatenate(
        [simulation.velocity_of(b) if id(b) in there else np.zeros_like(b.positions()) for b in bodies]
    )


def _contact_forces(simulation: Running, bodies: Sequence[Shown]) -> Floats:
    with_vertices = [body for body in simulation.bodies if len(body.positions())]
    starts = np.cumsum([0, *(len(body.positions()) for body in with_vertices)])
    forces = simulation.contact_forces().on_vertices()
    of_body = {id(body): forces[starts[k] : starts[k + 1]] for k, body in enumerate(with_vertices)}
    return np.concatenate([of_body.get(id(body), np.zeros_like(body.positions())) for body in bodies])


_FIELDS: Final[Mapping[str, Callable[[Running, Sequence[Shown]], Floats]]] = {
    "velocity": _velocities,
    "contact_force": _contact_forces,
}


def _checked_fields(fields: Sequence[str], simulation: Running) -> tuple[str, ...]:
    if isinstance(fields, str) or not set(fields) <= set(_FIELDS):
        raise OutputFileError(f"fields are a list of {', '.join(map(repr, _FIELDS))}, got {fields!r}.")
    if "contact_force" in fields and simulation.contact is None:
        raise OutputFileError("fields has 'contact_force', but the simulation was made with contact=False.")
    return tuple(dict.fromkeys(fields))
