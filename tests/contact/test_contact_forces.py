"""Forces of contact as arrays: those of the scene's own gradient, and every action has its reaction."""

from __future__ import annotations

import numpy as np
import pytest
from collision_scenes import SCENES
from numpy.typing import NDArray
from scipy import sparse

from yasps import Scene
from yasps.contact import (
    BarrierContact,
    ContactForces,
    ContactTable,
    Plane,
    contact_forces,
    crushed_gradient,
    crushed_pairs,
)

Floats = NDArray[np.float64]
UP = np.array([0.1, -0.2, 0.97])
UP /= np.linalg.norm(UP)
NAMES = (
    "nearly parallel",
    "shaken",
    "edges crossing at 0.001",
    "edges crossing at 0.015",
    "box corner to corner",
    "box edge across edge",
)


def scene_of(name: str, barrier: str = "log", radius: float = 3e-3) -> tuple[Scene, BarrierContact]:
    """Two free surfaces of one scene of the collision tests, as two objects over a half-space, with friction and radii
    that vary from vertex to vertex; all have one code."""
    (points, faces), dhat = SCENES[name]
    scene = Scene("surface", threads=1)
    mesh = scene.add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", len(points))
    position = vertices.add_attribute("position", 3, 1, value=points)
    ends = np.concatenate([faces[:, :2], faces[:, 1:]]).T
    pieces = sparse.coo_array((np.ones(ends.shape[1]), tuple(ends)), shape=(len(points),) * 2)
    half = int((sparse.csgraph.connected_components(pieces, directed=False)[1] == 0).sum())
    lowest = points[np.argmin(points @ UP)]
    contact = BarrierContact(
        mesh,
        vertices,
        faces,
        activation_distance=dhat,
        stiffness=3.5,
        barrier=barrier,
        radii=radius * np.random.default_rng(4).uniform(0.1, 1.0, len(points)),
        planes=[Plane("slope", tuple(UP.tolist()), tuple((lowest - (radius + 0.3 * dhat) * UP).tolist()))],
        objects={"one": half, "two": len(points) - half},
        table=ContactTable(0.5, 0.2),
        slip_length=1e-4,
    )
    scene.add_minimize_target(position)
    return scene, contact


def check_against_gradient(scene: Scene, contact: BarrierContact, forces: ContactForces) -> None:
    """All but the mapping to reduced coordinates: targets are the vertices' positions."""
    gradients = [g for path, g in scene.compile().gradients().items() if path.endswith("barrier")]
    expected = -np.sum(gradients, axis=0).reshape(-1, 3)
    # Nearly parallel edges: both computations lose the same digits, differently.
    np.testing.assert_allclose(forces.on_vertices("normal"), expected, atol=1e-12 * np.abs(expected).max())
    values = scene.energy_values()
    for kind, primitive in contact.primitives.items():
        energies = forces.normal.energy[forces.normal.kind == kind]
        np.testing.assert_allclose(energies, values[primitive.primitive["barrier"].path], rtol=1e-11)


@pytest.mark.parametrize(
    ("name", "barrier", "radius"),
    [*((name, "log", 3e-3) for name in NAMES), pytest.param("shaken", "paper", 0.0, marks=pytest.mark.nightly)],
)
def test_forces_are_those_of_the_scenes_gradient(name: str, barrier: str, radius: float) -> None:
    scene, contact = scene_of(name, barrier, radius)
    forces = contact_forces(contact)
    assert forces.names == ("one", "two", "slope")
    assert len(forces.normal) == len(contact.active) > 0
    assert "half_space" in forces.normal.kind
    check_against_gradient(scene, contact, forces)
    size = np.abs(forces.normal.forces).max(axis=(1, 2))
    between = forces.normal.kind != "half_space"
    assert (np.abs(forces.normal.forces.sum(axis=1)).max(axis=1) <= 2e-15 * size)[between].all()
    whole = np.abs(forces.on_vertices()).max()
    sums = np.stack([forces.on_vertices()[forces.body_of == k].sum(axis=0) for k in range(2)])
    np.testing.assert_allclose(forces.on_bodies()[:2], sums, atol=1e-14 * whole)
    np.testing.assert_allclose(forces.on_bodies()[2], -sums.sum(axis=0), atol=1e-14 * whole)
    torques = forces.torques(np.zeros(3))
    np.testing.assert_allclose(torques.sum(axis=0), 0.0, atol=1e-14 * whole)


