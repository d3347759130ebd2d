"""Products with the Hessian of growing numbers of bunnies in several formats: the paper's figure 30."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.plots import Curves
from benchmarks.spmv import Case, check_product, make_case, moved_bytes, product_peer
from benchmarks.spmv_peers import FloatArray
from yasps.frontend.commands.environment_report import cpu_model
from yasps.meshes import TetrahedralMesh, rabbit, read_tetrahedral_mesh
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, find_compiler, link
from yasps.runtime.core.library import available_processors, load_runtime

DESCRIPTION = "the paper's figure 30: products with the Hessian of growing numbers of bunnies, in several formats"
DEFAULT_SIZE = 5_000  # vertices of a bunny
BUNNIES = (1, 2, 4)
UNIT = "ms"
NOTES = (
    "--size: vertices of a bunny, 19,193 in the paper (--mesh bunny_19k.msh). Vertices of all are permuted at random, "
    "as there. The sparsity of tets with 3 unknowns a vertex, 3 x 3 blocks in double precision; random values.",
    "BCSR, BCOO: plain C++ loops over blocks, unrolled, by rows or one block after another, compiled as yasps' are. "
    "half: the upper triangle, each block used twice; full: both. yasps: upper triangle, reordered by itself, with "
    "what it takes to bring vectors there and back; not reordered: as given. One thread, processor time.",
    "The text gives no numbers. It says that YASPS is faster than all of cuSPARSE's formats and its own BCSR and BCOO "
    "kernels, the closest being BCOO of the upper triangle. bytes: of the upper blocks, their columns, and vectors.",
)

_KERNELS = """\
template <bool kHalf>
static void bcsr(long rows, const long* start, const int* column, const double* blocks, const double* x, double* y) {
    for (long r = 0; r < rows; ++r) {
        double a = 0, b = 0, c = 0;
        const double u = x[3 * r], v = x[3 * r + 1], w = x[3 * r + 2];
        for (long k = start[r]; k < start[r + 1]; ++k) {
            const double *const h = blocks + 9 * k, *const at = x + 3L * column[k];
            a += h[0] * at[0] + h[1] * at[1] + h[2] * at[2];
            b += h[3] * at[0] + h[4] * at[1] + h[5] * at[2];
            c += h[6] * at[0] + h[7] * at[1] + h[8] * at[2];
            if (!kHalf || column[k] == r) continue;
            double* const to = y + 3L * column[k];
            to[0] += h[0] * u + h[3] * v + h[6] * w;
            to[1] += h[1] * u + h[4] * v + h[7] * w;
            to[2] += h[2] * u + h[5] * v + h[8] * w;
        }
        y[3 * r] += a, y[3 * r + 1] += b, y[3 * r + 2] += c;
    }
}
template <bool kHalf>
static void bcoo(long count, const int* row, const int* column, const double* blocks, const double* x, double* y) {
    for (long k = 0; k < count; ++k) {
        const double *const h = blocks + 9 * k, *const at = x + 3L * column[k];
        double* const to = y + 3L * row[k];
        to[0] += h[0] * at[0] + h[1] * at[1] + h[2] * at[2];
        to[1] += h[3] * at[0] + h[4] * at[1] + h[5] * at[2];
        to[2] += h[6] * at[0] + h[7] * at[1] + h[8] * at[2];
        if (!kHalf || row[k] == column[k]) continue;
        const double* const other = x + 3L * row[k];
        double* const turned = y + 3L * column[k];
        turned[0] += h[0] * other[0] + h[3] * other[1] + h[6] * other[2];
        turned[1] += h[1] * other[0] + h[4] * other[1] + h[7] * other[2];
        turned[2] += h[2] * other[0] + h[5] * other[1] + h[8] * other[2];
    }
}
#define FORMAT(NAME, KERNEL, HALF, INDEX)                                                                      \\
    extern "C" void NAME(long n, const INDEX* i, const int* c, const double* b, const double* x, double* y) { \\
        KERNEL<HALF>(n, i, c, b, x, y);                                                                       \\
    }
