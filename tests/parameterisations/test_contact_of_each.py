"""Contact works on every parameterisation as it is: one union of all, above one plate."""

from __future__ import annotations

import numpy as np
import pytest
from parameterised_pieces import PIECES, SHAPE, Piece, all_pieces

from yasps import Scene, materials
from yasps.contact import BarrierContact, contact_forces
from yasps.meshes import ground
from yasps.stepping import MovingPart, NewtonSettings, TimeStepper

DISTANCE = 2e-3  # m


def over_a_plate(height: float, weight: float) -> tuple[Scene, dict[str, Piece], BarrierContact]:
    scene = Scene("pieces", threads=1)
    pieces = all_pieces(scene, height)
    for piece in pieces.values():
        vertices = piece.vertices
        pull = materials.gravity(vertices["position"], vertices["mass"], (0.0, 0.0, -weight))
        scene.add_energy(vertices.add_attribute("gravity", computed_attribute=pull))
        scene.add_minimize_target(piece.targets)
    plate = ground((20.0, 20.0))
    still = scene.add_mesh("plate").add_primitive("vertices", len(plate.vertices))
    still.add_constant("position", 3, 1, value=plate.vertices)
    everything = scene.add_mesh("everything")
    union = everything.add_primitive_union("vertices", [*(piece.vertices for piece in pieces.values()), still])
    union.add_attribute("position")
    start = union.offset_of(still)
    faces = [SHAPE.surface_triangles() + first for first in union.offsets()[: len(pieces)]]
    contact = BarrierContact(
        everything,
        union,
        np.concatenate([*faces, plate.triangles + start]),
        activation_distance=DISTANCE,
        stiffness=1e5,
        fixed=np.arange(union.num_instances) >= start,
        group=np.repeat(np.arange(len(pieces) + 1), [8] * len(pieces) + [len(plate.vertices)]),
    )
    return scene, pieces, contact


@pytest.mark.nightly  # it compiles all kinds of pairs
def test_forces_on_unknowns_are_those_on_vertices_pulled_back() -> None:
    """-dE/dq = sum of (dx/dq)^T f, with f from the read-out of contact and dx/dq by complex steps in NumPy."""
    scene, pieces, contact = over_a_plate(0.5 * DISTANCE, 0.0)
    forces = contact_forces(contact).on_vertices()
    found = iter(zip(scene.minimize_targets, scene.compile().split(_contact_gradient(scene)), strict=True))
    for k, (name, piece) in enumerate(pieces.items()):
        here = [target.value.astype(complex) for target in piece.targets]
        exact = piece.positions([values.real for values in here])
        np.testing.assert_allclose(piece.vertices["position"].compute().array.reshape(-1, 3), exact, atol=1e-14)
        f = forces[8 * k : 8 * k + 8]
        assert f[:, 2].max() > 1.0, name
        for number, values in enumerate(here):
            target, gradient = next(found)
            assert target is piece.targets[number]
            for entry in range(values.size):
                moved = [other.copy() for other in here]
                moved[number][entry] += 1e-30j
                slope = piece.positions(moved).imag / 1e-30
                assert -gradient[entry] == pytest.approx((slope * f).sum(), abs=1e-12 * np.abs(f).max()), name


def _contact_gradient(scene: Scene) -> np.ndarray:
    return sum(g for path, g in scene.compile().gradients().items() if path.endswith(".barrier"))


@pytest.mark.nightly
def test_each_comes_to_rest_on_the_plate() -> None:
    """In large steps, under its weight; what no chain holds is borne by the plate alone."""
    scene, pieces, contact = over_a_plate(0.9 * DISTANCE, 9.8)
    parts = []
    for piece in pieces.values():
        x, mass = piece.vertices["position"], piece.vertices["mass"]
        predicted = piece.vertices.add_constant("predicted", 3, 1)
        home = piece.vertices.add_constant("home", 3, 1, value=x.value)
        off = x - home
        level = 0.5 * 100.0 * (off[0] ** 2 + off[1] ** 2)  # N/m, so that nothing rolls away
        energy = materials.inertia(x, predicted, mass, 0.05) + level
        scene.add_energy(piece.vertices.add_attribute("inertia", computed_attribute=energy))
        parts.append(MovingPart(x, predicted, mass))
    settings = NewtonSettings(velocity_tolerance=1e-7, solver="direct", max_iterations=500)
    stepper = TimeStepper(scene, parts, 0.05, contact, settings=settings)
    for _ in range(120):
        stepper.step()
    contact.check_intersection_free(contact.positions())
    forces = contact_forces(contact).on_vertices()
    for k, (name, part) in enumerate(zip(PIECES, parts, strict=True)):
        assert np.abs(stepper.velocities[k]).max() < 1e-4, name
        if name != "chain":
            borne = forces[8 * k : 8 * k + 8, 2].sum()
            assert borne == pytest.approx(9.8 * float(part.mass.value.sum()), rel=1e-3), name
