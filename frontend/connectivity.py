"""Connectivities: which instances of one primitive an instance of another refers to (paper, 4.4)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.frontend.errors import ConnectivityError
from yasps.frontend.spelling import both_spellings

if TYPE_CHECKING:
    from yasps.frontend.primitive import PrimitiveBase

IntArray = NDArray[np.int32]


@both_spellings
class Connectivity:
    """A map from each instance of `source` to `arity` instances of `target`."""

    def __init__(self, name: str, source: PrimitiveBase, target: PrimitiveBase, indices: ArrayLike, arity: int) -> None:
        self.name = name
        self.source = source
        self.target = target
        self.arity = arity
        self._indices = self._checked(indices)

    @property
    def path(self) -> str:
        """A name for messages and for the IR."""
        return f"{self.source.path}.{self.name}"

    @property
    def indices(self) -> IntArray:
        """Indices [instances of source, arity]; read-only, see `update_value`."""
        view = self._indices.view()
        view.flags.writeable = False
        return view

    def __repr__(self) -> str:
        return f"<connectivity {self.path}: {self.source.path} -> {self.arity} x {self.target.path}>"

    def update_value(self, indices: ArrayLike) -> None:
        """Replaces the indices; on a dynamic primitive the number of instances follows.

        Raises ConnectivityError for a wrong count, type or range; nothing is changed then.
        """
        self._replace(self._checked(indices))

    def _replace(self, checked: IntArray) -> None:
        self._indices = checked
        if self.source.follows_data:
            self.source.set_num_instances(len(checked))
        self.source.scene.connectivity_changed(self)

    def _checked(self, indices: ArrayLike) -> IntArray:
        try:
            array: NDArray[Any] = np.asarray(indices)
        except ValueError as error:
            raise ConnectivityError(
                f"{self.path} has arity {self.arity}, so every row needs {self.arity} indices, got a ragged list"
            ) from error
        if array.size == 0:
            array = array.astype(np.int32)
        if array.dtype.kind not in "iu":
            raise ConnectivityError(
                f"{self.path} holds indices, which are integers, got {array.dtype}; convert them, e.g. by "
                "array.astype(int)"
            )
        if array.ndim == 2 and array.shape[1] != self.arity:
            raise ConnectivityError(
                f"{self.path} has arity {self.arity}, but the rows have {array.shape[1]} indices each"
            )
        if array.ndim > 2 or array.size % self.arity:
            raise ConnectivityError(
                f"{self.path} has arity {self.arity}; {array.size} indices of shape {array.shape} don't fill whole rows"
            )
        rows = array.reshape(-1, self.arity)
        if not self.source.follows_data and len(rows) != self.source.num_instances:
            raise ConnectivityError(
                f"{self.path} needs {self.source.num_instances} x {self.arity} indices, one row for each instance of "
                f"{self.source.path}, got {len(rows)} rows"
            )
        self._check_range(rows, "")
        return np.ascontiguousarray(rows, dtype=np.int32).copy()

    def check_consistent(self) -> None:
        """Raises ConnectivityError if source or target have changed their number of instances and the indices have not.

        Indices are checked when they are given; a dynamic target may shrink afterwards.
        """
        if len(self._indices) != self.source.num_instances:
            raise ConnectivityError(
                f"{self.source.label} has {self.source.num_instances} instances, but {self.path} has rows for "
                f"{len(self._indices)}; set all parts together with update(...)"
            )
        self._check_range(self._indices, ": it has shrunk since they were set; give the connectivity new ones")

    def _check_range(self, rows: NDArray[Any], advice: str) -> None:
        count = self.target.num_instances
        wrong = np.argwhere((rows < 0) | (rows >= count))
        if len(wrong):
            row, slot = wrong[0]
            valid = f"valid are 0..{count - 1}" if count else "so none is valid"
            raise ConnectivityError(
                f"{self.path}: index {rows[row, slot]} of instance {row} (slot {slot}) is out of range; "
                f"{self.target.label} has {count} instances, {valid} ({len(wrong)} indices are out of range){advice}"
            )
