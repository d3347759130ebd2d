"""Classes of vertices that do not meet each other."""

from __future__ import annotations

import numpy as np
import pytest
from collision_scenes import ONE, SCENES, TRIANGLE, move, union

from yasps import YaspsError
from yasps.contact import CollisionGeometry

POINTS, FACES = union(*(move((TRIANGLE, ONE), (0.1 * k, 0.1 * k, 0.05 * k)) for k in range(3)))
CLASS_OF = np.repeat([0, 1, 2], 3)


def allowed(*off: tuple[int, int]) -> np.ndarray:
    table = np.ones((3, 3), bool)
    for a, b in off:
        table[a, b] = table[b, a] = False
    return table


def classes_of_pairs(geometry: CollisionGeometry) -> set[tuple[int, ...]]:
    return {
        tuple(sorted(set(CLASS_OF[row].tolist())))
        for kind in geometry.active_set(POINTS).kinds().values()
        for row in kind.vertices
    }


@pytest.mark.parametrize("improved_max", [False, True])
def test_pairs_of_classes_that_are_not_allowed_are_left_out(improved_max: bool) -> None:
    all_pairs = {(0, 1), (0, 2), (1, 2)}
    for off in ([], [(0, 1)], [(0, 2), (1, 2)], [(0, 0)]):
        geometry = CollisionGeometry(
            POINTS, FACES, 0.15, class_of=CLASS_OF, allowed=allowed(*off), improved_max=improved_max
        )
        assert classes_of_pairs(geometry) == all_pairs - set(off)


def test_pairs_inside_a_class_may_be_off() -> None:
    (points, faces), reach = SCENES["shaken"]
    half = len(points) // 2
    of = np.repeat([0, 1], half)
    each = CollisionGeometry(points, faces, reach, class_of=of, allowed=[[True, True], [True, True]])
    others = CollisionGeometry(points, faces, reach, class_of=of, allowed=[[False, True], [True, False]])
    everything = CollisionGeometry(points, faces, 10.0, class_of=of, allowed=[[False, True], [True, False]])
    assert len(others.candidates(points)) <= len(each.candidates(points))
    for kind in everything.active_set(points).kinds().values():
        assert (np.ptp(of[kind.vertices], axis=1) == 1).all()


def test_they_may_cross_and_go_through_each_other() -> None:
    crossing = POINTS.copy()
    crossing[3:6, 2] = [-0.2, 0.3, -0.2]
    end = POINTS - 3.0 * (CLASS_OF == 1)[:, None] * np.array([0, 0, 1.0])
    free = CollisionGeometry(POINTS, FACES, 0.15)
    assert free.has_intersections(crossing)
    assert free.step_bound(POINTS, end) < 1
    off = CollisionGeometry(POINTS, FACES, 0.15, class_of=CLASS_OF, allowed=allowed((0, 1), (1, 2)))
    assert not off.has_intersections(crossing)
    off.check_intersection_free(crossing)
    assert off.step_bound(POINTS, end) == 1.0
    off.check_way(POINTS, end)
    other = CollisionGeometry(POINTS, FACES, 0.15, class_of=CLASS_OF, allowed=allowed((1, 2), (0, 2)))
    assert other.has_intersections(crossing)
    with pytest.raises(YaspsError, match="2 edges cross or touch"):
        other.check_intersection_free(crossing)


def test_wrong_classes_are_named() -> None:
    with pytest.raises(YaspsError, match="class_of and allowed go together"):
        CollisionGeometry(POINTS, FACES, 0.1, class_of=CLASS_OF)
    with pytest.raises(YaspsError, match=r"class_of must be integers \[9\]"):
        CollisionGeometry(POINTS, FACES, 0.1, class_of=[0.5] * 9, allowed=allowed())
    with pytest.raises(YaspsError, match="class_of must hold classes from 0 to 2, got 0 to 3"):
        CollisionGeometry(POINTS, FACES, 0.1, class_of=CLASS_OF + (CLASS_OF == 2), allowed=allowed())
    lopsided = allowed()
    lopsided[0, 1] = False
    with pytest.raises(YaspsError, match="symmetric bool"):
        CollisionGeometry(POINTS, FACES, 0.1, class_of=CLASS_OF, allowed=lopsided)
    with pytest.raises(YaspsError, match=r"triangles: the vertices of row 1 are of different classes: \[1, 1, 2\]"):
        CollisionGeometry(POINTS, FACES, 0.1, class_of=CLASS_OF + (np.arange(9) == 5), allowed=allowed())
