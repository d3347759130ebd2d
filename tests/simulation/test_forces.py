"""Forces of a simulation, and its report, on scenes whose forces are known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from yasps import DataError, Scene, SceneError
from yasps.bodies import AffineBody, Cloth, Ground, SoftBody
from yasps.meshes import box, cloth_grid
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

CUBE = box((0.1, 0.1, 0.1), (2, 2, 2))
G = 9.8
TIGHT = NewtonSettings(velocity_tolerance=1e-7, solver="direct", max_iterations=300)


@pytest.fixture(scope="module")
def stack() -> Simulation:
    """A soft cube on a stiff one on the ground, a cloth over them, at rest but for the last microns."""
    scene = Scene("stack", threads=1)
    bodies = [
        AffineBody(scene, "stiff", CUBE.translated((0.0, 0.0, 0.0502))),
        SoftBody(scene, "soft", CUBE.translated((0.013, 0.011, 0.1504)), youngs_modulus=3e5),
        Cloth(scene, "cloth", cloth_grid((0.12, 0.12), (4, 4), 0.2006)),
        Ground(scene, size=1.0),
    ]
    simulation = Simulation(scene, bodies, settings=TIGHT, activation_distance=5e-4)
    simulation.run(8)
    return simulation


def test_contact_forces_are_those_that_move_the_bodies(stack: Simulation) -> None:
    """m (v - v_old) / dt = m g + contact for each body, within the residual force that Newton's method reports."""
    before = {body: stack.velocity_of(body) for body in stack.moving}
    report = stack.step()
    forces = stack.contact_forces()
    on_bodies = forces.on_bodies()
    for body in stack.moving:
        mass = body.mass.value
        change = mass @ (stack.velocity_of(body) - before[body]) / 0.01
        weight = mass.sum() * np.array([0.0, 0.0, -G])
        left = len(mass) * report.residual_force
        np.testing.assert_allclose(on_bodies[forces.number_of(body.name)] + weight, change, atol=left)
        assert left < 1e-5 * mass.sum() * G
    total = sum(float(body.mass.value.sum()) for body in stack.moving) * G
    between = forces.between_bodies()
    assert between[0, 3, 2] == pytest.approx(total, rel=0.2)  # the ground bears all


def test_every_force_has_its_reaction(stack: Simulation) -> None:
    forces = stack.contact_forces()
    between = forces.between_bodies()
    np.testing.assert_array_equal(between, -between.transpose(1, 0, 2))
    on_vertices = forces.on_vertices()
    size = np.abs(on_vertices).max()
    sums = np.stack([on_vertices[forces.body_of == k].sum(axis=0) for k in range(4)])
    np.testing.assert_allclose(sums, forces.on_bodies(), atol=1e-14 * size)
    np.testing.assert_allclose(on_vertices.sum(axis=0), 0.0, atol=1e-14 * size)
    # Torques about one point: what the pairs do to each other cancels.
    np.testing.assert_allclose(forces.torques(np.zeros(3), "normal").sum(axis=0), 0.0, atol=1e-14 * size)
    # About another point by T' = T + (old - new) x F.
    moved = forces.torques(np.zeros(3)) - np.cross(forces.centres(), forces.on_bodies())
    np.testing.assert_allclose(forces.torques(), moved, atol=1e-14 * size)
    for number, body in enumerate(stack.bodies[:3]):
        mass = body.mass.value
        np.testing.assert_allclose(forces.centres()[number], mass @ body.positions() / mass.sum(), atol=1e-15)


