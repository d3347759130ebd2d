"""What a simulation asks of bodies and velocities before anything is added to the scene."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from yasps import NameTakenError, Scene, SceneError, UnsupportedSceneError
from yasps.bodies import Body, MovingObstacle
from yasps.frontend.language.arrays import real_numbers
from yasps.meshes.tetrahedral_mesh import Float64Array

AnyBody = TypeVar("AnyBody", bound=Body)
"""Bodies of one class or of several: tables of bodies may have any of them as keys."""


def check_names(scene: Scene, names: Iterable[str]) -> None:
    """Raises SceneError unless a simulation can add these to the scene."""
    for name in names:
        try:
            scene.check_child_name(name, "a part of a simulation")
        except NameTakenError as error:
            raise SceneError(
                f"a simulation adds {name!r} to its scene, but {scene.label} has something of that name: a scene has"
                " one simulation, and bodies join it by add()"
            ) from error


def checked_bodies(bodies: Iterable[Body], scene: Scene, known: Container[Body]) -> list[Body]:
    """The bodies, if they can make a simulation of this scene; known: those that have been in it before.

    Raises SceneError, UnsupportedSceneError, NameTakenError.
    """
    if isinstance(bodies, Body):
        raise SceneError(f"a simulation takes a list of bodies, got {bodies!r} alone: put it in brackets")
    chosen = list(bodies)
    for body in chosen:
        if not isinstance(body, Body):
            raise SceneError(f"a simulation is made of bodies (yasps.bodies), got {body!r}")
        if body.scene is not scene:
            raise SceneError(f"body {body.name!r} belongs to another scene")
        if isinstance(body, MovingObstacle) and scene.is_on_device:
            raise UnsupportedSceneError(f"{body.name} moves, which is for the CPU only: take device='cpu'")
        if not body.is_fixed and body not in known:
            for name in ("predicted", "inertia", "gravity"):
                body.vertices.check_name(name, "a part of a simulation")
    if len(set(chosen)) != len(chosen):
        raise SceneError("a body is named twice")
    if all(body.is_fixed for body in chosen):
        raise SceneError("nothing can move: give the simulation at least one body that is not fixed")
    return chosen


def checked_velocities(
    velocities: Mapping[AnyBody, ArrayLike] | None, moving: Sequence[Body]
) -> dict[Body, Float64Array]:
    """Velocities of the vertices of bodies [m/s], [n, 3] each. Raises SceneError."""
    if velocities is None:
        return {}
    if not isinstance(velocities, Mapping):
        raise SceneError(f"velocities are a table, body -> velocity [m/s], got {velocities!r}")
    for body in velocities:
        if body not in moving:
            raise SceneError(f"velocities: {getattr(body, 'name', body)!r} is no body of this simulation that moves")
    return {body: vertex_velocities(body, velocity) for body, velocity in velocities.items()}


def vertex_velocities(body: Body, velocity: ArrayLike, angular: ArrayLike = (0.0, 0.0, 0.0)) -> Float64Array:
    """Velocities of the vertices of a body that moves [m/s], [n, 3]: one or one each, and a rotation [rad/s] about its
    centre of mass. Raises SceneError."""
    given = real_numbers(velocity, f"the velocity of {body.name}", SceneError)
    turning = real_numbers(angular, f"the rotation of {body.name}", SceneError)
    positions = body.positions()
    if given.shape not in ((3,), positions.shape) or turning.shape != (3,):
        raise SceneError(
            f"the velocity of {body.name} is [3] or {list(positions.shape)} and its rotation [3], got "
            f"{list(given.shape)} and {list(turning.shape)}"
        )
    mass = body.mass.value
    arms = positions - mass @ positions / mass.sum()
    return np.asarray(given + np.cross(turning, arms))
