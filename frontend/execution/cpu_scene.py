"""A scene compiled for the processor: evaluation, assembly and solution in the memory of its arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yasps.backend.codegen.program import CompiledModule, Program
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cpp.object import CppEmitter
from yasps.frontend.execution.compiled_scene import CompiledScene, Term, ToProject
from yasps.frontend.execution.instance_order import OrderedReads, OwnReads, grouped, own_reads, rows_of
from yasps.frontend.execution.scene_source import CompileRequest
from yasps.frontend.language.nodes import FloatArray
from yasps.frontend.language.primitive import Primitive
from yasps.frontend.language.scene_lock import one_thread_at_a_time
from yasps.runtime.assembly.assembler import Assembler, KernelCall, evaluate
from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.block_matrix import BlockGroup, BlockMatrix
from yasps.runtime.matrix.ordering import instance_order
from yasps.runtime.solvers.choice import LinearSolver
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PreconditionerChoice, SolveReport


@dataclass
class Placement:
    """Where an energy's derivatives go: rows in the order in which its kernel visits the instances, that of `ordered`
    if there is one."""

    kappas: NDArray[np.int32]
    positions: NDArray[np.int64]
    ordered: OrderedReads | None = None


class CpuScene(CompiledScene):
    """A compiled scene on the processor."""

    def __init__(self, request: CompileRequest, runtime: Runtime, *, deterministic: bool = False) -> None:
        self.runtime = runtime
        self.placements: dict[str, Placement] = {}
        self._own_reads: dict[str, OwnReads | None] = {}
        self.static_matrix = BlockMatrix(runtime, with_diagonal=True)
        self.dynamic_matrix = BlockMatrix(runtime, with_diagonal=False)
        self._assembler = Assembler(runtime, deterministic=deterministic)
        # What an assembler remembers of the places that it writes to is another for a gradient alone.
        self._of_gradients = Assembler(runtime, deterministic=deterministic)
        self._deterministic = deterministic
        self._solver = LinearSolver(runtime, deterministic=deterministic)
        super().__init__(request)

    @property
    def direct_solves_left(self) -> int:
        """See `LinearSolver`."""
        return self._solver.direct_left

    @direct_solves_left.setter
    def direct_solves_left(self, count: int) -> None:
        self._solver.direct_left = count

    @property
    def preconditioner_choice(self) -> PreconditionerChoice:
        """What preconditioner="auto" has learned."""
        return self._solver.preconditioners

    def _key(self) -> Sequence[str]:
        return [str(self.runtime.compiler.has_vector_math)]

    def _emitter(self, view: SceneView) -> CppEmitter:
        return CppEmitter(view, self.runtime.compiler.has_vector_math)

    def _build(self, dump_to: Path | None) -> Sequence[CompiledModule]:
        self.program = Program(self.code, self.runtime.compiler, dump_to)
        runtime = [CompiledModule(item.name, item.seconds, item.cached, 0) for item in self.runtime.objects]
        return [*runtime, *self.program.log]

    def _point(self) -> None:
        self.program.bind(self._array_of)
        for term in self._terms:
            placement = self.placements.get(term.symbol)
            if placement is None:
                continue
            if not (self._dynamic_valid if term.dynamic else self._static_valid):
                placement.ordered = None
            elif placement.ordered is not None:
                placement.ordered.point()

    def _run(self, symbol: str, count: int, shape: tuple[int, int]) -> FloatArray:
        out = np.empty((count, *shape))
        function, arguments = self.program.function(symbol, "batch"), self.program.arguments(symbol)
        evaluate(self.runtime, function, arguments, count, out)
        return out

    @one_thread_at_a_time
    def total_energy(self) -> float:
        """Sum of all energies; infinite or NaN where one is."""
        return float(sum(self.runtime.sum(values) for values in self.energies().values()))

    def _build_structure(self, terms: Sequence[Term], *, dynamic: bool) -> None:
        boundaries, block_sizes = self._layout()
        kappas, sorted_reads = [], []
        for term in terms:
            assert term.kappa is not None
            kappa = self.program.indices(term.kappa, term.count, term.capacity)
            ordered = self._ordered(term, self._by_branches(term)) if dynamic and term.count else None
            sorted_reads.append(ordered)
            kappas.append(kappa if ordered is None else rows_of(kappa, ordered.order))
        # Both parts need the same order inside; the one with most blocks, and that seldom changes, chooses it.
        if dynamic:
            built = self.dynamic_matrix.build(boundaries, block_sizes, kappas, order=self.static_matrix.order)
        else:
            built = self.static_matrix.build(boundaries, block_sizes, kappas, reorder=True)
        for term, kappa, positions, ordered in zip(terms, kappas, built, sorted_reads, strict=True):
            self.placements[term.symbol] = Placement(kappa, positions, ordered)
            if not dynamic:
                self._order_instances(term)

    def _order_instances(self, term: Term) -> None:
        """Lets the kernel visit the instances along their unknowns, if in the given order it would jump about; those of
        the same branches of UNIONs one after another."""
        matrix, placement = self.static_matrix, self.placements[term.symbol]
        order = None
        if isinstance(term.owner, Primitive) and not term.owner.is_dynamic:
            order = instance_order(placement.kappas, matrix.block_size_at, matrix.order)
        ordered = self._ordered(term, self._by_branches(term, order))
        if ordered is None:
            return
        self.placements[term.symbol] = Placement(
            rows_of(placement.kappas, ordered.order), rows_of(placement.positions, ordered.order), ordered
        )

    def _by_branches(self, term: Term, order: NDArray[np.int64] | None = None) -> NDArray[np.int64] | None:
        """This order, or the given one, but with instances of the same branches of UNIONs one after another, so that
        kernels find them in the same packs."""
        assert term.derivative is not None
        branches = self.program.branches(term.derivative, term.count)
        return order if branches is None else grouped(branches, order)

    def _ordered(self, term: Term, order: NDArray[np.int64] | None) -> OrderedReads | None:
        """What the term's kernel reads in this order; None where it must stay in the given one."""
        assert term.derivative is not None
        if order is None or not isinstance(term.owner, Primitive):
            return None
        if term.derivative not in self._own_reads:
            self._own_reads[term.derivative] = own_reads(self.program, term.derivative, term.owner, self.emitter)
        reads = self._own_reads[term.derivative]
        return None if reads is None else OrderedReads(self.program, term.derivative, order, *reads)

    def _derive(
        self, terms: Sequence[Term], *, hessian: bool, project: ToProject
    ) -> tuple[FloatArray, Sequence[int | None]]:
        gradient = np.zeros(self.static_matrix.size)
        calls, placements = [], [self.placements[term.symbol] for term in terms]
        for term, placement in zip(terms, placements, strict=True):
            assert term.derivative is not None
            if placement.ordered is not None:
                placement.ordered.refresh()
            calls.append(
                KernelCall(
                    self.program.function(term.derivative, "derive"),
                    self.program.arguments(term.derivative),
                    term.count,
                    placement.kappas,
                    placement.positions if hessian else None,
                    (1 if term.dynamic else 0) if hessian else None,
                    term.mode_for(project),
                )
            )
        parts = [self.static_matrix, self.dynamic_matrix] if hessian else []
        assembler = self._assembler if hessian else self._of_gradients
        statuses = assembler.assemble(calls, parts, gradient, self.static_matrix.block_size_at)
        first_bad = [status.first_bad for status in statuses]
        for k, (bad, placement) in enumerate(zip(first_bad, placements, strict=True)):
            if bad is not None and placement.ordered is not None:
                first_bad[k] = int(placement.ordered.order[bad])
        return gradient, first_bad

    def _fix(self, fixed: NDArray[np.bool_]) -> None:
        self.static_matrix.fix(fixed)
        self.dynamic_matrix.fix(fixed)

    @one_thread_at_a_time
    def solve_linear(
        self, gradient: FloatArray, options: SolveOptions, start: FloatArray | None = None
    ) -> tuple[FloatArray, SolveReport]:
        return self._solver.solve([self.static_matrix, self.dynamic_matrix], gradient, options, start)

    @one_thread_at_a_time
    def multiply(self, x: FloatArray) -> FloatArray:
        matrices = self.static_matrix, self.dynamic_matrix
        static, dynamic = (matrix.multiply(x, deterministic=self._deterministic) for matrix in matrices)
        return static + dynamic

    @one_thread_at_a_time
    def placement_indices(self, term: Term) -> NDArray[np.int32]:
        placement = self.placements[term.symbol]
        if placement.ordered is None:
            return placement.kappas
        given = np.empty_like(placement.kappas)
        given[placement.ordered.order] = placement.kappas
        return given

    @one_thread_at_a_time
    def hessian_groups(self) -> list[BlockGroup]:
        return [*self.static_matrix.groups, *self.dynamic_matrix.groups]
