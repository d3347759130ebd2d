"""How fast this machine copies memory: the floor under every kernel that is not bound by arithmetic."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from benchmarks.measure import Peer, Row, measure

COPIED_BYTES = 1 << 27  # four times the last cache of most machines, each way


def memory_bandwidth(threads: int, repeats: int) -> Row:
    """GB/s (1e9) of a copy, bytes read plus bytes written, on this many threads.

    The processor may also read what is going to be overwritten; as usual (STREAM) that is not counted.
    """
    source = np.ones(COPIED_BYTES // 8)
    copy = np.zeros_like(source)
    pieces = list(zip(np.array_split(source, threads), np.array_split(copy, threads), strict=True))

    with ThreadPoolExecutor(threads) as pool:

        def run() -> None:
            # NumPy lets other threads run while it copies.
            list(pool.map(lambda pair: np.copyto(pair[1], pair[0]), pieces))

        row = measure([Peer("memory bandwidth", "copy", threads, run, 1.0, "s")], repeats)[0]
    moved = 2 * source.nbytes / 1e9
    assert row.median is not None
    return Row(row.case, row.implementation, threads, moved / row.value, "GB/s", moved / row.median)
