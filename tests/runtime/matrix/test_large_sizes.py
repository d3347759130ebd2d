"""What would be too many for 32-bit numbers is refused, by its sizes alone: nothing large is made here."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from yasps.runtime.collision.surface_pairs import MOST_PAIRS, check_pair_count
from yasps.runtime.core.library import IntArray, Runtime
from yasps.runtime.matrix.block_matrix import MOST_LOCAL_BLOCKS, BlockMatrix, check_layout, check_local_blocks
from yasps.runtime.matrix.ordering import bandwidth_reducing_order
from yasps.runtime.solvers.direct import UpperSum


def claimed(*shape: int) -> IntArray:
    """Zeros of this shape in four bytes."""
    array: IntArray = np.broadcast_to(np.int32(0), shape)
    return array


@pytest.mark.parametrize(
    ("shapes", "fits"),
    [
        ([(2**32 - 2, 1)], True),
        ([(2**32 - 1, 1)], False),
        ([(429_496_729, 4)], True),  # ten local blocks each
        ([(429_496_730, 4)], False),
        ([(2**31, 1), (2**31 - 2, 1)], True),
        ([(2**31, 1), (2**31 - 1, 1)], False),
        ([(1, 92_681)], True),  # more than 2^32 - 2 from 92,682 slots on
        ([(1, 92_682)], False),
        ([(5,), (2**40, 0)], True),
    ],
)
def test_local_blocks_of_all_energies_are_counted(shapes: list[tuple[int, ...]], fits: bool) -> None:
    if fits:
        check_local_blocks(shapes, MOST_LOCAL_BLOCKS)
        return
    with pytest.raises(ValueError, match=f"local blocks, but at most {MOST_LOCAL_BLOCKS}"):
        check_local_blocks(shapes, MOST_LOCAL_BLOCKS)


def test_a_matrix_refuses_them_before_it_asks_for_memory(runtime: Runtime) -> None:
    matrix = BlockMatrix(runtime)
    with pytest.raises(ValueError, match="10737418240 local blocks"):
        matrix.build(np.array([0, 12]), np.array([3], np.int32), [claimed(2**30, 4)])
    assert matrix.size == 0


@pytest.mark.parametrize(("scalars", "block", "fits"), [(2**29 - 2, 3, True), (2**29 + 1, 3, False), (2**31, 1, False)])
def test_unknowns_are_counted(scalars: int, block: int, fits: bool) -> None:
    boundaries, sizes = np.array([0, scalars]), np.array([block], np.int32)
    if fits:
        check_layout(boundaries, sizes)
        return
    with pytest.raises(ValueError, match=f"{scalars} unknowns; the runtime can index at most"):
        check_layout(boundaries, sizes)


def test_scipy_orders_no_more_pairs_than_it_can_count() -> None:
    assert bandwidth_reducing_order(claimed(2**30), claimed(2**30), 10) is None


def test_a_direct_solver_refuses_more_entries_than_its_libraries_index() -> None:
    def part(blocks: int) -> BlockMatrix:
        group = SimpleNamespace(rows=claimed(blocks), cols=claimed(blocks), r=3, c=3)
        return cast(BlockMatrix, SimpleNamespace(groups=[group], size=30))

    most = (2**31 - 1 - 30) // 18
    with pytest.raises(
        ValueError, match=r"2147483647 entries of a matrix, and this one has about \d+: use solver='pcg'"
    ):
        UpperSum().follow([part(most + 1)])


def test_pairs_of_surface_pieces_are_counted() -> None:
    check_pair_count(MOST_PAIRS)
    with pytest.raises(MemoryError, match=f"at most {MOST_PAIRS} are numbered"):
        check_pair_count(MOST_PAIRS + 1)
