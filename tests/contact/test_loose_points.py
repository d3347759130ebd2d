"""Loose vertices and rods: what they meet, and how far they may go."""

from __future__ import annotations

import numpy as np
import pytest
from collision_scenes import ONE, TRIANGLE
from numpy.typing import NDArray

from yasps import IntersectionError, Scene, YaspsError
from yasps.contact import ActiveSet, BarrierContact, CollisionGeometry

Floats = NDArray[np.float64]
NOTHING = np.empty((0, 3), np.int32)


def entries(active: ActiveSet) -> dict[tuple[str, tuple[int, ...]], float]:
    return {
        (name, tuple(row)): weight
        for name, kind in active.kinds().items()
        for row, weight in zip(kind.vertices.tolist(), kind.weight.tolist(), strict=True)
    }


def test_points_meet_triangles_rods_and_each_other() -> None:
    """Of a triangle's edges only what is part of the triangle."""
    rod = np.array([[2.0, 0, 0], [2, 1, 0]])
    points = np.array([[0.2, 0.2, 0.05], [-0.01, 0.5, 0.02], [2.0, 0.4, 0.03], [2.02, 1.02, 0.03], [2.03, 1.02, 0.06]])
    x = np.concatenate([TRIANGLE, rod, points, [[0.2, 0.2, 0.01]]])  # the last one takes no part
    for improved_max in (False, True):
        geometry = CollisionGeometry(x, ONE, 0.1, edges=[[3, 4]], points=[9, 5, 6, 7, 8], improved_max=improved_max)
        assert geometry.taking_part.tolist() == [True] * 10 + [False]
        assert geometry.edges.tolist() == [[0, 1], [0, 2], [1, 2], [3, 4], *([v, v] for v in range(5, 10))]
        active = geometry.active_set(x)
        assert entries(active) == {
            ("point_triangle", (5, 0, 1, 2)): 1,
            ("point_edge", (6, 0, 2)): 1,
            ("point_edge", (7, 3, 4)): 1,
            ("point_point", (4, 8)): 1,
            ("point_point", (4, 9)): 1,
            ("point_point", (8, 9)): 1,
        }
        assert active.minimum_distance == pytest.approx(np.hypot(0.01, 0.02))
    assert active.point_point.vertices.tolist() == [[4, 8], [4, 9], [8, 9]]
    assert active.point_point.edges.tolist() == [[7, 3], [8, 3], [7, 8]]
    assert active.point_edge.edges.tolist() == [[9, 9], [6, 3]]
    assert active.point_edge.counts.tolist() == [[1, 0], [0, 0]]
    assert active.point_triangle.counts.tolist() == [[1, 0]]


def test_pairs_of_many_points_are_all_that_are_near() -> None:
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(0, 1, (300, 3)), rng.uniform(0, 1, (40, 3))])
    rods = np.arange(300, 340).reshape(-1, 2)
    x[301::2] = x[300::2] + 0.2 * rng.standard_normal((20, 3))
    reach = 0.1
    geometry = CollisionGeometry(x, NOTHING, reach, edges=rods, points=np.arange(300))
    expected = {("point_point", (a, b)) for a in range(300) for b in range(a) if np.linalg.norm(x[a] - x[b]) < reach}
    expected = {(kind, row[::-1]) for kind, row in expected}
    for p in range(300):
        for a, b in rods.tolist():
            t = (x[p] - x[a]) @ (x[b] - x[a]) / np.sum((x[b] - x[a]) ** 2)
            if np.linalg.norm(x[p] - x[a] - np.clip(t, 0, 1) * (x[b] - x[a])) < reach:
                inside = 0 < t < 1
                expected.add(("point_edge", (p, a, b)) if inside else ("point_point", (p, a if t <= 0 else b)))
    found = {key for key in entries(geometry.active_set(x)) if min(key[1]) < 300}
    assert found == expected
    assert len({kind for kind, _ in found}) == 2