def test_terms_sum_to_the_gradient_and_contact_is_among_them(stack: Simulation) -> None:
    stack.contact_forces()
    terms = stack.forces_by_term()
    for target, gradient in zip(stack.scene.minimize_targets, stack.scene.gradient(), strict=True):
        total = sum(parts[target.path].ravel() for parts in terms.values())
        size = max(np.abs(parts[target.path]).max() for parts in terms.values())
        np.testing.assert_allclose(total, -gradient, atol=1e-13 * size)
    forces = stack.contact_forces()
    by_vertex = forces.on_vertices("normal")
    contact = [parts for path, parts in terms.items() if path.endswith(".barrier")]
    soft, cloth, stiff = (stack.bodies[k] for k in (1, 2, 0))
    size = np.abs(by_vertex).max()
    for body in (soft, cloth):
        found = sum(parts[body.position.path] for parts in contact)
        np.testing.assert_allclose(found, by_vertex[forces.body_of == forces.number_of(body.name)], atol=1e-12 * size)
    # Of the stiff body the generalised forces: the sum for t, the moments f r^T for A.
    own = by_vertex[forces.body_of == 0]
    rest = stiff.vertices["rest_position"].value.reshape(-1, 3)
    matrix, translation = stiff.targets
    np.testing.assert_allclose(sum(parts[translation.path] for parts in contact)[0], own.sum(axis=0), atol=1e-12 * size)
    np.testing.assert_allclose(sum(parts[matrix.path] for parts in contact)[0], own.T @ rest, atol=1e-12 * size)


def test_energies_and_gaps_are_those_of_the_scene(stack: Simulation) -> None:
    forces = stack.contact_forces()
    values = stack.scene.energy_values()
    barrier = sum(float(v.sum()) for path, v in values.items() if path.endswith(".barrier"))
    assert forces.normal.energy.sum() == pytest.approx(barrier, rel=1e-11)
    assert stack.contact is not None
    assert forces.normal.gap.min() == pytest.approx(stack.contact.active.minimum_distance, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(forces.normal.normal, axis=1), 1.0, rtol=1e-14)
    # Closest points lie half a gap off the middle: that of the ground's pairs is at half their gap.
    on_ground = (forces.normal.bodies == 3).any(axis=1)
    np.testing.assert_allclose(forces.normal.point[on_ground, 2], forces.normal.gap[on_ground] / 2, rtol=1e-2)
    areas = [forces.areas[forces.body_of == k].sum() for k in range(4)]
    np.testing.assert_allclose(areas, [0.06, 0.06, 0.0144, 1.0])


def test_the_report_says_what_is_there(stack: Simulation) -> None:
    report = stack.report()
    potential = sum(value for name, value in report.energies.items() if name != "kinetic")
    assert report.energies["kinetic"] + potential == pytest.approx(stack.energy(), rel=1e-12)
    assert report.newton is not None
    assert report.contacts == len(stack.contact_forces().normal)
    assert 0 < report.smallest_gap < 1
    assert set(report.between_bodies) == {("stiff", "soft"), ("stiff", "ground"), ("soft", "cloth")}
    # The ground's pressure carries the weight over the bottom's area, more at the rim's vertices.
    assert report.largest_pressure > 0.5 * report.between_bodies["stiff", "ground"][2] / 0.01
    text = str(report)
    assert f"step {stack.frame}, t = {stack.time:.6g} s" in text
    assert "on 'stiff' by 'ground': (" in text
    assert "smallest gap" in text


def test_without_contact_the_report_has_the_rest() -> None:
    scene = Scene("alone", threads=1)
    simulation = Simulation(scene, [SoftBody(scene, "soft", CUBE.translated((0, 0, 1.0)))], contact=False)
    with pytest.raises(SceneError, match="contact=False"):
        simulation.contact_forces()
    report = simulation.report()
    assert (report.contacts, report.largest_pressure, report.smallest_gap) == (0, 0.0, np.inf)
    assert report.newton is None
    assert "step 0, t = 0 s" in str(report)
    mass = simulation.moving[0].mass.value.sum()
    assert report.energies["gravity"] == pytest.approx(mass * G * 1.0)


def test_names_and_parts_that_are_not_there_are_refused(stack: Simulation) -> None:
    forces = stack.contact_forces()
    with pytest.raises(SceneError, match="'wall' is no body of this contact; there are 'stiff', 'soft'"):
        forces.number_of("wall")
    with pytest.raises(SceneError, match="part is one of"):
        forces.on_vertices("tangential")
    with pytest.raises(DataError, match=r"about is one point \[3\], or one for each body, \[4, 3\]"):
        forces.torques(np.zeros((7, 3)))
    assert not dataclasses.asdict(forces.friction)["gap"].size