def test_a_vertex_presses_a_half_space_along_its_normal() -> None:
    _, contact = scene_of("shaken")
    forces = contact_forces(contact)
    below = forces.normal.kind == "half_space"
    np.testing.assert_allclose(forces.normal.normal[below], np.tile(UP, (int(below.sum()), 1)), atol=1e-13)
    assert (forces.normal.bodies[below, 1] == 2).all()
    assert (forces.normal.normal_force[below] > 0).all()
    pressed = forces.between_bodies()[2, 0]
    assert pressed @ UP == pytest.approx(-np.linalg.norm(pressed))
    assert 0.0 < forces.normal.gap[below].min() - 0.3 * contact.geometry.activation_distance < 3e-3


def test_pairs_rub_at_the_gap_at_which_they_push() -> None:
    """Pieces of one object that are near at rest have a share of their radii only, of which both know."""
    _, contact = scene_of("shaken")
    shares = np.concatenate([pairs.share for pairs in contact.active.kinds().values()])
    assert shares.min() < 1.0
    forces = contact_forces(contact)
    assert len(forces.friction) == len(forces.normal) == len(shares)
    np.testing.assert_allclose(forces.friction.gap, forces.normal.gap, atol=1e-15)
    np.testing.assert_allclose(forces.friction.load, forces.normal.normal_force, rtol=1e-9)


@pytest.mark.parametrize("barrier", ["log", pytest.param("paper", marks=pytest.mark.nightly)])
def test_friction_is_that_of_the_scenes_gradient(barrier: str) -> None:
    """Of pairs that stick, that slide and in between; all kinds but one are among them."""
    kinds: set[str] = set()
    for name in ("shaken", "edges crossing at 0.001"):
        scene, contact = scene_of(name, barrier)
        assert contact.friction is not None
        (position,) = scene.minimize_targets
        points = contact.positions()
        shift = 10.0 ** np.random.default_rng(9).uniform(-6, -2.5, (len(points), 1))
        position.update_value(points + shift * np.random.default_rng(8).normal(size=points.shape))
        forces = contact_forces(contact)
        kinds |= set(forces.friction.kind.tolist())
        gradients = scene.compile().gradients()
        paths = {kind: pairs.primitive["potential"].path for kind, pairs in contact.friction.primitives.items()}
        expected = -sum(gradients[path] for path in paths.values() if path in gradients).reshape(-1, 3)
        found = forces.on_vertices("friction")
        np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
        values = scene.energy_values()
        for kind, path in paths.items():
            energies = forces.friction.energy[forces.friction.kind == kind]
            np.testing.assert_allclose(energies, values[path], rtol=1e-10)
        assert forces.friction.slides.any()
        assert not forces.friction.slides.all()
        # Friction is tangential, at most mu times the load, along the slip of the second piece.
        rubs = forces.friction
        assert (np.abs((rubs.on_first * rubs.normal).sum(axis=1)) <= 1e-13 * np.abs(rubs.load)).all()
        assert (np.linalg.norm(rubs.on_first, axis=1) <= 0.5 * (1 + 1e-12) * np.abs(rubs.load)).all()
        between = forces.between_bodies("friction")
        np.testing.assert_array_equal(between, -between.transpose(1, 0, 2))
        sums = np.stack([found[forces.body_of == k].sum(axis=0) for k in range(2)])
        np.testing.assert_allclose(forces.on_bodies("friction")[:2], sums, atol=1e-14 * np.abs(found).max())
    assert kinds >= {"point_triangle", "edge_edge", "mollified_edge_edge", "point_edge", "half_space"}


@pytest.mark.parametrize("name", ["shaken", "box edge across edge"])
def test_the_gradient_of_the_smallest_gaps(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is that of the pairs with gaps like the smallest, and the scene has all its pairs afterwards."""
    scene, contact = scene_of(name)
    normal = contact_forces(contact).normal
    for kind, gaps in crushed_pairs.gaps(contact).items():
        np.testing.assert_allclose(gaps, normal.gap[normal.kind == kind], rtol=1e-9, atol=1e-15)
    assert crushed_gradient(contact) is None  # nothing is as near as that
    monkeypatch.setattr(crushed_pairs, "CRUSHED", 1.0)
    monkeypatch.setattr(crushed_pairs, "ALIKE", share := float(np.mean(normal.gap) / normal.gap.min()))
    alike = normal.gap <= share * normal.gap.min()
    assert 0 < alike.sum() < len(normal)
    expected = np.zeros((len(contact.positions()), 3))
    used = normal.vertices[alike] >= 0
    np.add.at(expected, normal.vertices[alike][used], -normal.forces[alike][used])
    energies, everything = scene.energy_values(), scene.gradient()
    found = crushed_gradient(contact)
    assert found is not None
    np.testing.assert_allclose(found.reshape(-1, 3), expected, atol=1e-11 * np.abs(expected).max())
    for path, values in scene.energy_values().items():
        np.testing.assert_array_equal(values, energies[path])
    np.testing.assert_array_equal(scene.gradient()[0], everything[0])
