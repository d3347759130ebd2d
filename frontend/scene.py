"""Scenes: the global scope of a simulation (paper, 4.1, 4.7, 4.8)."""

from __future__ import annotations

import os
import re
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.backend.reference.scene_data import save_scene_data
from yasps.dialects.mat import spell
from yasps.dialects.rel import PROJECTIONS
from yasps.frontend.errors import NotConvergedError, SceneError, ShapeMismatchError
from yasps.frontend.execution.compiled_scene import CompiledScene, CompileReport
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.frontend.execution.emit import EnergyTerm
from yasps.frontend.execution.hessian import Hessian
from yasps.frontend.execution.newton_system import advice_on, solve_newton_system, solve_options
from yasps.frontend.execution.scene_source import CompileRequest, make_dump_folder
from yasps.frontend.execution.variants import Variants
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.mesh import Mesh
from yasps.frontend.language.nodes import FloatArray, Stored
from yasps.frontend.language.paper_names import SceneNames
from yasps.frontend.language.resizing import resize
from yasps.frontend.language.scene_html import html_of
from yasps.frontend.language.scene_lock import lock_of, one_thread_at_a_time
from yasps.frontend.language.scene_numbers import formulas_of, numbers_of, set_numbers
from yasps.frontend.language.spelling import both_spellings, paper_spelling
from yasps.runtime.build.cache import file_name
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import Runtime, load_runtime
from yasps.runtime.solvers.pcg import SolveReport

if TYPE_CHECKING:
    from scipy import sparse

    from yasps.frontend.execution.device_report import DeviceCompileReport
    from yasps.frontend.language.connectivity import Connectivity
    from yasps.frontend.language.primitive import Primitive, PrimitiveBase
    from yasps.runtime.device.protocol import Device


_DEVICE_NAME = re.compile(r"cpu|cuda(:\d+)?")


@dataclass(frozen=True)
class Solution:
    """x of H x = g: one flat array for each minimisation target, in their order, and how the solver ended.

    The Newton step is -x. Look at `report.converged`.
    """

    directions: list[FloatArray]
    gradient: list[FloatArray]
    report: SolveReport


class _SolveOptions(TypedDict, total=False):
    """Keywords of `Scene.solve` that are spelled in one way, for type checkers."""

    solver: str
    projection: str
    history: bool
    preconditioner: str
    fixed: Mapping[Attribute, ArrayLike] | None


