"""Global assembly alone: the structure of the Hessian and the sum of given local Hessians, beside SciPy and NumPy."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from benchmarks.bandwidth import memory_bandwidth
from benchmarks.element_rows import PeersDisagreeError
from benchmarks.measure import Peer, Report, Row, Settings, measure
from yasps.backend.codegen.preludes import PRELUDES
from yasps.frontend.commands.environment_report import cpu_model
from yasps.meshes import box, read_tetrahedral_mesh
from yasps.runtime.assembly.assembler import Assembler, KernelCall
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, find_compiler, link
from yasps.runtime.core.library import Runtime, available_processors, load_runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix

DESCRIPTION = "structure of the global Hessian and the sum of given local ones, ms, beside SciPy and NumPy"
DEFAULT_SIZE = 80_000  # tets
AGREEMENT = 1e-12  # relative; all work in float64
CONTACTS = 5_000
PAIRS = [(a, b) for a in range(4) for b in range(a, 4)]

UNIT = "ms"
WHAT_ROWS_HOLD = (
    "structure: which blocks there are and where each local one goes, from the indices of the tets. SciPy: "
    "coo_array.tocsr() of one entry for each of the 16 pairs of a tet's corners, which gives no places. 'first time': "
    "with a new order of the dof blocks, where that pays; it is kept afterwards.",
    f"contacts: the same for {CONTACTS:,} random quadruples of vertices, the rebuild of the dynamic part.",
    "values: given local Hessians (12x12, the upper triangle in ten 3x3 blocks, one after another) and gradients added "
    "up; memory zeroed first. SciPy: coo_array.tocsr() of all 144 entries of each tet. NumPy: bincount into known "
    "places of the upper blocks. deterministic: the same bits for any number of threads.",
    "floor: local Hessians and gradients, indices and places read once, the matrix written once, at the bandwidth of "
    "memory.",
)

_KERNEL = """
extern "C" long add_given(const void* const* args, long begin, long end, const yasps_sink* sink) {
    const double* const gradients = (const double*)args[0];
    const double* const hessians = (const double*)args[1];
    for (long i = begin; i < end; ++i) {
        for (long a = 0; a < 4; ++a) {
            double* const to = sink->gradient + sink->kappa[4 * i + a] - 1;
            for (long j = 0; j < 3; ++j) to[j] += gradients[12 * i + 3 * a + j];
        }
        for (long pair = 0; pair < 10; ++pair) {
            const double* const block = hessians + 90 * i + 9 * pair;
            const long position = sink->position[10 * i + pair];
            double* const to = block_at(*sink, position >> kYaspsFlagBits);
            if (position & kYaspsTurned) {
                for (long r = 0; r < 3; ++r)
                    for (long c = 0; c < 3; ++c) to[3 * c + r] += block[3 * r + c];
            } else {
                for (long k = 0; k < 9; ++k) to[k] += block[k];
            }
        }
    }
    return -1;
}
"""


@dataclass(frozen=True)
class Given:
    """Local derivatives of tets. tets: [m, 4]; gradients: [m, 4, 3]; hessians: [m, 10, 3, 3], the pairs of PAIRS."""

    count: int
    tets: NDArray[np.int32]
    gradients: NDArray[np.float64]
    hessians: NDArray[np.float64]

    @property
    def kappa(self) -> NDArray[np.int32]:
        """Placement indices."""
        return np.ascontiguousarray(3 * self.tets + 1)

    def entries(self) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]:
        """Values, rows and columns of all 144 entries of each tet."""
        full = np.empty((len(self.tets), 4, 4, 3, 3))
        for k, (a, b) in enumerate(PAIRS):
            full[:, a, b] = self.hessians[:, k]
            full[:, b, a] = self.hessians[:, k].transpose(0, 2, 1)
        first = 3 * self.tets
        offsets = np.arange(3, dtype=np.int32)
        rows = np.broadcast_to(first[:, :, None, None, None] + offsets[:, None], full.shape)
        cols = np.broadcast_to(first[:, None, :, None, None] + offsets, full.shape)
        return full.reshape(-1), rows.reshape(-1), cols.reshape(-1)


def given_derivatives(vertices: int, tets: NDArray[np.int32]) -> Given:
    """Random ones."""
    random = np.random.default_rng(0)
    hessians = random.uniform(-1.0, 1.0, (len(tets), len(PAIRS), 3, 3))
    for k, (a, b) in enumerate(PAIRS):
        if a == b:
            hessians[:, k] += hessians[:, k].transpose(0, 2, 1)
    return Given(vertices, tets, random.uniform(-1.0, 1.0, (len(tets), 4, 3)), hessians)


class Sum:
    """Adds given local derivatives up as a scene does."""

    def __init__(self, runtime: Runtime, kernel: int, given: Given, threads: int, *, deterministic: bool) -> None:
        self.threads = threads
        self.matrix = BlockMatrix(runtime)
        self._assembler = Assembler(runtime, deterministic=deterministic)
        kappa = given.kappa
        layout = np.array([0, 3 * given.count]), np.array([3], np.int32)
        (self.position,) = self.matrix.build(*layout, [kappa], reorder=True)
        self.gradient = np.empty(3 * given.count)
        self._keep = (given.gradients, given.hessians)
        self._arguments = (ctypes.c_void_p * 2)(*(array.ctypes.data for array in self._keep))
        self._call = KernelCall(kernel, ctypes.addressof(self._arguments), len(given.tets), kappa, self.position)

    def run(self) -> None:
        """Overwrites gradient and matrix."""
        sizes = self.matrix.block_size_at
        self._assembler.assemble([self._call], [self.matrix], self.gradient, sizes, self.threads)


def make_kernel(compiler: Compiler) -> tuple[ctypes.CDLL, int]:
    """The library and the address of a kernel that reads local derivatives from memory."""
    text = PRELUDES["runtime/core/sink.h"] + PRELUDES["backend/cpp/preludes/kernel.h"] + _KERNEL
    objects = compile_sources([Source("benchmark.add_given", text)], compiler)
    library = ctypes.CDLL(str(link(objects, compiler).path))
    address = ctypes.cast(library.add_given, ctypes.c_void_p).value
    assert address is not None
    return library, address


def run(settings: Settings) -> Report:
    """Times all rows. Raises PeersDisagreeError."""
    compiler = find_compiler()
    runtime = load_runtime(compiler)
    if settings.mesh is None:
        cells = max(1, round((settings.size / 6) ** (1 / 3)))
        mesh = box(divisions=(cells, cells, cells))
    else:
        mesh = read_tetrahedral_mesh(settings.mesh)
    given = given_derivatives(len(mesh.vertices), mesh.tets)
    threads = sorted({1, settings.threads})
    library, kernel = make_kernel(compiler)
    rows = measure(_structure(runtime, given, threads), settings.repeats)
    sums = [Sum(runtime, kernel, given, count, deterministic=fixed) for fixed in (False, True) for count in threads]
    rows += measure(_values(given, sums), settings.repeats)
    rows += _floor(given, sums[0], threads, settings.repeats)
    del library
    notes = [
        f"{len(given.tets):,} tets, {given.count:,} vertices, {sums[0].matrix.block_count:,} upper blocks; least and "
        f"median of {settings.repeats} rounds, in which all rows of a group take turns.",
        f"{cpu_model()}, {available_processors()} processors; {compiler.version}.",
        *WHAT_ROWS_HOLD,
    ]
    return Report(rows, notes)


def _structure(runtime: Runtime, given: Given, threads: list[int]) -> list[Peer]:
    peers = []
    layout = np.array([0, 3 * given.count]), np.array([3], np.int32)
    quadruples = np.random.default_rng(0).integers(0, given.count, (CONTACTS, 4), np.int32)
    for count in threads:

        def first_time(count: int = count) -> None:
            BlockMatrix(runtime).build(*layout, [given.kappa], count, reorder=True)

        again, dynamic = BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)
        rebuild = partial(again.build, *layout, [given.kappa], count, reorder=True)
        contacts = partial(dynamic.build, *layout, [3 * quadruples + 1], count)
        peers.append(Peer("structure, first time", "yasps", count, first_time, 1e3, UNIT))
        peers.append(Peer("structure", "yasps", count, rebuild, 1e3, UNIT))
        peers.append(Peer("contacts", "yasps", count, contacts, 1e3, UNIT))
    for name, corners in (("structure", given.tets), ("contacts", quadruples)):
        peers.append(Peer(name, "SciPy COO to CSR", 1, partial(block_sparsity, given.count, corners), 1e3, UNIT))
    return peers


def block_sparsity(count: int, corners: NDArray[np.int32]) -> sparse.csr_array[np.int8]:
    """Which blocks there are, both triangles."""
    n, slots = corners.shape
    rows = np.broadcast_to(corners[:, :, None], (n, slots, slots)).reshape(-1)
    cols = np.broadcast_to(corners[:, None, :], (n, slots, slots)).reshape(-1)
    return sparse.coo_array((np.ones(rows.size, np.int8), (rows, cols)), shape=(count, count)).tocsr()


def _values(given: Given, sums: list[Sum]) -> list[Peer]:
    values, rows, cols = given.entries()
    size = 3 * given.count
    places = (sums[0].position >> 2)[:, :, None] + np.arange(9)
    weights = given.hessians.copy()
    transposed = (sums[0].position & 1).astype(bool)
    weights[transposed] = weights[transposed].transpose(0, 2, 1)

    def scipy() -> sparse.csr_array[np.float64]:
        return sparse.coo_array((values, (rows, cols)), shape=(size, size)).tocsr()

    def numpy() -> NDArray[np.float64]:
        return bincount(places, weights)

    peers: list[tuple[str, int, Callable[[], object]]] = []
    x = np.random.default_rng(2).standard_normal(size)
    expected: NDArray[np.float64] = np.asarray(scipy() @ x)
    gradient = bincount(3 * given.tets[:, :, None] + np.arange(3), given.gradients)
    for one in sums:
        one.run()
        name = "yasps, deterministic" if one in sums[len(sums) // 2 :] else "yasps"
        _check_close(f"the matrix of {name}", one.matrix.multiply(x), expected)
        _check_close(f"the gradient of {name}", one.gradient, gradient)
        peers.append((name, one.threads, one.run))
    _check_close("NumPy's matrix", numpy(), sums[0].matrix.values)
    peers += [("SciPy COO to CSR", 1, scipy), ("NumPy bincount", 1, numpy)]
    return [Peer("values", name, count, work, 1e3, UNIT) for name, count, work in peers]


def bincount(places: NDArray[np.integer], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sums of the values at each place."""
    return np.bincount(places.reshape(-1), values.reshape(-1)).astype(np.float64, copy=False)


def _check_close(what: str, result: NDArray[np.float64], expected: NDArray[np.float64]) -> None:
    difference = float(np.abs(result - expected).max() / np.abs(expected).max())
    if not difference < AGREEMENT:
        raise PeersDisagreeError(f"{what} differs from its peer's by {difference:.1e} of the largest entry")


def _floor(given: Given, one: Sum, threads: list[int], repeats: int) -> list[Row]:
    moved = given.hessians.nbytes + given.gradients.nbytes + given.kappa.nbytes + one.position.nbytes
    moved += one.matrix.values.nbytes + one.gradient.nbytes
    rows = [Row("floor, values", "bytes", 1, moved / 1e6, "MB")]
    for bandwidth in (memory_bandwidth(count, repeats) for count in threads):
        rows += [bandwidth, Row("floor, values", "copy", bandwidth.threads, moved / bandwidth.value / 1e6, UNIT)]
    return rows
