"""What is driven in a simulation: moving obstacles, and vertices of bodies that are pinned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, ConnectivityError, Scene, SceneError, UnsupportedSceneError
from yasps.bodies import Body, MovingObstacle
from yasps.frontend.language.arrays import plain_array, positive_number
from yasps.meshes.tetrahedral_mesh import Float64Array
from yasps.stepping import Anchors, Driven, DrivenSurface, DrivenVertices, Pins, Prescribed
from yasps.stepping.driven import checked_motion

PIN_STIFFNESS = 1e3
"""Stiffness of a pin, in masses of its body over the squared time step: a body that hangs on one sinks by
g dt^2 / 1e3."""


WAY = ("start", "way")
"""Constants of a moving obstacle that say where it is, with its progress."""


class DrivenBodies:
    """Moving obstacles and pins of one simulation. all: what its stepper drives, in the order in which they came."""

    def __init__(self, scene: Scene, time_step: Attribute) -> None:
        """None yet; time_step: the scene's constant [s]."""
        self.all: list[Driven] = []
        self._scene, self._time_step = scene, time_step
        self._surfaces: dict[Body, DrivenSurface] = {}
        self._pins = 0

    def add(self, obstacle: MovingObstacle) -> None:
        """Moves an obstacle from now on: its progress is a target, its push an energy."""
        surface = self._surfaces[obstacle] = DrivenSurface(obstacle, float(self._time_step.value[0]))
        self.all.append(surface)
        self._scene.add_minimize_target(obstacle.progress)
        if obstacle.energies[0] not in self._scene.energies:
            self._scene.add_energy(obstacle.energies[0])

    def forget(self, body: Body) -> None:
        """Moves an obstacle, or what is pinned of a body, no longer."""
        if body in self._surfaces:
            assert isinstance(body, MovingObstacle)
            self.all.remove(self._surfaces.pop(body))
            self._scene.remove_energy(body.energies[0])
            self._scene.remove_minimize_target(body.progress)
        for driven in self.on(body):
            assert isinstance(driven, DrivenVertices)
            driven.release()
            self.all.remove(driven)

    def on(self, body: Body) -> list[Driven]:
        """What is pinned of a body."""
        return [driven for driven in self.all if driven.position is body.position]

    def velocity_of(self, obstacle: Body) -> Float64Array:
        """Velocities of an obstacle's vertices in the last step [m/s], [n, 3]; zero for one that is not driven."""
        if obstacle not in self._surfaces:
            return np.zeros((len(obstacle.rest), 3))
        return self._surfaces[obstacle].velocity.copy()

    def pin(
        self, body: Body, vertices: Iterable[int], stiffness: float | None, motion: Prescribed | None
    ) -> Pins | DrivenVertices:
        """See `Simulation.pin`; the body moves."""
        chosen = _checked_vertices(body, vertices)
        held = [other for other in self.all if other.position is body.position and not other.is_released]
        if any(np.isin(chosen, other.vertices).any() for other in held):
            raise SceneError(f"some of these vertices of {body.name} are pinned already: release those pins first")
        seconds = float(self._time_step.value[0])
        if stiffness is not None or self._scene.is_on_device:
            if motion is not None and stiffness is not None:
                raise SceneError("springs have no motion: move them by pins.move_to(places), or leave stiffness out")
            if motion is not None:
                raise UnsupportedSceneError(
                    "on a GPU pins are springs, which have no motion: move them by pins.move_to(places), or take"
                    " device='cpu'"
                )
            if stiffness is None:
                stiffness = PIN_STIFFNESS * float(body.mass.value.sum()) / seconds**2
            stiffness = positive_number(stiffness, f"the stiffness of a pin of {body.name}", "N/m", SceneError)
            anchors = self._add_anchors(body)
            anchors.hold(chosen, body.positions()[chosen], stiffness)
            return Pins(anchors)
        name = f"a pin of {body.name}"
        motion = body.positions()[chosen] if motion is None else motion
        checked_motion(motion, len(chosen), f"the motion of {name}")  # before anything is added
        pins = DrivenVertices(
            name,
            body.position,
            chosen,
            self._add_anchors(body),
            motion,
            spacing=seconds,
            is_exact=body.position in self._scene.minimize_targets,
        )
        self.all.append(pins)
        return pins

    def _add_anchors(self, body: Body) -> Anchors:
        """Springs that hold nothing yet."""
        self._pins += 1
        anchors = Anchors(body.mesh, f"pins_{self._pins}", body.vertices)
        body.add_energy(anchors.energy)
        return anchors

    # -- state ---------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Float64Array]:
        """Ways of obstacles; what holds each of the driven, how fast it is, which vertices, whether it was released,
        and where it was told to be; by name."""
        numbers = {f"{part}/{body.name}": body.vertices[part].value for body in self._surfaces for part in WAY}
        for k, driven in enumerate(self.all):
            numbers |= {f"multiplier/{k}": driven.multiplier.copy(), f"driven_velocity/{k}": driven.velocity.copy()}
            numbers[f"is_released/{k}"] = np.array(float(driven.is_released))
            numbers[f"driven_vertices/{k}"] = driven.vertices.astype(np.float64)
            if isinstance(driven.motion, np.ndarray) and driven.motion.shape == (len(driven.vertices), 3):
                numbers[f"motion/{k}"] = driven.motion.copy()
        return numbers

    def set_state(self, state: Mapping[str, Float64Array]) -> None:
        """Puts them back."""
        for body in self._surfaces:
            for part in WAY:
                body.vertices[part].update_value(state[f"{part}/{body.name}"])
        for k, driven in enumerate(self.all):
            driven.multiplier = np.array(state[f"multiplier/{k}"])
            driven.velocity = np.array(state[f"driven_velocity/{k}"])
            driven.is_released = bool(state[f"is_released/{k}"])
            driven.vertices = state[f"driven_vertices/{k}"].astype(np.int64)
            if f"motion/{k}" in state:
                driven.motion = np.array(state[f"motion/{k}"])


def _checked_vertices(body: Body, vertices: object) -> NDArray[np.int64]:
    """Numbers of vertices of a body to pin, each once, [n]. Raises ConnectivityError."""
    what = f"the vertices of {body.name} to pin"
    if isinstance(vertices, str | bytes) or not isinstance(vertices, Iterable):
        raise ConnectivityError(f"{what} are a list of their numbers, got {vertices!r}")
    given = plain_array(vertices if isinstance(vertices, np.ndarray) else list(vertices), what, ConnectivityError)
    if given.dtype == np.bool_:
        raise ConnectivityError(f"{what} are given by their numbers, got truth values: take np.flatnonzero of these")
    if given.ndim != 1 or len(given) == 0 or given.dtype.kind not in "iu":
        raise ConnectivityError(f"{what} are integers [n], at least one, got {given.dtype} {list(given.shape)}")
    bad = (given < 0) | (given >= len(body.rest))
    if bad.any():
        raise ConnectivityError(f"{body.name} has vertices 0 to {len(body.rest) - 1}, got {given[bad][0]} to pin")
    numbers, counts = np.unique(given, return_counts=True)
    if (counts > 1).any():
        raise ConnectivityError(f"{what}: {numbers[counts > 1][0]} is there twice")
    return given.astype(np.int64)