@both_spellings
class Scene(SceneNames, Entity):
    """Meshes, attributes, energies and minimisation targets, and what the compiler makes of them.

    device: "cpu"; "cuda", or "cuda:1" for another than the first GPU; or a `Device` (yasps.runtime.device.protocol),
    which several scenes may share. threads: of the CPU's runtime; default one for each processor. deterministic: the
    same bits for any number of threads, and on a GPU in every run, for some more time and memory; without it, on the
    CPU for the same number. Nothing is global: scenes of the same name live side by side.

    Threads may share a scene: whatever sets numbers or computes waits until no other thread does. `with scene.lock:`
    keeps the others out for several calls.
    """

    _kind = "scene"

    def __init__(
        self,
        name: str,
        *,
        device: str | Device = "cpu",
        threads: int | None = None,
        deterministic: bool = False,
    ) -> None:
        super().__init__("scene", None)
        self.name = self.check_name(name, "a scene")
        if isinstance(device, str) and not _DEVICE_NAME.fullmatch(device):
            raise SceneError(f'device={device!r}: it must be "cpu", "cuda", or "cuda:N" for the GPU number N')
        if threads is not None and (not isinstance(threads, int) or isinstance(threads, bool) or threads < 1):
            raise SceneError(f"threads={threads!r}: it must be a positive integer, or left out for one per processor")
        if threads is not None and device != "cpu":
            raise SceneError(f"threads={threads}: a GPU has its own; leave threads out")
        self.lock = lock_of(device)
        self._device_name = device
        self._device: Device | None = None
        self._threads = threads
        self._deterministic = deterministic
        self._energies: list[EnergyTerm] = []
        self._targets: list[Attribute] = []
        self._runtime: Runtime | None = None
        self._compiled: CompiledScene | None = None
        self._variants = Variants(lambda energies, inputs: self._compile_for(energies, inputs, [], None))
        self._alive: weakref.WeakSet[CompiledScene] = weakref.WeakSet()
        """All that was compiled and is still in use, by whomever: it must hear of arrays that moved."""
        self._evaluations = 0

    @property
    def scene(self) -> Scene:
        """Itself."""
        return self

    @property
    def num_instances(self) -> int:
        """A scene is one instance of itself."""
        return 1

    @property
    def path(self) -> str:
        """Empty: names inside a scene don't repeat the scene's."""
        return ""

    @property
    def label(self) -> str:
        """Name for messages."""
        return f"scene {self.name}"

    @property
    def energies(self) -> tuple[Attribute, ...]:
        """Registered energies, in order."""
        return tuple(term.attribute for term in self._energies)

    @property
    def minimize_targets(self) -> tuple[Attribute, ...]:
        """Minimisation targets, in order."""
        return tuple(self._targets)

    # -- all of it -----------------------------------------------------------------------------------------

    @one_thread_at_a_time
    def numbers(self) -> dict[str, NDArray[Any]]:
        """All numbers that were set and all indices, by their paths: [instances, rows, columns] of stored attributes,
        [instances, arity] of connectivities. They are read-only and change when the scene's do: copy what you keep."""
        return numbers_of(self)

    @one_thread_at_a_time
    def set_numbers(self, values: Mapping[str, ArrayLike]) -> None:
        """Sets numbers and indices by their paths, all or none; what is the same already is left alone.

        Raises SceneError for a path that is not there, DataError, ConnectivityError.
        """
        set_numbers(self, values)

    @one_thread_at_a_time
    def resize(
        self, counts: Mapping[Primitive, int], parts: Mapping[Attribute | Connectivity, Any]
    ) -> tuple[dict[Primitive, int], dict[Attribute | Connectivity, Any]]:
        """Other numbers of instances of primitives, with the numbers and indices that belong to them, all or none.

        counts: primitive -> how many instances it gets. parts: stored attribute or connectivity -> what `update_value`
        takes; of a variable arity, (indices, counts). For each primitive of another size, and each union that it is in,
        all stored attributes and connectivities are needed; so is every connectivity that leads to its instances, which
        may have other numbers now. Indices of unions that lead to other members alone are renumbered here. Other parts
        may be given, too. A dynamic primitive that gets no instances needs nothing.

        Nothing is compiled, but where rows of a variable arity get longer than ever and than their `longest`: placement
        indices, sparsity and what solvers keep are found again before the next result. Returns counts and parts that
        take it all back.

        Raises SceneError for what can't be resized, DataError for numbers that are missing or don't fit,
        ConnectivityError for indices that do; nothing is changed then.
        """
        return resize(self, counts, parts)

    @one_thread_at_a_time
    def formulas(self) -> dict[str, str]:
        """A digest of every energy's formula by its path: of operations, shapes and the names of what it reads, but of
        no numbers that can be set."""
        return formulas_of(self)

    @one_thread_at_a_time
    def _repr_html_(self) -> str:
        """In a notebook: meshes, primitives, what they hold with shapes, energies and targets."""
        return html_of(self)

    # -- construction --------------------------------------------------------------------------------------

    def __getattr__(self, name: str) -> Mesh:
        """A mesh by its name."""
        return cast(Mesh, self._part(name))

    @one_thread_at_a_time
    def add_mesh(self, name: str) -> Mesh:
        """Adds a mesh; reached as `scene.name` afterwards. Raises NameTakenError."""
        self.check_child_name(name, "a mesh")
        mesh = Mesh(name, self)
        self._children[name] = mesh
        return mesh

    @one_thread_at_a_time
    def add_energy(
        self, attribute: Attribute, dynamic_instances: bool | None = None, projection: str = "clamp"
    ) -> None:
        """Registers a 1x1 attribute as a term of the energy: the sum over its instances is minimised (paper, 4.7).

        dynamic_instances: may the instances change from solve to solve? Default: as the primitive says.
        projection: what is done to negative eigenvalues of the local Hessians: "clamp" to 0, "abs"olute value, "none".

        Raises ShapeMismatchError if it isn't 1x1; SceneError for another scene's attribute, one registered before, one
        without an owner, a static energy on a dynamic primitive.
        """
        self._check_energy(attribute)
        if projection not in PROJECTIONS:
            raise SceneError(f"projection must be one of {', '.join(PROJECTIONS)}, got {projection!r}")
        if any(term.attribute is attribute for term in self._energies):
            raise SceneError(f"{attribute.path} is an energy of this scene already")
        assert attribute.owner is not None
        if dynamic_instances is None:
            dynamic_instances = attribute.owner.is_dynamic
        if attribute.owner.is_dynamic and not dynamic_instances:
            raise SceneError(
                f"{attribute.path} lives on the dynamic {attribute.owner.label}: register it with "
                "dynamic_instances=True"
            )
        self._energies.append(EnergyTerm(attribute, projection, bool(dynamic_instances)))
        self.structure_changed()

    @one_thread_at_a_time
    def add_minimize_target(self, targets: Attribute | Sequence[Attribute]) -> None:
        """Adds stored variables that energies are minimised over (paper, 4.7); results come in this order.

        Raises SceneError for computed attributes, constants, other scenes' attributes and repeated ones; nothing is
        added then.
        """
        if not isinstance(targets, Attribute | Sequence):
            raise SceneError(f"minimisation targets are an attribute or a list of them, got {targets!r}")
        listed = [targets] if isinstance(targets, Attribute) else list(targets)
        for k, target in enumerate(listed):
            self._check_own(target, "a minimisation target")
            if not isinstance(target.node, Stored):
                raise SceneError(
                    f"{target.path} is computed; a minimisation target must be stored (add_attribute with rows and "
                    "cols): minimise over what it is computed from"
                )
            if target.node.constant:
                raise SceneError(f"{target.path} was made by add_constant and never takes part in differentiation")
            if any(target is known for known in (*self._targets, *listed[:k])):
                raise SceneError(f"{target.path} is a minimisation target already")
        self._targets.extend(listed)
        self.structure_changed()

    @one_thread_at_a_time
    def remove_energy(self, attribute: Attribute) -> None:
        """Takes back what `add_energy` registered; the attribute stays. Raises SceneError if it is no energy."""
        kept = [term for term in self._energies if term.attribute is not attribute]
        if len(kept) == len(self._energies):
            raise SceneError(f"{getattr(attribute, 'path', attribute)!r} is no energy of {self.label}")
        self._energies = kept
        self.structure_changed()

    @one_thread_at_a_time
    def remove_minimize_target(self, targets: Attribute | Sequence[Attribute]) -> None:
        """Takes back what `add_minimize_target` added: the numbers stay as they are from now on.

        Raises SceneError if one is no target; nothing is removed then.
        """
        listed = [targets] if isinstance(targets, Attribute) else list(targets)
        for target in listed:
            if not any(target is known for known in self._targets):
                raise SceneError(f"{getattr(target, 'path', target)!r} is no minimisation target of {self.label}")
        self._targets = [known for known in self._targets if not any(known is target for target in listed)]
        self.structure_changed()

    def _check_energy(self, attribute: Attribute) -> None:
        self._check_own(attribute, "an energy")
        if attribute.shape != (1, 1):
            raise ShapeMismatchError(
                f"an energy is 1x1 on every instance, but {attribute.path} is {spell(attribute.shape)}; reduce it, "
                "e.g. by dot, sum or norm"
            )

    def _check_own(self, attribute: Attribute, what: str) -> None:
        if not isinstance(attribute, Attribute):
            raise SceneError(f"{what} must be an attribute, got {attribute!r}")
        if attribute.owner is None:
            raise SceneError(f"{what} must live on a primitive, mesh or the scene; a number alone does not")
        if attribute.owner.scene is not self:
            other = attribute.owner.scene
            same_name = ", which has the same name but is another" if other.name == self.name else ""
            raise SceneError(f"{attribute.path} belongs to scene {other.name!r}, not to scene {self.name!r}{same_name}")

    # -- results -------------------------------------------------------------------------------------------

    @one_thread_at_a_time
    def minimize_energy(
        self,
        tolerance: float = 1e-4,
        max_iterations: int = 10_000,
        *,
        solver: str = "pcg",
        projection: str = "always",
        preconditioner: str = "jacobi",
        fixed: Mapping[Attribute, ArrayLike] | None = None,
    ) -> list[FloatArray]:
        """x of H x = g, one flat array for each target (paper, 4.8); the Newton step is the *negative*: -x.

        g is the gradient of all energies, H their projected Hessian. tolerance: relative, on the squared norm of the
        residual, r^T D^-1 r <= tolerance g^T D^-1 g with H's diagonal blocks D. The rest: see `solve`.

        Raises NotConvergedError if the solver stops before that, NotFiniteError, SceneError without energies or
        targets, DataError or ConnectivityError for numbers that don't fit a dynamic primitive's size or bad arguments.
        """
        solution = self.solve(
            tolerance,
            max_iterations,
            solver=solver,
            projection=projection,
            preconditioner=preconditioner,
            fixed=fixed,
        )
        report = solution.report
        if report.converged:
            return solution.directions
        advice = advice_on(report, self.compile())
        raise NotConvergedError(f"the linear solver stopped: {report}. {advice} solve() returns the result as it is.")

    @overload
    def solve(
        self, tolerance: float = 1e-4, max_iterations: int = 10_000, **options: Unpack[_SolveOptions]
    ) -> Solution: ...
    @overload
    def solve(self, tolerance: float = 1e-4, *, maxIterations: int, **options: Unpack[_SolveOptions]) -> Solution: ...

    @paper_spelling
    @one_thread_at_a_time
    def solve(
        self,
        tolerance: float = 1e-4,
        max_iterations: int = 10_000,
        *,
        solver: str = "pcg",
        projection: str = "always",
        history: bool = False,
        preconditioner: str = "jacobi",
        fixed: Mapping[Attribute, ArrayLike] | None = None,
    ) -> Solution:
        """As `minimize_energy`, with gradient and solver's report, and without raising when it did not converge.

        solver: "pcg", conjugate gradients; "direct", a sparse factorisation, for systems that these take thousands of
        iterations for; "auto", the one that did better (see `LinearSolver`). projection: "always"; "on-demand", which
        removes negative eigenvalues only if the exact Hessian turns out not to be positive definite; "auto", the same,
        but always for energies whose instances change (see `solve_newton_system`). history: keep the residual of every
        iteration of conjugate gradients in the report. preconditioner: of conjugate gradients, "jacobi", "two-level" or
        "auto" (see `PcgSolver`).
        fixed: target -> which of its instances stay as they are, bool [instances]: gradient and x are 0 there, and the
        system is that of the others. Nothing is compiled for it. Raises SceneError for what is no target, DataError.
        """
        options = solve_options(
            tolerance,
            max_iterations,
            solver=solver,
            projection=projection,
            history=history,
            preconditioner=preconditioner,
        )
        compiled = self.compile()
        solved = solve_newton_system(compiled, options, fixed=compiled.unknowns_of(fixed) if fixed else None)
        return Solution(compiled.split(solved.x), compiled.split(solved.gradient), solved.report)

    @one_thread_at_a_time
    def gradient(self) -> list[FloatArray]:
        """Gradient of all energies, one flat array for each target."""
        compiled = self.compile()
        return compiled.split(compiled.assemble(hessian=False))

    @one_thread_at_a_time
    def hessian(self, projected: bool = True) -> Hessian:
        """Hessian of all energies with respect to all targets, as a copy of one's own.

        projected: each energy's local Hessians made positive semi-definite as it was registered; False: exact.
        """
        self._check_complete(need_targets=True)
        if projected or all(term.projection == "none" for term in self._energies):
            compiled = self.compile()
        else:
            compiled = self._variants.of(self._energies, self._targets, exact=True)
        compiled.assemble()
        return compiled.hessian()

    @one_thread_at_a_time
    def mixed_hessian(
        self, targets: Attribute | Sequence[Attribute], parameters: Attribute | Sequence[Attribute]
    ) -> sparse.csr_array[np.float64]:
        """Second derivatives d^2 E / (d targets d parameters), exact: one row for each scalar of the targets, one
        column for each of the parameters, in the order given.

        targets and parameters: stored attributes, of add_attribute or add_constant. This is the ground of inverse
        problems: at a minimum x(p) of E, H dx/dp = -mixed_hessian(x, p).

        Raises SceneError for computed, foreign or repeated attributes, or without energies.
        """
        from scipy import sparse

        rows = [targets] if isinstance(targets, Attribute) else list(targets)
        columns = [parameters] if isinstance(parameters, Attribute) else list(parameters)
        if not rows or not columns:
            raise SceneError("mixed_hessian needs at least one target and one parameter")
        compiled = self.compile_for([*rows, *columns])
        compiled.assemble()
        count = sum(attribute.node.array.size for attribute in rows if isinstance(attribute.node, Stored))
        whole = compiled.hessian().to_scipy()
        return sparse.csr_array(whole[:count, count:])

    @one_thread_at_a_time
    def compile_for(
        self,
        inputs: Attribute | Sequence[Attribute],
        *,
        energies: Sequence[Attribute] | None = None,
        projected: bool = False,
    ) -> CompiledScene:
        """The sum of some energies compiled for derivatives with respect to these stored attributes, of add_attribute
        or add_constant, whichever the minimisation targets are; kept with the scene.

        energies: 1x1 attributes, registered or not; default all that are registered. projected: negative eigenvalues
        of the local Hessians are removed as the energies were registered, of others by "clamp"; else they are exact.

        Raises SceneError for computed, foreign or repeated inputs, foreign or repeated energies, or without any;
        ShapeMismatchError for an energy that isn't 1x1.
        """
        listed = [inputs] if isinstance(inputs, Attribute) else list(inputs)
        self._check_stored(listed)
        if not listed:
            raise SceneError("derivatives need at least one stored attribute to be taken with respect to")
        if energies is None:
            self._check_complete(need_targets=False)
            terms = self._energies
        else:
            terms = self._terms_of(energies)
        return self._variants.of(terms, listed, exact=not projected)

    @one_thread_at_a_time
    def jacobian(
        self, attribute: Attribute, variables: Attribute | Sequence[Attribute]
    ) -> sparse.csr_array[np.float64]:
        """Exact first derivatives of an attribute by stored attributes, at their present numbers: a row for each number
        of the attribute, instance by instance and row-major, a column for each of the variables, in the order given.

        Compiled on first use and kept until energies or targets of the scene change. Raises SceneError for computed,
        foreign or repeated variables, and for another scene's attribute.
        """
        columns = [variables] if isinstance(variables, Attribute) else list(variables)
        self._check_own(attribute, "what is differentiated")
        if not columns:
            raise SceneError("jacobian needs at least one variable")
        self._check_stored(columns)
        return self._variants.jacobian(attribute, columns)

    def _check_stored(self, variables: Sequence[Attribute]) -> None:
        """Raises SceneError for what derivatives can't be taken by."""
        for k, attribute in enumerate(variables):
            self._check_own(attribute, "a target or parameter")
            if not isinstance(attribute.node, Stored):
                raise SceneError(
                    f"{attribute.path} is computed; derivatives are taken with respect to stored attributes"
                )
            if any(attribute is other for other in variables[:k]):
                raise SceneError(f"{attribute.path} is named twice")

    def _terms_of(self, energies: Sequence[Attribute]) -> list[EnergyTerm]:
        """Energies as they were registered; others as they would be by default."""
        if not energies:
            raise SceneError("derivatives need at least one energy")
        terms = []
        for k, attribute in enumerate(energies):
            self._check_energy(attribute)
            if any(attribute is other for other in energies[:k]):
                raise SceneError(f"{attribute.path} is named twice")
            assert attribute.owner is not None
            registered = [term for term in self._energies if term.attribute is attribute]
            terms.append(registered[0] if registered else EnergyTerm(attribute, "clamp", attribute.owner.is_dynamic))
        return terms

    def _check_complete(self, *, need_targets: bool) -> None:
        """Raises SceneError without energies or, if they are needed, targets."""
        if not self._energies:
            raise SceneError(f"{self.label} has no energy yet: add_energy(attribute) first")
        if need_targets and not self._targets:
            raise SceneError(f"{self.label} has no minimisation target yet: add_minimize_target(attribute) first")

    @one_thread_at_a_time
    def total_energy(self) -> float:
        """Sum of all energies over all their instances; infinite or NaN where one is."""
        return self.compile(need_targets=False).total_energy()

    @one_thread_at_a_time
    def energy_values(self) -> dict[str, FloatArray]:
        """Each energy on every instance, by its path."""
        return self.compile(need_targets=False).energies()

    @overload
    def compile(self, *, need_targets: bool = True) -> CompiledScene: ...
    @overload
    def compile(self, *, needTargets: bool) -> CompiledScene: ...
    @overload
    def compile(self, *, device: str, arch: str) -> DeviceCompileReport: ...

    @paper_spelling
    @one_thread_at_a_time
    def compile(
        self, *, need_targets: bool = True, device: str | None = None, arch: str | None = None
    ) -> CompiledScene | DeviceCompileReport:
        """Compiles the scene now (it happens by itself when needed) and returns the compiled scene.

        device="cuda", arch="sm_90": compiles and links for GPUs of that architecture instead, wherever the scene runs,
        and returns what came of it: one row for each module, with seconds, registers, bytes of stack and of spills.
        That needs `pip install 'yasps[cuda]'` but no GPU.

        Raises SceneError without energies (or, unless told otherwise, targets), CompilerNotFoundError,
        CudaNotFoundError.
        """
        if (device, arch) != (None, None) and (device != "cuda" or not re.fullmatch(r"sm_\d+[a-z]?", str(arch))):
            raise SceneError(
                f"compile(device={device!r}, arch={arch!r}): without them the scene is compiled for the device it was "
                'made with; device="cuda", arch="sm_90" compiles for a GPU of that architecture, without running it'
            )
        self._check_complete(need_targets=need_targets)
        if arch is not None:
            from yasps.frontend.execution.device_report import compile_for_device

            return compile_for_device(CompileRequest(self._symbol, self._energies, self._targets), arch)
        if self._compiled is None or self._compiled.is_outgrown:
            self._compiled = self._compile_for(self._energies, self._targets, [], self._dump_folder())
        return self._compiled

    def _compile_for(
        self,
        energies: Sequence[EnergyTerm],
        targets: Sequence[Attribute],
        outputs: Sequence[Attribute],
        dump_to: Path | None,
        dump_locations: bool = False,
    ) -> CompiledScene:
        request = CompileRequest(self._symbol, energies, targets, outputs, dump_to, dump_locations, self.lock)
        compiled: CompiledScene
        if not self.is_on_device:
            compiled = CpuScene(request, self.runtime, deterministic=self._deterministic)
        else:
            from yasps.frontend.execution.cuda_scene import CudaScene

            compiled = CudaScene(request, self.device, lambda: self.runtime, deterministic=self._deterministic)
        self._alive.add(compiled)
        return compiled

    @property
    def _symbol(self) -> str:
        """Its name in the IR: another than that of any part, whose paths don't end in a dot."""
        taken = self.name in self.attributes or self.name in self._children
        return f"{self.name}." if taken else self.name

    @property
    def compile_report(self) -> CompileReport:
        """What compiling the scene took; compiles if needed."""
        return self.compile().report

    @property
    def is_on_device(self) -> bool:
        """Does the scene run on a GPU?"""
        return self._device_name != "cpu"

    @property
    @one_thread_at_a_time
    def device(self) -> Device:
        """The GPU, with a stream of this scene's own; opened on first use.

        Raises NoDeviceError without a GPU or its driver, CudaNotFoundError, SceneError for a scene on the CPU.
        """
        if self._device is None:
            if not self.is_on_device:
                raise SceneError(f"{self.label} runs on the CPU: make it with device='cuda' to have a GPU")
            if isinstance(self._device_name, str):
                from yasps.runtime.device.gpu import Gpu

                self._device = Gpu(int(self._device_name.partition(":")[2] or 0))
            else:
                self._device = self._device_name
            self.lock.has_device = True
        return self._device

    @property
    @one_thread_at_a_time
    def runtime(self) -> Runtime:
        """The CPU's solver runtime; compiled and loaded on first use."""
        if self._runtime is None:
            self._runtime = load_runtime(find_compiler(), self._threads)
        return self._runtime

    @one_thread_at_a_time
    def evaluate(self, attribute: Attribute) -> FloatArray:
        """Values of an attribute on all instances, [instances, rows, columns]; see `Attribute.compute`.

        Raises SceneError for another scene's attribute.
        """
        self._check_own(attribute, "what is computed")
        if isinstance(attribute.node, Stored):
            return attribute.node.array.copy()
        if attribute.evaluator is None or attribute.evaluator.is_outgrown:
            self._evaluations += 1
            folder = self._dump_folder(f"compute-{self._evaluations}")
            attribute.evaluator = self._compile_for([], [], [attribute], folder)
        return attribute.evaluator.evaluate(attribute)

    @one_thread_at_a_time
    def dump_ir(self, folder: str | Path, *, locations: bool = False) -> None:
        """Compiles the scene once more and writes into the folder the IR after every pass, the generated sources, and
        the scene's numbers as `data.npz`, on which `yasps-opt --interpret` runs any of the dumps.

        locations: print behind each attribute the line of Python that made it.

        Raises what `compile` does, DataError or ConnectivityError for numbers that don't fit, and SceneError for what
        can't be a folder.
        """
        target = make_dump_folder(folder)
        self.compile()
        compiled = self._compile_for(self._energies, self._targets, [], target, locations)
        save_scene_data(target / "data.npz", compiled.data())

    def _dump_folder(self, part: str = "") -> Path | None:
        setting = os.environ.get("YASPS_DUMP_IR")
        return make_dump_folder(Path(setting) / file_name(self.name) / part) if setting else None

    # -- what changed --------------------------------------------------------------------------------------

    def structure_changed(self) -> None:
        """The next result needs a new compile of the energies."""
        self._compiled = None
        self._variants.forget()

    def arrays_moved(self, owner: Entity) -> None:
        """Some array of the owner was replaced by another."""
        for compiled in self._alive:
            compiled.arrays_moved(owner)

    def connectivity_changed(self, connectivity: Connectivity) -> None:
        """Indices changed: derivatives go elsewhere."""
        for compiled in self._alive:
            compiled.connectivity_changed(connectivity)

    def size_changed(self, primitive: PrimitiveBase) -> None:
        """A primitive or union has another number of instances."""
        for compiled in self._alive:
            compiled.size_changed(primitive)


scene = Scene
"""The paper's spelling: `from yasps import scene; s0 = scene("scene0")`."""


def add_scene(name: str) -> Scene:
    """A new scene (paper, table 4)."""
    return Scene(name)
