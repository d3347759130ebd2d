"""Bodies, contact and time steps together: what a scene of moving things usually needs, and no more.

`Simulation` writes what a user would write with the language: inertia and gravity on every vertex, the union of all
vertices with contact on it, targets, backward Euler. The scene stays the user's: energies of one's own are added to it
in the next line.
"""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from yasps import (
    Attribute,
    ConnectivityError,
    Scene,
    SceneError,
    ShapeMismatchError,
    UnsupportedSceneError,
    YaspsError,
    materials,
)
from yasps.bodies import Body, HalfSpace, MovingObstacle
from yasps.contact import BarrierContact, ContactForces, ContactTable, check_start, contact_forces
from yasps.frontend.language.arrays import checked_count, positive_number, real_numbers
from yasps.meshes.tetrahedral_mesh import Float64Array
from yasps.output import FrameProgress, TimeTable
from yasps.stepping import (
    BACKWARD_EULER,
    Anchors,
    Driven,
    DrivenSurface,
    DrivenVertices,
    Integrator,
    MovingPart,
    NewtonReport,
    NewtonSettings,
    Pins,
    Prescribed,
    StepReport,
    TimeStepper,
    checked_integrator,
    step_or_halves,
    step_report,
)

LOGGER = logging.getLogger("yasps")

PAST = "past/"
"""How names of what a state has of the step before it begin."""
PIN_STIFFNESS = 1e3
"""Stiffness of a pin, in masses of its body over the squared time step: a body that hangs on one sinks by
g dt^2 / 1e3."""


ForceField = Callable[[Float64Array, Float64Array, float], ArrayLike]
"""Forces [N] on vertices, [n, 3] or [3], of their positions [m] and velocities [m/s], both [n, 3], and the time [s]."""


class Recorder(Protocol):
    """What `run` shows every frame to."""

    def record(self, simulation: Simulation) -> None:
        """Notes the state as it is now."""


@dataclass(frozen=True)
class _ContactOptions:
    table: ContactTable
    barrier: str
    stiffness: float | None
    eps_v: float
    lagging: str
    integrator: Integrator


