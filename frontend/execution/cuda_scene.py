"""A scene compiled for a GPU: everything but the scene's own arrays lives on the device.

The scene's arrays are on the host, where users set and read them. Before any work, those that changed since the last
time are copied to the device; results are copied back when they are asked for. In between, placement indices, sparsity,
derivatives, assembly and the solver's vectors never leave the device.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps.backend.codegen.object_text import Binding
from yasps.backend.codegen.program import CompiledModule, dump_sources
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cuda.object import CudaEmitter
from yasps.backend.cuda.program import NONE_BAD, CudaProgram, DerivativeLaunch
from yasps.frontend.errors import ConnectivityError, DataError, UnsupportedSceneError
from yasps.frontend.execution.compiled_scene import CompiledScene, Term, ToProject
from yasps.frontend.execution.device_report import CUDA_KEY
from yasps.frontend.execution.scene_source import CompileRequest
from yasps.frontend.language.nodes import FloatArray, Stored
from yasps.frontend.language.scene_lock import one_thread_at_a_time
from yasps.runtime.assembly.cuda.gradient import CudaGradient
from yasps.runtime.assembly.cuda.sum import DeviceSum
from yasps.runtime.core.library import Runtime
from yasps.runtime.device.foreign_arrays import DeviceIndices
from yasps.runtime.device.protocol import Device, DeviceArray
from yasps.runtime.matrix.block_matrix import BlockGroup
from yasps.runtime.matrix.cuda.block_matrix import BuildScratch, CudaBlockMatrix
from yasps.runtime.solvers.cuda.pcg import CudaSolver
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PreconditionerChoice, SolveReport


@dataclass
class _Mirror:
    """A host array on the device: what was copied last."""

    array: DeviceArray
    source: NDArray[Any] | None = None
    version: int = -1

    def refresh(self, source: NDArray[Any], version: int) -> None:
        if source is not self.source or version != self.version:
            self.array.upload(source)
            self.source, self.version = source, version


class _Placement:
    """Where an energy's derivatives go, and its values."""

    def __init__(self, device: Device, name: str) -> None:
        self.kappas = DeviceArray(device, np.int32, f"placement indices of {name}")
        self.positions: DeviceArray | None = None
        self.gradient_at: DeviceArray | None = None
        self.order = DeviceArray(device, np.uint32, f"order of the instances of {name}")
        self.is_sorted = False


