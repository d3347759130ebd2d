"""An order of the dof blocks in which coupled ones stand close to each other, and an order of elements along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Vectors of fewer blocks stay in the processor's cache in any order.
FEWEST_BLOCKS = 2000
# The mean distance of coupled blocks must shrink at least to this share to be worth a new order: where elements are
# numbered along with their vertices, as in a regular grid, the given order has more locality in the assembly.
_GAIN = 0.5
# Elements are sorted where the step from one to the next is on average more than this share of all dof blocks: what
# nearer ones touch is in the cache in any order.
_LONGEST_STEP = 1 / 64
# SciPy's graphs count their entries with 32 bits.
_MOST_ENTRIES = 2**31 - 1


def bandwidth_reducing_order(
    rows: NDArray[np.integer], cols: NDArray[np.integer], count: int
) -> NDArray[np.int32] | None:
    """The new number of each of `count` dof blocks, int32 [count]; None where the given order is about as good, or the
    pairs are too many for SciPy.

    rows, cols: the coupled pairs, in one triangle or both; duplicates and diagonal ones do no harm. The order is
    reverse Cuthill-McKee (George & Liu 1981, Computer Solution of Large Sparse Positive Definite Systems, sec. 4.3):
    products then find their part of a vector in the cache, and threads that each take a range of rows share few
    columns.
    """
    from scipy import sparse
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    if 2 * len(rows) > _MOST_ENTRIES:  # both triangles
        return None
    graph = sparse.coo_array((np.ones(len(rows), np.bool_), (rows, cols)), shape=(count, count)).tocsr()
    both: sparse.csr_array[np.bool_] = (graph + graph.T).tocsr()
    order = np.empty(count, np.int32)
    order[reverse_cuthill_mckee(sparse.csr_matrix(both), symmetric_mode=True)] = np.arange(count, dtype=np.int32)
    before = np.abs(rows - cols).sum(dtype=np.int64)
    after = np.abs(order[rows] - order[cols]).sum(dtype=np.int64)
    return order if after < _GAIN * before else None


def instance_order(
    kappa: NDArray[np.int32], block_size_at: NDArray[np.int32], order: NDArray[np.int32] | None
) -> NDArray[np.int64] | None:
    """An order of instances by the first of the dof blocks that each contributes to, int64 [n]; None where the given
    order is about as good.

    kappa: int32 [n, c], 1-based scalar offsets of dof blocks, 0 = no contribution; block_size_at: int32 [unknowns], as
    `BlockMatrix` has it; order: the place of each dof block, None where that is the order of the scalars.
    """
    if len(kappa) < FEWEST_BLOCKS:
        return None
    number_at = np.cumsum(block_size_at > 0, dtype=np.int32) - 1
    count = int(number_at[-1]) + 1
    place = number_at if order is None else order[number_at]
    place = np.append(place, np.int32(count))  # of what does not contribute: kappa - 1 is -1 then
    first = place[kappa[:, 0] - 1]
    for slot in kappa.T[1:]:
        np.minimum(first, place[slot - 1], out=first)
    if np.abs(np.diff(first)).mean() <= _LONGEST_STEP * count:
        return None
    # By the lower, then by the upper half: numbers of 16 bits are sorted in linear time, tenfold faster.
    by_first = np.argsort(first.astype(np.uint16), kind="stable")
    if count > np.iinfo(np.uint16).max:
        by_first = by_first[np.argsort((first >> 16).astype(np.uint16)[by_first], kind="stable")]
    return by_first
