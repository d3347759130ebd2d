"""Newton's method: iteration counts, longer steps, and what contact keeps between calls."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Attribute, Scene, materials
from yasps.contact import BarrierContact
from yasps.meshes import box, ground
from yasps.output import TimeTable
from yasps.stepping import MovingPart, NewtonReport, NewtonSettings, TimeStepper, minimize

STEP = 0.01


def soft_block(stretch: float, density: float = 1000.0) -> tuple[Scene, Attribute]:
    """A soft block, stretched or compressed along z, with inertia that pulls nowhere."""
    shape = box((0.1, 0.1, 0.2), (2, 2, 4))
    scene = Scene("block")
    mesh = scene.add_mesh("block_mesh")
    vertices = mesh.add_primitive("vertices", len(shape.vertices))
    start = shape.vertices * [1.0, 1.0, stretch]
    position = vertices.add_attribute("position", 3, 1, value=start)
    mass = vertices.add_constant("mass", 1, 1, value=shape.vertex_masses(density))
    inertia = materials.inertia(position, vertices.add_constant("start", 3, 1, value=start), mass, STEP)
    scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))
    tets = mesh.add_primitive("tets", len(shape.tets))
    x = tets.add_attribute(
        "positions", through=tets.add_connectivity("corners", vertices, shape.tets, 4), source=position
    )
    inverse, volume = materials.rest_shape(shape.vertices, shape.tets)
    f = materials.deformation_gradient(x, tets.add_constant("inverse", 3, 3, value=inverse))
    mu, lam = materials.stable_neo_hookean_parameters(1e5, 0.4)
    elastic = materials.stable_neo_hookean(f, mu, lam, tets.add_constant("volume", 1, 1, value=volume))
    scene.add_energy(tets.add_attribute("elastic", computed_attribute=elastic))
    scene.add_minimize_target(position)
    return scene, position


def run(**settings: object) -> tuple[NewtonReport, np.ndarray]:
    scene, position = soft_block(0.5)
    tight = NewtonSettings(velocity_tolerance=1e-7, linear_tolerance=1e-20, **settings)  # type: ignore[arg-type]
    report = minimize(scene, [position], STEP, settings=tight)
    return report, position.value


def test_every_way_ends_at_the_same_minimum() -> None:
    plain, expected = run(longest_step=1.0)
    assert plain.projected == plain.iterations
    assert plain.direct_solves == 0
    assert max(plain.step_lengths) == 1.0
    for settings in ({}, {"solver": "direct"}, {"projection": "on-demand"}, {"projection": "auto"}):
        report, found = run(**settings)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
        assert report.energy == pytest.approx(plain.energy, rel=1e-12)
        assert report.direct_solves == (report.iterations if settings.get("solver") == "direct" else 0)


def test_on_demand_takes_fewer_iterations_where_projection_makes_the_hessian_too_stiff() -> None:
    plain, _ = run(longest_step=1.0)
    on_demand, _ = run(longest_step=1.0, projection="on-demand")
    assert on_demand.iterations < plain.iterations
    assert on_demand.projected < on_demand.iterations


def test_a_step_too_short_is_made_longer() -> None:
    """Negative curvature in one of two energies is clamped: the Newton step is a tenth of what it should be."""
    scene = Scene("stiffened")
    points = scene.add_mesh("m").add_primitive("points", 1)
    x = points.add_attribute("x", 3, 1, value=[[1.0, 2.0, -1.0]])
    scene.add_energy(points.add_attribute("bowl", computed_attribute=0.5 * x.dot(x)))
    scene.add_energy(points.add_attribute("hill", computed_attribute=-0.45 * x.dot(x)))
    scene.add_minimize_target(x)
    settings = NewtonSettings(velocity_tolerance=1e-9, longest_step=1.0)
    short = minimize(scene, [x], 1.0, settings=settings)
    x.update_value([[1.0, 2.0, -1.0]])
    longer = minimize(scene, [x], 1.0, settings=NewtonSettings(velocity_tolerance=1e-9, longest_step=20.0))
    assert short.iterations > 100
    assert longer.iterations <= 3  # the parabola's lowest point is that of this energy
    assert longer.step_lengths[0] == pytest.approx(10.0)
    np.testing.assert_allclose(x.value, 0.0, atol=1e-9)


def test_after_a_failure_auto_projects_at_once() -> None:
    """x^4 / 4 - x^2 + x^2 / 2, from 0.01: projected, x doubles until the Hessian is definite, at x = 1 / sqrt(3)."""
    scene = Scene("wells")
    points = scene.add_mesh("m").add_primitive("points", 1)
    x = points.add_attribute("x", 3, 1, value=np.zeros((1, 3)))
    square = x[0] * x[0]
    scene.add_energy(points.add_attribute("bowl", computed_attribute=0.5 * x.dot(x)))
    scene.add_energy(points.add_attribute("wells", computed_attribute=0.25 * square * square - square))
    scene.add_minimize_target(x)
    systems = {}
    for projection in ("on-demand", "auto"):
        x.update_value([[0.01, 0.0, 0.0]])
        times = TimeTable()
        settings = NewtonSettings(velocity_tolerance=1e-6, longest_step=1.0, projection=projection)
        report = minimize(scene, [x], 1.0, settings=settings, times=times)
        np.testing.assert_allclose(x.value, [1.0, 0.0, 0.0], atol=1e-6)
        systems[projection] = {row.stage: row.calls for row in times.rows()}["linear solver"] - report.iterations
    assert systems["on-demand"] >= 6
    assert systems["auto"] == 1


def falling_box() -> tuple[Scene, BarrierContact, Attribute, MovingPart]:
    """A soft box just above the ground."""
    shape = box((0.1, 0.1, 0.1), (2, 2, 2)).translated((0.0, 0.0, 0.0515))
    floor = ground((1.0, 1.0))
    scene = Scene("falling")
    mesh = scene.add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", len(shape.vertices))
    position = vertices.add_attribute("position", 3, 1, value=shape.vertices)
    mass = vertices.add_constant("mass", 1, 1, value=shape.vertex_masses(1000.0))
    predicted = vertices.add_constant("predicted", 3, 1, value=shape.vertices)
    weight = materials.gravity(position, mass, (0.0, 0.0, -9.8))
    inertia = materials.inertia(position, predicted, mass, STEP)
    scene.add_energy(vertices.add_attribute("weight", computed_attribute=weight))
    scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))
    still = mesh.add_primitive("still", len(floor.vertices))
    still.add_constant("position", 3, 1, value=floor.vertices)
    union = mesh.add_primitive_union("points", [vertices, still])
    union.add_attribute("position")
    start = union.offset_of(still)
    contact = BarrierContact(
        mesh,
        union,
        np.concatenate([shape.surface_triangles(), floor.triangles + start]),
        activation_distance=2e-3,
        barrier="paper",
        stiffness=1e9,
        fixed=np.arange(union.num_instances) >= start,
        objects={"box": len(shape.vertices), "floor": len(floor.vertices)},
    )
    scene.add_minimize_target(position)
    return scene, contact, position, MovingPart(position, predicted, mass)


def test_steps_onto_the_ground_with_every_solver() -> None:
    heights = []
    for settings in (
        NewtonSettings(velocity_tolerance=1e-5, linear_tolerance=1e-14),
        NewtonSettings(velocity_tolerance=1e-5, solver="direct"),
        NewtonSettings(velocity_tolerance=1e-5, linear_tolerance=1e-14, projection="on-demand"),
    ):
        scene, contact, position, part = falling_box()
        stepper = TimeStepper(scene, [part], STEP, contact, settings=settings)
        for _ in range(6):
            stepper.step()
            assert not contact.geometry.has_intersections(contact.positions())
        assert len(contact.active) > 0
        heights.append(position.value.copy())
    np.testing.assert_allclose(heights[1], heights[0], atol=1e-5)
    np.testing.assert_allclose(heights[2], heights[0], atol=1e-5)


def test_free_step_agrees_with_the_geometry_and_serves_all_positions_on_the_way() -> None:
    _, contact, position, _ = falling_box()
    start = contact.positions()
    moving = len(position.value) // 3
    for length in (1e-5, 1e-4, 1.4e-3, 3e-3, 0.1, 0.1, 1e-3):
        end = start.copy()
        end[:moving, 2] -= length
        step, candidates = contact.free_step(start, end)
        exact = contact.geometry.candidates(start, end)
        assert step == pytest.approx(contact.geometry.step_bound(start, end, exact), rel=1e-6)
        for share in (0.0, 0.5, 1.0):
            there = start + share * step * (end - start)
            expected = contact.geometry.active_set(there)
            assert all(
                pairs.same_as(expected.kinds()[name])
                for name, pairs in contact.geometry.active_set(there, candidates).kinds().items()
            )


def test_contacts_at_the_same_positions_change_nothing_in_the_scene() -> None:
    scene, contact, position, _ = falling_box()
    moving = len(position.value) // 3
    there = contact.positions()
    there[:moving, 2] -= 1e-3
    position.update_value(there[:moving])
    contact.update()
    compiled = scene.compile()
    compiled.assemble()
    before = compiled.dynamic_matrix.groups
    assert len(before) > 0
    contact.update()  # the same positions
    nudged = there.copy()
    nudged[:moving, 2] += 1e-9  # the same pairs
    position.update_value(nudged[:moving])
    contact.update()
    compiled.assemble()
    assert compiled.dynamic_matrix.groups is before  # not built again
    position.update_value(there[:moving] + np.array([0.0, 0.0, 2e-3]))
    assert len(contact.update()) == 0
    compiled.assemble()
    assert sum(len(group.rows) for group in compiled.dynamic_matrix.groups) == 0
