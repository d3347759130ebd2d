"""The benchmarks `spmv`, `solver` and `assembly` on a device: the Hessian's structure, products and solutions there."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.assembly import CONTACTS, block_sparsity
from benchmarks.device_peers import products_of, structures_of
from benchmarks.element_rows import PeersDisagreeError
from benchmarks.measure import Peer, Report, Row, Settings, measure
from benchmarks.on_device import (
    DEVICE_NOTES,
    ON_DEVICE,
    about_device,
    copy_bandwidth,
    device_peer,
    share_rows,
)
from benchmarks.solver import MAX_ITERATIONS, TOLERANCE, SystemNotSolvedError
from benchmarks.solver_problems import PROBLEMS, MakeProblem
from benchmarks.spmv import ITERATIONS, PRODUCTS, Case, check_product, make_case, moved_bytes, product_peer
from yasps.frontend.execution.cuda_scene import CudaScene
from yasps.meshes import TetrahedralMesh, box, read_tetrahedral_mesh
from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import Runtime, load_runtime
from yasps.runtime.device.protocol import Device, DeviceArray, LoadedProgram
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.matrix.cuda.block_matrix import CudaBlockMatrix
from yasps.runtime.solvers.cuda.pcg import CudaSolver, least_bytes_per_iteration
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver

MS = "ms"
SPMV_NOTES = (
    *DEVICE_NOTES,
    f"Products come {PRODUCTS} at a time, on the GPU as one recorded graph. 'deterministic': the same bits each time.",
    f"one iteration: conjugate gradients with block Jacobi, a {ITERATIONS}th of a solve of {ITERATIONS} iterations, "
    "with inverting the diagonal blocks.",
    "cuSPARSE's matrices hold both triangles; theirs is the time of one product.",
)
OPTIONS = SolveOptions(TOLERANCE, MAX_ITERATIONS, preconditioner="jacobi")
"""What both solvers have."""
SOLVER_NOTES = (
    *DEVICE_NOTES,
    f"The whole solve, block-Jacobi, r^T M^-1 r <= {TOLERANCE:g} g^T M^-1 g; the gradient is there already. floor: "
    "every block and vector once in each iteration.",
)
ASSEMBLY_NOTES = (
    *DEVICE_NOTES,
    "structure: which blocks there are and where each local one goes; contacts: the same for "
    f"{CONTACTS:,} random quadruples of vertices. The GPU's include reading how many blocks there are. CuPy's COO to "
    "CSR of one entry for each of the 16 pairs of a tet's corners gives no places.",
    "floor: indices read once, blocks' rows and columns and all positions written once; sorting moves more.",
)


def _vector(device: Device, values: np.ndarray) -> DeviceArray:
    return DeviceArray(device, values.dtype, "a vector of a benchmark").upload(values)


def _mesh(settings: Settings, per_cell: int) -> TetrahedralMesh:
    """The mesh asked for, or a cube of `size` of what a cell has so many of."""
    if settings.mesh is not None:
        return read_tetrahedral_mesh(settings.mesh)
    cells = max(1, round((settings.size / per_cell) ** (1 / 3)))
    return box(divisions=(cells, cells, cells))


# -- spmv --------------------------------------------------------------------------------------------------


class _DeviceCase:
    """The matrix of a case on the device."""

    def __init__(
        self, case: Case, device: Device, program: LoadedProgram, runtime: Runtime, *, deterministic: bool
    ) -> None:
        self.device = device
        self.name = "yasps, deterministic" if deterministic else "yasps"
        self.matrix = CudaBlockMatrix(device, program)
        (group,) = case.plain.groups
        # Every block as an energy of its own: two slots, which name the row and the column.
        kappa = np.column_stack([group.rows, group.cols]).astype(np.int32) + 1
        kappa[group.rows == group.cols, 1] = 0
        boundaries, block_sizes = np.array([0, case.plain.size]), np.array([3], np.int32)
        self.matrix.build(boundaries, block_sizes, [_vector(device, kappa)])
        self.matrix.values.upload(_sorted_values(case.plain))
        self.solver = CudaSolver(device, program, lambda: runtime, deterministic=deterministic)
        self.x = _vector(device, case.x)
        self.y = DeviceArray(device, np.float64, "a product of a benchmark")
        self.multiply()
        check_product(self.name, self.y.download(), case)
        self.graph = device.record(self._multiply_often)

    def multiply(self) -> None:
        """y = H x."""
        self.solver.multiply([self.matrix], self.x, self.y)

    def _multiply_often(self) -> None:
        for _ in range(PRODUCTS):
            self.multiply()

    def solve(self) -> None:
        """Some iterations."""
        self.solver.solve([self.matrix], self.x, SolveOptions(0.0, ITERATIONS))


def _sorted_values(matrix: BlockMatrix) -> np.ndarray:
    """The values of a matrix of one shape with its blocks by row, then column, as on a device."""
    (group,) = matrix.groups
    order = np.lexsort((group.cols, group.rows))
    assert np.all(group.rows <= group.cols)
    return group.values[order].reshape(-1)


def run_spmv(settings: Settings, device: Device) -> Report:
    """Products and iterations. Raises PeersDisagreeError."""
    runtime, mesh = load_runtime(find_compiler()), _mesh(settings, 1)
    program = device.load([], runtime_sources())
    bandwidth = copy_bandwidth(device, settings.repeats)
    rows = [bandwidth]
    about: list[str] = []
    for permuted in (False, True):
        case = make_case(runtime, mesh, permuted=permuted)
        peers, found = _spmv_peers(runtime, case, device, program, settings.threads)
        about += found
        measured = measure(peers, settings.repeats)
        products = [row for row in measured if row.case == case.name]
        rows += [*measured, *share_rows(moved_bytes(case.plain), bandwidth, products, 1e3)]
    what = f"{len(mesh.vertices):,} vertices, {case.plain.block_count:,} upper blocks"
    return Report(rows, [*about_device(device, what, settings.repeats), *dict.fromkeys(about), *SPMV_NOTES])


def _spmv_peers(
    runtime: Runtime, case: Case, device: Device, program: LoadedProgram, threads: int
) -> tuple[list[Peer], list[str]]:
    iteration = f"{case.name}, one iteration"
    pcg = PcgSolver(runtime)
    solve = partial(
        pcg.solve, [case.reordered], case.x, SolveOptions(0.0, ITERATIONS, preconditioner="jacobi"), threads=threads
    )
    peers = [
        product_peer(case, "yasps", threads, partial(case.reordered.multiply, threads=threads)),
        Peer(iteration, "yasps", threads, solve, 1e3 / ITERATIONS, MS),
    ]
    for deterministic in (False, True):
        one = _DeviceCase(case, device, program, runtime, deterministic=deterministic)
        multiply = Peer(case.name, one.name, ON_DEVICE, one.graph.launch, 1e3 / PRODUCTS, MS)
        iterate = Peer(iteration, one.name, ON_DEVICE, one.solve, 1e3 / ITERATIONS, MS)
        peers += [device_peer(device, peer, times=1) for peer in (multiply, iterate)]
    others, about = products_of(case.full, case.x)
    for other in others:
        check_product(other.name, other.result(), case)
        peers.append(Peer(case.name, other.name, ON_DEVICE, partial(other.run, PRODUCTS), 1e3 / PRODUCTS, MS))
    return peers, about


# -- solver ------------------------------------------------------------------------------------------------


def run_solver(settings: Settings, device: Device) -> Report:
    """One Newton system each of four scenes. Raises SystemNotSolvedError."""
    bandwidth = copy_bandwidth(device, settings.repeats)
    rows = [bandwidth]
    for make in PROBLEMS:
        rows += _solver_rows(make, settings, device, bandwidth)
    what = f"about {settings.size:,} unknowns"
    return Report(rows, [*about_device(device, what, settings.repeats), *SOLVER_NOTES])


def _solver_rows(make: MakeProblem, settings: Settings, device: Device, bandwidth: Row) -> list[Row]:
    ours, theirs = make(settings.size, settings.threads), make(settings.size, device)
    gpu = theirs.compiled
    assert isinstance(gpu, CudaScene)
    pcg, parts, g = PcgSolver(load_runtime(find_compiler())), [gpu.static_matrix, gpu.dynamic_matrix], ours.gradient
    right = _vector(device, theirs.gradient)
    cpu_report = pcg.solve(ours.parts, g, OPTIONS, threads=settings.threads)[1]
    report = gpu._solver.solve(parts, right, OPTIONS)[1]
    for where, one in (("the CPU", cpu_report), (device.name, report)):
        if not one.converged:
            raise SystemNotSolvedError(f"{ours.name}: conjugate gradients on {where} ended with: {one}")

    def solve() -> None:
        pcg.solve(ours.parts, g, OPTIONS, threads=settings.threads)

    def solve_there() -> None:
        gpu._solver.solve(parts, right, OPTIONS)

    peers = [
        Peer(ours.name, "yasps PCG", settings.threads, solve, 1.0, "s"),
        device_peer(device, Peer(ours.name, "yasps PCG", ON_DEVICE, solve_there, 1.0, "s"), times=1),
    ]
    rows = measure(peers, settings.repeats)
    moved = least_bytes_per_iteration(parts) * report.iterations
    return [
        Row(ours.name, "yasps PCG", settings.threads, cpu_report.iterations, "iterations"),
        Row(ours.name, "yasps PCG", ON_DEVICE, report.iterations, "iterations"),
        *rows,
        *share_rows(moved, bandwidth, rows, 1.0),
    ]


# -- assembly ----------------------------------------------------------------------------------------------


def run_assembly(settings: Settings, device: Device) -> Report:
    """The structure of a mesh and of contacts. Raises PeersDisagreeError."""
    runtime, mesh = load_runtime(find_compiler()), _mesh(settings, 6)
    program, count = device.load([], runtime_sources()), len(mesh.vertices)
    layout = np.array([0, 3 * count]), np.array([3], np.int32)
    quadruples = np.random.default_rng(0).integers(0, count, (CONTACTS, 4), np.int32)
    bandwidth = copy_bandwidth(device, settings.repeats)
    rows = [bandwidth]
    about: list[str] = []
    for case, corners, static in (("structure", mesh.tets, True), ("contacts", quadruples, False)):
        kappa = (3 * corners + 1).astype(np.int32)
        ours = BlockMatrix(runtime, with_diagonal=static)
        theirs = CudaBlockMatrix(device, program, with_diagonal=static)
        there = _vector(device, kappa)
        (positions,) = theirs.build(*layout, [there])
        (expected,) = ours.build(*layout, [kappa], settings.threads)
        if not np.array_equal(positions.download(), expected):
            raise PeersDisagreeError(f"{case}: the GPU puts local blocks elsewhere than the CPU")
        peers = [
            Peer(case, "yasps", settings.threads, partial(ours.build, *layout, [kappa], settings.threads), 1e3, MS),
            device_peer(device, Peer(case, "yasps", ON_DEVICE, partial(theirs.build, *layout, [there]), 1e3, MS)),
            Peer(case, "SciPy COO to CSR", 1, partial(block_sparsity, count, corners), 1e3, MS),
        ]
        other, missing = structures_of(count, corners)
        about += missing
        peers += [Peer(case, one.name, ON_DEVICE, partial(one.run, 1), 1e3, MS) for one in other]
        measured = measure(peers, settings.repeats)
        moved = kappa.nbytes + positions.nbytes + 8 * theirs.block_count
        own = [row for row in measured if row.implementation == "yasps"]
        rows += [*measured, *share_rows(moved, bandwidth, own, 1e3)]
    what = f"{len(mesh.tets):,} tets, {count:,} vertices"
    return Report(rows, [*about_device(device, what, settings.repeats), *dict.fromkeys(about), *ASSEMBLY_NOTES])
