"""A simulation as one ParaView file: temporal VTKHDF, written frame by frame.

The layout is that of the VTKHDF file format 2.0 for a temporal `UnstructuredGrid`
(https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/vtkhdf_specifications.html), which
ParaView 5.12 and VTK 9.3 or newer read. Every step is one part; the cells are stored once and every step
points at them.

How a frame becomes visible: all its arrays are written behind the frames that are there, and flushed; only
then the attribute `NSteps`, which tells readers how many frames to look at, is raised by one and its time is
added. The file is closed between frames, so that ParaView can open it while the simulation goes on, and a run
that is killed leaves the frames written so far. (Tried on 400 runs killed while they did nothing but write
frames.)
"""

import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import h5py
import numpy as np
import numpy.typing as npt

from yasps.frontend.language.arrays import plain_array
from yasps.output.vtkhdf_layout import (
    BESIDE,
    FIXED_CELLS,
    Array,
    OutputFileError,
    flat_cells,
    grouped,
    holds,
    reading,
    step_times,
)

# Rows of a chunk at most: a chunk must stay under 4 GiB, and a frame is otherwise one chunk.
_LARGEST_CHUNK: Final = 2**20
# Rows of a chunk in the arrays that hold one number a step.
_STEPS_PER_CHUNK: Final = 256


