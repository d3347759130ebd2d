"""Joints between bodies of any kind, and between bodies and the world.

Each joint holds two frames together, each made of material points: sums of positions of vertices, which a UNION of all
bodies gives. So one formula serves rigid, affine, soft and caged bodies, and what a user parameterises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, Primitive, Scene, SceneError, concat_rows, materials
from yasps.bodies.body import Body
from yasps.bodies.material_frames import checked_vector, material_frame, right_handed
from yasps.frontend.language.arrays import positive_number, real_numbers
from yasps.meshes.tetrahedral_mesh import Float64Array, Int32Array

WORLD = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
"""Points that never move."""
Row = dict[str, Any]
"""Numbers of one joint, by the names of connectivities and constants."""
UNLIMITED = 1e9
"""An angle [rad] that no limit is, and a torque [N m] that no motor has."""


@dataclass(frozen=True)
class Residual:
    """How far a joint is from what it is for."""

    name: str
    gap: float
    """Distance of what should coincide: of origins, of the axis of a slider, of the length of a spring [m]."""
    angle: float
    """Largest angle between vectors that should be parallel [rad]."""
    force: float
    """With which the joint pulls at its origin [N]: the gap times its stiffness."""


class _Frames:
    """A dynamic primitive of pairs of frames, and numbers for each."""

    def __init__(self, joints: Joints, name: str, constants: Sequence[tuple[str, int]]) -> None:
        self.primitive: Primitive = joints.mesh.add_primitive(name, 0, is_dynamic=True)
        self.frames = (self._frame(joints, "first"), self._frame(joints, "second"))
        self.numbers = {name: self.primitive.add_constant(name, rows, 1) for name, rows in constants}

    def _frame(self, joints: Joints, side: str) -> Attribute:
        corners = self.primitive.add_connectivity(side, joints.vertices, [], 4)
        x = self.primitive.add_attribute(f"{side}_positions", through=corners, source=joints.position)
        weights = self.primitive.add_constant(f"{side}_weights", 4, 4)
        return self.primitive.add_attribute(f"{side}_frame", computed_attribute=materials.frame_of(x, weights))

    def add(self, row: Row) -> int:
        """One more; its number."""
        count = self.primitive.num_instances
        self.primitive.update(**{name: np.vstack([self._all(name), np.reshape(row[name], (1, -1))]) for name in row})
        return count

    def _all(self, name: str) -> Float64Array | Int32Array:
        """Numbers of all so far, a row each."""
        if name in {"first", "second"}:
            return self.primitive.connectivities[name].indices.reshape(-1, 4)
        count, size = self.primitive.num_instances, self.primitive[name].shape
        return self.primitive[name].value.reshape(count, size[0] * size[1])

    def number(self, name: str, which: int) -> float:
        """A number of one."""
        return float(self.numbers[name].value[which])

    def set(self, number: int, **values: float) -> None:
        """Other numbers of one."""
        for name, value in values.items():
            numbers = self.numbers[name].value
            numbers[number] = value
            self.numbers[name].update_value(numbers)

    def values(self) -> Float64Array:
        """Both frames of each now, [n, 2, 4, 3]."""
        return np.stack([frame.compute().array for frame in self.frames], axis=1)


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint of `Joints`."""

    joints: Joints
    name: str
    kind: str
    frames: _Frames
    number: int
    pair: Row

    def residual(self) -> Residual:
        """How far it is from what it is for, now."""
        first, second = self.frames.values()[self.number]
        way, stiffness = second[0] - first[0], self.frames.number("stiffness", self.number)
        if self.kind == "spring":
            gap = abs(float(np.linalg.norm(way)) - self.frames.number("length", self.number))
            return Residual(self.name, gap, 0.0, stiffness * gap)
        if self.kind == "slider":
            way = way - (way @ first[1]) * first[1]
        kept = self.frames.numbers["alignment"].compute().array[self.number, :, 0] > 0
        e, f = (one[1:][kept] / np.linalg.norm(one[1:][kept], axis=1, keepdims=True) for one in (first, second))
        angles = np.arctan2(np.linalg.norm(np.cross(e, f), axis=1), (e * f).sum(axis=1))
        gap = float(np.linalg.norm(way))
        return Residual(self.name, gap, float(angles.max(initial=0.0)), stiffness * gap)


