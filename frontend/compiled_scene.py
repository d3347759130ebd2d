"""A scene's numbers and its machine code brought together: evaluation, assembly and solution on the CPU."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from xdsl.dialects.builtin import ModuleOp

from yasps.backend.cpp_object import CppEmitter
from yasps.backend.object_text import Binding
from yasps.backend.program import CompiledModule, Program
from yasps.backend.scene_code import SceneCode
from yasps.backend.scene_data import SceneData
from yasps.backend.scene_view import SceneView
from yasps.frontend.attribute import Attribute, FloatArray, Joined, Location, Stored, operands_of
from yasps.frontend.connectivity import Connectivity
from yasps.frontend.emit import EnergyTerm, SceneEmitter
from yasps.frontend.entity import Entity
from yasps.frontend.errors import ConnectivityError, NotFiniteError, UnsupportedSceneError
from yasps.frontend.primitive import Primitive, PrimitiveUnion
from yasps.frontend.scene_key import compiler_digest, text_without_sizes
from yasps.passes.errors import CompileError
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.assembly import Assembler, KernelCall, evaluate
from yasps.runtime.block_matrix import BlockMatrix
from yasps.runtime.library import Projection, Runtime
from yasps.runtime.solver import SolveReport
from yasps.runtime.solver_choice import LinearSolver
from yasps.runtime.toolchain import kept_text

MODES = {"clamp": Projection.CLAMP, "abs": Projection.ABS, "none": Projection.NONE}


@dataclass(frozen=True)
class CompileReport:
    """What compiling took.

    symbolic_seconds: passes from the frontend's IR to scalar code; native_seconds: emitting, compiling, linking,
    loading; modules: one line for each object file.
    """

    symbolic_seconds: float
    native_seconds: float
    modules: tuple[CompiledModule, ...]

    @property
    def compiled(self) -> int:
        """Object files and links that were made, not found in the cache."""
        return sum(not module.cached for module in self.modules)

    def __str__(self) -> str:
        cached = len(self.modules) - self.compiled
        return (
            f"{self.compiled} modules compiled, {cached} cached; symbolic {self.symbolic_seconds:.2f} s, "
            f"native {self.native_seconds:.2f} s"
        )


@dataclass
class _Term:
    """An energy in the program."""

    symbol: str
    where: Location
    owner: Primitive | PrimitiveUnion | None
    derivative: str | None
    kappa: str | None
    capacity: int
    dynamic: bool
    mode: Projection
    kappas: NDArray[np.int32] | None = None
    positions: NDArray[np.int64] | None = None

    @property
    def count(self) -> int:
        return 1 if self.owner is None else self.owner.num_instances


class _Reads:
    """Connectivities and owners of all attributes that some attributes are computed from."""

    def __init__(self, roots: Sequence[Attribute]) -> None:
        self.connectivities: set[Connectivity] = set()
        self.owners: set[Entity] = set()
        seen = set(roots)
        stack = list(roots)
        while stack:
            attribute = stack.pop()
            if attribute.owner is not None:
                self.owners.add(attribute.owner)
            node = attribute.node
            if isinstance(node, Joined):
                self.connectivities.add(node.connectivity)
            new = [operand for operand in operands_of(node) if operand not in seen]
            seen.update(new)
            stack.extend(new)


class CompiledScene:
    """Machine code for energies, targets and outputs of a scene, bound to its arrays."""

    def __init__(
        self,
        scene_name: str,
        energies: Sequence[EnergyTerm],
        targets: Sequence[Attribute],
        outputs: Sequence[Attribute],
        *,
        runtime: Runtime,
        deterministic: bool = False,
        dump_to: Path | None,
        dump_locations: bool = False,
    ) -> None:
        self.runtime = runtime
        self.targets = list(targets)
        self.emitter = SceneEmitter(scene_name)
        start = time.perf_counter()
        self._unlowered: ModuleOp | None = self.emitter.emit(energies, targets, outputs)
        self._module: ModuleOp | None = None
        code = self._code(dump_to, dump_locations)
        symbolic = time.perf_counter() - start
        self.program = Program(code, runtime.compiler, dump_to)
        native = time.perf_counter() - start - symbolic
        self.report = CompileReport(symbolic, native, (*self._runtime_log(), *self.program.log))
        self.static_matrix = BlockMatrix(runtime, with_diagonal=True)
        self.dynamic_matrix = BlockMatrix(runtime, with_diagonal=False)
        self._assembler = Assembler(runtime, deterministic=deterministic)
        self._solver = LinearSolver(runtime, deterministic=deterministic)
        self._starts: dict[str, NDArray[np.int64]] = {}
        self._offsets: dict[str, NDArray[np.int64]] = {}
        self._terms = self._make_terms(energies)
        self._static_reads = _Reads([energy.attribute for energy in energies if not energy.dynamic])
        self._bound = False
        self._static_valid = False
        self._dynamic_valid = False

    @property
    def module(self) -> ModuleOp:
        """The scene's IR after all passes, which run now if the code came from the cache."""
        if self._module is None:
            self._module = self._lower(None, locations=False)
        return self._module

    def _lower(self, dump_to: Path | None, *, locations: bool) -> ModuleOp:
        assert self._unlowered is not None
        module, self._unlowered = self._unlowered, None
        try:
            return run_pipeline(module, dump_to, locations=locations)
        except CompileError as error:
            raise UnsupportedSceneError(str(error)) from error

    def _code(self, dump_to: Path | None, locations: bool) -> SceneCode:
        """The generated code: of an equal scene, of whatever size, from the cache of compiled code."""
        vector_math = self.runtime.compiler.has_vector_math

        def emitter_of(scene: SceneView) -> CppEmitter:
            return CppEmitter(scene, vector_math)

        if dump_to is not None:
            self._module = self._lower(dump_to, locations=locations)
            return SceneCode.of(self._module, emitter_of)

        def make() -> str:
            return SceneCode.of(self.module, emitter_of).to_text()

        assert self._unlowered is not None
        parts = [text_without_sizes(self._unlowered), str(vector_math), compiler_digest()]
        return SceneCode.from_text(kept_text("scene", parts, make))

    def _runtime_log(self) -> list[CompiledModule]:
        return [CompiledModule(item.name, item.seconds, item.cached, 0) for item in self.runtime.objects]

    def _make_terms(self, energies: Sequence[EnergyTerm]) -> list[_Term]:
        derivatives = self.program.code.derivatives
        terms = []
        for energy in energies:
            symbol = self.emitter.symbol_of(energy.attribute)
            derivative = derivatives.get(symbol)
            owner = energy.attribute.owner
            terms.append(
                _Term(
                    symbol,
                    energy.attribute.where,
                    owner if isinstance(owner, Primitive | PrimitiveUnion) else None,
                    derivative.symbol if derivative is not None else None,
                    derivative.indices if derivative is not None else None,
                    derivative.capacity if derivative is not None else 0,
                    energy.dynamic,
                    MODES[energy.projection],
                )
            )
        return terms

    # -- what changed --------------------------------------------------------------------------------------

    def arrays_moved(self) -> None:
        """The scene's arrays are new ones: pointers must be taken again."""
        self._bound = False

    def connectivity_changed(self, connectivity: Connectivity) -> None:
        """Indices changed: where derivatives go must be found again, for static energies only if they read them."""
        self._bound = False
        self._dynamic_valid = False
        if connectivity in self._static_reads.connectivities:
            self._static_valid = False

    def size_changed(self, owner: Entity) -> None:
        """A number of instances changed: of targets and of union members it moves all that comes after them."""
        self._bound = False
        self._dynamic_valid = False
        if owner in self._static_reads.owners or any(target.owner is owner for target in self.targets):
            self._static_valid = False

    # -- numbers -------------------------------------------------------------------------------------------

    @property
    def is_outgrown(self) -> bool:
        """Has a connectivity of variable arity got longer rows than the code was compiled for?"""
        arities = self.program.code.arities
        return any(c.arity != arities[name] for name, c in self.emitter.connected.items())

    def bind(self) -> None:
        """Points the program to the scene's arrays, if any has moved.

        Raises DataError or ConnectivityError for numbers or indices that don't fit the numbers of instances: kernels
        read without checks.
        """
        if self._bound:
            return
        if self.is_outgrown:
            raise ConnectivityError(
                "a connectivity of variable arity now has more neighbours on an instance than the scene was compiled "
                "for; "
                "call scene.compile() again"
            )
        for owner in self.emitter.owners.values():
            owner.check_consistent()
        start = 0
        for target in self.targets:
            assert isinstance(target.node, Stored)
            self._starts[self.emitter.symbol_of(target)] = np.array([start], np.int64)
            start += target.node.array.size
        for symbol, owner in self.emitter.owners.items():
            if isinstance(owner, PrimitiveUnion):
                self._offsets[symbol] = owner.offsets()
        self.program.bind(self._address_of)
        self._bound = True

    def _address_of(self, binding: Binding) -> int:
        if binding.kind == "storage":
            node = self.emitter.stored[binding.name].node
            assert isinstance(node, Stored)
            return node.array.ctypes.data
        if binding.kind == "indices":
            return self.emitter.connected[binding.name].indices.ctypes.data
        if binding.kind == "offsets":
            return self._offsets[binding.name].ctypes.data
        return self._starts[binding.name].ctypes.data

    def data(self) -> SceneData:
        """The scene's numbers for the reference interpreter."""
        self.bind()
        storages = {}
        for symbol, attribute in self.emitter.stored.items():
            assert isinstance(attribute.node, Stored)
            storages[symbol] = attribute.node.array.copy()
        return SceneData(
            storages,
            {symbol: c.indices for symbol, c in self.emitter.connected.items()},
            {symbol: owner.num_instances for symbol, owner in self.emitter.owners.items()},
        )

    # -- work ----------------------------------------------------------------------------------------------

    def evaluate(self, attribute: Attribute) -> FloatArray:
        """Values of an output attribute on all instances, [instances, rows, columns]."""
        assert attribute.owner is not None
        return self._run(self.emitter.symbol_of(attribute), attribute.owner.num_instances, attribute.shape)

    def _run(self, symbol: str, count: int, shape: tuple[int, int]) -> FloatArray:
        self.bind()
        out = np.empty((count, *shape))
        function, arguments = self.program.function(symbol, "batch"), self.program.arguments(symbol)
        evaluate(self.runtime, function, arguments, count, out)
        return out

    def energies(self) -> dict[str, FloatArray]:
        """Each energy on all its instances, by path, [instances]."""
        return {term.symbol: self._run(term.symbol, term.count, (1, 1)).reshape(-1) for term in self._terms}

    def total_energy(self) -> float:
        """Sum of all energies; infinite or NaN where one is."""
        return float(sum(self.runtime.sum(values) for values in self.energies().values()))

    def update_structure(self) -> None:
        """Placement indices and sparsity, for the parts that changed (paper, section 6, appendices A and B)."""
        self.bind()
        shapes = [target.shape for target in self.targets]
        sizes = [target.node.array.size for target in self.targets if isinstance(target.node, Stored)]
        boundaries = np.cumsum([0, *sizes]).astype(np.int64)
        block_sizes = np.array([rows * cols for rows, cols in shapes], np.int32)
        for valid, matrix, dynamic in (
            (self._static_valid, self.static_matrix, False),
            (self._dynamic_valid, self.dynamic_matrix, True),
        ):
            if valid:
                continue
            terms = [term for term in self._terms if term.dynamic is dynamic and term.kappa is not None]
            kappas = []
            for term in terms:
                assert term.kappa is not None
                term.kappas = self.program.indices(term.kappa, term.count, term.capacity)
                kappas.append(term.kappas)
            # Both parts need the same order inside; the one with most blocks, and that seldom changes, chooses it.
            if dynamic:
                built = matrix.build(boundaries, block_sizes, kappas, order=self.static_matrix.order)
            else:
                built = matrix.build(boundaries, block_sizes, kappas, reorder=True)
            for term, positions in zip(terms, built, strict=True):
                term.positions = positions
        self._static_valid = self._dynamic_valid = True

    def assemble(self, *, hessian: bool = True, project: bool = True) -> FloatArray:
        """Gradient of all targets, end to end; fills `static_matrix` and `dynamic_matrix` (their sum is the Hessian).

        Raises NotFiniteError that names the energy and the instance.
        """
        self.update_structure()
        gradient = np.zeros(self.static_matrix.size)
        calls, terms = [], []
        for term in self._terms:
            if term.derivative is None or term.count == 0:
                continue
            assert term.kappas is not None
            calls.append(
                KernelCall(
                    self.program.function(term.derivative, "derive"),
                    self.program.arguments(term.derivative),
                    term.count,
                    term.kappas,
                    term.positions if hessian else None,
                    (1 if term.dynamic else 0) if hessian else None,
                    term.mode if project else Projection.NONE,
                )
            )
            terms.append(term)
        parts = [self.static_matrix, self.dynamic_matrix]
        statuses = self._assembler.assemble(calls, parts, gradient, self.static_matrix.block_size_at)
        for term, status in zip(terms, statuses, strict=True):
            if status.first_bad is not None:
                raise NotFiniteError(
                    f"the derivatives of energy {term.symbol} are not finite on instance {status.first_bad}; look at "
                    f"its inputs there (inverted element, distance 0, overflow?). It was made at {term.where}"
                )
        return gradient

    def solve_linear(
        self,
        gradient: FloatArray,
        tolerance: float,
        max_iterations: int,
        *,
        solver: str = "pcg",
        history: bool = False,
    ) -> tuple[FloatArray, SolveReport]:
        """x of H x = gradient for the assembled Hessian by "pcg", "direct" or "auto", and how the solver ended."""
        parts = [self.static_matrix, self.dynamic_matrix]
        return self._solver.solve(parts, gradient, tolerance, max_iterations, solver=solver, with_history=history)

    def place_of(self, unknown: int) -> str:
        """Target and instance of one scalar unknown, for messages."""
        start = 0
        for target in self.targets:
            assert isinstance(target.node, Stored)
            if unknown < start + target.node.array.size:
                return f"{target.path}, instance {(unknown - start) // (target.shape[0] * target.shape[1])}"
            start += target.node.array.size
        raise IndexError(f"unknown {unknown} of {start}")

    def split(self, stacked: FloatArray) -> list[FloatArray]:
        """A vector of all unknowns as one flat array for each target."""
        sizes = [target.node.array.size for target in self.targets if isinstance(target.node, Stored)]
        return [part.copy() for part in np.split(stacked, np.cumsum(sizes)[:-1])]
