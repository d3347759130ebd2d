"""What a VTKHDF file of ours says about cells and data, and how both are laid out in it."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt

from yasps import YaspsError
from yasps.frontend.language.arrays import plain_array

Array = npt.NDArray[Any]

# Cell name (as in meshio) -> (number in vtkCellType.h, points per cell).
CELL_KINDS: Final[Mapping[str, tuple[int, int]]] = {
    "vertex": (1, 1),
    "line": (3, 2),
    "triangle": (5, 3),
    "tetra": (10, 4),
    "hexahedron": (12, 8),
    "triangle6": (22, 6),
    "tetra10": (24, 10),
}


BESIDE: Final = "yasps"
"""Group of what only yasps reads."""


class OutputFileError(YaspsError):
    """A frame or a mesh that can't be written to an output file, or a file that can't be made or read."""


FIXED_CELLS: Final = "A series has the same points and cells in all frames: begin another series for another mesh."


def flat_cells(cells: Mapping[str, npt.ArrayLike], number_of_points: int) -> tuple[Array, Array, Array]:
    """Connectivity, offsets (one more than there are cells) and VTK's cell numbers."""
    connectivity: list[Array] = []
    sizes: list[Array] = [np.zeros(1, dtype=np.int64)]
    types: list[Array] = []
    for name, values in cells.items():
        if name not in CELL_KINDS:
            raise OutputFileError(f"Unknown kind of cell '{name}'; known are {', '.join(CELL_KINDS)}.")
        number, arity = CELL_KINDS[name]
        array: Array = plain_array(values, f"The cells '{name}'", OutputFileError)
        if array.ndim != 2 or array.shape[1] != arity or array.dtype.kind not in "iu":
            raise OutputFileError(
                f"The cells '{name}' have shape {list(array.shape)} and type {array.dtype}, expected "
                f"integers (point numbers) of shape [cells, {arity}]."
            )
        if array.size and (array.min() < 0 or array.max() >= number_of_points):
            bad = int(np.argwhere((array < 0) | (array >= number_of_points))[0, 0])
            raise OutputFileError(
                f"Cell {bad} of '{name}' is {array[bad].tolist()}, but points are counted from 0 to "
                f"{number_of_points - 1}."
            )
        connectivity.append(array.astype(np.int64).ravel())
        sizes.append(np.full(len(array), arity, dtype=np.int64))
        types.append(np.full(len(array), number, dtype=np.uint8))
    if not sum(len(t) for t in types):
        raise OutputFileError("A series needs at least one cell: ParaView shows no points without cells.")
    return np.concatenate(connectivity), np.cumsum(np.concatenate(sizes)), np.concatenate(types)


def grouped(on_points: Mapping[str, Array], on_cells: Mapping[str, Array]) -> dict[tuple[str, str], Array]:
    """The data under (group of the file, name)."""
    found = {("PointData", name): array for name, array in on_points.items()}
    return found | {("CellData", name): array for name, array in on_cells.items()}


@contextmanager
def reading(path: Path) -> Iterator[h5py.File]:
    """The file, opened to be read. Raises OutputFileError for one that is not there, damaged, or no HDF5."""
    if not path.is_file():
        raise OutputFileError(f"There is no file '{path}' (looked from '{Path.cwd()}').")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, LookupError, RuntimeError, ValueError, TypeError, AttributeError) as error:  # h5py's, of damage
        raise OutputFileError(
            f"'{path}' can't be read as a series: it is damaged or something else. {error}"
        ) from error


def step_times(file: h5py.File, path: Path) -> Array:
    """Times of the whole frames [s], growing. Raises OutputFileError, or what h5py raises for damage."""
    root = file.get("VTKHDF")
    steps = root.get("Steps") if isinstance(root, h5py.Group) else None
    if not isinstance(steps, h5py.Group) or root.attrs.get("Type") != b"UnstructuredGrid":
        raise OutputFileError(f"'{path}' is no series that yasps wrote: it lacks the steps of an unstructured grid.")
    frames = int(steps.attrs["NSteps"])
    points = int(root["NumberOfPoints"][0])
    if not 0 <= frames <= len(steps["Values"]) or not 0 < points * max(frames, 1) <= len(root["Points"]):
        raise OutputFileError(f"'{path}' is damaged: it says that it has {frames} frames of {points} points.")
    times: Array = np.asarray(steps["Values"][:frames], np.float64)
    if not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise OutputFileError(f"'{path}' is damaged: the times of its frames don't grow.")
    return times


def holds(file: h5py.File, name: str, values: Array) -> bool:
    """Whether a dataset is there and has these values."""
    data = file.get(name)
    if not isinstance(data, h5py.Dataset):
        return False
    if values.dtype.kind == "U":
        return bool(data.shape == () and data.asstr()[()] == values.item())
    return data.shape == values.shape and bool(np.array_equal(data[()], values))
