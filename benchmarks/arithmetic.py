"""How fast one processor adds and multiplies: the floor under every kernel that is not bound by memory."""

from __future__ import annotations

import ctypes

from benchmarks.measure import Peer, Row, measure
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link

ROUNDS = 200_000
CHAINS = 12  # independent, so that none waits for another's result; all stay in registers
LANES = 8

# Additions and multiplications by turns, which no compiler can join to one instruction here: different chains.
_TEXT = f"""\
typedef double V __attribute__((vector_size(64)));
extern "C" void yasps_benchmark_arithmetic(long rounds, const double* start, double* out) {{
    V sums[{CHAINS}], products[{CHAINS}];
    const V step = start[0] - (V){{}}, factor = start[1] - (V){{}};
    for (int k = 0; k < {CHAINS}; ++k) sums[k] = products[k] = start[2] + k - (V){{}};
    for (long round = 0; round < rounds; ++round) {{
#pragma GCC unroll {CHAINS}
        for (int k = 0; k < {CHAINS}; ++k) {{
            sums[k] += step;
            products[k] *= factor;
        }}
    }}
    V total = {{}};
    for (int k = 0; k < {CHAINS}; ++k) total += sums[k] + products[k];
    for (int l = 0; l < {LANES}; ++l) out[l] = total[l];
}}
"""


def peak_arithmetic(compiler: Compiler, repeats: int) -> Row:
    """Operations a nanosecond (1e9 a second) of one thread: additions and multiplications, 8 lanes at a time.

    A fused multiply-add would count as two operations in one instruction; that is not counted on.
    """
    objects = compile_sources([Source("benchmark.arithmetic", _TEXT)], compiler.with_flags("-Wno-psabi"))
    function = ctypes.CDLL(str(link(objects, compiler).path)).yasps_benchmark_arithmetic
    function.argtypes = (ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p)
    function.restype = None
    start, out = (ctypes.c_double * 3)(1e-3, 1.0 + 1e-9, 1.0), (ctypes.c_double * LANES)()

    def run() -> None:
        function(ROUNDS, ctypes.addressof(start), ctypes.addressof(out))

    row = measure([Peer("peak arithmetic", "8 lanes", 1, run, 1.0, "s")], repeats)[0]
    done = 2 * CHAINS * LANES * ROUNDS / 1e9
    assert row.median is not None
    return Row(row.case, row.implementation, 1, done / row.value, "operations/ns", done / row.median)
