"""Vertices with radii: which pairs are active, how far a step may go, and pairs that are near already at rest."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from closest_pieces import nearest, nearest_of_edges
from collision_scenes import ONE, SCENES, TRIANGLE, Mesh, distances, move, sheet, union
from numpy.typing import NDArray

from yasps import IntersectionError, YaspsError
from yasps.contact import CollisionGeometry

Floats = NDArray[np.float64]
NAMES = ("shifted past each other", "edges crossing at 0.03", "box corner to corner")


def gaps_by_brute_force(geometry: CollisionGeometry, x: Floats, radii: Floats) -> Floats:
    """Of all pairs of edges, and of vertex and triangle, without a common vertex."""
    gaps = []
    triangles = [tuple(face) for face in geometry.triangles.tolist()]
    for v in sorted({corner for face in triangles for corner in face}):
        for face in triangles:
            if v not in face:
                distance, own, weights = nearest(x[v], face, x)
                gaps.append(distance - radii[v] - weights @ radii[list(own)])
    for a, b in combinations([tuple(edge) for edge in geometry.edges.tolist()], 2):
        if not set(a) & set(b):
            distance, first, second = nearest_of_edges(a, b, x)
            gaps.append(distance - first @ radii[list(a)] - second @ radii[list(b)])
    return np.array(gaps)


@pytest.mark.parametrize("name", NAMES)
def test_pairs_are_active_by_their_gap(name: str) -> None:
    (points, faces), reach = SCENES[name]
    points = points + 1e-4 * np.random.default_rng(0).standard_normal(points.shape)
    radii = np.random.default_rng(1).uniform(0, 0.3 * reach, len(points))
    geometry = CollisionGeometry(100 * points, faces, reach, radii=radii)  # nothing is near at rest
    active = geometry.active_set(points)
    gaps = gaps_by_brute_force(geometry, points, radii)
    assert sum(kind.weight.sum() for kind in active.kinds().values()) == (gaps < reach).sum() > 0
    assert active.minimum_gap == pytest.approx(gaps.min(), abs=1e-12)
    assert active.overlaps == (gaps.min() <= 0)
    assert active.minimum_distance > max(0.0, active.minimum_gap)
    assert all((kind.share == 1).all() for kind in active.kinds().values())


@pytest.mark.parametrize("improved_max", [False, True])
def test_equal_radii_are_a_larger_distance(improved_max: bool) -> None:
    """Twice the radius more; whatever the object, for what is far at rest."""
    (points, faces), reach = SCENES["turned"]
    thick = CollisionGeometry(
        100 * points, faces, reach - 0.06, radii=np.full(len(points), 0.03), improved_max=improved_max
    ).active_set(points)
    thin = CollisionGeometry(100 * points, faces, reach, improved_max=improved_max).active_set(points)
    for kind, pairs in thin.kinds().items():
        assert pairs.same_as(thick.kinds()[kind])
    assert thick.minimum_distance == thin.minimum_distance
    assert thick.minimum_gap == pytest.approx(thin.minimum_distance - 0.06, abs=1e-15)


def test_radii_of_nothing_are_none() -> None:
    (points, faces), reach = SCENES["shaken"]
    none = CollisionGeometry(points, faces, reach)
    zero = CollisionGeometry(points, faces, reach, radii=np.zeros(len(points)))
    end = points + 0.3 * np.random.default_rng(2).standard_normal(points.shape)
    assert len(none.candidates(points, end)) == len(zero.candidates(points, end))
    assert none.step_bound(points, end) == zero.step_bound(points, end)
    for kind, pairs in none.active_set(points).kinds().items():
        assert pairs.same_as(zero.active_set(points).kinds()[kind])


def two_triangles(gap: float) -> Mesh:
    return union((10 * (TRIANGLE - 0.3), ONE), move((TRIANGLE, ONE), (0.0, 0.0, gap)))


def test_a_step_keeps_a_tenth_of_the_gap() -> None:
    points, faces = two_triangles(3.0 + 0.5)
    radii = np.array([0.125] * 3 + [0.25] * 3)
    geometry = CollisionGeometry(points, faces, 0.1, radii=radii)
    height = points[3, 2] - points[0, 2]
    end = points - np.array([0, 0, 20.0]) * (np.arange(6) >= 3)[:, None]
    bound = geometry.step_bound(points, end)
    kept = (height - 20 * bound - 0.375) / (height - 0.375)
    assert 0.1 <= kept <= 0.102
    end[3:, 2] = points[0, 2] + 0.375 + 0.11 * (height - 0.375)
    assert geometry.step_bound(points, end) == 1.0


@pytest.mark.parametrize("name", ["edges crossing at 0.03", "box corner to corner"])
def test_steps_of_random_motions_keep_a_tenth_of_each_gap(name: str) -> None:
    (points, faces), reach = SCENES[name]
    radii = np.full(len(points), 0.3 * CollisionGeometry(points, faces, reach).active_set(points).minimum_distance)
    geometry = CollisionGeometry(100 * points, faces, reach, radii=radii)
    before = gaps_by_brute_force(geometry, points, radii)
    assert before.min() > 0
    bounds = []
    for seed in range(3):
        end = points + np.random.default_rng(seed).standard_normal(points.shape)
        everything = geometry.candidates(points, end, distance=10.0)
        step = geometry.step_bound(points, end, everything)
        bounds.append(step)
        kept = gaps_by_brute_force(geometry, points + step * (end - points), radii) / before
        assert kept.min() > 0.1 - 1e-9
        if step < 1:
            assert kept.min() < 0.102
    assert 0 < min(bounds) < 1


def test_radii_that_vary_in_a_piece_count_least() -> None:
    """A vertex comes down where a triangle is thick, and its thinnest place says how far; it is too near then."""
    points, faces = union((10 * TRIANGLE, ONE), move((TRIANGLE, ONE), (0.5, 0.5, 1.0)))
    points[4:, 2] += 3
    geometry = CollisionGeometry(points, faces, 0.1, radii=[0.5, 0.0, 0.0, 0.1, 0.1, 0.1], objects={"a": 3, "b": 3})
    end = points - np.array([0, 0, 3.0]) * (np.arange(6) >= 3)[:, None]
    there = points + geometry.step_bound(points, end) * (end - points)
    assert there[3, 2] == pytest.approx(0.1 + 0.1 * (1 - 0.1), rel=0.01)
    active = geometry.active_set(there)
    assert active.overlaps
    assert active.minimum_gap == pytest.approx(there[3, 2] - 0.1 - 0.45)


def test_a_cloth_thicker_than_its_cells_is_at_rest() -> None:
    """No pair is active at rest, and one that moves is bounded: nothing sticks to its own neighbours."""
    points, faces = sheet(12)
    reach, radius = 0.01, 0.11  # cells are 0.083
    geometry = CollisionGeometry(points, faces, reach, radii=np.full(len(points), radius))
    geometry.check_intersection_free(points)
    active = geometry.active_set(points)
    assert len(active) == 0
    assert geometry.step_bound(points, 3 * points) == 1.0
    wave = points + np.column_stack([0 * points[:, :2], 0.05 * np.sin(9 * points[:, 0])])
    assert geometry.step_bound(points, wave) == 1.0
    # Pressed together in x, its parts come near each other by a share of the radius, until a tenth is left.
    pressed = points * np.array([0.05, 1, 1])
    step = geometry.step_bound(points, pressed)
    assert 0 < step < 1
    there = points + step * (pressed - points)
    near = geometry.active_set(there)
    assert len(near) > 0
    assert not near.overlaps
    shares = np.concatenate([kind.share for kind in near.kinds().values()])
    assert shares.min() < 1
    assert shares.min() >= 0


def test_a_cloth_that_is_folded_keeps_its_whole_thickness() -> None:
    """Two far ends of one cloth have the whole offset, neighbours their share, which is that of the gap at rest."""
    points, faces = sheet(8)  # cells of 0.125
    reach, radius = 0.02, 0.1
    geometry = CollisionGeometry(points, faces, reach, radii=np.full(len(points), radius))
    folded = points.copy()
    angle = np.pi * np.clip((points[:, 0] - 0.3) / 0.4, 0, 1)
    bend = 0.4 / np.pi
    folded[:, 0] = np.minimum(points[:, 0], 0.3) + bend * np.sin(angle) - np.maximum(points[:, 0] - 0.7, 0)
    folded[:, 2] = bend * (1 - np.cos(angle))
    assert not geometry.active_set(folded).overlaps
    folded[:, 2] *= (2 * radius + 0.5 * reach) / (2 * bend)  # halves at that distance
    active = geometry.active_set(folded)
    far = [
        share
        for kind in active.kinds().values()
        for row, share in zip(kind.vertices, kind.share, strict=True)
        if np.ptp(points[row, 0]) > 0.5
    ]
    assert len(far) > 0
    assert min(far) == 1
    for kind in active.kinds().values():
        for row, share in zip(kind.vertices, kind.share, strict=True):
            least = min(np.linalg.norm(points[a] - points[b]) for a, b in combinations(row.tolist(), 2))
            assert share == 1 or least < 2 * radius + reach


def test_energy_is_continuous_where_the_closest_feature_changes() -> None:
    """A vertex of a thick cloth slides over the triangles around it, whose shares are different."""
    points, faces = sheet(4)
    points = points + 0.01 * np.random.default_rng(3).standard_normal(points.shape)
    reach, radius, middle = 0.12, 0.2, 12
    geometry = CollisionGeometry(points, faces, reach, radii=np.full(len(points), radius), improved_max=True)
    assert len(geometry.active_set(points)) == 0
    shares: set[float] = set()
    places: set[tuple[int, ...]] = set()

    def energy(along: float) -> float:
        x = points.copy()
        x[middle] += [0.14 * along - 0.07, 0.05 - 0.11 * along, 0.03]
        total = 0.0
        for name, kind in geometry.active_set(x).kinds().items():
            gaps = np.sqrt(distances(name, x[kind.vertices].astype(np.complex128)).real) - kind.share * 2 * radius
            assert (gaps > 0).all()
            total += float(np.sum(kind.counts.sum(axis=1) * -((gaps / reach - 1) ** 2) * np.log(gaps / reach)))
            shares.update(kind.share.tolist())
            places.update(map(tuple, kind.vertices[kind.counts.any(axis=1)].tolist()))
        return total

    energies = np.array([energy(along) for along in np.linspace(0, 1, 400)])
    assert energies.max() > 0
    assert len(shares) > 3
    assert len(places) > 10
    assert np.abs(np.diff(energies)).max() < 0.02 * np.ptp(energies)


def test_what_is_nearer_than_its_radii_is_refused() -> None:
    points, faces = union((TRIANGLE, ONE), move((TRIANGLE, ONE), (0.1, 0.1, 0.25)))
    points[4:, 2] += 1
    upper = np.array([0, 0, 1.0]) * (np.arange(6) >= 3)[:, None]
    objects = {"floor": 3, "cloth": 3}
    geometry = CollisionGeometry(points, faces, 0.1, radii=[0.2, 0.2, 0.2, 0.06, 0.06, 0.06], objects=objects)
    message = (
        r"positions: 1 pairs are nearer to each other than their radii; deepest: vertex 0 of 'cloth' and triangle"
        r" \(vertex 0 of 'floor', .*\), by 0\.01\. Move"
    )
    with pytest.raises(IntersectionError, match=message):
        geometry.check_intersection_free(points)
    with pytest.raises(IntersectionError, match=r"1 pairs touch \(closer beyond their radii than"):
        geometry.step_bound(points, points)
    assert geometry.active_set(points).overlaps
    higher = points + 0.02 * upper
    geometry.check_intersection_free(higher)
    assert geometry.active_set(higher).minimum_gap == pytest.approx(0.01)
    with pytest.raises(IntersectionError, match=r"vertex 0 of 'cloth' and .* are 0\.01 apart beyond their radii at"):
        geometry.check_way(higher, higher - 2 * upper)
    geometry.check_way(higher, higher + 0.1 * upper)


def test_wrong_radii_are_named() -> None:
    with pytest.raises(YaspsError, match=r"radii are one length >= 0 or one for each of 3 vertices, got \[1\]"):
        CollisionGeometry(TRIANGLE, ONE, 0.1, radii=[0.1])
    with pytest.raises(YaspsError, match="radii are one length >= 0 or one for each of 3 vertices"):
        CollisionGeometry(TRIANGLE, ONE, 0.1, radii=[0.1, -1.0, 0.1])
