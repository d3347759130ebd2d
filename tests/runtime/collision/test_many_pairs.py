"""Pairs are looked at eight at a time by several threads: each as if it were alone, and the same for all threads."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from collision_scenes import SCENES, Mesh, move, sheet, union
from numpy.typing import NDArray
from single_pairs import PairGeometry, crossing_edges, vertices_over_thin_triangles

from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.collision import surface_pairs
from yasps.runtime.collision.surface_pairs import ClosePairs, Pieces, Surface, SurfacePairs, Thickness
from yasps.runtime.core.library import load_runtime

Floats = NDArray[np.float64]
Ids = NDArray[np.int32]
NONE = np.empty((0, 4), np.int32)
THREADS = [2, 5]


@pytest.fixture(autouse=True)
def few_pairs_are_enough_for_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface_pairs, "_FEW", 0)
    monkeypatch.setattr(surface_pairs, "_FEW_PAIRS", 0)


def surface_of(
    points: Floats, faces: Ids, threads: int, thickness: Thickness | None = None, loose: Ids | None = None
) -> Surface:
    sides = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0).astype(np.int32)
    ids = np.arange(len(points), dtype=np.int32)
    none = np.empty((0, 2), np.int32)
    pieces = Pieces(ids, sides, faces, none[:, 0] if loose is None else loose, none)
    runtime = load_runtime(find_compiler(), threads)
    return Surface(runtime, pieces, np.full(len(points), -1, np.int32), thickness)


def rough_sheets(seed: int) -> Mesh:
    """Two sheets so near that they have thousands of pairs, vertex on vertex and edge on edge but for some noise, and
    some vertices in one place."""
    mesh = union(sheet(14), move(sheet(14), (0.0, 0.0, 0.02)), move(sheet(9), (0.03, 0.02, 0.04), turn=0.1))
    points, faces = mesh
    rng = np.random.default_rng(seed)
    points = points + 1e-3 * rng.standard_normal(points.shape) * (rng.random((len(points), 1)) < 0.5)
    points[40] = points[41]
    points[70:72] = points[69]
    return points, faces


DEGENERATE: dict[str, Mesh] = {name: mesh for name, (mesh, _) in SCENES.items()} | {
    f"rough sheets {seed}": rough_sheets(seed) for seed in range(2)
}


def all_of(pairs: ClosePairs) -> bytes:
    return b"".join(np.ascontiguousarray(value).tobytes() for value in dataclasses.asdict(pairs).values())


@pytest.mark.parametrize("thick", [False, True], ids=["thin", "thick"])
@pytest.mark.parametrize("name", DEGENERATE)
def test_all_threads_find_the_same_to_the_last_bit(name: str, thick: bool) -> None:
    points, faces = DEGENERATE[name]
    rng = np.random.default_rng(1)
    end = points + 0.05 * rng.standard_normal(points.shape) - [0, 0, 0.03] * (points[:, 2:] > 0.01)
    thickness = None
    if thick:
        radii, objects = rng.uniform(0, 5e-3, len(points)), np.zeros(len(points), np.int32)
        thickness = Thickness(radii, objects, 0.02)
    loose = np.flatnonzero(rng.random(len(points)) < 0.2).astype(np.int32)

    def run(threads: int) -> list[bytes | float | None]:
        surface = surface_of(points, faces, threads, thickness, loose)
        pairs = surface.find(points, end, 0.05)
        found: list[bytes | float | None] = [pairs.edge_edge.tobytes(), pairs.vertex_triangle.tobytes()]
        for improved in (False, True):
            kinds, least, gap = surface.close_pairs(points, points, 0.05, pairs, improved)
            found += [least, gap, *map(all_of, kinds)]
        meetings = surface.meetings(points, end, points, pairs)
        found += [value.tobytes() for value in vars(meetings).values()]
        return [*found, surface.step_bound(points, end, points, 0.0, pairs)]

    alone = run(1)
    assert sum(len(part) for part in alone[:2] if isinstance(part, bytes)) > 0
    for threads in THREADS:
        assert run(threads) == alone


def pairs_of_all_sorts(triangle: bool) -> Floats:
    """[n, 4, 3]: at random, nearly parallel or thin, without length, vertex on vertex; mixed."""
    rng = np.random.default_rng(2)
    parts = [rng.standard_normal((60, 4, 3))]
    for angle in (0.0, 1e-12, 1e-8, 1e-5, 1e-3, 0.3):
        make = vertices_over_thin_triangles if triangle else crossing_edges
        parts.append(make(rng, 12, angle, 0.1))
    for a, b in ((0, 1), (2, 3), (1, 2), (0, 3)):
        same = rng.standard_normal((8, 4, 3))
        same[:, a] = same[:, b]
        parts.append(same)
    grid = rng.integers(0, 2, (80, 4, 3)).astype(np.float64)  # vertices exactly above each other
    return np.asarray(rng.permutation(np.concatenate([*parts, grid])))


def together(points: Floats, triangle: bool) -> tuple[Surface, SurfacePairs]:
    """All pairs in one scene without a common vertex."""
    rows = np.arange(4 * len(points), dtype=np.int32).reshape(-1, 4)
    surface = surface_of(points.reshape(-1, 3), np.empty((0, 3), np.int32), 2)
    return surface, SurfacePairs(NONE, rows) if triangle else SurfacePairs(rows, NONE)


@pytest.mark.parametrize("triangle", [False, True], ids=["edges", "triangle"])
def test_a_pair_is_the_same_among_others_as_alone(triangle: bool) -> None:
    points = pairs_of_all_sorts(triangle)
    surface, pairs = together(points, triangle)
    geometry = PairGeometry(triangle)
    distances = [geometry.distance(each)[0] for each in points]
    for reach in (np.inf, float(np.median(distances))):
        x = points.reshape(-1, 3)
        kinds, least, _ = surface.close_pairs(x, x, reach, pairs)
        found = {int(row[0]) // 4: (k, row % 4) for k, kind in enumerate(kinds) for row in kind.vertices}
        expected = [number for number, distance in enumerate(distances) if distance < reach]
        assert sorted(found) == expected
        assert least == min(distances)
        for number in expected:
            alone = geometry.surface.close_pairs(points[number], points[number], np.inf, geometry.pairs)[0]
            kind, vertices = found[number]
            (of_alone,) = [k for k, entries in enumerate(alone) if len(entries.vertices)]
            assert kind == of_alone
            used = (2, 3, 4, 4, 4, 4, 4)[kind]
            assert vertices[:used].tolist() == alone[kind].vertices[0, :used].tolist()


def test_a_normal_that_is_mostly_rounding_hides_no_pair() -> None:
    """By the formula of lines such edges seem to be farther apart than they are."""
    rng = np.random.default_rng(5)
    points = np.concatenate([crossing_edges(rng, 200, angle, 1e-7) for angle in (1e-11, 1e-10, 1e-9)])
    surface, pairs = together(points, False)
    x = points.reshape(-1, 3)
    kinds, _, _ = surface.close_pairs(x, x, 2e-7, pairs)
    geometry = PairGeometry(False)
    expected = [number for number, each in enumerate(points) if geometry.distance(each)[0] < 2e-7]
    assert sorted(int(row[0]) // 4 for kind in kinds for row in kind.vertices) == expected
    assert len(expected) > 300


@pytest.mark.parametrize("triangle", [False, True], ids=["edges", "triangle"])
def test_a_step_is_bounded_by_the_first_pair_to_meet(triangle: bool) -> None:
    points = pairs_of_all_sorts(triangle)
    rng = np.random.default_rng(3)
    geometry = PairGeometry(triangle)
    points = points[[geometry.distance(each)[0] > 0.02 for each in points]]
    split = 1 if triangle else 2
    apart = points[:, split:].mean(axis=1) - points[:, :split].mean(axis=1)
    ends = points + 0.2 * rng.standard_normal(points.shape)
    ends[:, split:] -= apart[:, None] * rng.uniform(0, 1.5, (len(points), 1, 1))
    alone = np.array([geometry.step_bound(*way) for way in zip(points, ends, strict=True)])
    assert 20 < (alone < 1).sum() < len(alone) - 20
    kept = np.ones(len(points), np.bool_)
    for _ in range(12):  # without the pairs that bound it the step is longer
        surface, pairs = together(points[kept], triangle)
        start, end = points[kept].reshape(-1, 3), ends[kept].reshape(-1, 3)
        bound = surface.step_bound(start, end, start, 0.0, pairs)
        assert bound == pytest.approx(alone[kept].min(), rel=0.02)
        meets = surface.meetings(start, end, start, pairs).vertices[:, 0] // 4
        assert meets.tolist() == np.flatnonzero(alone[kept] < 1).tolist()
        kept &= alone > alone[kept].min()


def test_a_pair_that_touches_is_seen_among_others() -> None:
    points = pairs_of_all_sorts(False)
    geometry = PairGeometry(False)
    points = points[[geometry.distance(each)[0] > 0.02 for each in points]]
    points[13, 3] = points[13, 0]
    surface, pairs = together(points, False)
    ways = points + 0.3 * np.random.default_rng(4).standard_normal(points.shape)
    assert surface.step_bound(points.reshape(-1, 3), ways.reshape(-1, 3), points.reshape(-1, 3), 1e-12, pairs) is None
