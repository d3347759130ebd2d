"""Preconditioned conjugate gradients on a device, with all vectors and scalars there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from yasps.runtime.core.library import IntArray, LongArray, Runtime
from yasps.runtime.device.protocol import BLOCK, Device, DeviceArray, Graph, LoadedProgram, blocks_for_sum
from yasps.runtime.matrix.cuda.block_matrix import CudaBlockMatrix
from yasps.runtime.matrix.cuda.build import BuildScratch
from yasps.runtime.matrix.cuda.product import GatheredProduct, Launch, Product, ScatteredProduct
from yasps.runtime.solvers.cuda.coarse_space import CudaCoarseSpace
from yasps.runtime.solvers.options import DEFAULTS, SolveOptions
from yasps.runtime.solvers.pcg import (
    COARSE_BROKE_DOWN,
    LOGGER,
    PreconditionerChoice,
    SolveReport,
    StopReason,
    check_targets,
    report_of,
)

# As in solver.cuh.
_STATE = np.dtype(
    [(name, np.float64) for name in ("squared", "reference", "relative", "step")]
    + [(name, np.int64) for name in ("iteration", "reason", "verdict", "block")]
)
_SETTINGS = np.dtype(
    [("tolerance", np.float64), ("max_iterations", np.int64), ("history", np.int64), ("pause", np.int64)]
)
_REASON = 40  # offset of State.reason
_RUNNING, _PAUSED = -1, -2


class CudaSolver:
    """Conjugate gradients with block-Jacobi or two-level preconditioner on a device; `PcgSolver` says what is computed.

    Owns the solver's vectors; keep one and use it for every solve. Iterations are launched as a recorded graph of some
    of them; after each the host reads 64 bytes to learn whether the solve is over. Those of a graph that come after the
    last one do nothing, so solution and count are those of a solver that looks after every iteration. choice: what
    preconditioner="auto" has learned, by the limits that were measured on the CPU.
    """

    def __init__(
        self,
        device: Device,
        program: LoadedProgram,
        runtime: Callable[[], Runtime],
        *,
        deterministic: bool = False,
        iterations_per_check: int = 24,
        scratch: BuildScratch | None = None,
    ) -> None:
        """Make a solver without memory; the first solve gets it.

        program: holds the kernels of runtime/cuda. runtime: gives the CPU's runtime, which finds aggregates; called
        where a system first has the coarse space. deterministic: the same bits in every run, for a product that reads
        most blocks twice. iterations_per_check: an even number of iterations that are launched at once. scratch: shares
        memory with builds on this device (`CudaBlockMatrix`). Raises ValueError for an odd number.
        """
        if iterations_per_check < 2 or iterations_per_check % 2:
            raise ValueError(f"iterations_per_check is {iterations_per_check}; it must be even and at least 2")
        self._device, self._program = device, program
        self._iterations = iterations_per_check
        self.choice = PreconditionerChoice()
        scratch = scratch if scratch is not None else BuildScratch(device)
        self._coarse = CudaCoarseSpace(device, program, runtime, scratch)
        self._product: Product = (
            GatheredProduct(device, program, scratch) if deterministic else ScatteredProduct(device)
        )

        def vector(purpose: str) -> DeviceArray:
            return DeviceArray(device, np.float64, purpose)

        self._x = vector("solution of a linear system")
        self._solution = vector("solution of a linear system, kept in a trial")
        self._first_x = vector("start of a linear system, kept for a trial")
        self._residuals = vector("residuals of a linear system")
        self._direction = vector("direction of a solver")
        self._preconditioned = vector("preconditioned residual of a solver")
        self._q = vector("product of a solver")
        self._inverse = vector("inverted diagonal blocks")
        self._partial = vector("partial sums of a solver")
        self._history = vector("history of a solver")
        self._states = DeviceArray(device, _STATE, "state of a solver")
        self._settings = DeviceArray(device, _SETTINGS, "settings of a solver")
        self._worst = DeviceArray(device, np.int64, "diagonal block that cannot be inverted")
        self._diagonals = DeviceArray(device, np.int64, "table of diagonal blocks")
        self._runs = DeviceArray(device, np.int64, "table of dof blocks")
        self._sent_runs: LongArray | None = None
        #: What was recorded of iterations without and with the coarse space.
        self._graphs: dict[bool, tuple[list[Launch], Graph]] = {}

    def solve(
        self,
        parts: Sequence[CudaBlockMatrix],
        g: DeviceArray,
        options: SolveOptions = DEFAULTS,
        x0: DeviceArray | None = None,
    ) -> tuple[DeviceArray, SolveReport]:
        """Solve (sum of parts) x = g; the Newton step of an energy with gradient g is -x.

        All arguments mean what they mean for `PcgSolver.solve`; g and x0 are float64 [unknowns] on the device. Returns
        x on the device, which the next solve overwrites (it may be that one's x0), and the report. Raises ValueError
        for arguments that do not fit together, DeviceMemoryError.
        """
        if options.preconditioner == "gauss-seidel":
            raise ValueError(
                'preconditioner="gauss-seidel" is for the CPU, since its sweeps go row after row: on a GPU "auto", '
                '"jacobi" and "two-level" can be had'
            )
        check_targets(parts)
        size = parts[0].size
        _check_vector(g, size, "g")
        if size and g.address == self._x.address:
            raise ValueError("g is the solution that an earlier solve returned; this solve would overwrite it: copy it")
        if x0 is not None:
            _check_vector(x0, size, "x0")
        if size == 0:
            return self._x.resize(0), SolveReport(StopReason.CONVERGED, 0, 0.0, None, () if options.history else None)
        self._prepare(parts)
        if options.preconditioner == "auto" and x0 is not None and x0.address == self._x.address:
            x0 = self._copy_of(self._x, self._first_x)  # a trial starts from there, too
        solved = False

        def run(two_level: bool, max_iterations: int) -> tuple[DeviceArray, SolveReport]:
            nonlocal solved
            kept = self._copy_of(self._x, self._solution) if solved else None  # of a trial only the report counts
            report = self._solve(parts, g, replace(options, max_iterations=max_iterations), x0, two_level=two_level)
            if kept is not None:
                self._copy_of(kept, self._x)
            solved = report.converged
            return self._x, report

        return self.choice.solve(options, parts[0], run)

    def _solve(
        self,
        parts: Sequence[CudaBlockMatrix],
        g: DeviceArray,
        options: SolveOptions,
        x0: DeviceArray | None,
        *,
        two_level: bool,
    ) -> SolveReport:
        """Leaves the solution in self._x."""
        size = parts[0].size
        if options.history:
            self._history.upload(np.full(options.max_iterations + 1, np.nan))
        history = self._history.address if options.history else 0
        settings = (options.tolerance, options.max_iterations, history, two_level)
        self._settings.upload(np.array([settings], _SETTINGS))
        self._start(parts, g, x0)
        state = self._state() if two_level else self._iterate(size, coarse=False)
        coarse = broke_down = False
        if state["reason"] == _PAUSED:
            coarse = self._coarse.make(parts)
            broke_down = not coarse
            self._resume(size, coarse=coarse)
            state = self._iterate(size, coarse=coarse)
        if state["reason"] == StopReason.CONVERGED.value and state["reference"] == 0:
            self._x.clear()  # g = 0, whatever the start
        recorded = self._history.download() if options.history else None
        reason, iterations, block = (int(state[name]) for name in ("reason", "iteration", "block"))
        report = report_of(reason, iterations, float(state["relative"]), block, recorded)
        report = replace(report, two_level=coarse, coarse_broke_down=broke_down)
        if broke_down:
            LOGGER.warning(COARSE_BROKE_DOWN)
        return report

    def _copy_of(self, vector: DeviceArray, other: DeviceArray) -> DeviceArray:
        """The other vector, with the numbers of the first."""
        other.resize(*vector.shape)
        self._device.copy(vector.address, other.address, 8 * vector.size)
        return other

    def multiply(self, parts: Sequence[CudaBlockMatrix], x: DeviceArray, y: DeviceArray) -> None:
        """y = (sum of parts) x; x is float64 [unknowns], y another array, which gets that shape. Raises ValueError."""
        check_targets(parts)
        size = parts[0].size
        _check_vector(x, size, "x")
        if y is x or y.dtype != np.float64:
            raise ValueError("y must be another array of float64 than x")
        self._product.prepare(parts)
        y.resize(size).clear()
        self._do(self._product.launches(x.address, y.address, 0))

    def _blocks(self, size: int) -> int:
        """Of a kernel over all unknowns."""
        return blocks_for_sum(self._device, size)

    def _prepare(self, parts: Sequence[CudaBlockMatrix]) -> None:
        """Memory and tables."""
        size = parts[0].size
        self._product.prepare(parts)
        self._send_runs(parts[0].boundaries, parts[0].block_sizes)
        for vector in (self._x, self._direction, self._preconditioned, self._q):
            vector.resize(size)
        self._residuals.resize(2, size)
        self._partial.resize(4 * self._blocks(size))
        self._states.resize(2)
        self._worst.resize(1)
        self._diagonals.upload(np.array([(part.values.address, part.diagonal.address) for part in parts], np.int64))

    def _send_runs(self, boundaries: LongArray, block_sizes: IntArray) -> None:
        """Makes room for the inverted diagonal blocks and says where they lie."""
        runs: list[list[int]] = []
        inverse = 0
        for begin, end, q in zip(boundaries[:-1].tolist(), boundaries[1:].tolist(), block_sizes.tolist(), strict=True):
            if begin != end and (not runs or runs[-1][1] != q):
                runs.append([begin, q, inverse])
            inverse += (end - begin) * q
        table = np.array(runs, np.int64)
        if self._sent_runs is None or not np.array_equal(table, self._sent_runs):
            self._sent_runs = None
            self._runs.upload(table)
            self._sent_runs = table
        self._inverse.resize(inverse)

    def _start(self, parts: Sequence[CudaBlockMatrix], g: DeviceArray, x0: DeviceArray | None) -> None:
        """Everything before the first iteration."""
        part = parts[0]
        size, threads = part.size, BLOCK * self._blocks(part.size)
        x, q, partial, worst = self._x.address, self._q.address, self._partial.address, self._worst.address
        runs, inverse = (self._runs.address, self._runs.shape[0]), self._inverse.address
        start = x0.address if x0 is not None else 0
        blocks = part.block_start.size
        diagonals = (self._diagonals.address, len(parts), part.block_start.address, blocks)
        launches = [
            Launch("yasps_pcg_prepare", threads, (g.address, start, size, x, q, partial, worst)),
            Launch("yasps_invert_diagonal", blocks, (*diagonals, *runs, inverse, worst)),
        ]
        if x0 is not None:
            launches += self._product.launches(x, q, 0)
        vectors = (self._residuals.address, self._direction.address)
        settings = (self._settings.address, self._states.address)
        launches += [
            Launch("yasps_pcg_start", threads, (g.address, q, *runs, inverse, size, *vectors, partial)),
            Launch("yasps_pcg_begin", BLOCK, (partial, self._blocks(size), worst, *settings)),
        ]
        self._do(launches)
        if x0 is not None:
            self._q.clear()

    def _resume(self, size: int, *, coarse: bool) -> None:
        """Lets iterations begin after the pause, with the coarse space, if there is one."""
        if not coarse:
            self._device.upload(np.array([_RUNNING]), self._states.address + _REASON)
            return
        residual, space = self._residuals.address, self._coarse
        self._do(space.launches(residual, 0))
        runs = (self._runs.address, self._runs.shape[0], self._inverse.address)
        arguments = (self._states.address, residual, *runs, size, *space.results, self._direction.address)
        self._do([Launch("yasps_pcg_resume", BLOCK * self._blocks(size), arguments)])

    def _iterate(self, size: int, *, coarse: bool) -> np.void:
        """Runs iterations until the state says that they are over, and returns it."""
        first = self._iteration(size, 0, coarse=coarse)
        kept = self._graphs.pop(coarse, None)
        if kept is None or kept[0] != first:
            kept = None  # the old graph goes before the new one is made
            pair = [*first, *self._iteration(size, 1, coarse=coarse)]
            # Once directly, so that all kernels are loaded and the device has work while the graph is made.
            self._do(pair)
            kept = first, self._device.record(lambda: self._do(pair * (self._iterations // 2)))
        self._graphs[coarse] = kept
        while True:
            kept[1].launch()
            state = self._state()
            if state["reason"] != _RUNNING:
                return state

    def _state(self) -> np.void:
        """Between two graphs."""
        states = np.empty(1, _STATE)
        self._device.download(self._states.address, states)
        state: np.void = states[0]
        return state

    def _do(self, launches: Sequence[Launch]) -> None:
        for launch in launches:
            launch.do(self._device, self._program)

    def _iteration(self, size: int, odd: int, *, coarse: bool) -> list[Launch]:
        """The launches of one iteration. Odd ones swap the two states and the two residuals."""
        threads = BLOCK * self._blocks(size)
        states = [self._states.address, self._states.address + _STATE.itemsize]
        residuals = [self._residuals.address, self._residuals.address + 8 * size]
        now, after, r, next_r = states[odd], states[1 - odd], residuals[odd], residuals[1 - odd]
        p, q, z = self._direction.address, self._q.address, self._preconditioned.address
        curvatures = self._partial.address
        squares = curvatures + 8 * self._blocks(size)
        preconditioner = (self._runs.address, self._runs.shape[0], self._inverse.address)
        update = (now, after, self._settings.address, squares, z, size, self._x.address, p, q)
        space = self._coarse
        return [
            *self._product.launches(p, q, now + _REASON),
            Launch("yasps_pcg_curvature", threads, (now, p, q, size, curvatures)),
            Launch("yasps_pcg_step", threads, (now, curvatures, r, q, *preconditioner, size, next_r, z, squares)),
            *(space.launches(next_r, now + _REASON) if coarse else []),
            Launch("yasps_pcg_direction", threads, (*update, *(space.results if coarse else (0, 0, 0, 0)))),
        ]


def least_bytes_per_iteration(parts: Sequence[CudaBlockMatrix]) -> int:
    """Bytes that an iteration moves to or from memory at least, if nothing stays in a cache; not if deterministic.

    Every block once with its row and column, the vectors as pcg.cu counts them, and the inverted diagonal blocks.
    """
    blocks = sum(group.count * (8 * group.r * group.c + 8) for part in parts for group in part.groups)
    sizes = np.diff(parts[0].boundaries)
    return int(blocks + 120 * sizes.sum() + (8 * sizes * parts[0].block_sizes).sum())


def _check_vector(vector: DeviceArray, size: int, name: str) -> None:
    if vector.shape != (size,) or vector.dtype != np.float64:
        raise ValueError(f"{name} has shape {vector.shape} and type {vector.dtype}; float64 ({size},) is needed")
