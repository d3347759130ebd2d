"""Improved max: a vertex near many triangles counts as much as its nearest triangle alone."""

from __future__ import annotations

from collections import Counter, defaultdict
from itertools import chain, combinations

import ipctk
import numpy as np
import pytest
from closest_pieces import nearest
from collision_scenes import EDGES_OF_KIND, SCENES, Mesh, distances, move, sheet, union
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from yasps import meshes
from yasps.contact import CollisionGeometry

Floats = NDArray[np.float64]
Entries = dict[tuple[str, tuple[int, ...]], Counter[int]]
"""How often which vertex's area counts at each place; corners of triangles are sorted."""


def entries_of(geometry: CollisionGeometry, x: Floats) -> Entries:
    """Those of vertices and triangles."""
    found: Entries = {}
    for kind, pairs in geometry.active_set(x).kinds().items():
        for row, counts, edges in zip(
            pairs.vertices.tolist(), pairs.counts.tolist(), pairs.edges.tolist(), strict=True
        ):
            if edges != [len(geometry.edges)] * 2:
                assert counts == [0, 0]
                continue
            assert any(counts)
            assert counts[1] == 0 or kind == "point_point"
            key = kind, (row[0], *sorted(row[1:]))
            assert key not in found
            found[key] = Counter({v: count for v, count in zip(row[:2], counts, strict=True) if count})
    return found


def expected_entries(x: Floats, faces: NDArray[np.int32], reach: float, radii: Floats) -> Entries:
    """Inclusion and exclusion over all triangles, edges and corners that are without the vertex, from its words."""
    found: defaultdict[tuple[str, tuple[int, ...]], Counter[int]] = defaultdict(Counter)
    for v in range(len(x)):
        triangles = [tuple(face) for face in faces.tolist() if v not in face]
        edges = Counter(edge for triangle in triangles for edge in combinations(sorted(triangle), 2))
        pieces = [(triangle, 1) for triangle in triangles] + [(edge, 1 - count) for edge, count in edges.items()]
        for corner in set(chain(*triangles)):
            at_corner = sum(corner in triangle for triangle in triangles)
            others = sum(count - 1 for edge, count in edges.items() if corner in edge)
            pieces.append(((corner,), 1 - at_corner + others))
        for piece, count in pieces:
            distance, own, weights = nearest(x[v], piece, x)
            if count == 0 or distance - radii[v] - weights @ radii[list(own)] >= reach:
                continue
            kind = ("point_point", "point_edge", "point_triangle")[len(own) - 1]
            row = tuple(sorted((v, *own))) if len(own) == 1 else (v, *sorted(own))
            found[kind, row][v] += count
    kept = {key: Counter({v: count for v, count in times.items() if count}) for key, times in found.items()}
    return {key: times for key, times in kept.items() if times}


def random_sheet(seed: int, points: int, height: float = 0.0) -> Mesh:
    """A flat sheet of random triangles around the unit square."""
    rng = np.random.default_rng(seed)
    corners = np.array([[-1.0, -1], [-1, 2], [2, -1], [2, 2]])
    plane = np.concatenate([corners, rng.uniform(-0.8, 1.8, (points, 2))])
    triangles = Delaunay(plane).simplices.astype(np.int32)
    return np.column_stack([plane, np.full(len(plane), height)]), triangles


def above(surface: Mesh, points: Floats) -> Mesh:
    """The surface, and a thin triangle upright on each of the points; these come first."""
    count = len(points)
    up = np.array([[0.01, 0.0, 5.0], [0.0, 0.01, 5.0]])
    spikes = np.concatenate([points, points + up[0], points + up[1]])
    ids = np.arange(count)
    return union((spikes, np.column_stack([ids, ids + count, ids + 2 * count]).astype(np.int32)), surface)


def barrier(distance: Floats, reach: float) -> Floats:
    ratio = np.minimum(distance / reach, 1.0)
    return -((ratio - 1) ** 2) * np.log(ratio)


def sum_of_vertex(geometry: CollisionGeometry, x: Floats, vertex: int) -> float:
    """What the barrier at all entries of one vertex sums to."""
    total = 0.0
    for (kind, row), times in entries_of(geometry, x).items():
        distance = np.sqrt(distances(kind, x[None, list(row)].astype(np.complex128)).real)
        total += times[vertex] * float(barrier(distance, geometry.activation_distance)[0])
    return total


