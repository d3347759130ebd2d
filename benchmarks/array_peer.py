"""What the benchmarks know of a peer that derives all local gradients and Hessians as arrays: JAX, PyTorch."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.element_problem import FloatArray


@dataclass(frozen=True)
class ArrayPeer:
    """Gradients [m, 3 c] and Hessians [m, 3 c, 3 c] of the first elements (c corners each), for positions [n, 3], on
    one thread or on a GPU.

    derive: as they are; derive_projected: with negative eigenvalues set to zero. resident: a function that does so
    (projected or not) for these positions and waits, with positions and results where the peer keeps them.
    """

    name: str
    version: str
    count: int
    derive: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    derive_projected: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    resident: Callable[[FloatArray, bool], Callable[[], object]]

    def processors_busy(self, x: FloatArray) -> float:
        """Processor time over wall time of `derive_projected`."""
        self.derive_projected(x)
        wall, cpu = time.perf_counter(), time.process_time()
        self.derive_projected(x)
        return (time.process_time() - cpu) / (time.perf_counter() - wall)
