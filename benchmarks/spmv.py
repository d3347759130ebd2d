"""Symmetric block-sparse products and conjugate gradients, beside SciPy, Eigen and MKL (paper, fig. 30)."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import sparse

from benchmarks.bandwidth import memory_bandwidth
from benchmarks.element_rows import PeersDisagreeError
from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.spmv_peers import EigenProduct, FloatArray, MklNotFoundError, MklProduct
from benchmarks.sympy_kernel import EigenNotFoundError
from yasps.frontend.commands.environment_report import cpu_model
from yasps.meshes import TetrahedralMesh, read_tetrahedral_mesh, sphere
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import Runtime, available_processors, load_runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.matrix.ordering import bandwidth_reducing_order
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver

DESCRIPTION = "product with the Hessian of a tetrahedral mesh and conjugate gradients, ms, beside SciPy, Eigen and MKL"
DEFAULT_SIZE = 19_000  # vertices
AGREEMENT = 1e-12  # relative; all work in float64
ITERATIONS = 50
PRODUCTS = 20

UNIT = "ms"
WHAT_ROWS_HOLD = (
    "The sparsity of a Hessian of an energy over tets with 3 unknowns on each vertex; upper triangle for yasps, Eigen "
    "and MKL, the full matrix for SciPy; random values, which do not matter for the time.",
    f"Products come {PRODUCTS} at a time, as in a solver: what fits in the processor's caches is there.",
    "yasps: BlockMatrix.multiply, with what it takes to bring vectors into the solver's layout and back; 'not "
    "reordered': without reverse Cuthill-McKee. MKL: mkl_sparse_d_mv of BSR, symmetric, after mkl_sparse_optimize. "
    "Eigen: selfadjointView<Upper> of a row-major SparseMatrix. SciPy: bsr_array @ x.",
    f"one iteration: conjugate gradients with block Jacobi, a {ITERATIONS}th of a solve of {ITERATIONS} iterations, "
    "with inverting the diagonal blocks. Inside a solve vectors stay in the solver's layout.",
    "order: finding it, without building the structure; once for each topology.",
    "floor: every byte of the upper blocks and their columns read once, of x and y once, at the bandwidth of memory. A "
    "matrix that fits in the last cache can be faster.",
)


@dataclass(frozen=True)
class Case:
    """The same matrix with its dof blocks in the order of the mesh, reordered by yasps, and in SciPy's hands."""

    name: str
    plain: BlockMatrix
    reordered: BlockMatrix
    full: sparse.csr_array[np.float64]
    x: FloatArray


def run(settings: Settings) -> Report:
    """Times all rows. Raises PeersDisagreeError."""
    compiler = find_compiler()
    runtime = load_runtime(compiler)
    mesh = sphere(vertices=settings.size) if settings.mesh is None else read_tetrahedral_mesh(settings.mesh)
    threads = sorted({1, settings.threads})
    rows: list[Row] = []
    missing: list[str] = []
    cases = [make_case(runtime, mesh, permuted=permuted) for permuted in (False, True)]
    for case in cases:
        peers = _yasps(runtime, case, threads)
        products: list[tuple[str, int, Callable[[FloatArray], FloatArray]]] = []
        bsr = case.full.tobsr((3, 3))
        products.append(("SciPy BSR", 1, partial(_scipy_product, bsr)))
        try:
            products.append(("Eigen", 1, EigenProduct(case.full, compiler).multiply))
        except EigenNotFoundError as error:
            missing.append(str(error))
        try:
            products += [("MKL", count, MklProduct(case.full, count).multiply) for count in threads]
        except MklNotFoundError as error:
            missing.append(str(error))
        for name, count, product in products:
            check_product(name, product(case.x), case)
            peers.append(product_peer(case, name, count, product))
        rows += measure(peers, settings.repeats)
    rows += _floor(cases[0].plain, threads, settings.repeats)
    notes = [
        f"{len(mesh.vertices):,} vertices, {len(mesh.tets):,} tets, {cases[0].plain.block_count:,} upper blocks; least "
        f"and median of {settings.repeats} rounds, in which all rows of a case take turns.",
        f"{cpu_model()}, {available_processors()} processors; {compiler.version}; OMP_WAIT_POLICY "
        f"{os.environ.get('OMP_WAIT_POLICY', 'not set')}.",
        *(f"No rows for one peer: {reason}" for reason in dict.fromkeys(missing)),
        *WHAT_ROWS_HOLD,
    ]
    return Report(rows, notes)


