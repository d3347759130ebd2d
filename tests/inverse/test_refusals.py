"""What gradients can't be taken of, by, or through, with advice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from inverse_runs import add_miss, chain, sliding_cube

from yasps import DataError, Scene, SceneError, ShapeMismatchError, UnsupportedSceneError, YaspsError
from yasps.bodies import RigidBody
from yasps.inverse import (
    PRECISE,
    Constant,
    Energy,
    FromOutside,
    InitialVelocity,
    MotionOf,
    PerStep,
    Squares,
    Tied,
    Trajectory,
)
from yasps.inverse.kinks import kinks_of
from yasps.meshes import box
from yasps.simulation import Simulation


def test_parameters_and_objectives() -> None:
    simulation, body = chain(5.0)
    other, stranger = chain(5.0)
    miss, trajectory = add_miss(body, (0.3, -0.2, 0.1)), Trajectory(simulation, 2)
    strange = add_miss(stranger, (0.3, -0.2, 0.1))
    refused: dict[str, Callable[[], Any]] = {
        "is no attribute of scene chain": lambda: trajectory.gradient(miss, stranger.stiffness),
        "is computed; gradients are by stored attributes. It is computed from chain.vertices.position": lambda: (
            trajectory.gradient(miss, miss)
        ),
        "predicted is set in every step": lambda: trajectory.gradient(miss, body.vertices["predicted"]),
        "by the time step are not built": lambda: trajectory.gradient(miss, simulation.time_step),
        "stiffness is named twice": lambda: trajectory.gradient(miss, [body.stiffness, body.stiffness]),
        "is in two of the parameters": lambda: trajectory.gradient(
            miss, [body.mass, Tied(body.mass, body.vertices["hook"])]
        ),
        "at least one parameter": lambda: trajectory.gradient(miss, []),
        "is no parameter": lambda: trajectory.gradient(miss, ["stiffness"]),
        "no energy, position or objective reads chain.vertices.rest_position": lambda: trajectory.gradient(
            miss, body.vertices["rest_position"]
        ),
        "is no moving body": lambda: trajectory.gradient(miss, InitialVelocity(stranger)),
        "is no schedule of this trajectory": lambda: trajectory.gradient(
            miss, PerStep(body.mass, np.tile(body.mass.value, (2, 1)))
        ),
        "belongs to scene": lambda: trajectory.gradient(strange, body.stiffness),
        "there is no objective": lambda: trajectory.gradient([], body.stiffness),
        "an objective is a 1x1 attribute": lambda: trajectory.gradient("miss", body.stiffness),
        "which belongs to a step and not to a frame": lambda: trajectory.gradient(
            body.vertices["inertia"], body.stiffness
        ),
        "the run has the frames 0 to 2": lambda: trajectory.gradient(Energy(miss, [3]), body.stiffness),
        'frames are "last"': lambda: trajectory.gradient(Energy(miss, "first"), body.stiffness),
        "1x1 on every instance": lambda: Energy(body.position),
        "a weight >= 0": lambda: Squares(body.position, weight=-1.0),
        "has 9 numbers, got 3": lambda: trajectory.gradient(
            lambda frame: (0.0, {body.position: np.zeros(3)}), body.stiffness
        ),
        "are by attributes and bodies": lambda: trajectory.gradient(
            lambda frame: (0.0, {"x": np.zeros(3)}),  # type: ignore[arg-type,dict-item,return-value]
            body.stiffness,
        ),
        "which does not move": lambda: trajectory.gradient(
            lambda frame: (0.0, {stranger: np.zeros(9)}), body.stiffness
        ),
        "what can't be called|an attribute or a function": lambda: FromOutside(3),  # type: ignore[arg-type]
        r"has the shape \[3\], got \[2\]": lambda: trajectory.set(InitialVelocity(body), [1.0, 2.0]),
        "not by 'mass'": lambda: trajectory.gradient(miss, body.stiffness)["mass"],
        "values are": lambda: PerStep(body.mass, 3.0),
        "PerStep sets stored": lambda: PerStep(miss, [1.0]),
        "two or more": lambda: Tied(body.mass),
        "other shapes": lambda: Tied(body.mass, body.stiffness),
        "can't be tied": lambda: trajectory.gradient(miss, Tied(body.position, body.vertices["goal"])),
        "MotionOf is of": lambda: MotionOf(body),  # type: ignore[arg-type]
        "of a body that moves": lambda: InitialVelocity("chain"),  # type: ignore[arg-type]
    }
    for words, call in refused.items():
        with pytest.raises((SceneError, DataError, ShapeMismatchError), match=words):
            call()
    assert other.frame == 0
    assert isinstance(trajectory.gradient(miss, Constant(body.mass)).value, float)

    def broken(frame: Any) -> Any:
        raise KeyError("of my own")

    with pytest.raises(KeyError, match="of my own") as caught:
        trajectory.gradient(broken, body.stiffness)
    assert "an objective raised this at frame 2" in caught.value.__notes__


def test_simulations() -> None:
    simulation, body = chain(5.0)
    simulation.before_step.append(lambda _: None)
    with pytest.raises(SceneError, match="before_step"):
        Trajectory(simulation, 2)
    simulation.before_step.clear()
    with pytest.raises(SceneError, match="steps"):
        Trajectory(simulation, 0)
    with pytest.raises(SceneError, match="keep"):
        Trajectory(simulation, 2, keep="none")
    with pytest.raises(SceneError, match="a Simulation"):
        Trajectory(body, 2)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="values for 3 steps, but the run has 2"):
        Trajectory(simulation, 2, schedules=[PerStep(body.stiffness, [1.0, 2.0, 3.0])])
    with pytest.raises(SceneError, match="moves vertices by itself"):
        Trajectory(simulation, 2, schedules=[PerStep(body.position, np.zeros((2, 9)))])
    simulation.add_force(body, lambda x, v, t: -v, "drag")
    with pytest.raises(SceneError, match="functions of positions and velocities"):
        Trajectory(simulation, 2)


def test_bodies_that_count_from_where_they_are() -> None:
    scene = Scene("rigid", threads=1)
    body = RigidBody(scene, "body", box((0.1, 0.1, 0.1), (1, 1, 1)))
    simulation = Simulation(scene, [body], contact=False)
    with pytest.raises(UnsupportedSceneError, match="base_rotation"):
        Trajectory(simulation, 2)


def test_steps_that_are_cut_into_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, _ = chain(5.0)
    trajectory = Trajectory(simulation, 2)
    step = simulation.step
    monkeypatch.setattr(simulation, "step", lambda: replace(step(), substeps=2))
    with pytest.raises(SceneError, match="step 1 was cut into 2 parts"):
        trajectory.run()
    monkeypatch.setattr(simulation, "step", lambda: replace(step(), lag_converged=False))
    with pytest.raises(SceneError, match="friction of step 1 did not settle"):
        trajectory.run()


def test_a_state_that_is_singular() -> None:
    """A vertex without mass, on no spring, is anywhere."""
    simulation, body = chain(0.0)
    body.mass.update_value([0.3, 0.4, 0.0])
    trajectory = Trajectory(simulation, 1)
    simulation.stepper.settings = replace(PRECISE, solver="pcg", projection="always")
    with pytest.raises(YaspsError, match="Hessian"):
        trajectory.gradient(add_miss(body, (0.3, -0.2, 0.1)), body.position)


def test_kinks() -> None:
    simulation, cube = sliding_cube()
    contact = simulation.contact
    assert contact is not None
    assert kinks_of(contact) == []
    lowest = contact.positions()[:, 2].min()
    x = cube.targets[1].value
    x[2] += contact.geometry.activation_distance * (1 - 1e-12) - lowest
    cube.targets[1].update_value(x)
    contact.reset()
    (kink,) = kinks_of(contact)
    assert "half_space of vertices" in kink
    assert "activation distance" in kink