def fall(count: int, moving: list[int], way: tuple[float, float, float]) -> Floats:
    motion = np.zeros((count, 3))
    motion[moving] = way
    return motion


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_steps_stop_a_point_before_a_triangle_a_rod_and_a_point(radius: float) -> None:
    x = np.array([*TRIANGLE, [2.0, 0, 0], [2, 1, 0], [4, 0, 0], [0.2, 0.2, 1], [2.0, 0.5, 1], [4, 0, 1]])
    geometry = CollisionGeometry(x, ONE, 0.1, edges=[[3, 4]], points=[5, 6, 7, 8], radii=np.full(9, radius))
    for point in (6, 7, 8):
        end = x + fall(9, [point], (0, 0, -3.0))
        step = geometry.step_bound(x, end)
        kept = (1 - 3 * step - 2 * radius) / (1 - 2 * radius)
        assert 0.1 <= kept <= 0.102
        with pytest.raises(IntersectionError, match=rf"vertex {point}"):
            geometry.check_way(x, end)
        nearer = x + fall(9, [point], (0.0, 0, -0.7))
        assert geometry.step_bound(x, nearer) == 1.0
    assert geometry.step_bound(x, x + fall(9, [7], (1.5, 0, -3.0))) == 1.0  # past the rod
    geometry.check_intersection_free(x)
    near = x.copy()
    near[8] = [4, 0, 0.08]
    if radius == 0.0:
        geometry.check_intersection_free(near)
        near[8] = near[5]
        with pytest.raises(IntersectionError, match=r"1 pairs touch .*point point pair: vertex 5, vertex 8"):
            geometry.step_bound(near, x)
    else:
        message = r"1 pairs are nearer .* deepest: vertex 5 and vertex 8, by 0\.02"
        with pytest.raises(IntersectionError, match=message):
            geometry.check_intersection_free(near)


def test_two_points_that_run_through_each_other_are_stopped() -> None:
    rng = np.random.default_rng(1)
    geometry = CollisionGeometry(np.eye(3)[:2], NOTHING, 0.1, points=[0, 1])
    for _ in range(50):
        x = rng.standard_normal((2, 3))
        step = geometry.step_bound(x, x[::-1].copy())
        there = x + step * (x[::-1] - x)
        kept = np.linalg.norm(there[0] - there[1]) / np.linalg.norm(x[0] - x[1])
        assert 0.1 - 1e-12 <= kept <= 0.102


def test_rods_count_each_pair_once() -> None:
    """Improved max does nothing along a rod: its vertices are near a triangle or they are not."""
    x = np.concatenate([10 * (TRIANGLE - 0.3), [[-1.0, 0, -2.95], [0, 0, -2.95], [1, 0.1, -2.95]]])
    geometry = CollisionGeometry(x, ONE, 0.1, edges=[[3, 4], [4, 5]], improved_max=True)
    active = geometry.active_set(x)
    assert active.point_triangle.vertices[:, 0].tolist() == [3, 4, 5]
    assert active.point_triangle.counts.tolist() == [[1, 0]] * 3
    assert len(active) == 3


@pytest.mark.parametrize("radius", [0.0, 0.004])
def test_a_scene_may_have_no_triangle_at_all(radius: float) -> None:
    """Two loose points: each has the cross-section pi r^2, half of which is its share of a pair."""
    scene = Scene("points", threads=1)
    vertices = scene.add_mesh("loose").add_primitive("vertices", 2)
    position = vertices.add_attribute("position", 3, 1, value=[[0.0, 0, 0], [2 * radius + 0.008, 0, 0]])
    contact = BarrierContact(
        scene.add_mesh("contact"),
        vertices,
        NOTHING,
        points=[0, 1],
        radii=radius,
        rest_positions=[[0.0, 0, 0], [1.0, 0, 0]],
        activation_distance=0.01,
        stiffness=1e4,
    )
    scene.add_minimize_target(position)
    contact.update()
    share = ((2 * radius + 0.008) ** 2 - 4 * radius**2) / (0.01**2 + 2 * 0.01 * 2 * radius)
    expected = np.pi * (radius or 0.005) ** 2 * 1e4 * 0.01 * -((share - 1) ** 2) * np.log(share)
    assert scene.total_energy() == pytest.approx(expected, rel=1e-12)


def test_wrong_points_are_named() -> None:
    x = np.concatenate([TRIANGLE, TRIANGLE + 3])
    with pytest.raises(YaspsError, match="points: vertex 1 is in a triangle or an edge"):
        CollisionGeometry(x, ONE, 0.1, points=[4, 1])
    with pytest.raises(YaspsError, match="points: vertex 4 is there twice"):
        CollisionGeometry(x, ONE, 0.1, points=[4, 4])
    with pytest.raises(YaspsError, match="points must hold ids from 0 to 5, got 6 to 6"):
        CollisionGeometry(x, ONE, 0.1, points=[6])
    with pytest.raises(YaspsError, match=r"points must have shape \[m, 1\]|points must hold integer"):
        CollisionGeometry(x, ONE, 0.1, points=[4.0])
