"""Bodies: what they add to a scene, and that a user's own energy fits on."""

from __future__ import annotations

import numpy as np
import pytest

from yasps import Scene, SceneError, YaspsError, materials
from yasps.bodies import AffineBody, Cloth, Ground, HalfSpace, Obstacle, SoftBody
from yasps.meshes import (
    TriangleMesh,
    box,
    cloth_grid,
    hinge_stiffness,
    hinges_of,
    triangle_areas,
    triangle_vertex_masses,
)

CUBE = box((0.2, 0.1, 0.1), (2, 1, 1))
ROTATION = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_a_soft_body_has_what_its_name_says() -> None:
    scene = Scene("s", threads=1)
    soft = SoftBody(scene, "soft", CUBE, density=500.0, youngs_modulus=1e4, poisson_ratio=0.3)
    assert scene.soft is soft.mesh
    assert soft.mesh.tets is soft.tets
    assert soft.targets == (soft.vertices["position"],)
    assert soft.mass.value.sum() == pytest.approx(500.0 * 0.2 * 0.1 * 0.1)
    assert not soft.is_fixed
    np.testing.assert_array_equal(soft.positions(), CUBE.vertices)
    scene.add_minimize_target(soft.targets)
    forces = np.concatenate(scene.gradient())
    assert np.abs(forces).max() < 1e-10  # at rest

    # An energy of one's own, in the next line; and a stretch of 1 % in x has the energy of linear elasticity.
    soft.add_energy(soft.vertices.add_attribute("push", computed_attribute=soft.position[0] * 2.0))
    np.testing.assert_allclose(scene.gradient()[0][0::3], 2.0, atol=1e-9)
    rest = float(scene.energy_values()["soft.tets.elastic"].sum())
    soft.position.update_value(soft.rest * (1.0 + 1e-4 * np.array([1.0, 0.0, 0.0])))
    mu, lam = materials.lame_parameters(1e4, 0.3)
    expected = 0.5 * (2 * mu + lam) * 1e-8 * 0.2 * 0.1 * 0.1
    gained = float(scene.energy_values()["soft.tets.elastic"].sum()) - rest
    assert gained == pytest.approx(expected, rel=1e-3)
    soft.set_stiffness(2e4, 0.3)
    doubled = float(scene.energy_values()["soft.tets.elastic"].sum())
    soft.position.update_value(soft.rest)
    assert doubled - float(scene.energy_values()["soft.tets.elastic"].sum()) == pytest.approx(2 * expected, rel=1e-3)


def test_an_affine_body_turns_without_energy() -> None:
    scene = Scene("s", threads=1)
    stiff = AffineBody(scene, "stiff", CUBE.translated((1.0, 0.0, 0.0)), youngs_modulus=1e6)
    matrix, translation = stiff.targets
    assert stiff.falling == (translation,)
    assert not stiff.meets_itself
    matrix.update_value(ROTATION)
    np.testing.assert_allclose(stiff.positions(), CUBE.vertices @ ROTATION.T + [1.0, 0.0, 0.0], atol=1e-12)
    assert scene.energy_values()["stiff.body.orthogonality"] == pytest.approx(0.0, abs=1e-20)
    matrix.update_value(1.1 * np.eye(3))
    expected = 0.5 * 1e6 * 2e-3 * 3 * (1.1**2 - 1) ** 2
    assert scene.energy_values()["stiff.body.orthogonality"] == pytest.approx(expected)


def test_cloth_is_flat_and_unstretched_at_rest() -> None:
    scene = Scene("s", threads=1)
    shape = cloth_grid((1.0, 0.5), (3, 2))
    cloth = Cloth(scene, "cloth", shape, area_density=0.3, stretch=100.0, shear=10.0, bending=1e-3)
    assert cloth.mass.value.sum() == pytest.approx(0.3 * 0.5)
    assert float(sum(v.sum() for v in scene.energy_values().values())) == pytest.approx(0.0, abs=1e-20)
    cloth.position.update_value(shape.vertices * [1.1, 1.0, 1.0])
    values = scene.energy_values()
    assert values["cloth.triangles.membrane"].sum() == pytest.approx(100.0 * 0.1**2 * 0.5)
    assert values["cloth.hinges.bending"].sum() == pytest.approx(0.0, abs=1e-20)


def test_cloth_has_the_contact_modulus_of_a_solid_of_like_cells() -> None:
    """A force on a cell of size h moves it by force / (modulus h) in a solid, and by force / stretch in cloth."""
    moduli = []
    for cells in (4, 8):
        cloth = Cloth(Scene("scene"), "cloth", cloth_grid((1.0, 1.0), (cells, cells)), stretch=100.0)
        edges = np.diff(cloth.rest[cloth.triangles[:, [0, 1, 2, 0]]], axis=1)
        moduli.append(cloth.contact_modulus)
        assert cloth.contact_modulus == pytest.approx(100.0 / np.linalg.norm(edges, axis=2).mean())
    assert moduli[1] == pytest.approx(2 * moduli[0])


