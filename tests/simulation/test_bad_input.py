"""What a stranger gets wrong is said in their terms, and nothing is half-done: the next try finds all as it was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yasps import (
    ConnectivityError,
    DataError,
    IntersectionError,
    NotConvergedError,
    Scene,
    SceneError,
    ShapeMismatchError,
    UnsupportedSceneError,
    YaspsError,
)
from yasps.bodies import AffineBody, HalfSpace, MovingObstacle, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, box
from yasps.simulation import Simulation
from yasps.stepping import DrivenVertices

CUBE = box((0.1, 0.1, 0.1), (1, 1, 1))
SURFACE = TriangleMesh(CUBE.vertices, CUBE.surface_triangles())


def cube_and_ground() -> tuple[Scene, AffineBody, HalfSpace]:
    scene = Scene("s", threads=1)
    return scene, AffineBody(scene, "cube", CUBE.translated((0.0, 0.0, 0.2))), HalfSpace(scene, "ground")


def soft_cube() -> tuple[Simulation, SoftBody]:
    scene = Scene("cube", threads=1)
    soft = SoftBody(scene, "soft", CUBE.translated((0.0, 0.0, 1.0)))
    return Simulation(scene, [soft], contact=False), soft


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"time_step": "short"}, "time_step needs real numbers"),
        ({"time_step": np.nan}, "time_step must be positive"),
        ({"gravity": (0.0, -9.8)}, "gravity needs 1 x 3x1 = 3 numbers, got 2"),
        ({"activation_distance": -1e-3}, "activation_distance must be positive"),
        ({"contacts": {"cube": 0.5}}, "contacts are a ContactTable"),
        ({"contacts": ContactTable().set("cube", "grund", friction=0.5)}, "names 'grund', but there are only"),
        ({"barrier": "logarithm"}, "barrier is one of 'log', 'paper', got 'logarithm'"),
        ({"contact_stiffness": -2.0}, "contact_stiffness must be positive, .* Pa"),
        ({"eps_v": 0.0}, "eps_v must be positive, .* m/s"),
        ({"lagging": "twice"}, "lagging is one of 'once', 'converged', got 'twice'"),
        ({"velocities": [(0.0, 0.0, 1.0)]}, "velocities are a table"),
        ({"velocities": {"cube": (0.0, 0.0, 1.0)}}, "velocities: 'cube' is no body of this simulation that moves"),
        ({"settings": {"max_iterations": 3}}, "settings are NewtonSettings"),
        ({"rescue": 1.5}, "rescue must be an integer"),
    ],
)
def test_after_a_wrong_argument_the_same_bodies_can_be_used(wrong: dict[str, Any], words: str) -> None:
    scene, cube, ground = cube_and_ground()
    with pytest.raises(YaspsError, match=words):
        Simulation(scene, [cube, ground], **wrong)
    assert not {"time_step", "gravity"} & set(scene.attributes)
    assert "inertia" not in cube.vertices.attributes
    assert Simulation(scene, [cube, ground], contact=False).bodies == [cube, ground]


def test_velocities_of_a_wrong_shape_leave_the_scene_as_it_was() -> None:
    scene, cube, ground = cube_and_ground()
    with pytest.raises(SceneError, match=r"the velocity of cube is \[3\] or \[8, 3\]"):
        Simulation(scene, [cube, ground], contact=False, velocities={cube: (1.0, 0.0)})
    with pytest.raises(SceneError, match="'ground' is no body of this simulation that moves"):
        Simulation(scene, [cube, ground], contact=False, velocities={ground: (1.0, 0.0, 0.0)})
    simulation = Simulation(scene, [cube, ground], contact=False, velocities={cube: (1.0, 0.0, 0.0)})
    np.testing.assert_array_equal(simulation.velocity_of(cube), np.tile([1.0, 0.0, 0.0], (8, 1)))
    for wrong in ("fast", (0.0, 0.0, np.nan)):
        with pytest.raises(SceneError, match="the velocity of cube"):
            simulation.set_velocity(cube, wrong)
    with pytest.raises(SceneError, match="body 'cube' is not in this simulation"):
        simulation.velocity_of("cube")  # type: ignore[arg-type]


def test_bodies_come_in_any_collection_and_a_scene_has_one_simulation() -> None:
    scene, cube, ground = cube_and_ground()
    with pytest.raises(SceneError, match=r"takes a list of bodies, got <AffineBody 'cube'.*> alone"):
        Simulation(scene, cube)  # type: ignore[arg-type]
    simulation = Simulation(scene, (body for body in (cube, ground)), contact=False)
    assert simulation.bodies == [cube, ground]
    with pytest.raises(SceneError, match=r"a scene has one simulation, and bodies join it by add\(\)"):
        Simulation(scene, [cube, ground], contact=False)
    with pytest.raises(SceneError, match="frames must be an integer >= 0, got -1"):
        simulation.run(-1)


def test_names_that_a_simulation_needs_are_asked_for_first() -> None:
    scene, cube, ground = cube_and_ground()
    cube.vertices.add_constant("gravity", 1, 1)
    with pytest.raises(YaspsError, match="has an attribute named 'gravity' already"):
        Simulation(scene, [cube, ground], contact=False)
    assert not {"time_step", "gravity"} & set(scene.attributes)


def test_vertices_and_motions_of_pins() -> None:
    simulation, soft = soft_cube()
    energies = len(simulation.scene.energies)
    for vertices, words in (
        ([8], "soft has vertices 0 to 7, got 8 to pin"),
        ([-1], "got -1 to pin"),
        ([0.5], "are integers"),
        ([], "at least one"),
        ([1, 1], "1 is there twice"),
        ([True] * 8, "got truth values: take np.flatnonzero"),
        ("01", "a list of their numbers, got '01'"),
        (3, "a list of their numbers, got 3"),
        ([[0, 1]], r"are integers \[n\]"),
    ):
        with pytest.raises(ConnectivityError, match=words):
            simulation.pin(soft, vertices)  # type: ignore[arg-type]
    with pytest.raises(ShapeMismatchError, match=r"the motion of a pin of soft: positions are \[1, 3\], got \[3, 3\]"):
        simulation.pin(soft, [0], motion=np.zeros((3, 3)))
    with pytest.raises(DataError, match="the motion of a pin of soft: entry 0 is nan"):
        simulation.pin(soft, [0], motion=np.full((1, 3), np.nan))
    with pytest.raises(SceneError, match=r"the stiffness of a pin of soft must be positive, .* N/m"):
        simulation.pin(soft, [0], -1.0)
    assert len(simulation.scene.energies) == energies
    assert not simulation.driven.all
    pins, springs = simulation.pin(soft, [0]), simulation.pin(soft, [1], 10.0)
    with pytest.raises(SceneError, match="pinned already"):
        simulation.pin(soft, [0], 10.0)
    for released in (pins, springs):
        released.release()
        with pytest.raises(SceneError, match="released: pin the vertices again"):
            released.move_to(np.zeros((1, 3)))
    assert isinstance(pins, DrivenVertices)
    with pytest.raises(SceneError, match="a pin of soft was released"):
        pins.follow(None)


def test_what_a_gpu_does_not_have_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, soft = soft_cube()
    plate = MovingObstacle(simulation.scene, "plate", SURFACE)
    monkeypatch.setattr(Scene, "is_on_device", True)
    with pytest.raises(UnsupportedSceneError, match="on a GPU pins are springs, which have no motion"):
        simulation.pin(soft, [0], motion=soft.positions()[:1])
    with pytest.raises(UnsupportedSceneError, match="plate moves, which is for the CPU only: take device='cpu'"):
        simulation.add(plate)
    assert simulation.bodies == [soft]


def test_a_motion_that_fails_moves_nothing() -> None:
    """Not even where a first half went well: motions are the user's own, and may raise what they like."""
    scene = Scene("s", threads=1)
    soft = SoftBody(scene, "soft", CUBE.translated((0.0, 0.0, 1.0)))
    plate = MovingObstacle(scene, "plate", SURFACE)
    simulation = Simulation(scene, [soft, plate], contact=False)
    simulation.step()
    before = simulation.state()

    def check(error: type[Exception], words: str) -> pytest.ExceptionInfo[Exception]:
        with pytest.raises(error, match=words) as caught:
            simulation.step()
        after = simulation.state()
        assert before.keys() == after.keys()
        for name, value in before.items():
            np.testing.assert_array_equal(after[name], value)
        assert simulation.stepper.time_step == simulation.time_step.value[0] == 0.01
        return caught

    shape = r"positions are \[8, 3\], got "
    for motion, error, words in (
        (np.zeros((3, 3)), ShapeMismatchError, f"the motion of plate: {shape}"),
        (lambda time: np.zeros((2, 3)), ShapeMismatchError, f"the motion of plate at t = 0.02 s: {shape}"),
        (lambda time: None, DataError, "the motion of plate at t = 0.02 s needs real numbers"),
        (np.zeros((0, 8, 3)), ShapeMismatchError, "the motion of plate is a table of positions without a row"),
        (np.zeros((2, 8, 2)), ShapeMismatchError, f"the motion of plate, row 1: {shape}"),
        ("up", DataError, "the motion of plate needs real numbers"),
    ):
        plate.motion = motion
        check(error, words)

    minimize = simulation.stepper.minimize
    calls: list[float] = []

    def motion(time: float) -> np.ndarray:
        calls.append(time)
        if len(calls) == 3:  # the whole step, the first half, the second
            raise ZeroDivisionError("mine")
        return SURFACE.vertices

    def failing(fixed: object = None) -> object:
        report = minimize(fixed)  # type: ignore[arg-type]
        if simulation.stepper.time_step == 0.01:
            raise NotConvergedError("not today")
        return report

    plate.motion = motion
    simulation.stepper.minimize = failing  # type: ignore[assignment]
    caught = check(ZeroDivisionError, "mine")
    assert len(calls) == 3
    assert "the motion of plate at t = 0.02 s raised this" in caught.value.__notes__[0]