FORMAT(bcsr_half, bcsr, true, long)
FORMAT(bcsr_full, bcsr, false, long)
FORMAT(bcoo_half, bcoo, true, int)
FORMAT(bcoo_full, bcoo, false, int)
"""


@dataclass(frozen=True)
class PlainFormat:
    """A matrix in one of the formats. index: starts of rows (BCSR) or the row of each block (BCOO)."""

    function: Callable[..., None]
    count: int
    index: NDArray[np.integer]
    columns: NDArray[np.int32]
    blocks: FloatArray
    y: FloatArray

    def multiply(self, x: FloatArray) -> FloatArray:
        """The product, in `y`."""
        self.y[:] = 0.0
        self.function(self.count, *(a.ctypes.data for a in (self.index, self.columns, self.blocks, x, self.y)))
        return self.y


def plain_formats(case: Case, compiler: Compiler) -> dict[str, PlainFormat]:
    """All of them, by name."""
    objects = compile_sources([Source("benchmark.plain_products", _KERNELS)], compiler)
    library = ctypes.CDLL(str(link(objects, compiler).path))
    whole = case.full.tobsr((3, 3))
    count = len(whole.indptr) - 1
    rows = np.repeat(np.arange(count, dtype=np.int32), np.diff(whole.indptr))
    made = {}
    for share, kept in {"half": whole.indices >= rows, "full": np.ones(len(rows), np.bool_)}.items():
        row, column = rows[kept], whole.indices[kept].astype(np.int32)
        blocks = np.ascontiguousarray(whole.data[kept])
        starts = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
        for name, index, length in (("bcsr", starts.astype(np.int64), count), ("bcoo", row, len(row))):
            function = getattr(library, f"{name}_{share}")
            function.argtypes = (ctypes.c_long, *[ctypes.c_void_p] * 5)
            function.restype = None
            made[f"{name.upper()}, {share}"] = PlainFormat(
                function, length, index, column, blocks, np.empty(len(case.x))
            )
    return made


def run(settings: Settings) -> Report:
    """Times all formats for each number of bunnies. Raises PeersDisagreeError."""
    compiler = find_compiler()
    runtime = load_runtime(compiler)
    bunny = rabbit(settings.size) if settings.mesh is None else read_tetrahedral_mesh(settings.mesh)
    rows: list[Row] = []
    curves: dict[str, tuple[list[float], list[float]]] = {}
    for bunnies in BUNNIES:
        case = make_case(runtime, copies(bunny, bunnies), permuted=True)
        products: dict[str, Callable[[FloatArray], FloatArray]] = {
            "yasps": partial(case.reordered.multiply, threads=1),
            "yasps, not reordered": partial(case.plain.multiply, threads=1),
            **{name: made.multiply for name, made in plain_formats(case, compiler).items()},
        }
        peers: list[Peer] = []
        for name, product in products.items():
            check_product(name, product(case.x), case)
            peers.append(product_peer(case, name, 1, product))
        for row in measure(peers, settings.repeats, time.process_time):
            rows.append(Row(f"{bunnies} bunnies", row.implementation, 1, row.value, UNIT, row.median))
            x, y = curves.setdefault(row.implementation, ([], []))
            x.append(bunnies)
            y.append(row.value)
        rows.append(Row(f"{bunnies} bunnies", "bytes", 1, moved_bytes(case.plain) / 1e6, "MB"))
    plot = Curves("figure_30", "A product, one thread", "bunnies", UNIT, curves)
    about = (
        f"{len(bunny.vertices):,} vertices a bunny; {cpu_model()}, {available_processors()} processors; "
        f"{compiler.version}; least and median of {settings.repeats} rounds."
    )
    return Report(rows, [about, *NOTES], [plot])


def copies(mesh: TetrahedralMesh, count: int) -> TetrahedralMesh:
    """So many of it, side by side."""
    low, high = mesh.bounds
    places = [np.array([1.1 * number * float(high[0] - low[0]), 0.0, 0.0]) for number in range(count)]
    vertices = np.vstack([mesh.vertices + place for place in places])
    tets = np.vstack([mesh.tets + number * len(mesh.vertices) for number in range(count)])
    return TetrahedralMesh(vertices, tets)
