"""Bodies, contact and time steps together: what a scene of moving things usually needs, and no more.

`Simulation` writes what a user would write with the language: inertia and gravity on every vertex, the union of all
vertices with contact on it, targets, backward Euler. The scene stays the user's: energies of one's own are added to it
in the next line.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from yasps import Attribute, Connectivity, Scene, SceneError, ShapeMismatchError, YaspsError, materials
from yasps.bodies import Body, MovingObstacle
from yasps.contact import BarrierContact, ContactForces, ContactTable, check_start, contact_forces
from yasps.frontend.language.arrays import checked_count, in_instances, positive_number, real_numbers
from yasps.meshes import TriangleMesh
from yasps.meshes.tetrahedral_mesh import Float64Array
from yasps.output import TimeTable
from yasps.simulation.applied_forces import AppliedForces, ForceField
from yasps.simulation.checkpoints import Checkpoints
from yasps.simulation.checks import AnyBody, check_names, checked_bodies, checked_velocities, vertex_velocities
from yasps.simulation.contact_of_bodies import ContactOptions, add_contact, stands_still
from yasps.simulation.driven_bodies import DrivenBodies
from yasps.simulation.fingerprint import fingerprint_of
from yasps.simulation.frames import Recorder, run_frames
from yasps.simulation.notebook import html_of
from yasps.simulation.remeshing import RemeshReport, remesh
from yasps.simulation.state import restore, save, set_state, state_of
from yasps.stepping import (
    BACKWARD_EULER,
    Carried,
    DrivenVertices,
    Integrator,
    MovingPart,
    NewtonReport,
    NewtonSettings,
    Pins,
    Prescribed,
    StepReport,
    TimeStepper,
    energies_by_kind,
    forces_by_term,
    step_or_halves,
    step_report,
)


class Companion(Protocol):
    """What has a history: bodies, joints, something of a user's own."""

    @property
    def history(self) -> tuple[Attribute, ...]:
        """Stored constants that `start_step` sets."""

    def start_step(self) -> None:
        """Before every step; moves no vertex."""