NAMES = ("nearly parallel", "turned a little")
FEW = {**SCENES, "turned a little": (union(sheet(3), move(sheet(3), (0.1, -0.2, 0.07), turn=0.6, noise=0.01)), 0.2)}


@pytest.mark.parametrize("name", NAMES)
def test_entries_are_those_of_inclusion_and_exclusion(name: str) -> None:
    (points, faces), reach = FEW[name]
    points, reach = points + 1e-4 * np.random.default_rng(0).standard_normal(points.shape), 1.5 * reach
    random = np.random.default_rng(1)
    for radii in (np.zeros(len(points)), random.uniform(0, 0.3 * reach, len(points))):
        far = 100 * points  # nothing is near at rest
        geometry = CollisionGeometry(far, faces, reach, radii=radii, improved_max=True)
        expected = expected_entries(points, faces, reach, radii)
        assert len(expected) > 20
        assert entries_of(geometry, points) == expected


@pytest.mark.parametrize("reach", [0.3, 3.0])
def test_a_vertex_over_a_flat_sheet_counts_once(reach: float) -> None:
    """Over faces, over edges and over vertices: the sum is the barrier of the nearest point, whatever the reach."""
    surface = random_sheet(1, 40)
    points, faces = surface
    rng = np.random.default_rng(2)
    inner = faces[np.abs(points[faces] - 0.5).max(axis=(1, 2)) < 0.8][:6]
    weights = np.concatenate(
        [rng.dirichlet([1, 1, 1], 6), np.tile([0.25, 0.75, 0], (6, 1)), np.tile([1, 0, 0], (6, 1))]
    )
    places = np.einsum("nk,nkd->nd", weights, points[np.tile(inner, (3, 1))]) + np.array([0, 0, 0.1])
    for place in places:
        x, triangles = above(surface, place[None])
        geometry = CollisionGeometry(x, triangles, reach, improved_max=True)
        assert sum_of_vertex(geometry, x, 0) == pytest.approx(float(barrier(np.array(0.1), reach)), rel=1e-12)


def test_with_a_small_reach_each_vertex_over_a_sheet_has_total_weight_one() -> None:
    """Exactly over a face, an edge and a vertex, of a regular sheet in rational numbers."""
    for place in ((0.5, 0.1875), (0.5, 0.125), (0.4375, 0.4375), (0.5, 0.5)):
        x, triangles = above(sheet(4), np.array([[*place, 0.03125]]))
        entries = entries_of(CollisionGeometry(x, triangles, 0.035, improved_max=True), x)
        assert sum(times[0] for times in entries.values()) == 1, place
        assert all(times[0] >= 0 for times in entries.values())


def test_a_vertex_over_a_ridge_counts_once() -> None:
    """Two planes that fall away from an edge, and a corner of three: the nearest point lies on them."""
    ridge = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0.5, -0.4], [-1, 0.4, -0.3], [1, 1.5, -0.4], [-1, 1.4, -0.5]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 4], [1, 4, 5], [1, 5, 3]], np.int32)
    for place in ([0.01, 0.4, 0.05], [0.3, 0.6, 0.0], [0.0, 1.0, 0.06], [-0.2, 0.5, 0.1]):
        x, triangles = above((ridge, faces), np.array([place]))
        reach = 0.2
        geometry = CollisionGeometry(x, triangles, reach, improved_max=True)
        closest = min(nearest(x[0], tuple(face), x)[0] for face in triangles[1:].tolist())
        total = sum_of_vertex(geometry, x, 0)
        assert total == pytest.approx(float(barrier(np.array(closest), reach)), rel=1e-12)


