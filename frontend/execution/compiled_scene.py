"""What a scene compiled for any device has in common: its code, its terms, and what must be done again when."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from xdsl.dialects.builtin import ModuleOp

from yasps.backend.codegen.object_text import Binding, ObjectEmitter
from yasps.backend.codegen.program import CompiledModule
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.reference.scene_data import SceneData
from yasps.frontend.errors import ConnectivityError, NotFiniteError, SceneError, UnsupportedSceneError
from yasps.frontend.execution.emit import EnergyTerm
from yasps.frontend.execution.fixed_unknowns import unknowns_of
from yasps.frontend.execution.hessian import Hessian
from yasps.frontend.execution.scene_source import CompileRequest, SceneSource
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.location import Location
from yasps.frontend.language.nodes import FloatArray, Joined, Stored, operands_of
from yasps.frontend.language.primitive import Primitive, PrimitiveBase, PrimitiveUnion
from yasps.frontend.language.scene_lock import one_thread_at_a_time
from yasps.runtime.core.library import Projection
from yasps.runtime.matrix.block_matrix import MOST_LOCAL_BLOCKS, MOST_SCALARS, BlockGroup
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PreconditionerChoice, SolveReport

MODES = {"clamp": Projection.CLAMP, "abs": Projection.ABS, "none": Projection.NONE}

ToProject: TypeAlias = bool | Literal["dynamic"]
"""Whether negative eigenvalues are removed: of all energies, of none, or only of those whose instances change."""


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
class Term:
    """An energy in the program."""

    symbol: str
    where: Location
    owner: Primitive | PrimitiveUnion | None
    derivative: str | None
    kappa: str | None
    capacity: int
    dynamic: bool
    mode: Projection

    @property
    def count(self) -> int:
        """How many instances it has now."""
        return 1 if self.owner is None else self.owner.num_instances

    @property
    def blocks(self) -> int:
        """Of all its local Hessians: pairs of places."""
        return self.count * (self.capacity * (self.capacity + 1) // 2)

    def mode_for(self, project: ToProject) -> Projection:
        """What becomes of negative eigenvalues, if they are to be removed at all."""
        wanted = self.dynamic if project == "dynamic" else project
        return self.mode if wanted else Projection.NONE


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


class _Kept:
    """Values of an attribute that depends on no target, and what they were computed from."""

    def __init__(self, attribute: Attribute) -> None:
        assert attribute.owner is not None
        self.attribute, self.owner = attribute, attribute.owner
        self._stored = [one.node for one in attribute.inputs if isinstance(one.node, Stored)]
        self._connectivities = list(_Reads([attribute]).connectivities)
        self.array: FloatArray = np.empty((0, *attribute.shape))
        self._computed_from: list[object] = []

    def state(self) -> list[object]:
        """All that the values are computed from; what has not changed is the same object or number."""
        state: list[object] = [self.owner.num_instances]
        for node in self._stored:
            state += (node.array, node.version)
        state += [connectivity.stored_indices for connectivity in self._connectivities]
        return state

    @property
    def is_stale(self) -> bool:
        """Has something changed since?"""
        return not self._computed_from or any(
            new is not old and not (isinstance(new, int) and new == old)
            for new, old in zip(self.state(), self._computed_from, strict=True)
        )

    def renew(self, array: FloatArray) -> None:
        """Takes the values as they are now."""
        self.array, self._computed_from = array, self.state()


def _followed(connectivities: Iterable[Connectivity], owners: Iterable[Entity]) -> set[Entity]:
    """Those whose number of instances others must fit: targets of connectivities, and members of unions."""
    found: set[Entity] = set()
    stack: list[Entity] = [connectivity.target for connectivity in connectivities]
    stack += [owner for owner in owners if isinstance(owner, PrimitiveUnion)]
    while stack:
        entity = stack.pop()
        if entity not in found:
            found.add(entity)
            stack += entity.members if isinstance(entity, PrimitiveUnion) else ()
    return found


class CompiledScene(InScene, ABC):
    """Machine code for energies, targets and outputs of a scene, bound to its arrays."""

    def __init__(self, request: CompileRequest) -> None:
        self._lock = request.lock
        self.targets = list(request.targets)
        start = time.perf_counter()
        self._source = SceneSource(request, self._emitter, self._key())
        self.emitter, self.code, self.numbers = self._source.emitter, self._source.code, self._source.numbers
        symbolic = time.perf_counter() - start
        modules = self._build(request.dump_to)
        native = time.perf_counter() - start - symbolic
        self.report = CompileReport(symbolic, native, tuple(modules))
        self._starts: dict[str, NDArray[np.int64]] = {}
        self._offsets: dict[str, NDArray[np.int64]] = {}
        self._terms = self._make_terms(request.energies)
        self._owners = set(self.emitter.owners.values())
        self._connected = set(self.emitter.connected.values())
        for connectivity in self._connected:
            connectivity.compiled_arity = max(connectivity.compiled_arity, connectivity.arity)
        self._unchecked: set[Entity] = set(self._owners)  # may have numbers or indices that do not fit
        self._kept = {name: _Kept(attribute) for name, attribute in self.emitter.kept.items()}
        self._followed = _followed(self._connected, self._owners)
        self._static_reads = _Reads([energy.attribute for energy in request.energies if not energy.dynamic])
        self._bound = False
        self._static_valid = False
        self._dynamic_valid = False

    # -- what devices differ in ----------------------------------------------------------------------------

    @abstractmethod
    def _key(self) -> Sequence[str]:
        """What the generated code depends on apart from the scene."""

    @abstractmethod
    def _emitter(self, view: SceneView) -> ObjectEmitter:
        """What emits the code."""

    @abstractmethod
    def _build(self, dump_to: Path | None) -> Sequence[CompiledModule]:
        """Compiles and loads the code, and makes room for what it computes; returns the compile log."""

    @abstractmethod
    def _point(self) -> None:
        """Points the program to the scene's arrays as they are now."""

    @abstractmethod
    def _run(self, symbol: str, count: int, shape: tuple[int, int]) -> FloatArray:
        """Values of a computed attribute on `count` instances; the program is bound."""

    @abstractmethod
    def total_energy(self) -> float:
        """Sum of all energies; infinite or NaN where one is."""

    @abstractmethod
    def _build_structure(self, terms: Sequence[Term], *, dynamic: bool) -> None:
        """Placement indices of some terms and the sparsity of their part, the static or the dynamic one."""

    @abstractmethod
    def _derive(
        self, terms: Sequence[Term], *, hessian: bool, project: ToProject
    ) -> tuple[FloatArray, Sequence[int | None]]:
        """Gradient of all targets and, with `hessian`, the Hessian, which stays inside; of each term the first
        instance, if any, whose derivatives are not finite."""

    @abstractmethod
    def _fix(self, fixed: NDArray[np.bool_]) -> None:
        """Makes rows and columns of these unknowns in the assembled Hessian those of the identity."""

    @abstractmethod
    def solve_linear(
        self, gradient: FloatArray, options: SolveOptions, start: FloatArray | None = None
    ) -> tuple[FloatArray, SolveReport]:
        """x of H x = gradient for the assembled Hessian, and how the solver ended. start: where conjugate gradients
        begin, default 0. Raises DataError for a solver that the device does not have."""

    @abstractmethod
    def multiply(self, x: FloatArray) -> FloatArray:
        """H x for the assembled Hessian, x [unknowns]."""

    @abstractmethod
    def placement_indices(self, term: Term) -> NDArray[np.int32]:
        """Where the derivatives of an energy of changing instances went when last assembled, [instances, slots]:
        1-based scalar offsets of dof blocks, 0 for none."""

    @abstractmethod
    def hessian_groups(self) -> list[BlockGroup]:
        """The blocks of the assembled Hessian by shape, on the host; of one place there may be several."""

    @property
    def direct_solves_left(self) -> int:
        """How many of the next systems solver="auto" gives to the direct solver; 0 on a device that has none."""
        return 0

    @direct_solves_left.setter
    def direct_solves_left(self, count: int) -> None:
        """For a state that goes on elsewhere."""

    @property
    @abstractmethod
    def preconditioner_choice(self) -> PreconditionerChoice:
        """What preconditioner="auto" has learned."""

    # -- code ----------------------------------------------------------------------------------------------

    @property
    @one_thread_at_a_time
    def module(self) -> ModuleOp:
        """The scene's IR after all passes, which run now if the code came from the cache."""
        return self._source.module

    def _make_terms(self, energies: Sequence[EnergyTerm]) -> list[Term]:
        derivatives = self.code.derivatives
        terms = []
        for energy in energies:
            symbol = self.emitter.symbol_of(energy.attribute)
            derivative = derivatives.get(symbol)
            owner = energy.attribute.owner
            terms.append(
                Term(
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

    def arrays_moved(self, owner: Entity) -> None:
        """The owner's arrays are new ones: pointers must be taken again."""
        if self._reads(owner):
            self._bound = False
            self._unchecked.add(owner)

    def _reads(self, owner: Entity) -> bool:
        return not isinstance(owner, PrimitiveBase) or owner in self._owners

    def connectivity_changed(self, connectivity: Connectivity) -> None:
        """Indices changed: where derivatives go must be found again, for static energies only if they read them."""
        if connectivity not in self._connected:
            return
        self._bound = False
        self._dynamic_valid = False
        if connectivity in self._static_reads.connectivities:
            self._static_valid = False
        self._unchecked.add(connectivity.source)

    def size_changed(self, owner: Entity) -> None:
        """A number of instances changed: of targets and of union members it moves all that comes after them."""
        if not self._reads(owner):
            return
        self._bound = False
        self._unchecked |= self._owners if owner in self._followed else {owner}
        self._dynamic_valid = False
        if owner in self._static_reads.owners or any(target.owner is owner for target in self.targets):
            self._static_valid = False

    # -- numbers -------------------------------------------------------------------------------------------

    @property
    def is_outgrown(self) -> bool:
        """Has a connectivity of variable arity got longer rows than the code was compiled for?"""
        arities = self.code.arities
        return not self._bound and any(c.arity != arities[name] for name, c in self.emitter.connected.items())

    @one_thread_at_a_time
    def bind(self) -> None:
        """Points the program to the scene's arrays, if any has moved.

        Raises DataError or ConnectivityError for numbers or indices that don't fit the numbers of instances, since
        kernels read without checks; SceneError for more unknowns than 32-bit indices reach.
        """
        if not self._bound:
            self._bind()
        for kept in self._kept.values():
            if kept.is_stale:
                symbol, shape = self.emitter.symbol_of(kept.attribute), kept.attribute.shape
                kept.renew(self._run(symbol, kept.owner.num_instances, shape))
                self._point()

    def _bind(self) -> None:
        if self.is_outgrown:
            raise ConnectivityError(
                "a connectivity of variable arity now has more neighbours on an instance than the scene was compiled "
                "for; "
                "call scene.compile() again"
            )
        for owner in self._owners & self._unchecked:
            owner.check_consistent()
        start = 0
        for target in self.targets:
            assert isinstance(target.node, Stored)
            _set_if_new(self._starts, self.emitter.symbol_of(target), np.array([start], np.int64))
            start += target.node.array.size
        if start > MOST_SCALARS:
            raise SceneError(
                f"the minimisation targets have {start} unknowns together, but at most {MOST_SCALARS} can be solved for"
            )
        for symbol, owner in self.emitter.owners.items():
            if isinstance(owner, PrimitiveUnion):
                _set_if_new(self._offsets, symbol, owner.offsets())
        self._point()
        self._unchecked.clear()
        self._bound = True

    @one_thread_at_a_time
    def data(self) -> SceneData:
        """The scene's numbers for the reference interpreter."""
        self.bind()
        storages = {symbol: numbers.copy() for symbol, numbers in self.numbers.items()}
        storages |= {symbol: kept.array.copy() for symbol, kept in self._kept.items()}
        for symbol, attribute in self.emitter.stored.items():
            assert isinstance(attribute.node, Stored)
            storages[symbol] = attribute.node.array.copy()
        return SceneData(
            storages,
            {symbol: c.indices for symbol, c in self.emitter.connected.items()},
            {symbol: owner.num_instances for symbol, owner in self.emitter.owners.items()},
        )

    def read_beside_targets(self) -> list[tuple[object, int]]:
        """All that the code reads but the targets: each array or list of indices, and how often it was set in place.
        What was not set since is the same object and number."""
        stored = [attribute.node for attribute in self.emitter.stored.values() if attribute not in self.targets]
        arrays = [(node.array, node.version) for node in stored if isinstance(node, Stored)]
        return [*arrays, *((connected.stored_indices, 0) for connected in self.emitter.connected.values())]

    def _array_of(self, binding: Binding) -> NDArray[Any]:
        """The array on the host that a kernel reads."""
        if binding.name in self.numbers:
            return self.numbers[binding.name]
        if binding.name in self._kept:
            return self._kept[binding.name].array
        if binding.kind == "storage":
            node = self.emitter.stored[binding.name].node
            assert isinstance(node, Stored)
            return node.array
        if binding.kind == "indices":
            connectivity = self.emitter.connected[binding.name]
            stored = connectivity.stored_indices
            return stored if isinstance(stored, np.ndarray) else connectivity.indices
        return (self._offsets if binding.kind == "offsets" else self._starts)[binding.name]

    # -- work ----------------------------------------------------------------------------------------------

    def _refresh(self) -> None:
        """Makes what kernels read as it is now."""
        self.bind()

    @one_thread_at_a_time
    def update_structure(self) -> None:
        """Placement indices and sparsity, for the parts that changed (paper, section 6, appendices A and B)."""
        self._refresh()
        if self._static_valid and self._dynamic_valid:
            return
        if not self._static_valid:
            self._place(dynamic=False)
        if not self._dynamic_valid:
            self._place(dynamic=True)
        self._complete_structure()
        self._static_valid = self._dynamic_valid = True

    def _place(self, *, dynamic: bool) -> None:
        """Builds the structure of a part. Raises UnsupportedSceneError for more local blocks than there may be."""
        terms = self._placed_terms(dynamic=dynamic)
        if sum(term.blocks for term in terms) > MOST_LOCAL_BLOCKS:
            worst = max(terms, key=lambda term: term.blocks)
            raise UnsupportedSceneError(
                f"{worst.symbol} (made at {worst.where.file}:{worst.where.line}) has {worst.blocks} local blocks: each"
                f" of its {worst.count} instances depends on up to {worst.capacity} places of unknowns, and has a block"
                f" for every two of them; all energies together may have {MOST_LOCAL_BLOCKS}, which are numbered with"
                " 32 bits; connect each instance to fewer others, or make fewer instances"
            )
        self._build_structure(terms, dynamic=dynamic)

    def _complete_structure(self) -> None:
        """What depends on both parts, after one of them was built."""

    def _placed_terms(self, *, dynamic: bool) -> list[Term]:
        """Energies of the static or the dynamic part that depend on targets."""
        return [term for term in self._terms if term.dynamic is dynamic and term.kappa is not None]

    def _derived_terms(self) -> list[Term]:
        """Energies that have derivatives now."""
        return [term for term in self._terms if term.derivative is not None and term.count]

    @one_thread_at_a_time
    def assemble(
        self, *, hessian: bool = True, project: ToProject = True, fixed: NDArray[np.bool_] | None = None
    ) -> FloatArray:
        """Gradient of all targets, end to end; with `hessian` also the Hessian, which stays inside, else that is left
        as it is. project: remove negative eigenvalues as the energies were registered; "dynamic": only of those
        whose instances change. fixed: unknowns that stay as they are, [unknowns], whole instances of targets: their
        gradient is 0, and so are their rows and columns of the Hessian, but for ones on the diagonal.

        Raises NotFiniteError that names the energy and the instance.
        """
        self.update_structure()
        gradient = self._gradient_of(self._derived_terms(), hessian=hessian, project=project)
        if fixed is not None:
            gradient[fixed] = 0.0
            if hessian:
                self._fix(fixed)
        return gradient

    @one_thread_at_a_time
    def gradients(self, paths: Collection[str] | None = None) -> dict[str, FloatArray]:
        """Of each energy that has derivatives now, by path, the gradient of all targets, end to end; paths: of these
        energies alone."""
        self.update_structure()
        terms = [term for term in self._derived_terms() if paths is None or term.symbol in paths]
        return {term.symbol: self._gradient_of([term], hessian=False, project=False) for term in terms}

    def _gradient_of(self, terms: Sequence[Term], *, hessian: bool, project: ToProject) -> FloatArray:
        gradient, first_bad = self._derive(terms, hessian=hessian, project=project)
        for term, instance in zip(terms, first_bad, strict=True):
            if instance is not None:
                raise self._not_finite(term, instance)
        self._check_gradient(gradient)
        return gradient

    @one_thread_at_a_time
    def evaluate(self, attribute: Attribute) -> FloatArray:
        """Values of an output attribute on all instances, [instances, rows, columns]."""
        assert attribute.owner is not None
        self._refresh()
        return self._run(self.emitter.symbol_of(attribute), attribute.owner.num_instances, attribute.shape)

    @one_thread_at_a_time
    def energies(self) -> dict[str, FloatArray]:
        """Each energy on all its instances, by path, [instances]."""
        self.bind()
        none = np.empty(0)
        return {
            term.symbol: self._run(term.symbol, count, (1, 1)).reshape(-1) if (count := term.count) else none
            for term in self._terms
        }

    @one_thread_at_a_time
    def hessian(self) -> Hessian:
        """A copy of the assembled Hessian."""
        return Hessian(int(self._layout()[0][-1]), self.hessian_groups())

    def _layout(self) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Scalar offsets of the targets, [targets + 1], and scalars of one instance of each."""
        sizes = [target.node.array.size for target in self.targets if isinstance(target.node, Stored)]
        boundaries = np.cumsum([0, *sizes]).astype(np.int64)
        return boundaries, np.array([rows * cols for rows, cols in (t.shape for t in self.targets)], np.int32)

    def unknowns_of(self, fixed: Mapping[Attribute, ArrayLike]) -> NDArray[np.bool_]:
        """For each scalar unknown whether it is fixed, [unknowns]; fixed: target -> bool [instances].

        Raises SceneError for what is no target, DataError for other shapes and types.
        """
        return unknowns_of(self.targets, fixed)

    def _not_finite(self, term: Term, instance: int) -> NotFiniteError:
        value = float(self._run(term.symbol, term.count, (1, 1))[instance, 0, 0])
        what = f"energy {term.symbol} is not finite ({value})"
        if np.isfinite(value):
            what = f"the derivatives of energy {term.symbol} are not finite"
        return NotFiniteError(
            f"{what} on instance {instance}{_connected(term.owner, instance)}; "
            "look at its inputs there (inverted element, distance 0, overflow?). "
            f"It was made at {term.where}"
        )

    def _check_gradient(self, gradient: FloatArray) -> None:
        """Raises NotFiniteError that names the target: each energy is finite, but what lies behind its JOINs is not."""
        if not np.isfinite(gradient).all():
            unknown = int(np.argmin(np.isfinite(gradient)))
            raise NotFiniteError(
                f"the gradient is not finite on {self.place_of(unknown)}, though each energy has finite derivatives "
                "with respect to what it reads: what a JOIN or UNION reads has none with respect to this target there "
                "(the norm of a zero vector, the root of 0, overflow?)"
            )

    def place_of(self, unknown: int) -> str:
        """Target and instance of one scalar unknown, for messages."""
        start = 0
        for target in self.targets:
            assert isinstance(target.node, Stored)
            if unknown < start + target.node.array.size:
                return f"{target.path}, instance {(unknown - start) // (target.shape[0] * target.shape[1])}"
            start += target.node.array.size
        raise IndexError(f"unknown {unknown} of {start}")

    def changing_energies_at(self, unknown: int) -> list[str]:
        """Names, for messages, of the energies whose instances change (such as contact) and that act on the dof block
        which starts at this scalar; each with the instance where it is largest."""
        found = []
        values = self.energies()
        for term in self._terms:
            if not term.dynamic or term.kappa is None or term.count == 0:
                continue
            acting = np.flatnonzero((self.placement_indices(term) == unknown + 1).any(axis=1))
            if acting.size:
                largest = int(acting[np.argmax(values[term.symbol][acting])])
                found.append(f"{term.symbol} on instance {largest}{_connected(term.owner, largest)}")
        return found

    def split(self, stacked: FloatArray) -> list[FloatArray]:
        """A vector of all unknowns as one flat array for each target: views of it."""
        ends = self._layout()[0].tolist()
        return [stacked[start:end] for start, end in pairwise(ends)]


def _connected(owner: Primitive | PrimitiveUnion | None, instance: int) -> str:
    """What an instance is connected to, for messages."""
    if owner is None or not owner.connectivities:
        return ""
    parts = [
        f"{c.name}: " + ", ".join(_name_of(c.target, int(index)) for index in c.indices[instance] if index >= 0)
        for c in owner.connectivities.values()
    ]
    return f" ({'; '.join(parts)})"


def _name_of(primitive: PrimitiveBase, instance: int) -> str:
    """An instance's name; that of a union is the member's."""
    if not isinstance(primitive, PrimitiveUnion):
        return f"{primitive.path} {instance}"
    starts = primitive.offsets()
    k = int(np.searchsorted(starts, instance, side="right")) - 1
    return _name_of(primitive.members[k], instance - int(starts[k]))


def _set_if_new(arrays: dict[str, NDArray[np.int64]], name: str, array: NDArray[np.int64]) -> None:
    """Keeps the array that is there if it is equal: it need not be copied to a device again then."""
    if name not in arrays or not np.array_equal(arrays[name], array):
        arrays[name] = array