class Simulation:
    """Steps bodies of one scene through time.

    scene: the one that the bodies were added to. bodies: at least one that moves. time_step [s]. gravity [m/s^2].
    activation_distance [m]: surfaces closer than this repel; default 1/1000 of the diagonal of the box around what
    moves. contact: False for none at all. contacts: friction and stiffness of pairs of bodies, by name. barrier,
    contact_stiffness: see `BarrierContact`; by default "log", with a tenth of the softer body's modulus [Pa]; for
    "paper" 10 N over the cubed activation distance [J/m^4]. velocities: body -> velocity at the start [m/s], one or one
    for each vertex. settings: of Newton's method; by default the tolerance is a tenth of the activation distance a
    step, at most 2e-3 m/s; with friction at most a tenth of eps_v, and forces balance to 1e-3 of the largest. eps_v:
    speed below which things with friction stick [m/s]. lagging, integrator: see `TimeStepper`. rescue: how often a
    time step that fails is cut in two, see `step`.

    `time_step` and `gravity` are constants of the scene that can be changed between steps; `effective_step` [s] is the
    one that energies of velocities read, for (x - X) / effective_step (see `Integrator`); `before_step` and
    `after_step` are lists of functions that are called with the simulation.

    Raises SceneError, DataError, NameTakenError, UnsupportedSceneError, IntersectionError if surfaces cross at the
    start; nothing is added to the scene then.
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
        velocities: Mapping[AnyBody, ArrayLike] | None = None,
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
        self.rescue = checked_count(rescue, "rescue", 0, SceneError)
        self.contact: BarrierContact | None = None
        self._last: NewtonReport | None = None
        self._built: Mapping[str, str] | None = None
        self._former_contacts: list[BarrierContact] = []
        self._has_contact = contact
        self._options = ContactOptions(
            ContactTable() if contacts is None else contacts, barrier, contact_stiffness, eps_v, lagging, integrator
        )
        if settings is not None and not isinstance(settings, NewtonSettings):
            raise SceneError(f"settings are NewtonSettings (yasps.stepping), got {settings!r}")
        self._settings = settings
        self._predicted: dict[Body, Attribute] = {}
        self._forces = AppliedForces(self.velocity_of, lambda: self.time)
        self._unions = 0
        self._known: set[str] = set()
        """Names of all bodies that were ever in it."""
        time_step = positive_number(time_step, "time_step", "s", SceneError)
        gravity = in_instances(real_numbers(gravity, "gravity"), 1, (3, 1), "gravity")
        check_names(scene, ["time_step", "effective_step", "gravity", *(["everything"] if contact else [])])
        with self.times.stage("set-up"):
            chosen = self._check(bodies)
        moving = [body for body in chosen if not body.is_fixed]
        if activation_distance is None:
            corners = np.concatenate([body.positions() for body in moving])
            activation_distance = 1e-3 * float(np.linalg.norm(np.ptp(corners, axis=0)))
        self.activation_distance = positive_number(activation_distance, "activation_distance", "m")
        start = checked_velocities(velocities, moving)
        self.time_step = scene.add_constant("time_step", 1, 1, value=time_step)
        self.effective_step = scene.add_constant("effective_step", 1, 1, value=time_step)
        self.gravity = scene.add_constant("gravity", 3, 1, value=gravity)
        self.driven = DrivenBodies(scene, self.time_step)
        self._companions: list[Companion] = []
        self._carried: list[Carried] = []
        with self.times.stage("set-up"):
            for body in chosen:
                self._take(body)
            self._connect(start)

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
        before = self._motion()
        try:
            for body in bodies:
                self._take(body)
            self._connect(before)
        except BaseException:
            for body in bodies:
                if body in self.bodies:
                    self._forget(body)
            raise

    def remove(self, *bodies: Body) -> None:
        """Takes bodies away between steps, with all energies that they added; their pins and fields of forces are gone
        for good. The same is compiled again as in `add`.

        Raises SceneError for a body that is not there, or if nothing would move any more.
        """
        for body in bodies:
            self._number_of(body)
        self._check([body for body in self.bodies if body not in bodies], looks=False)
        before = self._motion()
        for body in dict.fromkeys(bodies):
            self._forget(body)
        self._connect(before)

    def remesh(
        self,
        body: Body,
        shape: TriangleMesh,
        weights: ArrayLike | sparse.sparray,
        *,
        positions: ArrayLike | None = None,
        velocities: ArrayLike | None = None,
        parts: Mapping[Attribute | Connectivity, Any] | None = None,
    ) -> RemeshReport:
        """Another mesh for a cloth between steps, with its state carried over. Nothing is compiled, if the cloth is
        `refinable`.

        shape: at rest. weights: [new, old], sparse or not: each new vertex is the sum of old ones with its weights,
        which add up to 1: positions, velocities, radii and, for BDF2, those of the step before. An old vertex that all
        the weight of a new one is on lives on in it: pins and whatever else is connected to it follow. positions [m],
        velocities [m/s]: [n, 3], instead of the weighted ones. parts: numbers and indices of your own for what you
        added to the cloth, as `Scene.resize` takes them.

        Contact is that of the new surface; friction is lagged there anew. Mass is that of the new mesh. Where edges
        and triangles are cut and nothing is bent, mass, momentum and centre of mass stay, and so does the stretch;
        bending and kinetic energies jump, and the report says by how much. The contact modulus stays.

        Raises SceneError for what is no cloth of this simulation or a pin whose vertex is gone, MeshError, DataError,
        ShapeMismatchError, ConnectivityError; IntersectionError if surfaces cross at the new positions. Nothing has
        changed then.
        """
        self._number_of(body)
        self._fingerprint()  # of what it was made of, which another mesh does not change
        return remesh(self, body, shape, weights, positions=positions, velocities=velocities, given=parts or {})

    def _check(self, bodies: Iterable[Body], *, looks: bool = True) -> list[Body]:
        """The bodies, if they can make a simulation; looks: whether where they are is looked at, too."""
        chosen = checked_bodies(bodies, self.scene, self._predicted)
        if self._has_contact and looks:
            self._options.check_names(self._known | {body.name for body in chosen})
            check_start(chosen, self._options.table)
        return chosen

    def _take(self, body: Body) -> None:
        """Inertia and gravity of a body."""
        self.bodies.append(body)
        self._known.add(body.name)
        if isinstance(body, MovingObstacle):
            self.driven.add(body)
        if body.is_fixed:
            return
        vertices = body.vertices
        if body not in self._predicted:
            predicted = vertices.add_constant("predicted", rows=3, cols=1, value=body.positions())
            inertia = materials.inertia(body.position, predicted, body.mass, self.effective_step)
            vertices.add_attribute("inertia", computed_attribute=inertia)
            weight = materials.gravity(body.position, body.mass, self.gravity)
            vertices.add_attribute("gravity", computed_attribute=weight)
            self._predicted[body] = predicted
        registered = self.scene.energies
        for energy in (vertices["inertia"], vertices["gravity"], *body.energies):
            if energy not in registered:
                self.scene.add_energy(energy)
        self.scene.add_minimize_target(list(body.targets))

    def _forget(self, body: Body) -> None:
        self.bodies.remove(body)
        self._forces.forget(body)
        self.driven.forget(body)
        if body.is_fixed:
            return
        for energy in (body.vertices["inertia"], body.vertices["gravity"], *body.energies):
            self.scene.remove_energy(energy)
        self.scene.remove_minimize_target(list(body.targets))

    def _connect(self, velocities: Mapping[Body, Float64Array]) -> None:
        """The union of all vertices, contact on it, and a stepper that starts with these velocities."""
        self._built = None
        if self._has_contact:
            name = f"everything_{self._unions}" if self._unions else "everything"
            self._unions += 1
            contact = add_contact(
                self.scene,
                name,
                self.bodies,
                self._options,
                activation_distance=self.activation_distance,
                effective_step=self.effective_step,
            )
            if self.contact is not None:
                for energy in self.contact.energies:
                    self.scene.remove_energy(energy)
                self._former_contacts.append(self.contact)
            self.contact = contact
        if self._has_friction and self._settings is not None:
            self._options.warn_of(self._settings)
        now = self.time
        self.stepper = TimeStepper(
            self.scene,
            [MovingPart(body.position, self._predicted[body], body.mass) for body in self.moving],
            float(self.time_step.value[0]),
            self.contact,
            accelerations={target: self.gravity for body in self.moving for target in body.falling},
            settings=self._newton_settings(),
            lagging=self._options.lagging,
            integrator=self._options.integrator,
            effective_step=self.effective_step,
            times=self.times,
            arms={target: arm for body in self.moving for target, arm in body.arms.items()},
        )
        self.stepper.time = now
        self.stepper.driven = self.driven.all
        self.stepper.carried = self._carried
        self.stepper.driven_tolerance = 1e-6 * self.activation_distance
        if self.contact is not None:
            self.stepper.immovable = stands_still(self.bodies)
        for body, velocity in velocities.items():
            if body in self.bodies:
                self.set_velocity(body, velocity)

    @property
    def _has_friction(self) -> bool:
        return self.contact is not None and self.contact.friction is not None

    def _newton_settings(self) -> NewtonSettings:
        """Those given, or those that suit the time step."""
        if self._settings is not None:
            return self._settings
        seconds = float(self.time_step.value[0])
        return self._options.newton_settings(self.activation_distance / seconds, has_friction=self._has_friction)

    def _number_of(self, body: Body) -> int:
        if body not in self.bodies:
            name = getattr(body, "name", body)
            raise SceneError(f"body {name!r} is not in this simulation; it has {[b.name for b in self.bodies]}")
        return self.moving.index(body) if not body.is_fixed else -1

    # -- motion --------------------------------------------------------------------------------------------

    def velocity_of(self, body: Body) -> Float64Array:
        """Velocities of a body's vertices [m/s], [n, 3]; zero for a fixed one."""
        number = self._number_of(body)
        return self.driven.velocity_of(body) if number < 0 else self.stepper.velocities[number].copy()

    def set_velocity(self, body: Body, velocity: ArrayLike, angular: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Velocity of a body for the next step [m/s], one or one for each vertex [n, 3], and its rotation [rad/s] about
        its centre of mass. Raises SceneError for a fixed body or a wrong shape."""
        number = self._number_of(body)
        if number < 0:
            raise SceneError(f"{body.name} is fixed and has no velocity")
        self.stepper.velocities[number] = vertex_velocities(body, velocity, angular)

    def _motion(self) -> dict[Body, Float64Array]:
        return {body: self.velocity_of(body) for body in self.moving}

    # -- what is driven ------------------------------------------------------------------------------------

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
        return self.driven.pin(body, vertices, stiffness, motion)

    def add_force(self, body: Body, force: ArrayLike | ForceField = (0.0, 0.0, 0.0), name: str = "force") -> Attribute:
        """A force [N] on each vertex of a body; returns the attribute that holds it, 3x1. It compiles once.

        force: one for all vertices or [n, 3], which `update_value` changes between steps; or a field, a function of
        positions [n, 3], velocities [n, 3] and time [s] that gives them at the beginning of every step: wind, drag,
        magnets. Forces stay the same within a step, also in one that is tried in parts. Where one has a potential, an
        energy on `body.vertices` is exact.

        Raises SceneError, NameTakenError, DataError or ShapeMismatchError for forces of another shape.
        """
        if self._number_of(body) < 0:
            raise SceneError(f"{body.name} is fixed: a force does nothing to it")
        return self._forces.add(body, force, name)

    @property
    def has_force_fields(self) -> bool:
        """Whether any force is a function of positions and velocities."""
        return self._forces.has_fields

    def attach(self, companion: Companion) -> None:
        """Something that goes along with the bodies, such as `Joints`: its `start_step` is called before every step,
        and the constants of its `history` belong to the state."""
        if companion not in self._companions:
            self._companions.append(companion)

    def carry(self, constant: Attribute, attribute: Attribute) -> None:
        """Sets a stored constant at the beginning of every step so that (attribute - constant) / effective_step is the
        rate of an attribute at the end of the step: for damping. Raises ShapeMismatchError, SceneError."""
        if constant.owner is not attribute.owner or constant.shape != attribute.shape:
            raise ShapeMismatchError(
                f"what is carried has a constant of its own primitive and shape: {attribute.path} is {attribute.shape},"
                f" {constant.path} {constant.shape}"
            )
        constant.update_value(attribute.value)
        self._carried.append(Carried(constant, attribute))

    @property
    def _with_history(self) -> list[Companion]:
        return [*self.bodies, *self._companions]

    def history(self) -> list[Attribute]:
        """Constants of bodies and companions that `start_step` sets."""
        return [one for owner in self._with_history for one in owner.history]

    # -- steps ---------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time that has passed [s]."""
        return self.stepper.time if hasattr(self, "stepper") else 0.0

    def energy(self) -> float:
        """Kinetic, elastic, gravitational and contact energy together, with energies of one's own [J]. The potential of
        friction is left out, which is none of the motion's."""
        energies = energies_by_kind(self.scene, self.stepper)
        return sum(energies.values()) - energies["friction"]

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
        for one in self._with_history:
            one.start_step()
        self._fingerprint()
        before = self.state()
        seconds = positive_number(self.time_step.value[0], "time_step", "s", SceneError)
        if seconds != self.stepper.time_step:
            self.stepper.time_step, self.stepper.settings = seconds, self._newton_settings()
        self._forces.update()
        try:
            report = step_or_halves(self.stepper, self._set_time_step, self.rescue)
        except YaspsError as error:
            file = Path(tempfile.mkdtemp(prefix="yasps-")) / f"{self.scene.name}-step-{self.frame + 1}.npz"
            save(self, file, self._fingerprint(), before)
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

    def run(
        self, frames: int, recorder: Recorder | None = None, checkpoints: Checkpoints | None = None
    ) -> list[NewtonReport]:
        """So many steps, with progress shown and intersections looked for after each. The recorder also sees the start.
        checkpoints: are written in between, each after the frame was recorded.

        Raises what `step` raises, and IntersectionError should surfaces ever cross.
        """
        return run_frames(self, frames, recorder, checkpoints)

    def check_intersection_free(self) -> None:
        """Raises IntersectionError, with names, if surfaces cross or touch, or something is in a half-space."""
        if self.contact is not None:
            with self.times.stage("check: no intersection"):
                self.contact.check_intersection_free(self.contact.positions())

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
        return forces_by_term(self.scene)

    def report(self) -> StepReport:
        """The present state in numbers: energies, momentum, contact, and what the last step took. All of it is computed
        by this call; steps pay nothing for it."""
        forces = None if self.contact is None else self.contact_forces()
        reach = self.activation_distance
        return step_report(self.scene, self.stepper, frame=self.frame, newton=self._last, forces=forces, reach=reach)

    def _repr_html_(self) -> str:
        """In a notebook: bodies, contact, time, and a picture where the machine can draw."""
        return html_of(self)

    # -- state ---------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Float64Array]:
        """All that the next step depends on apart from the scene itself, by name."""
        return state_of(self)

    def save(self, file: str | Path) -> None:
        """Writes the state and all numbers of the scene to a file, which is there wholly or not at all. Raises
        SceneError."""
        save(self, Path(file), self._fingerprint())

    def restore(self, file: str | Path) -> None:
        """Sets the state to that of a file, of `save`, of `Checkpoints` or of a failed step. The next steps are then
        those that followed it, to the last bit where the scene is deterministic; functions of the user's own must not
        depend on more than positions, velocities and time.

        Raises SceneError for a damaged file, or one of a simulation that was built otherwise, by the name of what
        differs; IntersectionError if it crosses what is here now, such as an obstacle that was moved since. Nothing has
        changed then.
        """
        restore(self, Path(file), self._fingerprint())

    def _set_state(self, state: Mapping[str, Float64Array]) -> None:
        set_state(self, state)

    def _fingerprint(self) -> Mapping[str, str]:
        """Of the simulation as it was before its first step."""
        if self._built is None:
            self._built = fingerprint_of(self)
        return self._built
