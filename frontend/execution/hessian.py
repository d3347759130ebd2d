"""Second derivatives of a scene's energy as a matrix of one's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from yasps.frontend.language.nodes import FloatArray
from yasps.runtime.matrix.block_matrix import BlockGroup

if TYPE_CHECKING:
    from scipy import sparse


@dataclass(frozen=True)
class HessianBlock:
    """All stored blocks of one shape: rows, cols [n] are the scalar offsets of their first entries; values [n, r, "
    "c]."""

    rows: NDArray[np.int32]
    cols: NDArray[np.int32]
    values: FloatArray


class Hessian:
    """A symmetric block-sparse matrix, rows and columns in the order of the minimisation targets.

    A copy: later solves don't change it. `blocks` holds the upper triangle (diagonal blocks in full); of one place
    there may be several blocks (a static and a dynamic part), which add up.
    """

    def __init__(self, size: int, groups: Sequence[BlockGroup]) -> None:
        self.shape = (size, size)
        self.blocks = []
        for group in groups:
            above = group.rows <= group.cols
            self.blocks.append(HessianBlock(group.rows[above], group.cols[above], group.values[above]))
            if not above.all():  # the solver's own order of unknowns decides which of two blocks is stored
                transposed = group.values[~above].transpose(0, 2, 1).copy()
                self.blocks.append(HessianBlock(group.cols[~above], group.rows[~above], transposed))

    def __repr__(self) -> str:
        stored = sum(len(block.rows) for block in self.blocks)
        return f"<Hessian {self.shape[0]} x {self.shape[1]}: {stored} blocks>"

    def to_scipy(self) -> sparse.csr_array[np.float64]:
        """The whole matrix, both triangles, as scipy.sparse."""
        from scipy import sparse

        rows, cols, values = [], [], []
        for block in self.blocks:
            _, r, c = block.values.shape
            i = np.broadcast_to(block.rows[:, None, None] + np.arange(r)[:, None], block.values.shape)
            j = np.broadcast_to(block.cols[:, None, None] + np.arange(c), block.values.shape)
            above = block.rows != block.cols
            rows += [i.ravel(), j[above].ravel()]
            cols += [j.ravel(), i[above].ravel()]
            values += [block.values.ravel(), block.values[above].ravel()]
        if not values:
            return sparse.csr_array(self.shape)
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols)))
        return sparse.csr_array(sparse.coo_array(entries, shape=self.shape))
