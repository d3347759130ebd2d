"""Collision geometry: ipctk's own barrier potential is the oracle for every array of the active set."""

from __future__ import annotations

from collections import Counter

import ipctk
import numpy as np
import pytest
from collision_scenes import ONE, SCENES, TRIANGLE, box, move, potential, sheet, union
from numpy.typing import ArrayLike

from yasps import YaspsError
from yasps.contact import CollisionGeometry
from yasps.contact.collision_geometry import IntersectionError


@pytest.mark.parametrize("name", SCENES)
def test_active_set_reproduces_ipctk_barrier_potential(name: str) -> None:
    (points, faces), dhat = SCENES[name]
    active = CollisionGeometry(points, faces, dhat).active_set(points)

    x = np.asfortranarray(points)
    mesh = ipctk.CollisionMesh(x, ipctk.edges(faces), np.asfortranarray(faces))
    collisions = ipctk.NormalCollisions()
    collisions.build(mesh, x, dhat, broad_phase=ipctk.BruteForce())
    oracle = ipctk.BarrierPotential(ipctk.ClampedLogSqBarrier(), dhat, 1.0)
    assert len(active) == len(collisions) > 0
    assert potential(active, points.astype(np.complex128), points, dhat).real == pytest.approx(
        oracle(collisions, mesh, x), rel=1e-12
    )

    direction = np.random.default_rng(1).standard_normal(points.shape)
    slope = potential(active, np.asarray(points + 1e-30j * direction, np.complex128), points, dhat).imag / 1e-30
    gradient = oracle.gradient(collisions, mesh, x)
    scale = float(np.linalg.norm(gradient) * np.linalg.norm(direction))
    assert slope == pytest.approx(gradient @ direction.ravel(), abs=1e-12 * scale)


def test_scenes_of_the_oracle_contain_every_kind_of_pair() -> None:
    counts: Counter[str] = Counter()
    weights = []
    for (points, faces), dhat in SCENES.values():
        active = CollisionGeometry(points, faces, dhat).active_set(points)
        counts.update({kind: len(pairs) for kind, pairs in active.kinds().items()})
        weights.append(active.point_edge.weight)
        weights.append(active.point_point.weight)
        for kind in ("point_triangle", "edge_edge"):
            assert (active.kinds()[kind].weight == 1).all()
    assert min(counts.values()) >= 3, counts
    merged = np.concatenate(weights)
    assert (merged == np.round(merged)).all()
    assert merged.min() >= 1
    assert merged.max() > 1


def test_rows_are_sorted_unique_and_independent_of_triangle_order() -> None:
    (points, faces), dhat = SCENES["shaken"]
    first = CollisionGeometry(points, faces, dhat).active_set(points)
    shuffled = np.random.default_rng(2).permutation(faces)
    second = CollisionGeometry(points, shuffled, dhat).active_set(points)
    for kind, pairs in first.kinds().items():
        rows = pairs.vertices.tolist()
        assert rows == sorted(rows)
        assert len(np.unique(pairs.vertices, axis=0)) == len(pairs)
        assert pairs.vertices.dtype == np.int32
        assert rows == second.kinds()[kind].vertices.tolist()
        assert (pairs.weight == second.kinds()[kind].weight).all()


def test_ids_are_the_scenes_and_interior_vertices_take_no_part() -> None:
    lower, upper = TRIANGLE, np.array([[0.2, 0.2, 0.05], [0.2, 0.2, 2.0], [0.4, 0.2, 2.0]])
    inside = np.array([0.3, 0.3, 0.01])  # an interior vertex of some tetrahedron, nearer than all others
    points = np.stack([inside, *lower, inside, *upper])
    geometry = CollisionGeometry(points, np.array([[1, 2, 3], [5, 6, 7]]), 0.1)
    active = geometry.active_set(points)
    assert active.point_triangle.vertices.tolist() == [[5, 1, 2, 3]]
    assert len(active) == 1
    assert active.minimum_distance == pytest.approx(0.05)


def test_threshold_comes_from_rest_lengths() -> None:
    """Edges that cross at 0.06 now, of which the first is half as long as at rest: |u x v|^2 = 1e-3 * 3.6."""
    rods = np.array([[0.0, 0, 0], [2, 0, 0], [0, 0, 1], [1, 0, 1]])
    now = np.array([[0.0, 0, 0], [1, 0, 0], [0, -0.03, 0.05], [1, 0.03, 0.05]])
    kinds = []
    for length in (1.85, 1.95):
        rods[1, 0] = length
        active = CollisionGeometry(rods, np.empty((0, 3)), 0.1, edges=[[0, 1], [2, 3]]).active_set(now)
        kinds.append([kind for kind, pairs in active.kinds().items() if len(pairs) > 0])
    assert kinds == [["edge_edge"], ["mollified_edge_edge"]]


