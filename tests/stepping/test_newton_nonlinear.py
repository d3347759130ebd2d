"""Contact of a nonlinear parameterisation: the line search looks at where the vertices really go."""

from __future__ import annotations

import numpy as np

from yasps import Scene, concat_rows
from yasps.contact import BarrierContact
from yasps.meshes import box
from yasps.stepping import NewtonSettings, minimize


def test_a_swinging_box_stops_at_a_fixed_one() -> None:
    """A box on a lever is pulled round by a spring on its angle, into a box that stands in its way."""
    shape = box((0.2, 0.2, 0.2), (1, 1, 1))
    triangles = shape.surface_triangles()
    scene = Scene("swing")
    mesh = scene.add_mesh("mesh")
    lever = mesh.add_primitive("lever", 1)
    angle = lever.add_attribute("angle", 1, 1)
    moving = mesh.add_primitive("moving", len(shape.vertices))
    of_lever = moving.add_connectivity("of_lever", lever, np.zeros(len(shape.vertices), int), 1)
    a = moving.add_attribute("angle", through=of_lever, source=angle)
    rest = moving.add_constant("rest", 3, 1, value=shape.vertices - shape.vertices.mean(axis=0) + [1.0, 0.0, 0.0])
    turned = concat_rows([a.cos() * rest[0] - a.sin() * rest[1], a.sin() * rest[0] + a.cos() * rest[1], rest[2]])
    moving.add_attribute("position", computed_attribute=turned)
    fixed = mesh.add_primitive("fixed", len(shape.vertices))
    fixed.add_constant("position", 3, 1, value=shape.vertices - shape.vertices.mean(axis=0) + [0.66, 0.75, 0.01])
    points = mesh.add_primitive_union("points", [moving, fixed])
    points.add_attribute("position")
    pull = 50.0 * (angle - 1.1) ** 2
    scene.add_energy(lever.add_attribute("spring", computed_attribute=pull))
    scene.add_minimize_target(angle)
    contact = BarrierContact(
        mesh,
        points,
        np.concatenate([triangles, triangles + len(shape.vertices)]),
        activation_distance=0.01,
        barrier="paper",
        stiffness=1e9,
        fixed=np.arange(points.num_instances) >= len(shape.vertices),
    )
    settings = NewtonSettings(velocity_tolerance=1e-6)
    minimize(scene, [], 1.0, contact=contact, settings=settings)
    assert not contact.geometry.has_intersections(contact.positions())
    assert len(contact.active) > 0
    assert 0.4 < float(angle.value[0]) < 0.85  # it came, and did not pass
