"""Friction of a scene's contact: against ipctk, through the scene's own energies, and what it takes from where.

The vertices are numbered at random, so that of two edges or two points either may come first.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import ipctk
import numpy as np
import pytest
from collision_scenes import SCENES, move, renumbered, union
from numpy.typing import NDArray

from yasps import Attribute, Scene, SceneError
from yasps.contact import KINDS, BarrierContact, ContactTable, Plane

Floats = NDArray[np.float64]
Ids = NDArray[np.int32]
STIFFNESS = 3.5
RADIUS = 1e-3
PLANE = Plane("ground", (0.6, 0.0, 0.8), (-60.0, 0.0, -80.0))
SLIP_LENGTH = 1e-5
NAMES = (
    "nearly parallel",
    "shaken",
    "edges crossing at 0.001",
    "edges crossing at 0.015",
    "box corner to corner",
    "box edge across edge",
)
MOLLIFIED = [name for name, kind in KINDS.items() if kind.edges is not None]


def contact_scene(points: Floats, faces: Ids, dhat: float, **options: object) -> tuple[BarrierContact, Attribute]:
    """Free vertices with a thick surface over a half-space, and their positions. All have one code."""
    scene = Scene("surface")
    mesh = scene.add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", len(points))
    position = vertices.add_attribute("position", 3, 1, value=points)
    chosen = {"stiffness": STIFFNESS, "table": ContactTable(0.5), "slip_length": SLIP_LENGTH, "radii": RADIUS}
    chosen |= {"planes": [PLANE], "activation_distance": dhat - 2 * RADIUS}
    contact = BarrierContact(mesh, vertices, faces, **(chosen | options))  # type: ignore[arg-type]
    scene.add_minimize_target(position)
    return contact, position


def keep_friction(contact: BarrierContact, *but: str) -> Scene:
    """Takes all energies but friction away, and that of some kinds."""
    scene = contact.parts.mesh.scene
    assert contact.friction is not None
    for pairs in contact.primitives.values():
        scene.remove_energy(pairs.primitive["barrier"])
    scene.remove_energy(contact.ahead.energy)
    for name in but:
        scene.remove_energy(contact.friction.primitives[name].primitive["potential"])
    return scene


def test_potential_gradient_and_hessian_are_those_of_ipctk() -> None:
    """Of all kinds that ipctk has friction for: nearly parallel edges slip there."""
    kinds: Counter[str] = Counter()
    for seed, name in enumerate(NAMES):
        mesh, dhat = SCENES[name]
        points, faces = renumbered(mesh, seed)
        contact, position = contact_scene(
            points, faces, dhat, barrier="paper", projection="none", radii=0.0, planes=(), activation_distance=dhat
        )
        scene = keep_friction(contact, *MOLLIFIED)
        assert contact.friction is not None
        kinds.update({kind: pairs.primitive.num_instances for kind, pairs in contact.friction.primitives.items()})
        way = SLIP_LENGTH * np.random.default_rng(seed).uniform(-1, 1, points.shape)
        position.update_value(points + way)

        x = np.asfortranarray(points)
        surface = ipctk.CollisionMesh(x, ipctk.edges(faces), np.asfortranarray(faces))
        collisions = ipctk.NormalCollisions()
        collisions.build(surface, x, dhat, broad_phase=ipctk.BruteForce())
        barrier = ipctk.BarrierPotential(ipctk.ClampedLogSqBarrier(), dhat, STIFFNESS)
        rubbing = ipctk.TangentialCollisions()
        rubbing.build(surface, x, collisions, barrier, 0.5)
        potential, u = ipctk.FrictionPotential(SLIP_LENGTH), np.asfortranarray(points + way - points)

        assert scene.total_energy() == pytest.approx(potential(rubbing, surface, u), rel=1e-9)
        gradient = potential.gradient(rubbing, surface, u)
        np.testing.assert_allclose(scene.gradient()[0], gradient, rtol=0, atol=1e-9 * np.abs(gradient).max())
        hessian = potential.hessian(rubbing, surface, u, ipctk.PSDProjectionMethod.NONE).toarray()
        exact = scene.hessian(projected=False).to_scipy().toarray()
        np.testing.assert_allclose(exact, hessian, rtol=0, atol=1e-9 * np.abs(hessian).max())
    assert min(kinds.values()) >= 2, kinds


def test_normal_forces_are_those_of_the_barrier() -> None:
    """A pair pushes its first piece away with its normal force; what turns mollified edges sums to 0 on each."""
    first_piece = {name: kind.edges[0] if kind.edges else range(kind.sides[1]) for name, kind in KINDS.items()}
    seen: Counter[str] = Counter()
    for seed, name in enumerate(("edges crossing at 0.001", "shaken")):
        mesh, dhat = SCENES[name]
        points, faces = renumbered(mesh, seed)
        contact, _ = contact_scene(points, faces, dhat)
        assert contact.friction is not None
        active = contact.active.kinds()
        nobody = {kind: pairs.chosen(np.zeros(len(pairs), np.bool_)) for kind, pairs in active.items()}
        for kind, pairs in active.items():
            for number in range(min(len(pairs), 3)):
                for other, chosen in (nobody | {kind: pairs.chosen(np.arange(len(pairs)) == number)}).items():
                    for primitives in (contact.primitives, contact.friction.primitives):
                        primitives[other].update(chosen, np.zeros(len(chosen), np.int32))
                force = contact.friction.primitives[kind].primitive["normal_force"].value[0]
                pushed = contact.parts.mesh.scene.gradient()[0].reshape(-1, 3)  # without a slip friction has none
                ids = pairs.vertices[number][list(first_piece[kind])]
                assert np.linalg.norm(pushed[ids].sum(axis=0)) == pytest.approx(abs(force), rel=1e-9)
                seen[kind] += 1
    assert set(seen) == set(KINDS)


def test_pairs_push_and_rub_both_sides_alike() -> None:
    points, faces = renumbered(SCENES["shaken"][0], 1)
    contact, position = contact_scene(points, faces, SCENES["shaken"][1])
    scene = keep_friction(contact)
    position.update_value(points + SLIP_LENGTH * np.random.default_rng(3).uniform(-9, 9, points.shape))
    force = scene.gradient()[0].reshape(-1, 3)
    assert np.abs(force).max() > 0
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-14 * np.abs(force).sum())
    assert scene.energy_values().keys() == {f"mesh.{name}_friction.potential" for name in (*KINDS, "half_space")}


def test_hessians_are_projected_where_they_are_2x2(tmp_path: Path) -> None:
    points, faces = renumbered(SCENES["edges crossing at 0.001"][0], 1)
    contact, _ = contact_scene(points, faces, 0.01)
    some = ("point_point", "edge_edge", "half_space")
    scene = keep_friction(contact, *(set(KINDS) - set(some)))
    scene.dump_ir(tmp_path)
    (text,) = (path.read_text() for path in tmp_path.glob("08-*.mlir"))
    assert len(re.findall(r"_friction\.potential.*projects \"2x2 of \d+x\d+: the energy reads", text)) == len(some)


def test_only_pairs_with_friction_are_in_it() -> None:
    """Three plates one above the other, of which the lower two rub; without any friction nothing is added."""
    plate = SCENES["aligned sheets"][0]
    half = (plate[0][: len(plate[0]) // 2], plate[1][: len(plate[1]) // 2])
    points, faces = union(half, move(half, (0.11, 0.07, 0.05)), move(half, (0.03, 0.13, 0.1)))
    count = len(half[0])
    objects = dict.fromkeys(("low", "middle", "high"), count)
    table = ContactTable().set("low", "middle", friction=0.3)
    contact, _ = contact_scene(points, faces, 0.07, table=table, objects=objects)
    assert contact.friction is not None
    for name, pairs in contact.active.kinds().items():
        owners = pairs.vertices // count
        lower = owners.max(axis=1) < 2
        given = contact.friction.primitives[name].primitive
        np.testing.assert_array_equal(given.vertices.indices, pairs.vertices[lower])
    assert contact.friction.primitives["point_triangle"].primitive.num_instances > 0
    contact.parts.laws["friction"].update_value(np.full(len(contact.laws.friction), 0.1))
    contact.lag()  # now all plates rub
    for name, pairs in contact.active.kinds().items():
        assert contact.friction.primitives[name].primitive.num_instances == len(pairs)
    smooth, _ = contact_scene(points, faces, 0.07, table=ContactTable(), slip_length=None)
    assert smooth.friction is None
    assert not hasattr(smooth.parts.mesh, "point_point_friction")


def test_slips_count_from_the_positions_before_the_step() -> None:
    """Of what is moved from outside before it, too; normal forces are those after that."""
    points, faces = renumbered(SCENES["shaken"][0], 1)
    contact, position = contact_scene(points, faces, SCENES["shaken"][1])
    scene = keep_friction(contact)
    way = 1e-6 * np.random.default_rng(5).standard_normal(points.shape)
    position.update_value(points + way)
    fresh = scene.total_energy()
    contact.start_step()
    forces = np.abs(scene.gradient()[0])
    moved = scene.total_energy()
    other, _ = contact_scene(points + way, faces, SCENES["shaken"][1], rest_positions=points)
    keep_friction(other)
    assert other.friction is not None
    other.friction.start_step(points)
    assert moved == other.parts.mesh.scene.total_energy() != fresh
    contact.start_step()
    still = scene.total_energy()
    assert np.abs(scene.gradient()[0]).max() < 1e-9 * forces.max()  # nothing moves any more
    assert 0 < still < moved


def test_a_slip_length_that_can_not_be_is_refused() -> None:
    points, faces = SCENES["shaken"][0]
    for wrong, words in ((None, "give slip_length"), (0.0, "must be positive"), (np.nan, "must be positive")):
        with pytest.raises(SceneError, match=words):
            contact_scene(points, faces, 0.05, slip_length=wrong)
    scene = Scene("other")
    with pytest.raises(SceneError, match="slip_length is a length"):
        contact_scene(points, faces, 0.05, slip_length=scene.add_constant("e", 1, 1, value=1e-5))


def test_friction_on_a_half_space_is_a_closed_form() -> None:
    """Vertices over a tilted plane: normal force and slip by hand, sticking and sliding."""
    normal = np.array(PLANE.normal)
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.1, 0.1, (9, 3))
    heights = RADIUS + rng.uniform(0.001, 0.009, 9)
    points += (heights - points @ normal)[:, None] * normal + PLANE.point
    faces = np.arange(9, dtype=np.int32).reshape(3, 3)
    dhat, stiffness, group = 0.01, 1e4, np.zeros(9, int)
    contact, position = contact_scene(
        points, faces, dhat + 2 * RADIUS, stiffness=stiffness, table=ContactTable(0.5, 0.4), group=group
    )
    scene = keep_friction(contact)
    way = SLIP_LENGTH * np.array([0.0, 1e-9, 0.2, 0.9, 3, 5, 9, 11, 100.0])[:, None] * rng.standard_normal((9, 3))
    position.update_value(points + way)
    a, b, c = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    area = np.repeat(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6, 3)
    reach = dhat * (dhat + 2 * RADIUS)
    tau = (heights - RADIUS) * (heights + RADIUS) / reach
    slope = 2 * heights / reach * (2 * (tau - 1) * np.log(tau) + (tau - 1) ** 2 / tau)
    way = position.value.reshape(-1, 3) - points
    slip = way - (way @ normal)[:, None] * normal
    y = np.linalg.norm(slip, axis=1)
    q = np.clip((y / SLIP_LENGTH - 1) / 9, 0, 1)
    share = np.minimum(y / SLIP_LENGTH, 1)
    friction = (0.5 - 0.1 * q**3 * (10 - 15 * q + 6 * q * q)) * share * (2 - share)
    expected = (stiffness * area * dhat * slope * friction / np.maximum(y, 1e-300))[:, None] * slip
    np.testing.assert_allclose(
        scene.gradient()[0].reshape(-1, 3), expected, rtol=0, atol=1e-10 * np.abs(expected).max()
    )