class CudaScene(CompiledScene):
    """A compiled scene on a device."""

    def __init__(
        self, request: CompileRequest, device: Device, runtime: Callable[[], Runtime], *, deterministic: bool = False
    ) -> None:
        """runtime: gives the CPU's, which the coarse space's aggregates are found by."""
        self.device = device
        self._runtime = runtime
        self._deterministic = deterministic
        self._mirrors: dict[Binding, _Mirror] = {}
        self._placements: dict[str, _Placement] = {}
        super().__init__(request)

    @property
    def preconditioner_choice(self) -> PreconditionerChoice:
        """What preconditioner="auto" has learned."""
        return self._solver.choice

    def _key(self) -> Sequence[str]:
        return CUDA_KEY

    def _emitter(self, view: SceneView) -> CudaEmitter:
        return CudaEmitter(view)

    def _build(self, dump_to: Path | None) -> Sequence[CompiledModule]:
        if dump_to is not None:
            dump_sources(self.code, dump_to, "cu")
        device, deterministic = self.device, self._deterministic
        self.program = CudaProgram(self.code, device)
        loaded = self.program.loaded
        scratch = self._scratch = BuildScratch(device)
        self.static_matrix = CudaBlockMatrix(device, loaded, deterministic=deterministic, scratch=scratch)
        self.dynamic_matrix = CudaBlockMatrix(
            device, loaded, with_diagonal=False, deterministic=deterministic, scratch=scratch
        )
        self._gradient = CudaGradient(device, loaded, deterministic=deterministic, scratch=scratch)
        self._right = DeviceArray(device, np.float64, "the right side of a linear system")
        self._start = DeviceArray(device, np.float64, "where the solver of a linear system begins")
        self._product = DeviceArray(device, np.float64, "the product of the Hessian with a vector")
        self._outcomes = DeviceArray(device, np.uint64, "outcomes of derivatives")
        self._values = DeviceArray(device, np.float64, "values of an attribute")
        self._sum = DeviceSum(device, loaded)
        self._solver = CudaSolver(device, loaded, self._runtime, deterministic=deterministic, scratch=scratch)
        return self.program.log

    # -- the scene's arrays --------------------------------------------------------------------------------

    def _point(self) -> None:
        self._check_indices_on_device()
        self.program.bind(self._address_of)

    def _check_indices_on_device(self) -> None:
        """Raises ConnectivityError for indices that somebody else wrote to the device and that are out of range."""
        foreign = [
            (connectivity, connectivity.stored_indices)
            for connectivity in self.emitter.connected.values()
            if isinstance(connectivity.stored_indices, DeviceIndices)
        ]
        self._outcomes.upload(np.full(len(foreign), NONE_BAD, np.uint64))
        kernel = self.program.loaded.kernel("yasps_check_indices")
        for k, (connectivity, indices) in enumerate(foreign):
            assert isinstance(indices, DeviceIndices)
            most = connectivity.target.num_instances
            self.device.launch(
                kernel, indices.size, [indices.address, indices.size, most, self._outcomes.address + 8 * k]
            )
        if not foreign:
            return
        for (connectivity, _), place in zip(foreign, self._outcomes.download(), strict=True):
            if place != NONE_BAD:
                row, slot = divmod(int(place), connectivity.arity)
                raise ConnectivityError(
                    f"{connectivity.path}: index {connectivity.indices[row, slot]} of instance {row} (slot {slot}) is "
                    f"out of range; {connectivity.target.label} has {connectivity.target.num_instances} instances"
                )

    def _address_of(self, binding: Binding) -> int:
        source, _ = self._source_of(binding)
        if isinstance(source, DeviceIndices):
            self._mirrors.pop(binding, None)
            return source.address
        if binding not in self._mirrors:
            array = DeviceArray(self.device, source.dtype, f"{binding.kind} {binding.name}")
            self._mirrors[binding] = _Mirror(array)
        self._send(binding)
        return self._mirrors[binding].array.address

    def _send(self, binding: Binding) -> None:
        source, version = self._source_of(binding)
        assert isinstance(source, np.ndarray)
        self._mirrors[binding].refresh(source, version)

    def _source_of(self, binding: Binding) -> tuple[NDArray[Any] | DeviceIndices, int]:
        """What a kernel reads, and how often it was changed in place."""
        if binding.kind == "indices" and binding.name not in self.numbers:
            return self.emitter.connected[binding.name].stored_indices, 0
        version = 0
        if binding.kind == "storage" and binding.name in self.emitter.stored:
            node = self.emitter.stored[binding.name].node
            assert isinstance(node, Stored)
            version = node.version
        return self._array_of(binding), version

    def _refresh(self) -> None:
        """Copies what changed since the last time. Arrays that moved have been bound anew."""
        self.bind()
        self._send_all()

    def _send_all(self) -> None:
        for binding in self._mirrors:
            self._send(binding)

    # -- work ----------------------------------------------------------------------------------------------

    def _run(self, symbol: str, count: int, shape: tuple[int, int]) -> FloatArray:
        self._send_all()
        self.program.launch_batch(symbol, count, self._values.resize(count, *shape))
        return self._values.download()

    @one_thread_at_a_time
    def total_energy(self) -> float:
        self._refresh()
        self._sum.begin(len(self._terms))
        for term in self._terms:
            self.program.launch_batch(term.symbol, term.count, self._values.resize(term.count))
            self._sum.add(self._values)
        return float(self._sum.results().sum())

    def _build_structure(self, terms: Sequence[Term], *, dynamic: bool) -> None:
        matrix = self.dynamic_matrix if dynamic else self.static_matrix
        placements = [self._indices_of(term) for term in terms]
        for term, placement in zip(terms, placements, strict=True):
            assert term.derivative is not None
            sort = self.program.sort_by_branches
            placement.is_sorted = sort(term.derivative, term.count, self._scratch, placement.order)
        positions = matrix.build(*self._layout(), [placement.kappas for placement in placements])
        for placement, array in zip(placements, positions, strict=True):
            placement.positions = array

    def _complete_structure(self) -> None:
        placements = [self._placements[term.symbol] for term in self._terms if term.kappa is not None]
        size, block_size_at = self.static_matrix.size, self.static_matrix.block_size_at
        places = self._gradient.build(size, block_size_at, [placement.kappas for placement in placements])
        for placement, place in zip(placements, places, strict=True):
            placement.gradient_at = place

    def _indices_of(self, term: Term) -> _Placement:
        """Computes an energy's placement indices."""
        assert term.kappa is not None
        if term.symbol not in self._placements:
            self._placements[term.symbol] = _Placement(self.device, term.symbol)
        placement = self._placements[term.symbol]
        self.program.launch_batch(term.kappa, term.count, placement.kappas.resize(term.count, term.capacity))
        return placement

    def _derive(
        self, terms: Sequence[Term], *, hessian: bool, project: ToProject
    ) -> tuple[FloatArray, Sequence[int | None]]:
        self._outcomes.upload(np.array([[NONE_BAD, 0]] * len(terms), np.uint64).reshape(-1, 2))
        self.launch_assembly(hessian=hessian, project=project, terms=terms)
        outcomes = self._outcomes.download()[:, 0]
        return self._gradient.values.download(), [int(bad) if bad != NONE_BAD else None for bad in outcomes]

    @one_thread_at_a_time
    def launch_assembly(
        self, *, hessian: bool = True, project: ToProject = True, terms: Sequence[Term] | None = None
    ) -> None:
        """What `assemble` does on the device alone, after it was called once: nothing is copied, nobody waits.
        terms: only these energies."""
        matrices = [self.static_matrix, self.dynamic_matrix]
        results: list[CudaGradient | CudaBlockMatrix] = [self._gradient, *(matrices if hessian else [])]
        for result in results:
            result.clear()
        for k, term in enumerate(self._derived_terms() if terms is None else terms):
            placement, matrix = self._placements[term.symbol], matrices[term.dynamic]
            assert term.derivative is not None
            assert placement.positions is not None
            launch = DerivativeLaunch(
                term.derivative,
                term.count,
                gradient=self._gradient.target.address,
                blocks=matrix.target.address if hessian else 0,
                kappa=placement.kappas.address,
                position=placement.positions.address,
                gradient_at=placement.gradient_at.address if placement.gradient_at is not None else 0,
                block_size_at=self.static_matrix.block_size_at.address,
                order=placement.order.address if placement.is_sorted else 0,
                mode=int(term.mode_for(project)),
                outcome=self._outcomes.address + 16 * k,
            )
            self.program.launch_derivative(launch)
        for result in results:
            result.finish()

    def _fix(self, fixed: NDArray[np.bool_]) -> None:
        raise UnsupportedSceneError(
            "unknowns can be fixed on the CPU only: make the scene with device='cpu', or take what does not move out "
            "of the minimisation targets"
        )

    @one_thread_at_a_time
    def solve_linear(
        self, gradient: FloatArray, options: SolveOptions, start: FloatArray | None = None
    ) -> tuple[FloatArray, SolveReport]:
        if options.solver == "direct":
            raise DataError(
                "solver='direct' runs on the CPU only: take solver='pcg' or 'auto' (which is 'pcg' on a GPU), or make "
                "the scene with device='cpu'"
            )
        parts = [self.static_matrix, self.dynamic_matrix]
        first = self._start.upload(start) if start is not None else None
        x, report = self._solver.solve(parts, self._right.upload(gradient), options, first)
        return x.download(), report

    @one_thread_at_a_time
    def multiply(self, x: FloatArray) -> FloatArray:
        self._solver.multiply([self.static_matrix, self.dynamic_matrix], self._start.upload(x), self._product)
        return self._product.download()

    @one_thread_at_a_time
    def placement_indices(self, term: Term) -> NDArray[np.int32]:
        return self._placements[term.symbol].kappas.download()

    @one_thread_at_a_time
    def hessian_groups(self) -> list[BlockGroup]:
        return [*self.static_matrix.download_groups(), *self.dynamic_matrix.download_groups()]