class Hinge(Joint):
    """A joint that turns about an axis."""

    def angle(self) -> float:
        """By which the second body has turned against the first one since the joint was made [rad], whole turns
        included if the joints are attached to the simulation."""
        return self.joints._angle(self)

    def drive(self, aim: float, stiffness: float, torque: float = UNLIMITED) -> None:
        """A motor that turns it to an angle [rad] with a stiffness [N m / rad] and at most this torque [N m]. Compiles
        once; later calls change its numbers. A stiffness of 0 ends it. Raises SceneError, DataError."""
        aim, stiffness, torque = _numbers((aim, stiffness, torque), f"the motor of {self.name}")
        if not (stiffness >= 0 and torque > 0):
            raise SceneError(
                f"the motor of {self.name}: an aim, a stiffness >= 0 and a torque > 0, got {aim}, {stiffness}, {torque}"
            )
        self.joints._turn(self, aim=aim, drive=stiffness, torque=torque)

    def limit(self, least: float, most: float, stiffness: float) -> None:
        """Limits of the angle [rad], which give way by a cube: stiffness [N m / rad^2]. Raises SceneError,
        DataError."""
        least, most, stiffness = _numbers((least, most, stiffness), f"the limits of {self.name}")
        if not (least <= most and stiffness >= 0):
            raise SceneError(
                f"the limits of {self.name}: least <= most and a stiffness >= 0, got {least}, {most}, {stiffness}"
            )
        self.joints._turn(self, least=least, most=most, limit=stiffness)


def _numbers(given: Sequence[float], what: str) -> list[float]:
    """Finite numbers. Raises DataError."""
    return [float(one) for one in real_numbers(given, what)]


def _origins(frames: _Frames) -> Attribute:
    """Of both frames, 2x3."""
    first, second = frames.frames
    return concat_rows([first.row(0), second.row(0)])


