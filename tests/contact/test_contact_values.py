"""Energies, gradients and Hessians of BarrierContact as the scene computes them, against ipctk's barrier potential.

The vertices are numbered at random, so that of two edges or two points either may come first.
"""

from __future__ import annotations

from collections import Counter

import ipctk
import numpy as np
import pytest
from collision_scenes import SCENES, move, renumbered, union
from numpy.typing import NDArray

from yasps import Scene
from yasps.contact import KINDS, BarrierContact
from yasps.meshes import ground

Floats = NDArray[np.float64]
STIFFNESS = 3.5
NAMES = (
    "nearly parallel",
    "shaken",
    "edges crossing at 0.001",
    "edges crossing at 0.015",
    "box corner to corner",
    "box edge across edge",
)


def contact_scene(free: Floats, faces: NDArray[np.int32], dhat: float) -> tuple[Scene, BarrierContact]:
    """Free vertices with a surface, beside a fixed triangle that is far away from it."""
    scene = Scene("surface")
    mesh = scene.add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", len(free))
    position = vertices.add_attribute("position", 3, 1, value=free)
    still = mesh.add_primitive("still", 3)
    still.add_constant("position", 3, 1, value=np.eye(3) + 100.0)
    points = mesh.add_primitive_union("points", [vertices, still])
    points.add_attribute("position")
    contact = BarrierContact(
        mesh,
        points,
        np.concatenate([faces, len(free) + np.array([[0, 1, 2]])]),
        activation_distance=dhat,
        barrier="paper",
        stiffness=STIFFNESS,
        projection="none",
        fixed=np.arange(points.num_instances) >= len(free),
    )
    scene.add_minimize_target(position)
    return scene, contact


def oracle(points: Floats, faces: NDArray[np.int32], dhat: float) -> tuple[float, Floats, Floats]:
    """Potential, gradient and Hessian of ipctk."""
    x = np.asfortranarray(points)
    mesh = ipctk.CollisionMesh(x, ipctk.edges(faces), np.asfortranarray(faces))
    collisions = ipctk.NormalCollisions()
    collisions.build(mesh, x, dhat, broad_phase=ipctk.BruteForce())
    potential = ipctk.BarrierPotential(ipctk.ClampedLogSqBarrier(), dhat, STIFFNESS)
    hessian = potential.hessian(collisions, mesh, x, ipctk.PSDProjectionMethod.NONE)
    return potential(collisions, mesh, x), potential.gradient(collisions, mesh, x), hessian.toarray()


def test_potential_gradient_and_hessian_are_those_of_ipctk() -> None:
    kinds: Counter[str] = Counter()
    swapped = 0
    for seed, name in enumerate(NAMES):
        mesh, dhat = SCENES[name]
        points, faces = renumbered(mesh, seed)
        scene, contact = contact_scene(points, faces, dhat)
        active = contact.active.kinds()
        kinds.update({kind: len(pairs) for kind, pairs in active.items()})
        swapped += int((np.diff(active["mollified_point_point"].vertices[:, 2:], axis=1) < 0).sum())
        value, gradient, hessian = oracle(points, faces, dhat)
        assert sum(values.sum() for values in scene.energy_values().values()) == pytest.approx(value, rel=1e-11)
        assert scene.total_energy() == pytest.approx(value, rel=1e-11)
        (found,) = scene.gradient()
        np.testing.assert_allclose(found, gradient, rtol=0, atol=1e-11 * np.abs(gradient).max())
        exact = scene.hessian(projected=False).to_scipy().toarray()
        np.testing.assert_allclose(exact, hessian, rtol=0, atol=1e-10 * np.abs(hessian).max())
    assert set(kinds) == set(KINDS)
    assert min(kinds.values()) >= 2, kinds
    assert swapped > 0


def test_pairs_follow_the_vertices() -> None:
    """After new positions and `update`, the energy is that of the pairs there, and of none where nothing is close."""
    mesh, dhat = SCENES["box corner to corner"]
    points, faces = renumbered(mesh, 3)
    scene, contact = contact_scene(points, faces, dhat)
    (position,) = scene.minimize_targets
    energies = []
    for noise in (0.0, 2e-3, 4e-3):
        there = points + noise * np.random.default_rng(8).standard_normal(points.shape)
        position.update_value(there)
        assert len(contact.update()) > 0
        energies.append(scene.total_energy())
        value, gradient, _ = oracle(there, faces, dhat)
        # Thresholds of mollifiers come from the rest edges, which the oracle takes from here.
        assert energies[-1] == pytest.approx(value, rel=0.05)
        assert scene.gradient()[0] @ gradient > 0.95 * np.linalg.norm(gradient) ** 2
    assert len(set(energies)) == 3
    position.update_value(10.0 * points)
    assert len(contact.update()) == 0
    assert scene.total_energy() == 0.0
    assert not scene.gradient()[0].any()


def test_pairs_are_renewed_where_as_many_are_close() -> None:
    """A triangle over a sheet moves by one cell: as many pairs of some kind, of other vertices."""
    sheet = ground((1.0, 1.0), divisions=(8, 8))
    triangle = np.array([[-0.2, -0.21, 0.01], [-0.14, -0.19, 0.01], [-0.17, -0.16, 0.012]])
    points = np.concatenate([sheet.vertices, triangle])
    faces = np.concatenate([sheet.triangles, [[len(points) - 3, len(points) - 2, len(points) - 1]]])
    scene, contact = contact_scene(points, faces, 0.02)
    (position,) = scene.minimize_targets
    pairs = []
    for _ in range(2):
        contact.update()
        seen = {name: contact.primitives[name].vertices.indices for name in contact.primitives}
        for name, kind in contact.active.kinds().items():
            np.testing.assert_array_equal(seen[name], kind.vertices)
        pairs.append(seen)
        points[-3:, 0] += 0.125
        position.update_value(points)
    before_and_after = [(pairs[0][name], pairs[1][name]) for name in KINDS]
    assert any(len(old) == len(new) and not np.array_equal(old, new) for old, new in before_and_after)


def test_groups_and_fixed_vertices_meet_all_others() -> None:
    """Three plates one above the other: two plates of one group, or fixed, have no energy together."""
    plate = SCENES["aligned sheets"][0]
    half = (plate[0][: len(plate[0]) // 2], plate[1][: len(plate[1]) // 2])
    points, faces = union(half, move(half, (0.11, 0.07, 0.05)), move(half, (0.03, 0.13, 0.1)))
    owner = np.repeat([0, 1, 2], len(half[0]))

    def pairs_of(**filters: Floats) -> set[tuple[int, ...]]:
        scene = Scene("plates")
        mesh = scene.add_mesh("mesh")
        vertices = mesh.add_primitive("vertices", len(points))
        vertices.add_attribute("position", 3, 1, value=points)
        contact = BarrierContact(
            mesh, vertices, faces, activation_distance=0.07, barrier="paper", stiffness=1.0, **filters
        )
        return {
            tuple(sorted(set(owner[row].tolist())))
            for pairs in contact.active.kinds().values()
            for row in pairs.vertices
        }

    assert pairs_of() == {(0, 1), (1, 2)}
    assert pairs_of(group=np.where(owner < 2, 4, -1)) == {(1, 2)}
    assert pairs_of(group=np.where(owner > 0, 4, 0)) == {(0, 1)}
    assert pairs_of(group=np.where(owner == 0, 4, -1)) == {(0, 1), (1, 2)}  # those of no group are none together
    assert pairs_of(fixed=owner == 1) == {(0, 1), (1, 2)}
    assert pairs_of(fixed=owner > 0) == {(0, 1)}