class VtkHdfSeries:
    """Writes the frames of a simulation with fixed cells to one `.vtkhdf` file.

    The file appears with the first frame (an older file of that name is replaced then, not before), and each
    call of `write_frame` adds one step. Use it as a context manager, or call `close`.

    Args:
        path: the file; its name must end in `.vtkhdf` (ParaView goes by it) and its folder must exist.
        number_of_points: n, the same in all frames.
        cells: name of a cell kind (`"tetra"`, `"triangle"` and others of `CELL_KINDS`) -> point numbers, shape
            [m, points of such a cell], counted from 0. The order of the kinds is the order of the cell data.
        static_point_data: name -> [n] or [n, c], the same in all frames.
        static_cell_data: name -> [m] or [m, c] over all cells, the same in all frames, say the number of the body.
        beside: name -> text or numbers, datasets of a group `yasps` beside VTK's own, which other readers leave alone.
        notes: name -> text in the same group, which a series that is resumed may change.
        single_precision: store floating-point data in 4 bytes instead of 8; arrays of 4 bytes always stay such. Times
            are always stored in 8.
        resume_at: if the file is there, go on in it behind its last frame up to this time. Those after that are
            cut off by the next frame, not before.

    Raises:
        OutputFileError: a wrong shape, type, name, point number or path, or a file to resume that is damaged or
            of another mesh. Nothing has been written then.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        number_of_points: int,
        cells: Mapping[str, npt.ArrayLike],
        *,
        static_point_data: Mapping[str, npt.ArrayLike] | None = None,
        static_cell_data: Mapping[str, npt.ArrayLike] | None = None,
        beside: Mapping[str, npt.ArrayLike | str] | None = None,
        notes: Mapping[str, str] | None = None,
        single_precision: bool = False,
        resume_at: float | None = None,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix != ".vtkhdf":
            raise OutputFileError(
                f"The file name '{self.path.name}' does not end in '.vtkhdf', by which ParaView knows "
                f"the format. Call it '{self.path.with_suffix('.vtkhdf').name}'."
            )
        if not self.path.parent.is_dir():
            raise OutputFileError(
                f"The folder '{self.path.parent}' for '{self.path.name}' does not exist. Make it first."
            )
        if number_of_points < 1:
            raise OutputFileError(f"number_of_points is {number_of_points}; a series needs at least one point.")
        self.number_of_points = number_of_points
        self._float = np.dtype(np.float32 if single_precision else np.float64)
        self._connectivity, self._offsets, self._types = flat_cells(cells, number_of_points)
        self.number_of_cells = len(self._types)
        self._static_points = self._data("static_point_data", static_point_data, number_of_points)
        self._static_cells = self._data("static_cell_data", static_cell_data, self.number_of_cells)
        self._beside = {name: np.asarray(values) for name, values in (beside or {}).items()}
        self._notes = dict(notes or {})
        self._frames = 0
        self._frames_in_file = 0
        self._last_time = -np.inf
        # What the first frame declares: (group, name) -> (columns, type); later frames must match.
        self._declared: dict[tuple[str, str], tuple[tuple[int, ...], np.dtype[Any]]] = {}
        self._closed = False
        if resume_at is not None and self.path.exists():
            self._take_up(resume_at)

    @property
    def number_of_frames(self) -> int:
        """How many frames the series has."""
        return self._frames

    def _take_up(self, until: float) -> None:
        """Goes on behind the frames of the file up to a time."""
        with reading(self.path) as file:
            times = step_times(file, self.path)
            root = file["VTKHDF"]
            expected = self._fixed() | {f"{BESIDE}/{name}": values for name, values in self._beside.items()}
            expected["VTKHDF/NumberOfPoints"] = np.array([self.number_of_points])
            for name, values in expected.items():
                if not holds(file, name, values):
                    raise OutputFileError(
                        f"'{self.path}' can't be resumed: it is of another scene, its {name} differs. Resume with "
                        "the scene that wrote it, or begin a new series under another name."
                    )
            static = grouped(self._static_points, self._static_cells)
            self._declared = {
                (group, name): (data.shape[1:], data.dtype)
                for group in ("PointData", "CellData")
                for name, data in root.get(group, {}).items()
                if (group, name) not in static
            }
            if root["Points"].dtype != self._float:
                raise OutputFileError(f"'{self.path}' can't be resumed: its points are {root['Points'].dtype}.")
        self._frames_in_file = len(times)
        self._frames = int(np.searchsorted(times, until, side="right"))
        self._last_time = float(times[self._frames - 1]) if self._frames else -np.inf

    def write_frame(
        self,
        time: float,
        points: npt.ArrayLike,
        *,
        point_data: Mapping[str, npt.ArrayLike] | None = None,
        cell_data: Mapping[str, npt.ArrayLike] | None = None,
    ) -> None:
        """Adds one step: wholly when it returns, not at all when it raises.

        Args:
            time: in seconds (or the user's unit), greater than that of the frame before.
            points: positions, shape [n, 3], finite.
            point_data: name -> [n] or [n, c]; the same names, shapes and types in every frame.
            cell_data: name -> [m] or [m, c] over all cells, in the order in which the kinds were given.

        Raises:
            OutputFileError: a wrong shape, NaN or infinity, names that differ from those of the first frame, a
                time that does not grow, a file that can't be written, or a series that is closed.
        """
        if self._closed:
            raise OutputFileError(f"'{self.path.name}' is closed: no frame can be added after close().")
        if not np.isfinite(time) or time <= self._last_time:
            raise OutputFileError(
                f"The time of frame {self._frames} of '{self.path.name}' is {time}; it must be finite and "
                f"greater than that of the frame before ({self._last_time})."
            )
        positions = self._checked("points", points, self.number_of_points)
        if positions.shape != (self.number_of_points, 3):
            raise OutputFileError(
                f"The points of frame {self._frames} have shape {list(positions.shape)}, expected "
                f"[{self.number_of_points}, 3]. {FIXED_CELLS}"
            )
        on_points = self._data("point_data", point_data, self.number_of_points)
        on_cells = self._data("cell_data", cell_data, self.number_of_cells)
        frame = grouped(on_points, on_cells)
        positions = positions.astype(self._float, copy=False)
        self._check_same_data(frame)

        try:
            if self._frames == 0:
                # Built under another name and then renamed: no reader ever sees a file without a frame.
                unfinished = self.path.with_name(f".{self.path.name}.unfinished")
                try:
                    with h5py.File(unfinished, "w") as file:
                        self._write_layout(file, frame)
                        self._append(file, float(time), positions, frame)
                    unfinished.replace(self.path)
                finally:
                    unfinished.unlink(missing_ok=True)
            else:
                with h5py.File(self.path, "r+") as file:
                    self._check_is_ours(file)
                    self._put_notes(file)
                    if self._frames_in_file > self._frames:
                        # On the disk, before rows of frames that are cut off are written over: a kill may follow.
                        _set_steps(file["VTKHDF/Steps"], self._frames)
                        file.flush()
                    try:
                        self._append(file, float(time), positions, frame)
                    except BaseException:
                        # Ctrl-C too: VTK 9.7 crashes where there are more times than NSteps.
                        _set_steps(file["VTKHDF/Steps"], self._frames)
                        raise
        except (OSError, KeyError, RuntimeError, ValueError, TypeError, AttributeError) as error:  # h5py's, of damage
            raise OutputFileError(f"Frame {self._frames} could not be written to '{self.path}': {error}") from error
        self._declared = {key: (a.shape[1:], a.dtype) for key, a in frame.items()}
        self._last_time = float(time)
        self._frames += 1
        self._frames_in_file = self._frames

    def _check_is_ours(self, file: h5py.File) -> None:
        steps = file.get("VTKHDF/Steps")
        frames = steps.attrs.get("NSteps", -1) if isinstance(steps, h5py.Group) else -1
        if not np.array_equal(frames, self._frames_in_file):
            raise OutputFileError(
                f"Frame {self._frames} was not written: '{self.path}' is not the series of {self._frames_in_file} "
                "frames that was written there. Something else has changed the file; begin a new series under another "
                "name."
            )

    def close(self) -> None:
        """Ends the series. The file itself is already closed, as after every frame."""
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _checked(self, what: str, values: npt.ArrayLike, rows: int) -> Array:
        """`values` as an array of a storable type with `rows` rows and no NaN."""
        array: Array = plain_array(values, what, OutputFileError)
        if array.dtype.kind == "b":
            array = array.astype(np.uint8)
        elif array.dtype.kind in "iu":
            if array.size and array.max() > np.iinfo(np.int64).max:
                raise OutputFileError(f"{what} holds {array.max()}, more than the file's signed 64-bit integers do.")
            array = array.astype(np.int64)
        elif array.dtype.kind == "f":
            # What is too great for 4 bytes becomes infinite, which the test below reports.
            with np.errstate(over="ignore"):
                array = array.astype(self._float if array.dtype.itemsize > 4 else np.float32)
        else:
            raise OutputFileError(f"{what} has type {array.dtype}; only numbers and booleans can be written.")
        if array.ndim not in (1, 2) or len(array) != rows or array.size == 0:
            raise OutputFileError(
                f"{what} has shape {list(array.shape)}, expected [{rows}] or [{rows}, components]. {FIXED_CELLS}"
            )
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            row = int(np.argwhere(~np.isfinite(array))[0, 0])
            raise OutputFileError(
                f"{what} is not finite (NaN or infinite in {array.dtype}) at row {row}: {array[row]}. "
                "The simulation has most likely diverged; the frame was not written."
            )
        return array

    def _data(self, argument: str, data: Mapping[str, npt.ArrayLike] | None, rows: int) -> dict[str, Array]:
        checked: dict[str, Array] = {}
        for name, values in (data or {}).items():
            if not name or "/" in name or name == ".":
                raise OutputFileError(f"The name '{name}' in {argument} must not be empty, be '.' or hold a '/'.")
            checked[name] = self._checked(f"{argument}['{name}']", values, rows)
        return checked

    def _check_same_data(self, frame: Mapping[tuple[str, str], Array]) -> None:
        for group, name in frame.keys() & grouped(self._static_points, self._static_cells).keys():
            raise OutputFileError(f"{group} '{name}' is static data of this series: no frame can bring its own.")
        if self._frames == 0:
            return
        if frame.keys() != self._declared.keys():
            raise OutputFileError(
                f"Frame {self._frames} has the data {sorted(frame)}, but the first had "
                f"{sorted(self._declared)}. Every frame of a series must hold the same data."
            )
        for key, array in frame.items():
            columns, dtype = self._declared[key]
            if (array.shape[1:], array.dtype) != (columns, dtype):
                raise OutputFileError(
                    f"{key[0]} '{key[1]}' of frame {self._frames} has components {list(array.shape[1:])} of "
                    f"type {array.dtype}, but {list(columns)} of type {dtype} in the first frame."
                )

    def _write_layout(self, file: h5py.File, frame: Mapping[tuple[str, str], Array]) -> None:
        """Everything that does not change with the frames, and empty arrays for what does."""
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], dtype=np.int64)
        # VTK wants a fixed-length ASCII string; a Python str would be stored with variable length.
        root.attrs["Type"] = np.bytes_("UnstructuredGrid")
        root["NumberOfPoints"] = np.array([self.number_of_points], dtype=np.int64)
        root["NumberOfCells"] = np.array([self.number_of_cells], dtype=np.int64)
        root["NumberOfConnectivityIds"] = np.array([len(self._connectivity)], dtype=np.int64)
        _growing(root, "Points", (self.number_of_points, 3), self._float)
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(0)
        _growing(steps, "Values", (1,), np.dtype(np.float64))
        for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
            _growing(steps, name, (1,), np.dtype(np.int64))
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            _growing(steps, name, (1, 1), np.dtype(np.int64))
        static = grouped(self._static_points, self._static_cells)
        for name, array in self._fixed().items():
            file[name] = array
        for (group, name), array in frame.items():
            _growing(root.require_group(group), name, array.shape, array.dtype)
        for group, name in (*static, *frame):
            _growing(steps.require_group(f"{group}Offsets"), name, (1,), np.dtype(np.int64))
        for name, array in self._beside.items():
            file[f"{BESIDE}/{name}"] = array.item() if array.dtype.kind == "U" else array
        self._put_notes(file)

    def _put_notes(self, file: h5py.File) -> None:
        """Writes notes that are not there as they are now; that is so at the first frame of a series alone."""
        for name, text in self._notes.items():
            if not holds(file, f"{BESIDE}/{name}", np.asarray(text)):
                file.require_group(BESIDE).pop(name, None)
                file[f"{BESIDE}/{name}"] = text

    def _fixed(self) -> dict[str, Array]:
        """What does not change with the frames, by path in the file."""
        cells = {"Connectivity": self._connectivity, "Offsets": self._offsets, "Types": self._types}
        static = grouped(self._static_points, self._static_cells)
        return {
            **{f"VTKHDF/{name}": array for name, array in cells.items()},
            **{f"VTKHDF/{group}/{name}": array for (group, name), array in static.items()},
        }

    def _append(self, file: h5py.File, time: float, positions: Array, frame: Mapping[tuple[str, str], Array]) -> None:
        root = file["VTKHDF"]
        steps = root["Steps"]
        index = self._frames
        # Rows are addressed from the number of whole frames: what a failed attempt left is written over.
        _put(root["Points"], index * self.number_of_points, positions)
        for (group, name), array in frame.items():
            _put(root[group][name], index * len(array), array)
            _put(steps[f"{group}Offsets"][name], index, np.array([index * len(array)]))
        for group, name in grouped(self._static_points, self._static_cells):
            _put(steps[f"{group}Offsets"][name], index, np.array([0]))
        _put(steps["PointOffsets"], index, np.array([index * self.number_of_points]))
        _put(steps["PartOffsets"], index, np.array([0]))
        _put(steps["NumberOfParts"], index, np.array([1]))
        _put(steps["CellOffsets"], index, np.array([[0]]))
        _put(steps["ConnectivityIdOffsets"], index, np.array([[0]]))
        file.flush()
        # Both leave when the file closes: HDF5 writes these few bytes at once, or else NSteps first.
        steps.attrs.modify("NSteps", np.int64(index + 1))
        _put(steps["Values"], index, np.array([time]))


def _growing(group: h5py.Group, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """An empty array to which frames of `shape` will be added along the first axis."""
    rows = _STEPS_PER_CHUNK if shape[0] == 1 else min(shape[0], _LARGEST_CHUNK)
    columns = shape[1:]
    group.create_dataset(name, shape=(0, *columns), maxshape=(None, *columns), chunks=(rows, *columns), dtype=dtype)


def _set_steps(steps: h5py.Group, frames: int) -> None:
    """Makes `frames` the number of steps that readers see; what lies behind them is written over later."""
    if len(steps["Values"]) > frames:
        steps["Values"].resize(frames, axis=0)
    steps.attrs.modify("NSteps", np.int64(frames))


def _put(dataset: h5py.Dataset, first: int, rows: Array) -> None:
    dataset.resize(first + len(rows), axis=0)
    dataset[first : first + len(rows)] = rows