def test_a_single_triangle_is_cloth_without_hinges() -> None:
    scene = Scene("s", threads=1)
    shape = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], np.int32))
    cloth = Cloth(scene, "cloth", shape)
    assert [energy.name for energy in cloth.energies] == ["membrane"]


def test_fixed_bodies_have_no_mass() -> None:
    scene = Scene("s", threads=1)
    ground = Ground(scene, height=-1.0, size=4.0)
    wall = Obstacle(scene, "wall", cloth_grid())
    for body in (ground, wall):
        assert body.is_fixed
        with pytest.raises(SceneError, match="fixed and has no mass"):
            _ = body.mass
    np.testing.assert_array_equal(ground.positions()[:, 2], -1.0)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda scene: SoftBody(scene, "b", CUBE, density=0.0), "b: density must be positive"),
        (lambda scene: SoftBody(scene, "b", CUBE, youngs_modulus=-1.0), "Young's modulus must be positive"),
        (lambda scene: AffineBody(scene, "b", CUBE, youngs_modulus=0.0), "youngs_modulus must be positive"),
        (lambda scene: Cloth(scene, "b", cloth_grid(), area_density=np.nan), "density must be positive"),
        (lambda scene: SoftBody(scene, "b", CUBE, density="heavy"), "b: density needs real numbers, got <U5"),
        (lambda scene: SoftBody(scene, "b", CUBE, youngs_modulus="stiff"), "Young's modulus needs real numbers"),
        (lambda scene: SoftBody(scene, "b", CUBE, poisson_ratio=0.5), "Poisson's ratio must lie between"),
        (lambda scene: SoftBody(scene, "b", 5), "a TetrahedralMesh or a closed TriangleMesh, got 5"),
        (lambda scene: AffineBody(scene, "b", CUBE, youngs_modulus=np.inf), "b: youngs_modulus must be positive"),
        (lambda scene: AffineBody(scene, "b", CUBE, radius=-1.0), "radius of b is a length >= 0, .* got -1.0"),
        (lambda scene: AffineBody(scene, "b", CUBE, radius=[1e-3, 2e-3]), r"one for each of \d+ vertices, got \[0.001"),
        (lambda scene: Cloth(scene, "b", cloth_grid(), stretch=0.0), "b: stretch must be positive"),
        (lambda scene: Cloth(scene, "b", cloth_grid(), bending=-1.0), "b: bending must be a number >= 0, got -1.0"),
        (lambda scene: Cloth(scene, "b", CUBE), "b: a cloth is a TriangleMesh, got"),
        (lambda scene: Obstacle(scene, "b", CUBE), "an obstacle is a TriangleMesh, .* of tetrahedra take the surface"),
        (lambda scene: HalfSpace(scene, "b", height="low"), "the height of b needs real numbers"),
        (lambda scene: HalfSpace(scene, "b", height=np.nan), "the height of b: entry 0 is nan"),
        (lambda scene: HalfSpace(scene, "b", normal=(1.0, 0.0)), "the normal of b is a vector"),
        (lambda scene: HalfSpace(scene, "b", size=-1.0), "the size of b must be positive"),
        (lambda scene: Cloth(scene, "b", cloth_grid(), warp=(0.0, 0.0, 1.0)), "warp .* normal to triangle"),
    ],
)
def test_wrong_numbers_leave_the_scene_as_it_was(build: object, words: str) -> None:
    scene = Scene("s", threads=1)
    with pytest.raises(YaspsError, match=words):
        build(scene)  # type: ignore[operator]
    assert not scene.energies
    scene.add_mesh("b")  # the name is free


def test_hinges_of_a_square() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    ((a, b, left, right),) = hinges_of(triangles)
    assert {a, b} == {0, 2}
    assert {left, right} == {1, 3}
    edge = vertices[b] - vertices[a]
    assert np.cross(edge, vertices[left] - vertices[a])[2] > 0 > np.cross(edge, vertices[right] - vertices[a])[2]
    np.testing.assert_allclose(triangle_areas(vertices, triangles), [0.5, 0.5])
    np.testing.assert_allclose(triangle_vertex_masses(vertices, triangles, 3.0), [1.0, 0.5, 1.0, 0.5])
    np.testing.assert_allclose(hinge_stiffness(vertices, hinges_of(triangles), 2.0), [2.0 * 3 * 2.0 / 1.0])
