"""Connectivities: which instances of one primitive an instance of another refers to (paper, 4.4)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.frontend.errors import ConnectivityError
from yasps.frontend.language.arrays import plain_array
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.paper_names import ConnectivityNames
from yasps.frontend.language.scene_lock import SceneLock, one_thread_at_a_time
from yasps.frontend.language.spelling import both_spellings
from yasps.runtime.device.foreign_arrays import DeviceIndices, ForeignArrayError, device_indices, is_on_device

if TYPE_CHECKING:
    from yasps.frontend.language.primitive import PrimitiveBase

IntArray = NDArray[np.int32]


@both_spellings
class Connectivity(ConnectivityNames, InScene):
    """A map from each instance of `source` to `arity` instances of `target`.

    Of a variable arity (`is_variable`), `arity` is the largest number of instances one refers to.
    """

    def __init__(
        self,
        name: str,
        source: PrimitiveBase,
        target: PrimitiveBase,
        indices: ArrayLike,
        *,
        arity: int | None = None,
        counts: ArrayLike | None = None,
        longest: int = 1,
    ) -> None:
        self.name = name
        self.source = source
        self.target = target
        self.is_variable = arity is None
        self.needs_neighbours = False
        """Is some mean taken through it? Then no instance may be connected to nothing."""
        self.arity = arity if arity is not None else 1
        self.compiled_arity = longest
        """The longest row that code was compiled for, or will be; rows of a variable arity never get shorter."""
        self._fits: tuple[IntArray, int] | None = None  # indices and the number of target instances they fit
        self._indices: IntArray | DeviceIndices
        if counts is not None:
            self._indices = self._checked_variable(indices, counts)
        else:
            self._indices = self._checked_on_device(indices) if is_on_device(indices) else self._checked(indices)
        if self.is_variable:
            self._take_rows(self._indices)

    @property
    def _lock(self) -> SceneLock:
        return self.source.scene.lock

    @property
    def path(self) -> str:
        """A name for messages and for the IR."""
        return f"{self.source.path}.{self.name}"

    @property
    @one_thread_at_a_time
    def indices(self) -> IntArray:
        """Indices [instances of source, arity]; read-only, see `update_value`.

        Of a variable arity, rows are as long as the longest and -1 fills them up. Those that were given as an array on
        a device are copied from there.
        """
        if isinstance(self._indices, DeviceIndices):
            copied = np.empty(self._indices.shape, np.int32)
            if copied.size:
                self.source.scene.device.download(self._indices.address, copied)
            return copied
        view = self._indices.view()
        view.flags.writeable = False
        return view

    @property
    def stored_indices(self) -> IntArray | DeviceIndices:
        """The same, where they are, and the same object until they are replaced."""
        return self._indices

    def __repr__(self) -> str:
        return f"<connectivity {self.path}: {self.source.path} -> {self.arity} x {self.target.path}>"

    @one_thread_at_a_time
    def update_value(self, indices: ArrayLike, counts: ArrayLike | None = None) -> None:
        """Replaces the indices (of a variable arity, with the counts); on a dynamic primitive the number of instances
        follows.

        In a scene on a GPU, indices of a fixed arity may be an int32 array there (`__cuda_array_interface__` or DLPack:
        CuPy, PyTorch, JAX, Warp). It is not copied, so leave it as it is and give a new one for new indices; its range
        is checked on the device, before the next result.

        Raises ConnectivityError for a wrong count, type or range; nothing is changed then.
        """
        self._replace(self.checked_parts(indices if counts is None else (indices, counts)))

    def checked_parts(self, value: Any) -> IntArray | DeviceIndices:
        """Rows of indices from what a user gives: indices, or (indices, counts) of a variable arity."""
        if not self.is_variable:
            if isinstance(value, DeviceIndices) or is_on_device(value):
                return self._checked_on_device(value)
            if isinstance(value, tuple) and len(value) == 2 and np.ndim(value[0]) > 0 and np.ndim(value[1]) > 0:
                raise ConnectivityError(f"{self.path} has the fixed arity {self.arity} and takes no counts")
            return self._checked(value)
        if not (isinstance(value, tuple) and len(value) == 2):
            raise ConnectivityError(f"{self.path} has a variable arity: give (indices, counts)")
        return self._checked_variable(*value)

    def _replace(self, checked: IntArray | DeviceIndices) -> None:
        self._take_rows(checked)
        if self.source.follows_data:
            self.source.set_num_instances(len(checked))
        self.source.scene.connectivity_changed(self)

    def _take_rows(self, checked: IntArray | DeviceIndices) -> None:
        """Keeps what `checked_parts` returned, of a variable arity as long as code expects, and tells nobody."""
        if self.is_variable:
            assert isinstance(checked, np.ndarray)
            self.arity = max(self.compiled_arity, checked.shape[1])
            checked = _filled_up(checked, self.arity)
        self._indices = checked

    def _checked_on_device(self, value: object) -> DeviceIndices:
        """Indices of an array on a device, but for their range."""
        if not self.source.scene.is_on_device:
            raise ConnectivityError(
                f"{self.path} got an array on a GPU, but {self.source.scene.label} runs on the CPU: give a NumPy "
                "array, or make the scene with device='cuda'"
            )
        try:
            array = value if isinstance(value, DeviceIndices) else device_indices(value, self.source.scene.device)
        except ForeignArrayError as error:
            raise ConnectivityError(f"{self.path}: {error}") from error
        if len(array.shape) not in (1, 2) or (len(array.shape) == 2 and array.shape[1] != self.arity):
            raise ConnectivityError(f"{self.path} has arity {self.arity}, but got an array of shape {array.shape}")
        if array.size % self.arity:
            raise ConnectivityError(f"{self.path} has arity {self.arity}; {array.size} indices don't fill whole rows")
        rows = array.in_rows_of(self.arity)
        self._check_count(len(rows))
        return rows

    def _check_count(self, rows: int) -> None:
        if not self.source.follows_data and rows != self.source.num_instances:
            raise ConnectivityError(
                f"{self.path} needs {self.source.num_instances} x {self.arity} indices, one row for each instance of "
                f"{self.source.path}, got {rows} rows"
            )

    def _checked(self, indices: ArrayLike) -> IntArray:
        array: NDArray[Any] = plain_array(indices, f"{self.path}, of arity {self.arity},", ConnectivityError)
        if array.size == 0:
            array = array.astype(np.int32)
        if array.dtype.kind not in "iu":
            raise ConnectivityError(
                f"{self.path} holds indices, which are integers, got {array.dtype}; convert them, e.g. by "
                "array.astype(int)"
            )
        if array.ndim == 2 and array.shape[1] != self.arity:
            raise ConnectivityError(
                f"{self.path} has arity {self.arity}, but the rows have {array.shape[1]} indices each: the array has "
                f"shape {array.shape}, and (instances, {self.arity}) is taken"
            )
        if array.ndim not in (1, 2) or array.size % self.arity:
            raise ConnectivityError(
                f"{self.path} has arity {self.arity}; {array.size} indices of shape {array.shape} don't fill whole "
                f"rows: give them flat, or as rows in shape (instances, {self.arity})"
            )
        rows = array.reshape(-1, self.arity)
        self._check_count(len(rows))
        self._check_range(rows, "")
        checked = np.array(rows, np.int32, order="C")
        self._fits = checked, self.target.num_instances
        return checked

    def _checked_variable(self, indices: ArrayLike, counts: ArrayLike) -> IntArray:
        """Rows filled up with -1 from flat indices and how many of them each instance has (CSR)."""
        flat: NDArray[Any] = plain_array(indices, f"{self.path}: indices", ConnectivityError)
        lengths: NDArray[Any] = plain_array(counts, f"{self.path}: counts", ConnectivityError)
        for array, what in ((flat, "indices"), (lengths, "counts")):
            if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
                raise ConnectivityError(
                    f"{self.path}: {what} must be one flat list of integers, got {array.dtype} {array.shape}"
                )
        if lengths.size and lengths.min() < 0:
            raise ConnectivityError(
                f"{self.path}: count {lengths.min()} of instance {int(lengths.argmin())} is negative"
            )
        if self.needs_neighbours and lengths.size and lengths.min() == 0:
            raise ConnectivityError(
                f"{self.path}: instance {int(lengths.argmin())} is connected to nothing, and a mean is taken through "
                "this "
                "connectivity"
            )
        total = sum(lengths.tolist())  # of Python integers, which don't overflow
        if total != flat.size:
            raise ConnectivityError(f"{self.path}: the counts add up to {total}, but there are {flat.size} indices")
        if not self.source.follows_data and lengths.size != self.source.num_instances:
            raise ConnectivityError(
                f"{self.path} needs {self.source.num_instances} counts, one for each instance of {self.source.path}, "
                "got "
                f"{lengths.size}"
            )
        wrong = np.flatnonzero((flat < 0) | (flat >= self.target.num_instances))
        if len(wrong):
            row = int(np.searchsorted(np.cumsum(lengths), wrong[0], side="right"))
            raise ConnectivityError(
                f"{self.path}: index {flat[wrong[0]]} of instance {row} is out of range; {self.target.label} has "
                f"{self.target.num_instances} instances"
            )
        longest = max(1, int(lengths.max(initial=0)))
        try:
            rows = np.full((lengths.size, longest), -1, np.int32)
            rows[np.arange(longest) < lengths[:, None]] = flat
        except MemoryError as error:
            raise ConnectivityError(
                f"{self.path}: {lengths.size} rows, each as long as the longest, {longest}, don't fit into memory; "
                "connect the few instances with so many neighbours through a primitive of their own"
            ) from error
        return rows

    def check_consistent(self) -> None:
        """Raises ConnectivityError if source or target have changed their number of instances and the indices have not.

        Indices are checked when they are given; a dynamic target may shrink afterwards.
        """
        if len(self._indices) != self.source.num_instances:
            raise ConnectivityError(
                f"{self.source.label} has {self.source.num_instances} instances, but {self.path} has rows for "
                f"{len(self._indices)}; set all parts together with update(...)"
            )
        if isinstance(self._indices, DeviceIndices):
            return  # looked at on the device
        if self._fits is None or self._fits[0] is not self._indices or self._fits[1] != self.target.num_instances:
            self._check_range(self._indices, ": it has shrunk since they were set; give the connectivity new ones")
            self._fits = self._indices, self.target.num_instances

    def _check_range(self, rows: NDArray[Any], advice: str) -> None:
        count = self.target.num_instances
        lowest = -1 if self.is_variable else 0
        if rows.size and (rows.min() < lowest or rows.max() >= count):
            wrong = np.argwhere((rows < lowest) | (rows >= count))
            row, slot = wrong[0]
            valid = f"valid are 0..{count - 1}" if count else "so none is valid"
            raise ConnectivityError(
                f"{self.path}: index {rows[row, slot]} of instance {row} (slot {slot}) is out of range; "
                f"{self.target.label} has {count} instances, {valid} ({len(wrong)} indices are out of range){advice}"
            )


def _filled_up(rows: IntArray, length: int) -> IntArray:
    """Rows of this length, filled up with -1."""
    return np.ascontiguousarray(np.pad(rows, ((0, 0), (0, length - rows.shape[1])), constant_values=-1))