class Simulation:
    """Steps bodies of one scene through time.

    scene: the one that the bodies were added to. bodies: at least one that moves. time_step [s]. gravity [m/s^2].
    activation_distance [m]: surfaces closer than this repel; default 1/1000 of the diagonal of the box around what
    moves. contact: False for none at all. contacts: friction and stiffness of pairs of bodies, by name. barrier,
    contact_stiffness: see `BarrierContact`; by default "log", with a tenth of the softer body's modulus [Pa]; for
    "paper" 10 N over the cubed activation distance [J/m^4]. velocities: body -> velocity at the start [m/s], one or one
    for each vertex. settings: of Newton's method; by default the tolerance is a tenth of the activation distance a
    step, at most 2e-3 m/s, with friction at most a tenth of eps_v. eps_v: speed below which things with friction stick
    [m/s]. lagging, integrator: see `TimeStepper`. rescue: how often a time step that fails is cut in two, see `step`.

    `gravity` is a constant of the scene that can be changed between steps; `effective_step` [s] is one that energies of
    velocities read, for (x - X) / effective_step (see `Integrator`); `before_step` and `after_step` are lists of
    functions that are called with the simulation.

    Raises SceneError, IntersectionError if surfaces cross at the start.
    """

    def __init__(
        self,
        scene: Scene,
        bodies: Sequence[Body],
        *,
        time_step: float = 0.01,
        gravity: ArrayLike = (0.0, 0.0, -9.8),
        contact: bool = True,
        activation_distance: float | None = None,
        contacts: ContactTable | None = None,
        barrier: str = "log",
        contact_stiffness: float | None = None,
        eps_v: float = 1e-3,
        lagging: str = "once",
        integrator: Integrator = BACKWARD_EULER,
        velocities: Mapping[Body, ArrayLike] | None = None,
        settings: NewtonSettings | None = None,
        rescue: int = 3,
        times: TimeTable | None = None,
    ) -> None:
        self.scene = scene
        self.bodies: list[Body] = []
        self.before_step: list[Callable[[Simulation], None]] = []
        self.after_step: list[Callable[[Simulation], None]] = []
        self.times = times or TimeTable()
        self.frame = 0
        self._last: NewtonReport | None = None
        self._has_contact = contact
        self._given = (activation_distance, settings)
        self._contact_options = _ContactOptions(
            contacts or ContactTable(),
            barrier,
            contact_stiffness,
            positive_number(eps_v, "eps_v", "m/s", SceneError),
            lagging,
            checked_integrator(integrator),
        )
        self._predicted: dict[Body, Attribute] = {}
        self._fields: list[tuple[Body, ForceField, str]] = []
        self._unions = self._pins = 0
        self._drives: dict[Body, DrivenSurface] = {}
        self._driven: list[Driven] = []
        """All that is driven, obstacles and pins."""
        self.rescue = checked_count(rescue, "rescue", 0, SceneError)
        self.contact: BarrierContact | None = None
        if not time_step > 0:
            raise SceneError(f"time_step must be positive, got {time_step} s")
        self._check(bodies)
        if contact:
            check_start(bodies, self._contact_options.table)
        self.time_step = scene.add_constant("time_step", 1, 1, value=time_step)
        self.effective_step = scene.add_constant("effective_step", 1, 1, value=time_step)
        self.gravity = scene.add_constant("gravity", 3, 1, value=gravity)
        for body in bodies:
            self._take(body)
        self._connect({})
        for body, velocity in (velocities or {}).items():
            self.set_velocity(body, velocity)

    # -- bodies --------------------------------------------------------------------------------------------

    @property
    def moving(self) -> list[Body]:
        """The bodies that are not fixed."""
        return [body for body in self.bodies if not body.is_fixed]

    def add(self, *bodies: Body) -> None:
        """Adds bodies of the same scene between steps. What touches the union of all vertices is compiled again: its
        positions and contact; energies of the bodies that were there come from the cache.

        Raises SceneError, IntersectionError; nothing is added then.
        """
        self._check([*self.bodies, *bodies])
        if self._has_contact:
            check_start([*self.bodies, *bodies], self._contact_options.table)
        before = self._motion()
        for body in bodies:
            self._take(body)
        try:
            self._connect(before)
        except YaspsError:
            for body in bodies:
                self._forget(body)
            raise

    def remove(self, *bodies: Body) -> None:
        """Takes bodies away between steps, with all energies that they added; the same is compiled again as in `add`.

        Raises SceneError for a body that is not there, or if nothing would move any more.
        """
        for body in bodies:
            self._number_of(body)
        self._check([body for body in self.bodies if body not in bodies])
        before = self._motion()
        for body in bodies:
            self._forget(body)
        self._connect(before)

    def _check(self, bodies: Sequence[Body]) -> None:
        for body in bodies:
            if not isinstance(body, Body):
                raise SceneError(f"a simulation is made of bodies (yasps.bodies), got {body!r}")
            if body.scene is not self.scene:
                raise SceneError(f"body {body.name!r} belongs to another scene")
        if len(set(bodies)) != len(bodies):
            raise SceneError("a body is named twice")
        if all(body.is_fixed for body in bodies):
            raise SceneError("nothing can move: give the simulation at least one body that is not fixed")

    def _take(self, body: Body) -> None:
        """Inertia and gravity of a body."""
        self.bodies.append(body)
        if isinstance(body, MovingObstacle):
            if self.scene.is_on_device:
                raise UnsupportedSceneError(f"{body.name} moves, which is for the CPU only: take device='cpu'")
            self._drives[body] = DrivenSurface(body, float(self.time_step.value[0]))
            self._driven.append(self._drives[body])
            self.scene.add_minimize_target(body.progress)
            if body.energies[0] not in self.scene.energies:
                self.scene.add_energy(body.energies[0])
        if body.is_fixed:
            return
        vertices = body.vertices
        if "predicted" not in vertices.attributes:
            predicted = vertices.add_constant("predicted", rows=3, cols=1, value=body.positions())
            inertia = materials.inertia(body.position, predicted, body.mass, self.effective_step)
            vertices.add_attribute("inertia", computed_attribute=inertia)
            weight = materials.gravity(body.position, body.mass, self.gravity)
            vertices.add_attribute("gravity", computed_attribute=weight)
        self._predicted[body] = vertices["predicted"]
        registered = self.scene.energies
        for energy in (vertices["inertia"], vertices["gravity"], *body.energies):
            if energy not in registered:
                self.scene.add_energy(energy)
        self.scene.add_minimize_target(list(body.targets))

    def _forget(self, body: Body) -> None:
        self.bodies.remove(body)
        self._fields = [field for field in self._fields if field[0] is not body]
        if isinstance(body, MovingObstacle):
            self._driven.remove(self._drives.pop(body))
            self.scene.remove_energy(body.energies[0])
            self.scene.remove_minimize_target(body.progress)
        if body.is_fixed:
            return
        self._driven[:] = [driven for driven in self._driven if driven.position is not body.position]
        for energy in (body.vertices["inertia"], body.vertices["gravity"], *body.energies):
            self.scene.remove_energy(energy)
        self.scene.remove_minimize_target(list(body.targets))

    def _connect(self, velocities: Mapping[Body, Float64Array]) -> None:
        """The union of all vertices, contact on it, and a stepper that starts with these velocities."""
        activation_distance, settings = self._given
        if activation_distance is None:
            corners = np.concatenate([body.positions() for body in self.moving])
            activation_distance = 1e-3 * float(np.linalg.norm(np.ptp(corners, axis=0)))
        self.activation_distance = activation_distance
        if self._has_contact:
            contact = self._add_contact()
            if self.contact is not None:
                for energy in self.contact.energies:
                    self.scene.remove_energy(energy)
            self.contact = contact
        time_step = float(self.time_step.value[0])
        options = self._contact_options
        tolerance = min(2e-3, 0.1 * activation_distance / time_step)
        if self.contact is not None and self.contact.friction is not None:
            tolerance = min(tolerance, 0.1 * options.eps_v)
            if settings is not None and (settings.velocity_tolerance or 0.0) > 0.1 * options.eps_v:
                LOGGER.warning(
                    "friction: the velocity tolerance, %.3g m/s, is more than a tenth of eps_v, %.3g m/s, the speed"
                    " below which things stick: whether they do is left to chance",
                    settings.velocity_tolerance,
                    options.eps_v,
                )
        now = self.time
        self.stepper = TimeStepper(
            self.scene,
            [MovingPart(body.position, self._predicted[body], body.mass) for body in self.moving],
            time_step,
            self.contact,
            accelerations={target: self.gravity.value for body in self.moving for target in body.falling},
            # Newton stops well inside the activation distance, or contact forces would be left half-balanced.
            settings=settings or NewtonSettings(velocity_tolerance=tolerance, max_iterations=500),
            lagging=options.lagging,
            integrator=options.integrator,
            effective_step=self.effective_step,
            times=self.times,
            arms={target: arm for body in self.moving for target, arm in body.arms.items()},
        )
        self.stepper.time = now
        self.stepper.driven = self._driven
        self.stepper.driven_tolerance = 1e-6 * activation_distance
        if self.contact is not None:
            still = [body.is_fixed and body not in self._drives for body in self.bodies if len(body.rest)]
            self.stepper.immovable = np.repeat(still, [len(body.rest) for body in self.bodies if len(body.rest)])
        for body, velocity in velocities.items():
            if body in self.bodies:
                self.set_velocity(body, velocity)

    def _add_contact(self) -> BarrierContact:
        options = self._contact_options
        stiffness = options.stiffness
        if stiffness is None and options.barrier == "paper":
            stiffness = 10.0 / self.activation_distance**3
        everything = self.scene.add_mesh(f"everything_{self._unions}" if self._unions else "everything")
        self._unions += 1
        bodies = [body for body in self.bodies if not isinstance(body, HalfSpace)]
        union = everything.add_primitive_union("vertices", [body.vertices for body in bodies])
        union.add_attribute("position")
        union.add_attribute("rest_position")
        counts = [len(body.rest) for body in bodies]
        starts = union.offsets()
        groups = [-1 if body.meets_itself else number for number, body in enumerate(bodies)]
        return BarrierContact(
            everything,
            union,
            np.concatenate([body.triangles + start for body, start in zip(bodies, starts, strict=False)]),
            edges=np.concatenate([body.edges + start for body, start in zip(bodies, starts, strict=False)]),
            points=np.concatenate([body.points + start for body, start in zip(bodies, starts, strict=False)]),
            radii=np.concatenate([body.radii() for body in bodies]),
            activation_distance=self.activation_distance,
            barrier=options.barrier,
            stiffness=stiffness,
            table=options.table,
            moduli={body.name: body.contact_modulus for body in self.bodies},
            planes=[body.plane for body in self.bodies if isinstance(body, HalfSpace)],
            fixed=np.repeat([body.is_fixed and body not in self._drives for body in bodies], counts),
            group=np.repeat(groups, counts),
            objects={body.name: len(body.rest) for body in bodies},
            slip_length=self.effective_step * options.eps_v,
        )

    def _number_of(self, body: Body) -> int:
        if body not in self.bodies:
            raise SceneError(f"body {body.name!r} is not in this simulation; it has {[b.name for b in self.bodies]}")
        return self.moving.index(body) if not body.is_fixed else -1

    # -- motion --------------------------------------------------------------------------------------------

    def velocity_of(self, body: Body) -> Float64Array:
        """Velocities of a body's vertices [m/s], [n, 3]; zero for a fixed one."""
        number = self._number_of(body)
        if body in self._drives:
            return self._drives[body].velocity.copy()
        return np.zeros((len(body.rest), 3)) if number < 0 else self.stepper.velocities[number].copy()

    def set_velocity(self, body: Body, velocity: ArrayLike, angular: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Velocity of a body for the next step [m/s], one or one for each vertex [n, 3], and its rotation [rad/s] about
        its centre of mass. Raises SceneError for a fixed body or a wrong shape."""
        number = self._number_of(body)
        if number < 0:
            raise SceneError(f"{body.name} is fixed and has no velocity")
        given, turning = np.asarray(velocity, dtype=np.float64), np.asarray(angular, dtype=np.float64)
        positions = body.positions()
        if given.shape not in ((3,), positions.shape) or turning.shape != (3,):
            raise SceneError(
                f"the velocity of {body.name} is [3] or {list(positions.shape)} and its rotation [3], got "
                f"{list(given.shape)} and {list(turning.shape)}"
            )
        mass = body.mass.value
        arms = positions - mass @ positions / mass.sum()
        self.stepper.velocities[number] = given + np.cross(turning, arms)

    def _motion(self) -> dict[Body, Float64Array]:
        return {body: self.velocity_of(body) for body in self.moving}

    # -- what is driven ------------------------------------------------------------------------------------

    def _add_anchors(self, body: Body) -> Anchors:
        """Springs that hold nothing yet."""
        self._pins += 1
        anchors = Anchors(body.mesh, f"pins_{self._pins}", body.vertices)
        body.add_energy(anchors.energy)
        return anchors

    def pin(
        self,
        body: Body,
        vertices: Iterable[int],
        stiffness: float | None = None,
        *,
        motion: Prescribed | None = None,
    ) -> Pins | DrivenVertices:
        """Holds vertices of a body exactly where they are, or moves them as `motion` says: see `MovingObstacle`.
        Vertices of affine bodies come to their places within a millionth of the activation distance.

        stiffness [N/m]: by springs instead, which give way. On a GPU there are springs alone, by default so stiff that
        the whole body on one pin sinks by gravity * time_step^2 / 1000.

        The first pins of a body are one more energy and compile; moving and releasing pins does not. Raises SceneError,
        ConnectivityError for vertices that are not there, DataError or ShapeMismatchError for positions.
        """
        if self._number_of(body) < 0:
            raise SceneError(f"{body.name} is fixed already")
        chosen = np.asarray(list(vertices), dtype=np.int64)
        bad = (chosen < 0) | (chosen >= len(body.rest))
        if bad.any():
            raise ConnectivityError(f"{body.name} has vertices 0 to {len(body.rest) - 1}, got {chosen[bad][0]} to pin")
        if stiffness is not None or self.scene.is_on_device:
            if motion is not None:
                raise SceneError("springs have no motion: move them by pins.move_to(places), or leave stiffness out")
            if stiffness is None:
                stiffness = PIN_STIFFNESS * float(body.mass.value.sum()) / float(self.time_step.value[0]) ** 2
            anchors = self._add_anchors(body)
            anchors.hold(chosen, body.positions()[chosen], stiffness)
            return Pins(anchors)
        for other in self._driven:
            if other.position is body.position and not other.is_released and np.isin(chosen, other.vertices).any():
                raise SceneError(f"some of these vertices of {body.name} are pinned already: release those pins first")
        pins = DrivenVertices(
            f"a pin of {body.name}",
            body.position,
            chosen,
            self._add_anchors(body),
            body.positions()[chosen] if motion is None else motion,
            spacing=float(self.time_step.value[0]),
            is_exact=body.position in self.scene.minimize_targets,
        )
        self._driven.append(pins)
        return pins

    def add_force(self, body: Body, force: ArrayLike | ForceField = (0.0, 0.0, 0.0), name: str = "force") -> Attribute:
        """A force [N] on each vertex of a body; returns the attribute that holds it, 3x1. It compiles once.

        force: one for all vertices or [n, 3], which `update_value` changes between steps; or a field, a function of
        positions [n, 3], velocities [n, 3] and time [s] that gives them at the beginning of every step: wind, drag,
        magnets. Forces stay the same within a step. Where one has a potential, an energy on `body.vertices` is exact.

        Raises SceneError, NameTakenError, DataError or ShapeMismatchError for forces of another shape.
        """
        if self._number_of(body) < 0:
            raise SceneError(f"{body.name} is fixed: a force does nothing to it")
        values = self._forces(body, force, name)
        holder = body.vertices.add_constant(name, 3, 1, value=values)
        load = materials.dead_load(body.position, holder)
        body.add_energy(body.vertices.add_attribute(f"{name}_load", computed_attribute=load))
        if callable(force):
            self._fields.append((body, force, name))
        return holder

    def _forces(self, body: Body, force: ArrayLike | ForceField, name: str) -> Float64Array:
        """Forces on the vertices now, [n, 3]."""
        if callable(force):
            force = force(body.positions(), self.velocity_of(body), self.time)
        values = real_numbers(force, f"the forces {name!r} on {body.name}")
        if values.shape not in ((3,), body.rest.shape):
            raise ShapeMismatchError(
                f"the forces {name!r} on {body.name} are [3] or {list(body.rest.shape)}, got {list(values.shape)}"
            )
        return np.array(np.broadcast_to(values, body.rest.shape))

    # -- steps ---------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time that has passed [s]."""
        return self.stepper.time if hasattr(self, "stepper") else 0.0

    def energy(self) -> float:
        """Kinetic, elastic, gravitational and contact energy together [J]."""
        values = self.scene.energy_values()
        potential = sum(float(v.sum()) for path, v in values.items() if not path.endswith(".vertices.inertia"))
        return potential + self.stepper.kinetic_energy()

    def step(self) -> NewtonReport:
        """One time step.

        A step that fails with NotConvergedError or NotFiniteError is tried again in two halves, and these in halves,
        up to `rescue` times (default 3: 8 parts); `substeps` of the report says how many parts it took, and the logger
        `yasps` why. A step that fails altogether leaves the state as it was before it, and writes that state to a file;
        the error says where.
        `restore(file)` and `step()` then fail again in the same way. Raises NotConvergedError, NotFiniteError,
        IntersectionError.
        """
        for call in self.before_step:
            call(self)
        for body in self.bodies:
            body.start_step()
        before, past = self.state(), None if self.contact is None else self.contact.save()
        remembered = self.stepper.past
        for body, field, name in self._fields:
            body.vertices[name].update_value(self._forces(body, field, name))
        try:
            report = step_or_halves(self.stepper, self._set_time_step, self.rescue)
        except YaspsError as error:
            self._set_state(before)
            if self.contact is not None and past is not None:
                self.contact.load(past)
            self.stepper.past = remembered
            file = Path(tempfile.mkdtemp(prefix="yasps-")) / f"{self.scene.name}-step-{self.frame + 1}.npz"
            np.savez(file, allow_pickle=False, **before)
            error.add_note(
                f"step {self.frame + 1} of {self.scene.name} (t = {self.time:.6g} s) failed; the state before it is in "
                f"{file}: simulation.restore({str(file)!r}) and simulation.step() repeat it"
            )
            raise
        self.frame += 1
        self._last = report
        for call in self.after_step:
            call(self)
        return report

    def _set_time_step(self, seconds: float) -> None:
        """Another time step, for parts of one; nothing compiles for it."""
        self.time_step.update_value(seconds)
        self.stepper.time_step = seconds

    def run(self, frames: int, recorder: Recorder | None = None) -> list[NewtonReport]:
        """So many steps, with progress shown and intersections looked for after each. The recorder also sees the start.

        Raises what `step` raises, and IntersectionError should surfaces ever cross.
        """
        reports = []
        if recorder is not None and self.frame == 0:
            recorder.record(self)
        with FrameProgress(frames) as progress:
            for frame in range(1, frames + 1):
                begin = time.perf_counter()
                report = self.step()
                seconds = time.perf_counter() - begin
                self.check_intersection_free()
                if recorder is not None:
                    with self.times.stage("output"):
                        recorder.record(self)
                reports.append(report)
                progress.update(
                    frame=frame,
                    newton_iterations=report.iterations,
                    cg_iterations=report.cg_iterations,
                    contacts=report.contacts,
                    milliseconds=1e3 * seconds,
                )
        return reports

    def check_intersection_free(self) -> None:
        """Raises IntersectionError, with names, if surfaces cross or touch."""
        if self.contact is not None:
            with self.times.stage("check: no intersection"):
                self.contact.geometry.check_intersection_free(self.contact.positions())

    # -- what is there now ---------------------------------------------------------------------------------

    def contact_forces(self) -> ContactForces:
        """Forces, gaps and energies of contact at the present state, for pairs, vertices and bodies.

        Bodies are numbered as in `bodies`, but half-spaces come last. Raises SceneError without contact.
        """
        if self.contact is None:
            raise SceneError("this simulation was made with contact=False")
        bodies = [body for body in self.bodies if len(body.rest)]
        masses = [np.zeros(len(b.rest)) if b.is_fixed else np.asarray(b.mass.value) for b in bodies]
        return contact_forces(self.contact, np.concatenate(masses))

    def forces_by_term(self) -> dict[str, dict[str, Float64Array]]:
        """Path of an energy -> path of a target -> minus the energy's gradient there, [instances, 3] in N for a 3x1
        target in metres, else [instances, rows, columns]. These are the generalised forces of reduced coordinates."""
        compiled = self.scene.compile()
        return {
            path: {
                target.path: -part.reshape(-1, *(target.shape if target.shape[1] > 1 else target.shape[:1]))
                for target, part in zip(compiled.targets, compiled.split(gradient), strict=True)
            }
            for path, gradient in compiled.gradients().items()
        }

    def report(self) -> StepReport:
        """The present state in numbers: energies, momentum, contact, and what the last step took. All of it is computed
        by this call; steps pay nothing for it."""
        forces = None if self.contact is None else self.contact_forces()
        reach = self.activation_distance
        return step_report(self.scene, self.stepper, frame=self.frame, newton=self._last, forces=forces, reach=reach)

    # -- state ---------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Float64Array]:
        """All that the next step depends on apart from the scene itself, by name."""
        numbers = {f"target/{target.path}": target.value for target in self.scene.minimize_targets}
        numbers |= {f"history/{one.path}": one.value for body in self.bodies for one in body.history}
        numbers |= {f"velocity/{body.name}": self.velocity_of(body) for body in self.moving}
        numbers |= {f"place/{body.name}": body.positions() for body in self._drives}
        numbers |= {f"multiplier/{k}": driven.multiplier.copy() for k, driven in enumerate(self._driven)}
        if (past := self.stepper.past) is not None:
            numbers |= {f"{PAST}{name}": value for name, value in past.start_numbers().items()}
        return numbers | {"time": np.array(self.time), "frame": np.array(float(self.frame))}

    def restore(self, file: str | Path) -> None:
        """Sets the state to that of a file that a failed step wrote. A state without the step before it, which BDF2
        remembers, goes on with a step of backward Euler. Raises SceneError if it is of another scene."""
        with np.load(file, allow_pickle=False) as stored:
            state = {name: np.asarray(stored[name]) for name in stored.files}
        here = {name: value.shape for name, value in self.state().items() if not name.startswith(PAST)}
        there = {name: value.shape for name, value in state.items() if not name.startswith(PAST)}
        if here != there:
            differing = sorted(set(here) ^ set(there)) or [name for name in here if here[name] != there[name]]
            raise SceneError(f"{file} is the state of another scene: {differing[0]} differs")
        self._set_state(state)

    def _set_state(self, state: Mapping[str, Float64Array]) -> None:
        for target in self.scene.minimize_targets:
            target.update_value(state[f"target/{target.path}"])
        for one in (one for body in self.bodies for one in body.history):
            one.update_value(state[f"history/{one.path}"])
        for number, body in enumerate(self.moving):
            self.stepper.velocities[number] = np.array(state[f"velocity/{body.name}"])
        for body, surface in self._drives.items():
            surface.put(state[f"place/{body.name}"])
        for number, driven in enumerate(self._driven):
            driven.multiplier = np.array(state[f"multiplier/{number}"])
        self.stepper.time, self.frame = float(state["time"]), int(state["frame"])
        if self.contact is not None:
            self.contact.reset()
        self.stepper.remember({name.removeprefix(PAST): np.array(x) for name, x in state.items() if PAST in name})