class Joints:
    """All joints of some bodies, as one mesh of the scene.

    `vertices`: the union of the bodies' vertices and of the `world`. Primitives `links` (points, hinges, fixed joints),
    `sliders`, `springs` and `turns` (motors and limits of hinges) come with the first of their kind, each with its
    energies; one more of a kind compiles nothing. `simulation.attach(joints)` lets angles count whole turns.

    Joints are springs, whose gap is the force over the stiffness: `residuals` says it. A stiffness of 1e4 times the
    mass over the squared time step leaves gravity a gap of g dt^2 / 1e4. Such systems are for `solver="direct"`.
    """

    def __init__(self, scene: Scene, bodies: Sequence[Body], name: str = "joints") -> None:
        """Adds mesh and union. Raises SceneError, NameTakenError."""
        for body in bodies:
            if not isinstance(body, Body) or body.scene is not scene or len(body.rest) == 0:
                raise SceneError(f"joints hold bodies of {scene.label} that have vertices, got {body!r}")
        if not bodies:
            raise SceneError("joints need at least one body")
        self.scene, self.bodies, self.mesh = scene, list(bodies), scene.add_mesh(name)
        world = self.mesh.add_primitive("world", num_instances=len(WORLD))
        world.add_constant("position", rows=3, cols=1, value=WORLD)
        self.vertices = self.mesh.add_primitive_union("vertices", [*(body.vertices for body in bodies), world])
        self.position = self.vertices.add_attribute("position")
        self.all: list[Joint] = []
        self._kinds: dict[str, _Frames] = {}
        self._turns: dict[Hinge, int] = {}

    # -- kinds ---------------------------------------------------------------------------------------------

    def point(
        self, first: Body | None, second: Body | None, at: ArrayLike, stiffness: float, *, name: str = ""
    ) -> Joint:
        """Two bodies, or a body and the world (None), stay together at a point [m]; they turn as they like.

        stiffness [N/m]. Raises SceneError, DataError.
        """
        return self._link("point", (first, second), (at, None), (stiffness, 0.0), name)

    def hinge(
        self,
        first: Body | None,
        second: Body | None,
        at: ArrayLike,
        axis: ArrayLike,
        stiffness: float,
        *,
        alignment: float | None = None,
        name: str = "",
    ) -> Hinge:
        """They stay together at a point [m] and turn about an axis only. stiffness [N/m]; alignment [N m / rad]: of the
        axis, default stiffness times the squared size of the larger body. Raises SceneError, DataError."""
        hinge = self._link("hinge", (first, second), (at, axis), (stiffness, alignment), name)
        assert isinstance(hinge, Hinge)
        return hinge

    def fixed(
        self,
        first: Body | None,
        second: Body | None,
        at: ArrayLike,
        stiffness: float,
        *,
        alignment: float | None = None,
        name: str = "",
    ) -> Joint:
        """They move as one. at: a point of both [m]. Others: see `hinge`. Raises SceneError, DataError."""
        return self._link("fixed", (first, second), (at, (1.0, 0.0, 0.0)), (stiffness, alignment), name)

    def slider(
        self,
        first: Body | None,
        second: Body | None,
        at: ArrayLike,
        axis: ArrayLike,
        stiffness: float,
        *,
        alignment: float | None = None,
        name: str = "",
    ) -> Joint:
        """A point of the second body [m] stays on an axis of the first one, and neither turns against the other.
        Others: see `hinge`. Raises SceneError, DataError."""
        return self._link("slider", (first, second), (at, axis), (stiffness, alignment), name)

    def spring(
        self,
        first: Body | None,
        second: Body | None,
        first_at: ArrayLike,
        second_at: ArrayLike,
        stiffness: float,
        *,
        length: float | None = None,
        name: str = "",
    ) -> Joint:
        """A spring between a point of each [m], of this length [m], by default as long as it is; a stiff one keeps the
        distance. stiffness [N/m]. Raises SceneError, DataError."""
        ends = [checked_vector(at, "an end of a spring") for at in (first_at, second_at)]
        distance = float(np.linalg.norm(ends[1] - ends[0]))
        length = distance if length is None else _numbers([length], "the length of a spring")[0]
        if not length >= 0 or (length > 0 and distance == 0):
            raise SceneError(f"a spring of length {length} m between points {distance} m apart has no direction")
        row = self._pair(first, second, ends, np.zeros((3, 3)))
        stiffness = positive_number(stiffness, "the stiffness of a spring", "N/m", SceneError)
        row |= {"stiffness": stiffness, "length": length}
        frames = self._kinds.get("springs")
        if frames is None:
            frames = self._kinds["springs"] = _Frames(self, "springs", (("stiffness", 1), ("length", 1)))
            numbers = frames.numbers
            self._register(
                frames, "stretched", materials.spring(_origins(frames), numbers["length"], numbers["stiffness"])
            )
        return self._made("spring", frames, row, name)

    # -- how -----------------------------------------------------------------------------------------------

    def _link(
        self,
        kind: str,
        bodies: tuple[Body | None, Body | None],
        place: tuple[ArrayLike, ArrayLike | None],
        stiffness: tuple[float, float | None],
        name: str,
    ) -> Joint:
        """place: point and axis; stiffness: of the point and of the alignment."""
        (at, axis), (held, alignment) = place, stiffness
        origin = checked_vector(at, f"the place of a {kind} joint")
        vectors = (
            np.zeros((3, 3)) if axis is None else right_handed(checked_vector(axis, f"the axis of a {kind} joint"))
        )
        row = self._pair(*bodies, [origin, origin], vectors)
        held = positive_number(held, f"the stiffness of a {kind} joint", "N/m", SceneError)
        if alignment is None:
            alignment = held * max(float(np.ptp(b.rest, axis=0).max()) for b in bodies if b is not None) ** 2
        kept = {"point": (0, 0, 0), "hinge": (1, 0, 0), "fixed": (1, 1, 1), "slider": (1, 1, 1)}[kind]
        if any(kept):
            alignment = positive_number(alignment, f"the alignment of a {kind} joint", "N m / rad", SceneError)
        # Two vectors turn with a small angle, so each has half of the stiffness; of a hinge's axis it is the one.
        share = 0.5 if sum(kept) == 3 else 1.0
        row |= {"stiffness": held, "alignment": share * alignment * np.array(kept, np.float64)}
        row |= {"reference": 0.0}
        primitive = "sliders" if kind == "slider" else "links"
        frames = self._kinds.get(primitive)
        if frames is None:
            frames = self._kinds[primitive] = _Frames(
                self, primitive, (("stiffness", 1), ("alignment", 3), ("reference", 1))
            )
            numbers = frames.numbers
            energy = materials.on_the_axis if kind == "slider" else materials.held_together
            self._register(frames, "held", energy(*frames.frames, numbers["stiffness"]))
            self._register(frames, "aligned", materials.aligned(*frames.frames, numbers["alignment"]))
        return self._made(kind, frames, row, name)

    def _register(self, frames: _Frames, name: str, energy: Attribute) -> None:
        self.scene.add_energy(frames.primitive.add_attribute(name, computed_attribute=energy))

    def _made(self, kind: str, frames: _Frames, row: Row, name: str) -> Joint:
        joint = (Hinge if kind == "hinge" else Joint)(
            self, name or f"{kind} {len(self.all)}", kind, frames, frames.add(row), row
        )
        self.all.append(joint)
        return joint

    def _pair(
        self, first: Body | None, second: Body | None, origins: Sequence[Float64Array], vectors: Float64Array
    ) -> Row:
        row: Row = {}
        if first is second:
            both = "the world" if first is None else repr(first)
            raise SceneError(f"a joint holds two bodies, or a body and the world (None); both are {both}")
        for side, body, origin in zip(("first", "second"), (first, second), origins, strict=True):
            if body is None:
                start = self.vertices.num_instances - len(WORLD)
                numbers = np.arange(len(WORLD))
                later = np.vstack([origin, vectors])
                weights = np.column_stack([np.array([1.0, 0, 0, 0]) - later.sum(axis=1), later])
            elif body in self.bodies:
                start = self.vertices.offset_of(body.vertices)
                numbers, weights = material_frame(body, origin, vectors)
            else:
                raise SceneError(f"{body!r} is none of the bodies of these joints: {[b.name for b in self.bodies]}")
            row |= {side: start + numbers, f"{side}_weights": weights}
        return row

    def _turn(self, hinge: Hinge, **values: float) -> None:
        """Numbers of a hinge's motor and limits."""
        frames = self._kinds.get("turns")
        if frames is None:
            names = ("reference", "aim", "drive", "torque", "least", "most", "limit")
            frames = self._kinds["turns"] = _Frames(self, "turns", [(name, 1) for name in names])
            n = frames.numbers
            angle = materials.joint_angle(*frames.frames, n["reference"])
            self._register(frames, "driven", materials.motor(angle, n["aim"], n["drive"], n["torque"]))
            self._register(frames, "limited", materials.angle_limits(angle, n["least"], n["most"], n["limit"]))
        if hinge not in self._turns:
            ends = {name: hinge.pair[name] for name in ("first", "second", "first_weights", "second_weights")}
            still = {
                "reference": hinge.frames.number("reference", hinge.number),
                "aim": 0.0,
                "drive": 0.0,
                "torque": UNLIMITED,
            }
            free = {"least": -UNLIMITED, "most": UNLIMITED, "limit": 0.0}
            self._turns[hinge] = frames.add({**ends, **still, **free, **values})
        else:
            frames.set(self._turns[hinge], **values)

    def _angle(self, hinge: Hinge) -> float:
        """As `materials.joint_angle` has it."""
        (_, _, e2, e3), (_, _, f2, f3) = hinge.frames.values()[hinge.number]
        turned = float(np.arctan2(e3 @ f2 - e2 @ f3, e2 @ f2 + e3 @ f3))
        reference = hinge.frames.number("reference", hinge.number)
        return reference + float(np.remainder(turned - reference + np.pi, 2 * np.pi)) - np.pi

    # -- what there is -------------------------------------------------------------------------------------

    @property
    def history(self) -> tuple[Attribute, ...]:
        """From where angles count: a part of the state of a simulation."""
        return tuple(kind.numbers["reference"] for kind in self._kinds.values() if "reference" in kind.numbers)

    def start_step(self) -> None:
        """Before every step: angles count on from where they are, beyond a half turn too."""
        for hinge in self.all:
            if isinstance(hinge, Hinge):
                hinge.frames.set(hinge.number, reference=hinge.angle())
        for hinge, number in self._turns.items():
            self._kinds["turns"].set(number, reference=hinge.frames.number("reference", hinge.number))

    def residuals(self) -> list[Residual]:
        """Of all joints, in the order in which they were made."""
        return [joint.residual() for joint in self.all]