def test_fields_that_fail_change_no_force() -> None:
    simulation, soft = soft_cube()
    first = simulation.add_force(soft, lambda x, v, time: (0.0, 0.0, 1.0 + time), "first")

    def second(x: np.ndarray, v: np.ndarray, time: float) -> tuple[float, float, float]:
        if time > 0:
            raise RuntimeError("mine")
        return 0.0, 0.0, 0.0

    simulation.add_force(soft, second, "second")
    simulation.step()
    before = simulation.state()
    with pytest.raises(RuntimeError, match="mine") as caught:
        simulation.step()
    assert "the field of the forces 'second' on soft raised this" in caught.value.__notes__[0]
    np.testing.assert_array_equal(first.value, np.tile([0.0, 0.0, 1.0], 8))
    for name, value in simulation.state().items():
        np.testing.assert_array_equal(before[name], value)
    soft.vertices.add_constant("wind_load", 1, 1)
    with pytest.raises(YaspsError, match="has an attribute named 'wind_load' already"):
        simulation.add_force(soft, (0.0, 0.0, 0.0), "wind")
    assert "wind" not in soft.vertices.attributes


def test_files_that_hold_no_state(tmp_path: Path) -> None:
    simulation, _ = soft_cube()
    before = simulation.state()
    (tmp_path / "text.npz").write_text("not a state")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    for name, words in (
        ("none.npz", "holds no state of a simulation"),
        ("text.npz", "holds no state of a simulation"),
        ("other.npz", "holds no state of a simulation: it has a in it"),
    ):
        with pytest.raises(SceneError, match=words):
            simulation.restore(tmp_path / name)
    for name, value in simulation.state().items():
        np.testing.assert_array_equal(before[name], value)


def test_what_is_put_through_a_half_space_is_noticed() -> None:
    scene, cube, ground = cube_and_ground()
    simulation = Simulation(scene, [cube, ground], activation_distance=1e-3)
    translation = cube.falling[0]
    place = translation.value
    for depth in (-0.05, -1.0):  # across, and wholly inside
        translation.update_value([0.0, 0.0, depth])
        with pytest.raises(IntersectionError, match=r"changed since the last step.*'ground'.* vertex . of 'cube'"):
            simulation.step()
    translation.update_value(place)
    assert simulation.contact is not None
    simulation.contact.check_way()
