"""The barrier that the solver's threads meet at."""

from __future__ import annotations

import subprocess
import sys

import pytest

from yasps.runtime.build.cuda.sources import with_includes
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link

ROUNDS = r"""
#include <unistd.h>

#include "core/team_barrier.h"

// In each round every thread writes its place, waits, reads all places and waits. Returns how many were not written.
// Some rounds have a thread that comes so late that the others sleep; between two of these there are many quick ones.
extern "C" long missed(int threads, long rounds) {
    yasps::TeamBarrier barrier;
    yasps::Buffer<long> places;
    if (!places.reserve_zero(threads)) return -1;
    long missed = 0;
#pragma omp parallel num_threads(threads) reduction(+ : missed)
    {
        const long thread = omp_get_thread_num(), team = omp_get_num_threads();
        for (long round = 1; round <= rounds; ++round) {
            if (round % 32 == 0 && round / 32 % team == thread) usleep(1000);
            places[thread] = round;
            barrier.wait();
            for (long k = 0; k < team; ++k) missed += places[k] != round;
            barrier.wait();
        }
    }
    return missed;
}
"""


@pytest.fixture(scope="module")
def library(compiler: Compiler) -> str:
    """The path of `missed`."""
    if not compiler.has_openmp:
        pytest.skip("there is one thread without OpenMP")
    parallel = compiler.with_flags("-fopenmp")
    return str(link(compile_sources([Source("rounds", with_includes(ROUNDS))], parallel), parallel).path)


@pytest.mark.parametrize("threads", [1, 2, 3, 5, 16])
def test_nobody_goes_on_before_all_have_come(library: str, threads: int) -> None:
    # In a process of its own, since a mistake may make it wait for ever.
    call = f"import ctypes; print(ctypes.CDLL({library!r}).missed({threads}, ctypes.c_long(256)))"
    done = subprocess.run([sys.executable, "-c", call], capture_output=True, text=True, timeout=30, check=True)
    assert done.stdout == "0\n"