def test_fixed_vertices_and_groups_never_meet_themselves() -> None:
    points, faces = union((TRIANGLE, ONE), move((TRIANGLE, ONE), (0.1, 0.1, 0.01)), move((TRIANGLE, ONE), (0, 0, 0.5)))
    owner = np.repeat([0, 1, 2], 3)

    def pairs(fixed: ArrayLike | None = None, group: ArrayLike | None = None) -> int:
        return len(CollisionGeometry(points, faces, 0.1, fixed=fixed, group=group).active_set(points))

    assert pairs() > 0
    assert pairs(fixed=owner == 0) == pairs()
    assert pairs(fixed=owner < 2) == 0
    assert pairs(group=np.where(owner < 2, 7, -1)) == 0
    assert pairs(group=np.where(owner == 1, 3, owner)) == pairs()
    crossing = points.copy()
    crossing[3:6, 2] = [-0.2, 0.3, -0.2]
    assert CollisionGeometry(points, faces, 0.1).has_intersections(crossing)
    fixed = CollisionGeometry(points, faces, 0.1, fixed=owner < 2)
    assert not fixed.has_intersections(crossing)
    fixed.check_intersection_free(crossing)
    with pytest.raises(YaspsError, match="group 7 holds both fixed and free"):
        CollisionGeometry(points, faces, 0.1, fixed=owner == 0, group=np.where(owner < 2, 7, -1))


def test_candidates_of_a_motion_serve_every_step_on_it() -> None:
    (start, faces), dhat = SCENES["turned"]
    end = start + 0.2 * np.random.default_rng(3).standard_normal(start.shape)
    geometry = CollisionGeometry(start, faces, dhat)
    candidates = geometry.candidates(start, end)
    for step in (0.0, 0.01, 1 / 3, 0.7, 1.0):
        now = start + step * (end - start)
        reused, fresh = geometry.active_set(now, candidates), geometry.active_set(now)
        assert len(fresh) > 0
        for kind, pairs in fresh.kinds().items():
            assert pairs.vertices.tolist() == reused.kinds()[kind].vertices.tolist()
            assert (pairs.weight == reused.kinds()[kind].weight).all()
    assert geometry.step_bound(start, end, candidates) == geometry.step_bound(start, end)
    beyond = start + 1.01 * (end - start)
    with pytest.raises(YaspsError, match=r"outside the motion .*call candidates"):
        geometry.active_set(beyond, candidates)
    with pytest.raises(YaspsError, match=r"end: .*outside the motion"):
        geometry.step_bound(start, beyond, candidates)
    with pytest.raises(YaspsError, match="made for distance 0, but"):
        geometry.active_set(start, geometry.candidates(start, end, distance=0.0))


def test_step_bound_stops_before_the_ground() -> None:
    ground, faces = union((10 * (TRIANGLE - 0.3), ONE), move((TRIANGLE, ONE), (0, 0, 4)))
    geometry = CollisionGeometry(ground, faces, 0.1)
    end = ground.copy()
    end[3:, 2] -= 20  # far through: the end itself crosses nothing
    assert not geometry.has_intersections(end)
    gap = ground[3, 2] - ground[0, 2]
    bound = geometry.step_bound(ground, end)
    assert 0.85 * gap / 20 <= bound <= 0.95 * gap / 20
    assert geometry.step_bound(ground, end, start_is_free=True) == bound
    end[3:, 2] = ground[0, 2] + 0.5
    assert geometry.step_bound(ground, end) == 1.0
    assert geometry.step_bound(ground, ground) == 1.0


def test_step_bound_keeps_random_motions_apart() -> None:
    (start, faces), dhat = SCENES["shaken"]
    geometry = CollisionGeometry(start, faces, dhat)
    before = geometry.active_set(start).minimum_distance
    bounds = []
    for seed in range(5):
        motion = np.random.default_rng(seed).standard_normal(start.shape)
        bounds.append(geometry.step_bound(start, start + motion))
        now = start + bounds[-1] * motion
        assert not geometry.has_intersections(now)
        assert geometry.active_set(now).minimum_distance >= 0.09 * before
    assert 0 < min(bounds) < max(bounds) < 1


