"""Pairs that are in the way, and the constraints that they become."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from collision_scenes import SCENES, Floats

from yasps import Scene
from yasps.bodies import HalfSpace, SoftBody
from yasps.contact import CollisionGeometry, Constraints
from yasps.meshes import box
from yasps.runtime.collision.surface_pairs import SurfacePairs
from yasps.simulation import Simulation

NONE = np.empty((0, 4), np.int32)


def through(points: Floats, seed: int) -> Floats:
    """Displacements of two halves into one another, and a little of each vertex by itself."""
    rng = np.random.default_rng(seed)
    half = len(points) // 2
    approach = points[half:].mean(axis=0) - points[:half].mean(axis=0)
    approach *= rng.uniform(0.5, 2.0) / np.linalg.norm(approach)
    side = np.where(np.arange(len(points)) < half, 1.0, -1.0)[:, None]
    return side * approach + 0.02 * rng.standard_normal(points.shape)


@pytest.mark.parametrize("radius", [0.0, 0.02])
@pytest.mark.parametrize("name", ["shaken", "turned", "box corner to corner"])
def test_what_meets_is_what_bounds_a_step(name: str, radius: float) -> None:
    (points, faces), reach = SCENES[name]
    geometry = CollisionGeometry(points, faces, reach, radii=radius * reach)
    surface, kinds, met = geometry._surface, set(), 0
    for seed in range(3):
        end = points + through(points, seed)
        candidates = geometry.candidates(points, end)
        found = geometry.meetings(points, end, candidates)
        met += len(found.times)
        assert found.times.min() == pytest.approx(geometry.step_bound(points, end, candidates), rel=1e-9)
        expected = {}
        for kind in ("edge_edge", "vertex_triangle"):
            for row in getattr(candidates.pairs, kind):
                pair = SurfacePairs(**{"edge_edge": NONE, "vertex_triangle": NONE} | {kind: row[None]})
                bound = surface.step_bound(points, end, points, 0.0, pair)
                if bound is not None and bound < 1:
                    expected[kind, *row.tolist()] = bound
        assert len(expected) == len(found.times)
        for k, (vertices, time) in enumerate(zip(found.vertices.tolist(), found.times, strict=True)):
            kind = "vertex_triangle" if found.weights[k, 0] == -1 and found.weights[k, 1] >= 0 else "edge_edge"
            kinds.add(kind)
            assert any(expected.get((one, *vertices)) == time for one in ("edge_edge", "vertex_triangle"))
        there = points[found.vertices] + found.times[:, None, None] * (end - points)[found.vertices]
        np.testing.assert_allclose(np.einsum("mi,mid->md", found.weights, there), found.ways, atol=1e-13)
        np.testing.assert_allclose(found.weights.sum(axis=1), 0.0, atol=1e-12)
        gap = np.linalg.norm(found.ways, axis=1) - found.offsets
        np.testing.assert_allclose(gap, 0.1 * found.gaps, rtol=0.011, atol=1e-12)
    assert met > 10
    assert len(kinds) == 2


def test_what_meets_does_not_depend_on_the_order_of_candidates() -> None:
    """A search after a resume finds them in another."""
    (points, faces), reach = SCENES["shaken"]
    geometry = CollisionGeometry(points, faces, reach)
    end = points + through(points, 0)
    candidates = geometry.candidates(points, end)
    found = geometry.meetings(points, end, candidates)
    assert len(found.times) > 3
    pairs = SurfacePairs(candidates.pairs.edge_edge[::-1].copy(), candidates.pairs.vertex_triangle[::-1].copy())
    again = geometry.meetings(points, end, replace(candidates, pairs=pairs))
    for name, value in vars(found).items():
        np.testing.assert_array_equal(value, getattr(again, name), err_msg=name)


def halves(points: Floats, axis: int) -> Constraints:
    """That each vertex stays above 0 along an axis."""
    count = len(points)
    ids = np.repeat(np.arange(count, dtype=np.int32)[:, None], 4, axis=1)
    weights, normals = np.tile([1.0, 0, 0, 0], (count, 1)), np.tile(np.eye(3)[axis], (count, 1))
    return Constraints(ids, weights, normals, np.zeros(count))


def test_constraints_say_what_they_lack() -> None:
    points = np.array([[1.0, -2.0, 3.0], [-4.0, 5.0, 6.0]])
    first, second = halves(points, 0), halves(points, 1)
    assert first.lacking(points).tolist() == [0.0, 4.0]
    assert second.lacking(points).tolist() == [2.0, 0.0]
    assert len(first.without(second)) == 0  # of the same vertices
    assert len(first.chosen(np.array([True, False])).and_also(second)) == 3
    assert first.without(second.chosen(np.array([True, False]))).vertices[:, 0].tolist() == [1]
    assert len(first.without(second.chosen(np.zeros(2, np.bool_)))) == 2


def test_constraints_keep_what_falls_out_of_the_others_and_half_spaces() -> None:
    scene = Scene("scene")
    shape = box((0.1, 0.1, 0.1), (2, 2, 2))
    low = SoftBody(scene, "low", shape.translated((0.0, 0.0, 0.06)), radius=1e-3)
    high = SoftBody(scene, "high", shape.translated((0.02, 0.01, 0.18)))
    plane = HalfSpace(scene, "plane", normal=(0.0, 0.0, 1.0), height=0.0)
    contact = Simulation(scene, [low, high, plane], activation_distance=2e-3).contact
    assert contact is not None
    start = contact.positions()
    end = start - np.repeat([[0.0, 0.0, 0.05], [0.0, 0.0, 0.12]], len(shape.vertices), axis=0)
    step, candidates = contact.free_step(start, end)
    assert step < 1
    constraints = contact.ahead.constraints(start, end, candidates)
    assert (constraints.lacking(start) == 0).all()
    assert (constraints.lacking(end) > 0).any()
    on_plane = (constraints.weights[:, 1:] == 0).all(axis=1)
    assert on_plane.sum() == 2 * 9  # the lower sides of both
    # Of gaps of 9 mm and more 0.9 of the activation distance is kept, beside the radius of 1 mm of the lower box.
    expected = 0.9 * 2e-3 + np.where(constraints.vertices[on_plane, 0] < len(shape.vertices), 1e-3, 0.0)
    np.testing.assert_allclose(constraints.least[on_plane], expected, rtol=1e-12)
    np.testing.assert_allclose(constraints.least[~on_plane].max(), 1e-3 + 0.9 * 2e-3, rtol=1e-6)
    kept = start + 0.999 * step * (end - start)
    assert (constraints.heights(kept) > 0).all()
