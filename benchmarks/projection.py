"""Projection onto the positive semidefinite cone, ns per matrix: what the width costs, beside Eigen and NumPy.

The paper's figure 23: a contact of two points over free vertices and affine bodies may be projected in all unknowns
that it could have (24), in those that it does have (15 or 6), or in the smallest linear cut.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.element_problem import FloatArray
from benchmarks.element_rows import check_close
from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.projection_peers import EigenProjection, eigen_projection, numpy_projection
from benchmarks.sympy_kernel import EigenNotFoundError
from yasps.frontend.commands.environment_report import cpu_model
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, find_compiler, link
from yasps.runtime.core.library import LANES, Runtime, available_processors, load_runtime

DESCRIPTION = "projection onto the PSD cone by width and by share that fails, ns per matrix, beside Eigen and NumPy"
DEFAULT_SIZE = 256  # matrices of each kind
WIDTHS = (3, 6, 9, 12, 15, 24)
SHARES = (0.0, 0.25, 1.0)
CHUNK = 128  # matrices projected with one call, as generated kernels do
PASSES = 16  # over the matrices in one timed run of yasps: after the first they are in the cache, as in a kernel

UNIT = "ns/matrix"
NOTES = (
    "A share of the matrices, scattered, has one to w / 2 negative eigenvalues; the others have none.",
    f"yasps: eight interleaved upper triangles, {CHUNK} matrices with one call, in place; they are first copied there, "
    f"which is part of the time and also given by itself (copy). {PASSES} passes over the matrices in each round.",
    "Eigen: SelfAdjointEigenSolver of fixed size, one matrix after the other, same compiler and flags; the projection "
    "is put together only where an eigenvalue is negative. NumPy: one eigh of them all.",
    "Figure 23: point-point contact in 24 unknowns (two affine bodies), 15 (one), 6 (none); yasps projects it in 3.",
)

# Copies and projects chunk by chunk, so that calls from Python do not count.
_HARNESS = """\
#include <string.h>
extern "C" long yasps_benchmark_projection(long (*project)(double*, int, int, int), const double* from, double* to,
                                           long count, int width, long chunk, long passes) {
    const long entries = width * (width + 1L) / 2;
    long changed = 0;
    for (long pass = 0; pass < passes; ++pass)
        for (long first = 0; first < count; first += chunk) {
            const long lanes = count - first < chunk ? count - first : chunk;
            const long doubles = (lanes + 7) / 8 * 8 * entries;
            memcpy(to + first * entries, from + first * entries, doubles * sizeof(double));
            if (project) changed += project(to + first * entries, width, (int)lanes, 0);
        }
    return changed;
}
"""


def random_matrices(count: int, width: int, share: float) -> FloatArray:
    """[count, w, w], symmetric, in random frames, eigenvalues of sizes 0.1 to 1; a share of them indefinite."""
    rng = np.random.default_rng(width)
    values = rng.uniform(0.1, 1.0, (count, width))
    negative = np.arange(width) < rng.integers(1, max(1, width // 2) + 1, (count, 1))
    values[negative & (rng.random((count, 1)) < share)] *= -1.0
    frames = np.linalg.qr(rng.standard_normal((count, width, width)))[0]
    matrices: FloatArray = (frames * values[:, None, :]) @ frames.swapaxes(1, 2)
    return 0.5 * (matrices + matrices.swapaxes(1, 2))


def packed(matrices: FloatArray) -> FloatArray:
    """[n, w, w] as [packs, w (w + 1) / 2, 8]; what is left over in the last pack is zero."""
    rows, cols = np.triu_indices(matrices.shape[1])
    triangles = np.zeros((-(-len(matrices) // LANES) * LANES, len(rows)))
    triangles[: len(matrices)] = matrices[:, rows, cols]
    return np.ascontiguousarray(triangles.reshape(-1, LANES, len(rows)).transpose(0, 2, 1))


def unpacked(packs: FloatArray, count: int, width: int) -> FloatArray:
    """The first `count` matrices of packs, [count, w, w]."""
    rows, cols = np.triu_indices(width)
    result = np.empty((count, width, width))
    result[:, rows, cols] = result[:, cols, rows] = packs.transpose(0, 2, 1).reshape(-1, len(rows))[:count]
    return result


@dataclass(frozen=True)
class Harness:
    """Calls the runtime's projection chunk by chunk."""

    runtime: Runtime
    function: Callable[..., int]

    def project(
        self, source: FloatArray, target: FloatArray, count: int, width: int, *, copy_only: bool, passes: int = 1
    ) -> int:
        """Copies packs and projects the copy, `passes` times over; returns the number of matrices changed."""
        project = None if copy_only else ctypes.cast(self.runtime.library.yasps_project, ctypes.c_void_p)
        return self.function(project, source.ctypes.data, target.ctypes.data, count, width, CHUNK, passes)


def make_harness(compiler: Compiler) -> Harness:
    """Compiles it."""
    objects = compile_sources([Source("benchmark.projection", _HARNESS)], compiler)
    function = ctypes.CDLL(str(link(objects, compiler).path)).yasps_benchmark_projection
    pointer = ctypes.c_void_p
    function.argtypes = (pointer, pointer, pointer, ctypes.c_long, ctypes.c_int, ctypes.c_long, ctypes.c_long)
    function.restype = ctypes.c_long
    return Harness(load_runtime(compiler, 1), function)


def run(settings: Settings) -> Report:
    """Times all widths and shares. Raises PeersDisagreeError."""
    compiler = find_compiler()
    harness = make_harness(compiler)
    eigen: EigenProjection | None = None
    try:
        eigen = eigen_projection(compiler, WIDTHS)
        about_eigen = f"Eigen {eigen.version}."
    except EigenNotFoundError as error:
        about_eigen = f"No rows for Eigen: {error}."
    rows: list[Row] = []
    for width in WIDTHS:
        for share in SHARES:
            rows += measure(_peers(harness, eigen, settings.size, width, share), settings.repeats)
    machine = f"{cpu_model()}, {available_processors()} processors; {compiler.version}; NumPy {np.__version__}."
    timing = f"{settings.size:,} matrices of each kind; least and median of {settings.repeats} rounds, one thread."
    return Report(rows, [timing, machine, about_eigen, *NOTES])


def _peers(harness: Harness, eigen: EigenProjection | None, count: int, width: int, share: float) -> list[Peer]:
    """What projects the same matrices, checked against each other."""
    matrices = random_matrices(count, width, share)
    source = packed(matrices)
    target = np.zeros_like(source)
    project = partial(harness.project, source, target, count, width)
    project(copy_only=False)
    ours = unpacked(target, count, width)
    check_close("projection", "NumPy", ours, numpy_projection(matrices))
    case = f"{width}x{width}, {share:.0%} fail"

    def peer(name: str, work: Callable[[], object], passes: int = 1) -> Peer:
        return Peer(case, name, 1, work, 1e9 / (count * passes), UNIT)

    peers = [
        peer("copy", partial(project, copy_only=True, passes=PASSES), PASSES),
        peer("yasps", partial(project, copy_only=False, passes=PASSES), PASSES),
    ]
    if eigen is not None:
        result = np.zeros_like(matrices)
        eigen.project(matrices, result)
        check_close("projection", "Eigen", ours, result)
        peers.append(peer("Eigen", partial(eigen.project, matrices, result)))
    peers.append(peer("NumPy", partial(numpy_projection, matrices)))
    return peers
