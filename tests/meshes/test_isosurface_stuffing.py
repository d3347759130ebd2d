"""Isosurface stuffing: the angle bounds over every way to warp and cut a tetrahedron, and whole meshes."""

import itertools
from collections.abc import Iterator

import numpy as np
import pytest

from yasps.meshes import (
    CoarseLatticeError,
    MeshError,
    TetrahedralMesh,
    stuff_isosurface,
    stuff_isosurface_with_vertex_count,
)
from yasps.meshes.isosurface_stuffing import (
    ALPHA_LONG,
    ALPHA_SHORT,
    Lattice,
    cut_node,
    fill_stencils,
    inside_stencil,
    lattice_edges_between_signs,
    warp_lattice,
)
from yasps.meshes.tetrahedral_mesh import TET_EDGES, signed_volumes

SMALLEST_ANGLE, LARGEST_ANGLE = 10.7, 164.8
# The corners a0, a1 (cube corners) and b0, b1 (cube centres) of one lattice tetrahedron.
TET = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0.5, 0.5], [0.5, 0.5, -0.5]])
STEPS = [
    *(np.array(signs) * 0.5 for signs in itertools.product((-1, 1), repeat=3)),
    *(sign * axis for sign in (-1, 1) for axis in np.eye(3)),
]


def dihedral_angles(corners: np.ndarray) -> np.ndarray:
    """The six dihedral angles in degrees [m, 6] of tetrahedra given by their corners [m, 4, 3]."""
    angles = []
    for i, j in TET_EDGES:
        k, n = (v for v in range(4) if v not in (i, j))
        edge = corners[:, j] - corners[:, i]
        one = np.cross(edge, corners[:, k] - corners[:, i])
        two = np.cross(edge, corners[:, n] - corners[:, i])
        sine = np.linalg.norm(np.cross(one, two), axis=1)
        angles.append(np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", one, two))))
    return np.stack(angles, axis=1)


def ball(points: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(points, axis=1) - 1.0)


def torus(points: np.ndarray) -> np.ndarray:
    around = np.linalg.norm(points[:, :2], axis=1) - 1.0
    return np.asarray(np.hypot(around, points[:, 2]) - 0.4)


def bumpy(points: np.ndarray) -> np.ndarray:
    return ball(points) + 0.12 * np.sin(5 * points).sum(axis=1)


def alpha(p: int, q: int) -> float:
    return ALPHA_LONG if p // 2 == q // 2 else ALPHA_SHORT


def warps(pattern: tuple[int, ...]) -> Iterator[np.ndarray]:
    """The corners after every farthest warp that gives the tetrahedron these signs: each corner of sign zero has moved
    along one of its 14 lattice edges, or had sign zero from the start. A corner moves towards one of the other sign;
    two corners cannot have moved along one edge, nor three around a triangle, as the first to move ends that."""
    zeros = [i for i in range(4) if pattern[i] == 0]
    for moves in itertools.product([None, *range(14)], repeat=len(zeros)):
        moved = TET.copy()
        target = {}
        for zero, move in zip(zeros, moves, strict=True):
            if move is not None:
                step = STEPS[move]
                moved[zero] += step * (ALPHA_SHORT if move < 8 else ALPHA_LONG)
                goal = [i for i in range(4) if np.array_equal(TET[zero] + step, TET[i])]
                if goal:
                    target[zero] = goal[0]
        if not has_cycle(target) and signs_exist(pattern, target):
            yield moved


def has_cycle(target: dict[int, int]) -> bool:
    for start in target:
        end = start
        for _ in target:
            end = target.get(end, -1)
            if end == start:
                return True
    return False


def signs_exist(pattern: tuple[int, ...], target: dict[int, int]) -> bool:
    options = [(-1, 1) if sign == 0 else (sign,) for sign in pattern]
    return any(all(s[i] != s[j] for i, j in target.items()) for s in itertools.product(*options))


def test_angle_bounds_hold_for_every_warp_and_cut() -> None:
    worst = []
    for pattern in itertools.product((-1, 0, 1), repeat=4):
        stencil = inside_stencil(pattern)
        cuts = [(i, j) for i, j in TET_EDGES.tolist() if pattern[i] * pattern[j] < 0]
        if not stencil:
            continue
        corners = np.array(list(warps(pattern)))
        for ends in itertools.product((False, True), repeat=len(cuts)):
            nodes = np.full((len(corners), 10, 3), np.nan)
            nodes[:, :4] = corners
            for (i, j), far in zip(cuts, ends, strict=True):
                fraction = 1 - alpha(i, j) if far else alpha(i, j)
                nodes[:, cut_node(i, j)] = TET[i] + fraction * (TET[j] - TET[i])
            worst += [dihedral_angles(nodes[:, tet]) for tet in stencil]
    angles = np.concatenate(worst)
    assert len(angles) > 10_000
    assert angles.min() > SMALLEST_ANGLE
    assert angles.max() < LARGEST_ANGLE


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_angle_bounds_and_conformity_hold_on_random_lattices(seed: int) -> None:
    """Random signs at the lattice points and random cuts: far rougher than any surface."""
    random = np.random.default_rng(seed)
    lattice = Lattice(np.zeros(3), 1.0, (8, 8, 8))
    points = lattice.points()
    signs = random.choice([-1, 1], len(points)).astype(np.int8)
    tets, right_handed = lattice.tets_touching(signs < 0)
    edges, edge_of_tet = lattice_edges_between_signs(tets, signs)
    fraction = np.clip(random.normal(0.5, 0.13, len(edges)), 1e-9, 1 - 1e-9)
    cuts = points[edges[:, 0]] + fraction[:, None] * (points[edges[:, 1]] - points[edges[:, 0]])
    warp_lattice(points, signs, lattice.colors(), edges, fraction)
    assert {-1, 0, 1} == set(signs.tolist())
    filled = fill_stencils(np.hstack([tets, len(points) + edge_of_tet]), signs[tets], right_handed)
    nodes = np.concatenate([points, cuts])
    assert (signed_volumes(nodes, filled) > 0).all()
    angles = dihedral_angles(nodes[filled])
    assert angles.min() > SMALLEST_ANGLE
    assert angles.max() < LARGEST_ANGLE
    # Every triangle is shared by two tetrahedra, lies on the surface (no corner inside), or on the lattice's border.
    used, numbered = np.unique(filled, return_inverse=True)
    triangles = used[TetrahedralMesh(nodes[used], numbered.reshape(-1, 4)).surface_triangles()]
    node_signs = np.concatenate([signs, np.zeros(len(cuts), dtype=np.int8)])
    on_surface = (node_signs[triangles] == 0).all(axis=1)
    corners = nodes[triangles]
    outermost = ((corners < 1.0) | (corners > 7.0)).any(axis=(1, 2))
    assert on_surface.any()
    assert (on_surface | outermost).all()


@pytest.mark.parametrize(
    ("function", "reach", "euler"), [(ball, 1.1, 2), (torus, 1.5, 0), (bumpy, 1.6, 2)], ids=["ball", "torus", "bumpy"]
)
@pytest.mark.parametrize("spacing", [0.21, 0.13])
def test_meshes_are_sound(function, reach: float, euler: int, spacing: float) -> None:  # type: ignore[no-untyped-def]
    mesh = stuff_isosurface(function, (-reach,) * 3, (reach,) * 3, spacing)
    angles = dihedral_angles(mesh.vertices[mesh.tets])
    assert angles.min() > SMALLEST_ANGLE
    assert angles.max() < LARGEST_ANGLE
    triangles = mesh.surface_triangles()
    on_surface = np.unique(triangles)
    assert len(mesh.surface_pinches()) == 0
    assert len(on_surface) - len(mesh.surface_edges()) + len(triangles) == euler
    assert np.abs(function(mesh.vertices[on_surface])).max() < 1e-3
    inside = np.setdiff1d(np.arange(len(mesh.vertices)), on_surface)
    assert (function(mesh.vertices[inside]) < 0).all()


def test_volume_converges_at_second_order() -> None:
    exact = 4 / 3 * np.pi
    errors = [
        exact - stuff_isosurface(ball, (-1.1,) * 3, (1.1,) * 3, spacing).volumes().sum() for spacing in (0.2, 0.1)
    ]
    assert 3.0 < errors[0] / errors[1] < 5.5


def test_a_surface_through_lattice_points_is_exact() -> None:
    """The lattice has points on z = 0 and on x, y = 0; the function vanishes there, without a sign."""
    mesh = stuff_isosurface(lambda p: np.abs(p).max(axis=1) - 0.5, (-1, -1, -1), (1, 1, 1), 0.25)
    assert mesh.bounds[0].tolist() == [-0.5, -0.5, -0.5]
    assert mesh.bounds[1].tolist() == [0.5, 0.5, 0.5]
    assert len(mesh.surface_pinches()) == 0


def test_the_same_arguments_give_the_same_mesh() -> None:
    one, two = (stuff_isosurface_with_vertex_count(bumpy, (-1.6,) * 3, (1.6,) * 3, 700) for _ in range(2))
    assert np.array_equal(one.vertices, two.vertices)
    assert np.array_equal(one.tets, two.tets)
    assert abs(len(one.vertices) - 700) <= 35


def test_unfit_arguments_are_told() -> None:
    low, high = (-1.2,) * 3, (1.2,) * 3
    with pytest.raises(MeshError, match="spacing is 0"):
        stuff_isosurface(ball, low, high, 0)
    with pytest.raises(MeshError, match="lowest and its highest corner"):
        stuff_isosurface(ball, high, low, 0.2)
    with pytest.raises(MeshError, match="make the spacing larger"):
        stuff_isosurface(ball, low, high, 1e-4)
    with pytest.raises(MeshError, match="surface leaves its box"):
        stuff_isosurface(ball, (-0.5,) * 3, (0.5,) * 3, 0.2)
    with pytest.raises(MeshError, match=r"one value for each position"):
        stuff_isosurface(lambda p: p, low, high, 0.2)
    with pytest.raises(MeshError, match="The function gave nan at"):
        stuff_isosurface(lambda p: np.where(p[:, 0] > 1, np.nan, ball(p)), low, high, 0.2)
    with pytest.raises(MeshError, match="No lattice point is inside"):
        stuff_isosurface(lambda p: ball(p) + 2, low, high, 0.2)
    with pytest.raises(MeshError, match="nothing inside"):
        stuff_isosurface_with_vertex_count(lambda p: ball(p) + 2, low, high, 100)
    with pytest.raises(MeshError, match="one tetrahedron alone has four"):
        stuff_isosurface_with_vertex_count(ball, low, high, 3)
    with pytest.raises(MeshError, match="No lattice spacing gave 7 vertices"):
        stuff_isosurface_with_vertex_count(ball, low, high, 7)


def test_surfaces_that_touch_are_refused() -> None:
    """Two cones that meet tip to tip in the origin, which is a lattice point."""

    def cones(points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        return np.maximum(np.hypot(y, z) - 0.5 * np.abs(x), np.abs(x) - 0.9)

    with pytest.raises(CoarseLatticeError, match=r"touches itself at 1 places, first near \[0\.0, 0\.0, 0\.0\]"):
        stuff_isosurface(cones, (-1, -1, -1), (1, 1, 1), 0.125)