@pytest.mark.parametrize("shift", [(0.1, -0.2, 1.1), (0.9, 0.95, 1.05), (0.95, 0.02, 1.1)])
def test_weights_of_vertex_and_triangle_are_ipctks(shift: tuple[float, float, float]) -> None:
    """Of closed surfaces, with areas; ipctk gives every vertex a quarter of its area (a third of its triangles').

    At the rim of open surfaces it adds the vertices there, too; and it counts triangles that have the vertex itself,
    which are near here only where the reach is larger than they are.
    """
    cube = meshes.box((1.0, 1.0, 1.0), (3, 3, 3))
    used, ids = np.unique(cube.surface_triangles(), return_inverse=True)
    one = (cube.vertices[used], ids.reshape(-1, 3).astype(np.int32))
    points, faces = union(one, move(one, shift, turn=0.1, noise=0.01))
    reach = 0.2
    x = np.asfortranarray(points)
    mesh = ipctk.CollisionMesh(x, ipctk.edges(faces), np.asfortranarray(faces))
    pairs = ipctk.Candidates()
    pairs.build(mesh, x, reach, broad_phase=ipctk.BruteForce())
    pairs.ee_candidates = []
    collisions = ipctk.NormalCollisions()
    collisions.use_area_weighting = True
    collisions.collision_set_type = ipctk.NormalCollisions.IMPROVED_MAX_APPROX
    collisions.build(pairs, mesh, x, reach)
    expected: Counter[tuple[int, ...]] = Counter()
    kinds = (collisions.vv_collisions, collisions.ev_collisions, collisions.fv_collisions)
    for size, kind in zip((2, 3, 4), kinds, strict=True):
        for pair in kind:
            expected[tuple(sorted(pair.vertex_ids(mesh.edges, mesh.faces)[:size]))] += pair.weight
    geometry = CollisionGeometry(points, faces, reach, improved_max=True)
    found: Counter[tuple[int, ...]] = Counter()
    for (_, row), times in entries_of(geometry, points).items():
        found[tuple(sorted(row))] += sum(count * mesh.vertex_areas[v] / 4 for v, count in times.items())
    rounding = 1e-12 * float(mesh.vertex_areas.max())
    assert len(found) > 0
    assert {row for row, weight in expected.items() if abs(weight) > rounding} == set(found)
    for row, weight in found.items():
        assert weight == pytest.approx(expected[row], abs=rounding)


def test_edge_pairs_come_one_by_one_with_both_edges() -> None:
    numbers = Counter[str]()
    for name in ("nearly parallel", "edges crossing at 0.001", "edges crossing at 0.015", "turned"):
        (points, faces), reach = SCENES[name]
        geometry = CollisionGeometry(points, faces, reach, improved_max=True)
        assert geometry.edges.tolist() == sorted(sorted(edge) for edge in ipctk.edges(faces).tolist())
        kinds = geometry.active_set(points).kinds()
        for kind, ends in {"edge_edge": (0, 1, 2, 3), **EDGES_OF_KIND}.items():
            numbers[kind] += len(kinds[kind])
            for row, edges in zip(kinds[kind].vertices[:, ends].tolist(), kinds[kind].edges, strict=True):
                assert geometry.edges[edges].tolist() == sorted([sorted(row[:2]), sorted(row[2:])])
        found = [tuple(sorted(edges)) for pairs in kinds.values() for edges in pairs.edges.tolist()]
        expected = [
            (a, b)
            for (a, first), (b, second) in combinations(enumerate(geometry.edges.tolist()), 2)
            if not set(first) & set(second)
            if ipctk.edge_edge_distance(*points[first], *points[second]) < reach**2
        ]
        assert sorted(edges for edges in found if edges[0] < len(geometry.edges)) == expected
    assert min(numbers.values()) > 0, numbers


def test_without_improved_max_there_are_no_counts() -> None:
    (points, faces), reach = SCENES["turned"]
    active = CollisionGeometry(points, faces, reach).active_set(points)
    merged = CollisionGeometry(points, faces, reach, improved_max=True).active_set(points)
    assert merged.minimum_distance == active.minimum_distance
    for pairs in active.kinds().values():
        assert not pairs.counts.any()
        assert not pairs.edges.any()
        assert (pairs.share == 1).all()
    assert merged.point_triangle.vertices.tolist() == active.point_triangle.vertices.tolist()


def test_order_of_triangles_changes_nothing() -> None:
    points, faces = move(SCENES["shaken"][0], (0.0, 0.0, 0.0), noise=1e-3)
    first = CollisionGeometry(points, faces, 0.2, improved_max=True).active_set(points)
    shuffled = np.random.default_rng(4).permutation(faces)
    second = CollisionGeometry(points, shuffled, 0.2, improved_max=True).active_set(points)
    for kind, pairs in first.kinds().items():
        other = second.kinds()[kind]
        rows = np.column_stack([pairs.vertices, pairs.edges]).tolist()
        assert rows == sorted(rows)
        assert pairs.same_as(other) or kind == "point_triangle"
    assert first.point_triangle.counts.tolist() == [[1, 0]] * len(first.point_triangle)
