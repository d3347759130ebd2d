"""Simulation: bodies, contact and steps together, and what may change between steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yasps import Attribute, IntersectionError, NotConvergedError, NotFiniteError, Scene, SceneError, ShapeMismatchError
from yasps.bodies import AffineBody, Cloth, Ground, HalfSpace, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import box, cloth_grid
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

CUBE = box((0.1, 0.1, 0.1), (1, 1, 1))
DT = 0.01


def falling_cube(height: float = 1.0, contact: bool = False) -> tuple[Simulation, SoftBody]:
    scene = Scene("cube", threads=1)
    soft = SoftBody(scene, "soft", CUBE.translated((0.0, 0.0, height)))
    bodies = [soft, Ground(scene)] if contact else [soft]
    settings = NewtonSettings(linear_tolerance=1e-12)
    return Simulation(scene, bodies, time_step=DT, contact=contact, settings=settings), soft


def test_free_fall_is_backward_eulers_own() -> None:
    simulation, soft = falling_cube()
    start = soft.positions()
    reports = simulation.run(3)
    assert len(reports) == simulation.frame == 3
    assert simulation.time == pytest.approx(3 * DT)
    fall = 9.8 * DT**2 * 3 * 4 / 2
    np.testing.assert_allclose(soft.positions(), start - [0.0, 0.0, fall], atol=1e-9)
    np.testing.assert_allclose(simulation.velocity_of(soft), np.broadcast_to([0, 0, -9.8 * 3 * DT], (8, 3)), atol=1e-6)


def test_velocities_forces_and_gravity() -> None:
    simulation, soft = falling_cube()
    simulation.gravity.update_value([0.0, 0.0, 0.0])
    simulation.set_velocity(soft, (1.0, 0.0, 0.0), angular=(0.0, 0.0, 2.0))
    assert simulation.stepper.momentum() == pytest.approx(soft.mass.value.sum() * np.array([1.0, 0.0, 0.0]))
    arms = soft.positions() - soft.rest.mean(axis=0)
    np.testing.assert_allclose(simulation.velocity_of(soft) - [1.0, 0.0, 0.0], np.cross([0, 0, 2.0], arms), atol=1e-12)
    simulation.set_velocity(soft, (0.0, 0.0, 0.0))
    force = simulation.add_force(soft, soft.mass.value[:, None] * np.array([[0.0, 3.0, 0.0]]))
    simulation.step()
    np.testing.assert_allclose(simulation.velocity_of(soft).mean(axis=0), [0.0, 3.0 * DT, 0.0], atol=1e-7)
    compiled = simulation.scene.compile()
    force.update_value(np.zeros((8, 3)))
    simulation.step()
    assert simulation.scene.compile() is compiled
    np.testing.assert_allclose(simulation.velocity_of(soft).mean(axis=0), [0.0, 3.0 * DT, 0.0], atol=1e-7)


def test_a_force_field_is_asked_at_the_beginning_of_every_step() -> None:
    """Drag -c v, explicit: each step takes the same share of the velocity, v (1 - c dt / m)."""
    simulation, soft = falling_cube()
    simulation.gravity.update_value([0.0, 0.0, 0.0])
    simulation.set_velocity(soft, (1.0, 0.0, 0.0))
    drag = 5.0  # 1/s
    seen = []

    def field(positions: np.ndarray, velocities: np.ndarray, time: float) -> np.ndarray:
        seen.append((positions[0, 0], time))
        return -drag * soft.mass.value[:, None] * velocities

    simulation.add_force(soft, field, "drag")
    simulation.run(3)
    np.testing.assert_allclose(simulation.velocity_of(soft).mean(axis=0), [(1 - drag * DT) ** 3, 0, 0], atol=1e-7)
    assert [time for _, time in seen] == pytest.approx([0.0, 0.0, DT, 2 * DT])
    assert seen[-1][0] > seen[0][0]


def test_forces_of_another_shape_are_refused() -> None:
    simulation, soft = falling_cube()
    with pytest.raises(ShapeMismatchError, match=r"the forces 'wind' on soft are \[3\] or \[8, 3\], got \[4, 3\]"):
        simulation.add_force(soft, lambda *_: np.zeros((4, 3)), "wind")
    assert "wind" not in soft.vertices.attributes


def test_pins_hold_move_and_let_go() -> None:
    scene = Scene("hanging", threads=1)
    cloth = Cloth(scene, "cloth", cloth_grid((0.2, 0.2), (2, 2)), bending=1e-4)
    simulation = Simulation(scene, [cloth], contact=False)
    pins = simulation.pin(cloth, [0, 2])
    simulation.run(4)
    sunk = cloth.rest[:, 2] - cloth.positions()[:, 2]
    assert np.abs(sunk[[0, 2]]).max() < 1e-5
    assert sunk[8] > 1e-3
    pins.move_to(cloth.rest[[0, 2]] + [0.0, 0.0, 0.01])
    compiled = scene.compile()
    simulation.step()
    np.testing.assert_allclose(cloth.positions()[[0, 2], 2], 0.01, atol=1e-5)
    pins.release()
    simulation.run(3)
    assert (np.abs(cloth.positions()[[0, 2], 2] - 0.01) > 1e-3).all()
    assert scene.compile() is compiled


def test_bodies_come_and_go_between_steps() -> None:
    simulation, soft = falling_cube(0.06, contact=True)
    simulation.run(2)
    velocity = simulation.velocity_of(soft)
    stiff = AffineBody(simulation.scene, "stiff", CUBE.translated((0.02, 0.0, 0.2)))
    simulation.add(stiff)
    np.testing.assert_array_equal(simulation.velocity_of(soft), velocity)
    simulation.run(3)
    assert stiff.positions()[:, 2].mean() < 0.2 - 1e-3
    assert soft.positions()[:, 2].min() > 0.0
    low = soft.positions()
    simulation.remove(soft)
    stiff_before = stiff.positions()
    simulation.run(2)
    np.testing.assert_array_equal(soft.positions(), low)  # no target any more
    assert simulation.contact is not None
    of_contact = {energy.path for energy in simulation.scene.energies if energy.path.startswith("everything")}
    assert of_contact == {energy.path for energy in simulation.contact.energies}  # none of former contacts
    assert (stiff.positions()[:, 2] < stiff_before[:, 2]).all()
    assert [body.name for body in simulation.bodies] == ["ground", "stiff"]
    with pytest.raises(SceneError, match="'soft' is not in this simulation"):
        simulation.remove(soft)
    with pytest.raises(SceneError, match="nothing can move"):
        simulation.remove(stiff)


def test_the_time_step_and_gravity_may_change_between_steps() -> None:
    """Free fall with other numbers in each step; the first guess knows them, so one iteration finds nothing to do."""
    simulation, soft = falling_cube()
    height, speed = 1.0, 0.0
    for seconds, fall in ((DT, 9.8), (DT / 2, 9.8), (2 * DT, 1.6), (2 * DT, 0.0)):
        simulation.time_step.update_value(seconds)
        simulation.gravity.update_value([0.0, 0.0, -fall])
        report = simulation.step()
        speed -= fall * seconds
        height += speed * seconds
        assert report.iterations == 1
        np.testing.assert_allclose(soft.positions()[:, 2].mean(), height, atol=1e-9)
        np.testing.assert_allclose(simulation.velocity_of(soft)[:, 2], speed, atol=1e-6)
    assert simulation.time == pytest.approx(5.5 * DT)


def test_targets_of_ones_own_come_and_go_between_steps() -> None:
    simulation, soft = falling_cube()
    simulation.step()
    spring = simulation.scene.add_mesh("own").add_primitive("springs", 1)
    x = spring.add_attribute("x", 1, 1, value=[1.0])
    potential = spring.add_attribute("potential", computed_attribute=0.5 * x * x)
    simulation.scene.add_energy(potential)
    assert simulation.report().energies["other"] == 0.5
    assert simulation.report().energies["friction"] == 0.0
    simulation.scene.add_minimize_target(x)
    simulation.step()
    assert float(x.value[0]) == pytest.approx(0.0, abs=1e-12)
    simulation.scene.remove_minimize_target(x)
    simulation.scene.remove_energy(potential)
    simulation.stepper.step()  # a stepper alone follows them, too
    np.testing.assert_allclose(simulation.velocity_of(soft)[:, 2], -9.8 * 3 * DT, atol=1e-6)


def test_a_body_that_the_contact_table_names_can_go() -> None:
    """The activation distance stays the same, whatever comes and goes."""
    scene = Scene("two", threads=1)
    left, right = (
        AffineBody(scene, name, CUBE.translated((x, 0.0, 0.3))) for name, x in (("left", 0.0), ("right", 1.0))
    )
    table = ContactTable(0.1).set("left", "ground", friction=0.5)
    simulation = Simulation(scene, [left, right, HalfSpace(scene, "ground")], contacts=table)
    reach = simulation.activation_distance
    simulation.remove(left, left)
    assert [body.name for body in simulation.bodies] == ["right", "ground"]
    assert simulation.activation_distance == reach
    table.set("third", "ground", friction=0.2)
    with pytest.raises(SceneError, match="the contact table names 'third', but there are only"):
        simulation.add(left)
    assert [body.name for body in simulation.bodies] == ["right", "ground"]
    simulation.add(AffineBody(scene, "third", CUBE.translated((0.0, 3.0, 0.3))), left)
    assert simulation.contact is not None
    assert simulation.activation_distance == simulation.contact.geometry.activation_distance == reach


def test_what_held_and_pushed_a_body_is_gone_when_it_comes_back() -> None:
    simulation, soft = falling_cube()
    other = SoftBody(simulation.scene, "other", CUBE.translated((1.0, 0.0, 1.0)))
    simulation.add(other)
    simulation.pin(soft, [0, 1])
    force = simulation.add_force(soft, lambda x, v, time: (0.0, 0.0, 5.0))
    simulation.step()
    simulation.remove(soft)
    np.testing.assert_array_equal(force.value, 0.0)
    simulation.add(soft)
    simulation.set_velocity(soft, (0.0, 0.0, 0.0))
    simulation.step()
    fall = soft.mass.value @ simulation.velocity_of(soft) / soft.mass.value.sum()
    np.testing.assert_allclose(fall, [0.0, 0.0, -9.8 * DT], atol=1e-5)


def test_a_body_that_intersects_is_not_added() -> None:
    simulation, soft = falling_cube(0.06, contact=True)
    inside = AffineBody(simulation.scene, "inside", CUBE.translated((0.03, 0.02, 0.07)))
    with pytest.raises(IntersectionError, match=r"soft|inside"):
        simulation.add(inside)
    assert [body.name for body in simulation.bodies] == ["soft", "ground"]
    simulation.step()
    assert soft.positions()[:, 2].min() < 0.01


def test_callbacks_are_called_with_the_simulation() -> None:
    simulation, _ = falling_cube()
    calls: list[tuple[str, int]] = []
    simulation.before_step.append(lambda s: calls.append(("before", s.frame)))
    simulation.after_step.append(lambda s: calls.append(("after", s.frame)))
    simulation.run(2)
    assert calls == [("before", 0), ("after", 1), ("before", 1), ("after", 2)]


def test_a_step_that_fails_is_undone_and_can_be_repeated_from_its_file() -> None:
    def poisoned() -> tuple[Simulation, SoftBody, Attribute]:
        simulation, soft = falling_cube()
        poison = soft.vertices.add_constant("poison", 1, 1, value=np.ones(8))
        soft.add_energy(soft.vertices.add_attribute("bad", computed_attribute=poison.log() * soft.position[2]))
        return simulation, soft, poison

    simulation, soft, poison = poisoned()
    simulation.run(2)
    before, velocity = soft.positions(), simulation.velocity_of(soft)
    poison.update_value(-np.ones(8))  # from here on the energy is not finite
    with pytest.raises((NotConvergedError, NotFiniteError)) as caught:
        simulation.step()
    np.testing.assert_array_equal(soft.positions(), before)
    np.testing.assert_array_equal(simulation.velocity_of(soft), velocity)
    assert (simulation.frame, simulation.time) == (2, pytest.approx(2 * DT))
    (note,) = caught.value.__notes__
    file = Path(note.split("is in ")[1].split(": simulation.restore")[0])
    assert file.is_file()

    again, other, _ = poisoned()
    again.restore(file)
    np.testing.assert_array_equal(other.positions(), before)
    np.testing.assert_array_equal(again.velocity_of(other), velocity)
    np.testing.assert_array_equal(again.stepper.target_velocities, simulation.stepper.target_velocities)
    assert again.frame == 2
    with pytest.raises((NotConvergedError, NotFiniteError)):
        again.step()
    scene = Scene("other", threads=1)
    with pytest.raises(SceneError, match=r"is a state of another simulation: the scene is .* there and other here"):
        Simulation(scene, [SoftBody(scene, "b", CUBE)], contact=False).restore(file)


def test_what_a_simulation_refuses() -> None:
    scene, other = Scene("s", threads=1), Scene("o", threads=1)
    soft = SoftBody(scene, "soft", CUBE)
    with pytest.raises(SceneError, match="nothing can move"):
        Simulation(scene, [])
    scene = Scene("s", threads=1)
    with pytest.raises(SceneError, match="belongs to another scene"):
        Simulation(scene, [soft])
    with pytest.raises(SceneError, match="time_step must be positive"):
        Simulation(other, [SoftBody(other, "soft", CUBE)], time_step=0.0)
    simulation, body = falling_cube()
    with pytest.raises(SceneError, match=r"the velocity of soft is \[3\] or \[8, 3\]"):
        simulation.set_velocity(body, np.zeros((3, 8)))


def test_what_is_in_a_half_space_is_seen_after_each_frame() -> None:
    scene = Scene("sunk", threads=1)
    body = AffineBody(scene, "cube", box((0.1, 0.1, 0.1), (1, 1, 1)).translated((0.0, 0.0, 0.2)))
    simulation = Simulation(scene, [body, HalfSpace(scene, "ground")])
    simulation.check_intersection_free()
    body.targets[1].update_value([0.0, 0.0, 0.04])
    with pytest.raises(IntersectionError, match=r"in half-space 'ground'.*'cube'"):
        simulation.check_intersection_free()