def test_start_that_crosses_or_touches_is_refused() -> None:
    points, faces = union((TRIANGLE, ONE), move((TRIANGLE, ONE), (0.1, 0.1, 1.0)))
    geometry = CollisionGeometry(points, faces, 0.1, objects={"floor": 3, "cloth": 3})
    crossing = points.copy()
    crossing[4] = [0.2, 0.2, -1]
    message = (
        r"2 edges cross or touch triangles; first: edge \(vertex 0 of 'cloth', vertex 1 of 'cloth'\)"
        r" and triangle \(vertex 0 of 'floor', vertex 1 of 'floor', vertex 2 of 'floor'\)"
    )
    with pytest.raises(IntersectionError, match="positions: " + message):
        geometry.check_intersection_free(crossing)
    with pytest.raises(IntersectionError, match="start: " + message):
        geometry.step_bound(crossing, points)
    touching = points.copy()
    touching[4] = [0.25, 0.25, 0]
    assert geometry.has_intersections(touching)
    with pytest.raises(IntersectionError, match=r"1 pairs touch .* point triangle pair: vertex 1 of 'cloth', vertex 0"):
        geometry.step_bound(touching, points, start_is_free=True)
    geometry.check_intersection_free(points)


def test_intersections_in_flat_and_nested_meshes() -> None:
    flat, faces = sheet(5)
    skew = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    assert not CollisionGeometry(flat, faces, 0.1).has_intersections(flat @ skew)
    points, cubes = union(box(), move(box(), (2.0, 0, 0)))
    nested = points.copy()
    nested[8:] = 0.5 + 0.1 * (points[:8] - 0.5)
    # The documented limit: containment without crossing surfaces is not an intersection.
    assert not CollisionGeometry(points, cubes, 0.1).has_intersections(nested)


def test_wrong_input_is_named() -> None:
    geometry = CollisionGeometry(TRIANGLE, ONE, 0.1)
    bad = TRIANGLE.copy()
    bad[1, 2] = np.nan
    for call in (geometry.has_intersections, geometry.active_set, geometry.candidates):
        with pytest.raises(YaspsError, match="1 vertices are NaN or infinite, first vertex 1"):
            call(bad)
        with pytest.raises(YaspsError, match=r"shape \[3, 3\].*got \[2, 3\]"):
            call(TRIANGLE[:2])
    with pytest.raises(YaspsError, match="end: 1 vertices are NaN"):
        geometry.step_bound(TRIANGLE, bad)
    with pytest.raises(YaspsError, match=r"rest_positions must have shape \[n, 3\]"):
        CollisionGeometry(TRIANGLE[:, :2], ONE, 0.1)
    with pytest.raises(YaspsError, match="ids from 0 to 2, got 0 to 3"):
        CollisionGeometry(TRIANGLE, [[0, 1, 3]], 0.1)
    with pytest.raises(YaspsError, match="row 0 names a vertex twice"):
        CollisionGeometry(TRIANGLE, [[0, 1, 1]], 0.1)
    with pytest.raises(YaspsError, match=r"triangles must have shape \[m, 3\]"):
        CollisionGeometry(TRIANGLE, [[0, 1]], 0.1)
    with pytest.raises(YaspsError, match="integer vertex ids"):
        CollisionGeometry(TRIANGLE, [[0.0, 1.0, 2.0]], 0.1)
    with pytest.raises(YaspsError, match="activation_distance must be positive"):
        CollisionGeometry(TRIANGLE, ONE, 0.0)
    with pytest.raises(YaspsError, match="which sum to 3"):
        CollisionGeometry(TRIANGLE, ONE, 0.1, objects={"cloth": 4})
    with pytest.raises(YaspsError, match=r"fixed must be bool \[3\]"):
        CollisionGeometry(TRIANGLE, ONE, 0.1, fixed=[0, 1, 0])
    other = CollisionGeometry(*sheet(2), 0.1)
    with pytest.raises(YaspsError, match="another CollisionGeometry"):
        geometry.active_set(TRIANGLE, other.candidates(sheet(2)[0]))


def test_a_scene_without_surface_has_no_contacts() -> None:
    geometry = CollisionGeometry(TRIANGLE, np.empty((0, 3), np.int32), 0.1)
    assert len(geometry.active_set(TRIANGLE)) == 0
    assert geometry.active_set(TRIANGLE).minimum_distance == np.inf
    assert geometry.step_bound(TRIANGLE, TRIANGLE + 1) == 1.0
    assert not geometry.has_intersections(TRIANGLE)
