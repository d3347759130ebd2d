"""Forces of contact as arrays: those of the scene's own gradient, and every action has its reaction."""

from __future__ import annotations

import numpy as np
import pytest
from collision_scenes import SCENES
from numpy.typing import NDArray

from yasps import Scene
from yasps.contact import BarrierContact, ContactForces, contact_forces

Floats = NDArray[np.float64]
NAMES = (
    "nearly parallel",
    "shaken",
    "edges crossing at 0.001",
    "edges crossing at 0.015",
    "box corner to corner",
    "box edge across edge",
)


def scene_of(name: str) -> tuple[Scene, BarrierContact]:
    """Two free surfaces of one scene of the collision tests, as two objects."""
    (points, faces), dhat = SCENES[name]
    scene = Scene("surface", threads=1)
    mesh = scene.add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", len(points))
    position = vertices.add_attribute("position", 3, 1, value=points)
    half = int(faces[faces[:, 0] > faces[0].max()].min()) if len(faces) > 1 else len(points)
    contact = BarrierContact(
        mesh, vertices, faces, activation_distance=dhat, stiffness=3.5, objects={"one": half, "two": len(points) - half}
    )
    scene.add_minimize_target(position)
    return scene, contact


def check_against_gradient(scene: Scene, contact: BarrierContact, forces: ContactForces) -> None:
    """All but the mapping to reduced coordinates: targets are the vertices' positions."""
    (gradient,) = scene.gradient()
    expected = -gradient.reshape(-1, 3)
    # Nearly parallel edges: both computations lose the same digits, differently.
    np.testing.assert_allclose(forces.on_vertices("normal"), expected, atol=1e-12 * np.abs(expected).max())
    values = scene.energy_values()
    for kind, primitive in contact.primitives.items():
        energies = forces.normal.energy[forces.normal.kind == kind]
        np.testing.assert_allclose(energies, values[primitive["barrier"].path], rtol=1e-11)


@pytest.mark.parametrize("name", NAMES)
def test_forces_are_those_of_the_scenes_gradient(name: str) -> None:
    scene, contact = scene_of(name)
    forces = contact_forces(contact)
    assert len(forces.normal) == len(contact.active) > 0
    check_against_gradient(scene, contact, forces)
    size = np.abs(forces.normal.forces).max(axis=(1, 2))
    assert (np.abs(forces.normal.forces.sum(axis=1)).max(axis=1) <= 4e-16 * size).all()
