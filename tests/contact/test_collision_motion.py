"""Pairs that are kept from one motion to the next, and step bounds, against the IPC Toolkit asked anew each time."""

from __future__ import annotations

import time

import ipctk
import numpy as np
import pytest
from collision_scenes import SCENES, Floats, box, move, potential, sheet, union
from numpy.typing import NDArray

from yasps import YaspsError
from yasps.contact import CollisionGeometry
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.collision.surface_pairs import SurfacePairs
from yasps.runtime.core.library import load_runtime

MOTIONS = ["still", "shaken", "together", "through"]


def motion(kind: str, points: Floats, seed: int) -> Floats:
    """Displacements: of no vertex, of each by itself, of all together and a little by itself, of halves into one
    another."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(points.shape)
    if kind == "still":
        return np.zeros_like(points)
    if kind == "shaken":
        return 0.2 * noise
    if kind == "together":
        return 5.0 * rng.standard_normal(3) + 0.02 * noise
    half = len(points) // 2
    approach = points[half:].mean(axis=0) - points[:half].mean(axis=0)
    approach *= rng.uniform(0.1, 2.0) / np.linalg.norm(approach)
    return np.where(np.arange(len(points)) < half, 1.0, -1.0)[:, None] * approach + 0.02 * noise


def oracle_mesh(points: Floats, faces: NDArray[np.int32]) -> ipctk.CollisionMesh:
    return ipctk.CollisionMesh(np.asfortranarray(points), ipctk.edges(faces), np.asfortranarray(faces))


@pytest.mark.parametrize("kind", MOTIONS)
@pytest.mark.parametrize("name", ["nearly parallel", "shaken", "turned", "box edge along edge"])
def test_kept_candidates_find_what_ipctk_finds_anew(name: str, kind: str) -> None:
    (points, faces), dhat = SCENES[name]
    mesh = oracle_mesh(points, faces)
    geometry = CollisionGeometry(points, faces, dhat)
    barrier = ipctk.BarrierPotential(ipctk.ClampedLogSqBarrier(), dhat, 1.0)
    margin = 0.3 * dhat
    found = 0
    for seed in range(4):
        way = motion(kind, points, seed)
        candidates = geometry.candidates(points, points + way, margin=margin)
        rng = np.random.default_rng(100 + seed)
        for step in (0.0, 0.37, 1.0):
            aside = rng.standard_normal(points.shape)
            aside *= 0.5 * margin * rng.random((len(points), 1)) / np.linalg.norm(aside, axis=1, keepdims=True)
            there = np.asfortranarray(points + step * way + aside)
            assert geometry.covers(candidates, there)
            active = geometry.active_set(there, candidates)
            expected = ipctk.NormalCollisions()
            expected.build(mesh, there, dhat, broad_phase=ipctk.BruteForce())
            assert len(active) == len(expected)
            here = potential(active, there.astype(np.complex128), points, dhat).real
            assert here == pytest.approx(barrier(expected, mesh, there), rel=1e-11)
            if len(active) > 0:
                nearest = np.sqrt(expected.compute_minimum_distance(mesh, there))
                assert active.minimum_distance == pytest.approx(nearest, rel=1e-12)
            found += len(active)
    assert found > 0


@pytest.mark.parametrize("kind", MOTIONS[1:])
@pytest.mark.parametrize("name", ["shaken", "turned", "box corner to corner"])
def test_step_bounds_are_no_less_than_ipctks_and_safe(name: str, kind: str) -> None:
    (points, faces), dhat = SCENES[name]
    mesh = oracle_mesh(points, faces)
    geometry = CollisionGeometry(points, faces, dhat)
    start = np.asfortranarray(points)
    kept = geometry.candidates(points, points + motion(kind, points, 0), margin=dhat)
    bounds = []
    for seed in range(6):
        end = np.asfortranarray(points + motion(kind, points, seed // 2) * (0.5 if seed % 2 else 1.0))
        expected = ipctk.Candidates()
        expected.build(mesh, start, end, 0.0, ipctk.BruteForce())
        slow = expected.compute_collision_free_stepsize(mesh, start, end, narrow_phase_ccd=ipctk.AdditiveCCD())
        bound = geometry.step_bound(start, end)
        assert bound >= (1 - 1e-6) * slow  # the toolkit stops where its next step might go too far
        assert ipctk.is_step_collision_free(mesh, start, start + 0.999 * bound * (end - start))
        if geometry.covers(kept, start, end):
            assert geometry.step_bound(start, end, kept) == bound
        bounds.append(bound)
    assert kind == "together" or min(bounds) < 1.0


@pytest.mark.parametrize("way", [0.0, 3.0])
def test_both_sides_of_a_pair_may_use_up_their_margin(way: float) -> None:
    """While both move together, too: then only their relative motion counts."""
    reach, margin = 0.1, 0.05
    points, faces = union(sheet(2), (sheet(2)[0] + [0.1, 0.2, 0.99 * (reach + 2 * margin)], sheet(2)[1]))
    geometry = CollisionGeometry(points, faces, reach)
    moved = points + np.array([0.0, 0.0, way])
    candidates = geometry.candidates(points, moved, margin=margin)
    towards = np.where(np.arange(len(points)) < len(points) // 2, 0.99, -0.99)[:, None] * [0.0, 0.0, margin]
    there = 0.5 * (points + moved) + towards
    assert geometry.covers(candidates, there)
    fresh, kept = geometry.active_set(there), geometry.active_set(there, candidates)
    assert len(fresh) > 10
    assert all(pairs.same_as(kept.kinds()[kind]) for kind, pairs in fresh.kinds().items())


def test_leaving_the_margin_is_noticed_at_each_vertex() -> None:
    (points, faces), dhat = SCENES["turned"]
    geometry = CollisionGeometry(points, faces, dhat)
    way = motion("together", points, 1)
    candidates = geometry.candidates(points, points + way, margin=0.1)
    for vertex in (0, 7, len(points) - 1):
        for share, covered in ((0.99, True), (1.01, False)):
            there = points + 0.6 * way
            # Across the way, for along it all others would only be a little late.
            across = np.cross(way[vertex], [1.0, 0.0, 0.0])
            there[vertex] += share * 0.1 * across / np.linalg.norm(across)
            assert geometry.covers(candidates, there) is covered
            if not covered:
                with pytest.raises(YaspsError, match="outside the motion"):
                    geometry.active_set(there, candidates)


def test_moving_together_brings_no_further_candidates() -> None:
    (points, faces), dhat = SCENES["shaken"]
    geometry = CollisionGeometry(points, faces, dhat)
    at_rest = geometry.candidates(points)
    together = geometry.candidates(points, points + np.array([30.0, -20.0, 10.0]))
    assert len(at_rest) <= len(together) <= 1.01 * len(at_rest)


def test_pairs_do_not_depend_on_the_order_of_trees_or_the_number_of_threads() -> None:
    points, faces = union(sheet(12), (sheet(12)[0] @ np.diag([1.0, 1.0, 0.0]) + [0.03, 0.02, 0.05], sheet(12)[1]))
    sets = []
    for threads in (1, 3):
        geometry = CollisionGeometry(points, faces, 0.1, runtime=load_runtime(find_compiler(), threads))
        folded = points.copy()
        for angle in (0.0, 0.7, 2.0):  # the trees keep their order of the first search
            folded[:, 2] = points[:, 2] + 0.2 * np.sin(angle * points[:, 0])
            pairs = geometry.candidates(folded).pairs
            sets.append(rows(pairs))
    assert sets[:3] == sets[3:]
    assert all(len(set(part)) == len(part) > 1000 for part in sets[0])
    fresh = CollisionGeometry(points, faces, 0.1).candidates(folded).pairs
    assert rows(fresh) == sets[2]


def chain_of_ways(points: Floats, count: int) -> list[tuple[Floats, Floats]]:
    """Ways as of line searches: on each most vertices go a part of the way before, and some, other ones each time, turn
    off. The fifth is another way for all."""
    rng = np.random.default_rng(3)
    ways = [(points, points + motion("together", points, 4))]
    for k in range(1, count):
        first, last = ways[-1]
        begin, finish = rng.uniform(0.0, 0.2), rng.uniform(0.8, 1.0)
        start, end = first + begin * (last - first), first + finish * (last - first)
        if k == 4:
            end = start + motion("together", points, 5)
        aside = rng.permutation(len(points))[: len(points) // 10]
        end[aside] += 0.3 * rng.standard_normal((len(aside), 3))
        ways.append((start, end + 1e-3 * rng.standard_normal(points.shape)))
    return ways


@pytest.mark.parametrize("thick", [False, True])
def test_candidates_made_of_earlier_ones_serve_as_well_as_fresh_ones(thick: bool) -> None:
    rng = np.random.default_rng(1)
    points, faces = union(sheet(8), (sheet(8)[0] + [0.03, 0.02, 0.08], sheet(8)[1]))
    points = np.concatenate([points, rng.uniform([0, 0, 0.02], [1, 1, 0.06], (40, 3))])
    loose, radii = np.arange(len(points) - 40, len(points)), rng.uniform(0, 0.01, len(points)) if thick else 0.0
    geometry = CollisionGeometry(points, faces, 0.05, points=loose, radii=radii)
    bounds: list[float] = []
    margin, kept, shared = 0.025, None, 0
    for start, end in chain_of_ways(points, 8):
        fresh = geometry.candidates(start, end)
        kept = geometry.candidates(start, end, margin=margin, before=kept)
        shared += not np.array_equal(kept.start, start)
        assert all(len(set(part)) == len(part) for part in rows(kept.pairs))
        assert geometry.covers(kept, start, end)
        for step in (0.0, 0.4, 1.0):
            there = start + step * (end - start)
            expected, found = geometry.active_set(there, fresh), geometry.active_set(there, kept)
            assert len(expected) > 50
            assert all(pairs.same_as(found.kinds()[kind]) for kind, pairs in expected.kinds().items())
            aside = rng.standard_normal(points.shape)
            beside = there + 0.5 * margin * aside / np.linalg.norm(aside, axis=1, keepdims=True)
            expected, found = geometry.active_set(beside), geometry.active_set(beside, kept)
            assert all(pairs.same_as(found.kinds()[kind]) for kind, pairs in expected.kinds().items())
        if not thick:  # else pieces overlap at once
            bounds.append(geometry.step_bound(start, end, kept, start_is_free=True))
            assert bounds[-1] == geometry.step_bound(start, end, fresh, start_is_free=True)
    assert shared == 6  # all but the first way and the one that is another for all
    assert thick or 0 < min(bounds) < max(bounds) < 1


def test_places_between_covered_ones_are_covered() -> None:
    """The time at which most vertices are nearest to the way is not the one at which all are near enough."""
    points, faces = union(sheet(4), (sheet(4)[0] + [0.03, 0.02, 0.2], sheet(4)[1]))
    geometry, margin, way = CollisionGeometry(points, faces, 0.1), 0.025, np.array([0.2, 0.0, 0.0])
    before = geometry.candidates(points, points + way, margin=margin)
    longer = np.array([0.45 * margin, 0.0, 0.0])
    start, end = points - longer, points + way + longer
    end[0] += [0.0, 1.0, 0.0]
    kept = geometry.candidates(start, end, margin=margin, before=before)
    assert not np.array_equal(kept.start, start)
    assert geometry.covers(kept, start, end)
    for step in np.linspace(0.0, 1.0, 21):
        assert geometry.covers(kept, start + step * (end - start))
    aside = start + 0.1 * (end - start)
    aside[0, 2] += 1.1 * margin
    assert not geometry.covers(kept, aside)


def test_candidates_made_of_earlier_ones_do_not_depend_on_the_number_of_threads() -> None:
    points, faces = union(sheet(8), (sheet(8)[0] + [0.03, 0.02, 0.08], sheet(8)[1]))
    found = []
    for threads in (1, 3):
        geometry = CollisionGeometry(points, faces, 0.05, runtime=load_runtime(find_compiler(), threads))
        kept = None
        for start, end in chain_of_ways(points, 5):
            kept = geometry.candidates(start, end, margin=0.025, before=kept)
            found.append((kept.pairs.edge_edge.tobytes(), kept.pairs.vertex_triangle.tobytes()))
    assert found[:5] == found[5:]


def test_earlier_candidates_of_less_reach_or_another_surface_are_not_used() -> None:
    points, faces = union(sheet(4), (sheet(4)[0] + [0.03, 0.02, 0.2], sheet(4)[1]))
    geometry, other = CollisionGeometry(points, faces, 0.3), CollisionGeometry(points, faces, 0.3)
    fresh = rows(geometry.candidates(points).pairs)
    for before in (geometry.candidates(points, distance=0.0), other.candidates(points), None):
        assert rows(geometry.candidates(points, before=before).pairs) == fresh
    small = geometry.candidates(points, margin=0.01)
    assert len(geometry.candidates(points, margin=0.5, before=small)) > len(small)


def test_edges_that_have_shrunk_to_points_are_still_seen() -> None:
    rods = np.array([[0.0, 0, 0], [2, 0, 0], [0, 0, 1], [3, 0, 1]])
    geometry = CollisionGeometry(rods, np.empty((0, 3)), 0.1, edges=[[0, 1], [2, 3]])
    points = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0.05], [0, 0, 0.05]])
    assert geometry.active_set(points).minimum_distance == pytest.approx(0.05)
    through = points + np.array([[0, 0, 0.1]] * 2 + [[0.0, 0, 0]] * 2)
    assert geometry.step_bound(points, through) == pytest.approx(0.45)


@pytest.mark.parametrize("gap", [1e-5, 1e-7, 1e-12])
def test_a_box_slides_along_the_ground_at_any_gap(gap: float) -> None:
    """By a third of its size, with every pair of the contact at the gap; a step down by more than it is stopped."""
    points, faces = union((3 * sheet(2)[0] - 1, sheet(2)[1]), move(box(), (0.0, 0.0, gap - 1)))
    geometry = CollisionGeometry(points, faces, 10 * gap)
    moves = np.arange(len(points))[:, None] >= len(sheet(2)[0])
    begun = time.perf_counter()
    assert geometry.step_bound(points, points + moves * [0.3, 0.2, 0.0]) == 1.0
    down = geometry.step_bound(points, points + moves * [0.3, 0.2, -2 * gap])
    assert time.perf_counter() - begun < 1.0
    assert down == pytest.approx(0.45, rel=0.02)


@pytest.mark.parametrize("seed", [35, 189, 193, 238, 367])
def test_edges_end_behind_end_on_nearly_one_line(seed: int) -> None:
    """They are 0.25 apart; where their lines cross is rounding, and seemed to be a place at which they touch."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-10, -6)
    rods = np.array([[0.0, 0, 0], [1, 0, 0], [1.25, 0, 0], [2.5, 0, 0]]) + size * rng.standard_normal((4, 3))
    geometry = CollisionGeometry(rods, np.empty((0, 3)), 1.0, edges=[[0, 1], [2, 3]])
    assert geometry.active_set(rods).minimum_distance == pytest.approx(0.25, abs=1e-5)
    assert geometry.step_bound(rods, rods + 1e-3 * rng.standard_normal((4, 3))) == 1.0


def rows(pairs: SurfacePairs) -> tuple[list[tuple[int, ...]], list[tuple[int, ...]]]:
    """Both kinds of pairs, sorted."""
    return sorted(tuple(row) for row in pairs.edge_edge.tolist()), sorted(
        tuple(row) for row in pairs.vertex_triangle.tolist()
    )