def make_case(runtime: Runtime, mesh: TetrahedralMesh, *, permuted: bool) -> Case:
    """The matrix of a mesh, its vertices in their order or mixed."""
    count = len(mesh.vertices)
    order = np.random.default_rng(0).permutation(count) if permuted else np.arange(count)
    kappa = (3 * order[mesh.tets] + 1).astype(np.int32)
    boundaries, block_sizes = np.array([0, 3 * count]), np.array([3], np.int32)
    plain, reordered = BlockMatrix(runtime), BlockMatrix(runtime)
    plain.build(boundaries, block_sizes, [kappa])
    reordered.build(boundaries, block_sizes, [kappa], reorder=True)

    random = np.random.default_rng(1)
    (group,) = plain.groups
    group.values[:] = random.uniform(-1.0, 1.0, group.values.shape)
    diagonal = group.rows == group.cols
    degree = np.bincount(np.concatenate([group.rows, group.cols]) // 3, minlength=count)
    # Diagonally dominant, so that conjugate gradients have something to solve.
    group.values[diagonal] = 3.0 * degree[:, None, None] * np.eye(3)
    copy_blocks(plain, reordered)
    return Case(
        "permuted vertices" if permuted else "natural order",
        plain,
        reordered,
        plain.to_scipy(),
        random.standard_normal(plain.size),
    )


def copy_blocks(source: BlockMatrix, target: BlockMatrix) -> None:
    """Gives a matrix of blocks of one shape the values of one with the same sparsity in another order."""
    ((ours,), (theirs,)) = target.groups, source.groups
    place, origin = (
        np.lexsort((np.maximum(group.rows, group.cols), np.minimum(group.rows, group.cols))) for group in (ours, theirs)
    )
    blocks = theirs.values[origin]
    flipped = (ours.rows > ours.cols)[place] != (theirs.rows > theirs.cols)[origin]
    blocks[flipped] = blocks[flipped].transpose(0, 2, 1)
    ours.values[place] = blocks


def _yasps(runtime: Runtime, case: Case, threads: list[int]) -> list[Peer]:
    peers = []
    for name, matrix in (("yasps", case.reordered), ("yasps, not reordered", case.plain)):
        solver = PcgSolver(runtime)
        for count in threads:
            check_product(name, matrix.multiply(case.x, count), case)
            peers.append(product_peer(case, name, count, partial(matrix.multiply, threads=count)))
            solve = partial(
                solver.solve, [matrix], case.x, SolveOptions(0.0, ITERATIONS, preconditioner="jacobi"), threads=count
            )
            peers.append(Peer(f"{case.name}, one iteration", name, count, solve, 1e3 / ITERATIONS, UNIT))
    (group,) = case.plain.groups
    find = partial(bandwidth_reducing_order, group.rows // 3, group.cols // 3, case.plain.size // 3)
    peers.append(Peer(f"{case.name}, order", "SciPy's reverse Cuthill-McKee", 1, find, 1e3, UNIT))
    return peers


def _scipy_product(matrix: sparse.bsr_array[np.float64], x: FloatArray) -> FloatArray:
    return np.asarray(matrix @ x)


def product_peer(case: Case, name: str, threads: int, product: Callable[[FloatArray], FloatArray]) -> Peer:
    """Products, some at a time."""

    def run() -> None:
        for _ in range(PRODUCTS):
            product(case.x)

    return Peer(case.name, name, threads, run, 1e3 / PRODUCTS, UNIT)


def check_product(name: str, result: FloatArray, case: Case) -> None:
    """Raises PeersDisagreeError unless this is the matrix times x."""
    expected: FloatArray = np.asarray(case.full @ case.x)
    difference = float(np.abs(result - expected).max() / np.abs(expected).max())
    if not difference < AGREEMENT:
        raise PeersDisagreeError(
            f"the products of {name} and SciPy's CSR differ by {difference:.1e} of the largest entry"
        )


def moved_bytes(matrix: BlockMatrix) -> int:
    """Bytes of the upper blocks and their columns, of x and of y."""
    return matrix.values.nbytes + 4 * matrix.block_count + 2 * 8 * matrix.size


def _floor(matrix: BlockMatrix, threads: list[int], repeats: int) -> list[Row]:
    moved = moved_bytes(matrix)
    rows = [Row("floor", "bytes", 1, moved / 1e6, "MB")]
    for bandwidth in (memory_bandwidth(count, repeats) for count in threads):
        rows += [bandwidth, Row("floor", "copy", bandwidth.threads, moved / bandwidth.value / 1e6, UNIT)]
    return rows
