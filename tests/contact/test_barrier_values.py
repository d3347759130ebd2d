"""The barrier with units, through a scene's own energies, against the IPC Toolkit; its weights against NumPy.

Every entry of an active set is one collision of ipctk's, with a weight from areas that NumPy computes here.
"""

from __future__ import annotations

from collections import Counter

import ipctk
import mpmath
import numpy as np
import pytest
from collision_scenes import SCENES, Floats, move, renumbered, union

from yasps import Scene
from yasps.contact import KINDS, BarrierContact, Pairs, Plane
from yasps.contact.surface_measures import FLAT_SHARE

KAPPA = 3e4
FEATURES = {"mollified_edge_edge": "EA_EB", "mollified_point_edge": "EA0_EB", "mollified_point_point": "EA0_EB0"}


def scene_of(points: Floats, faces: np.ndarray, dhat: float, **options: object) -> tuple[Scene, BarrierContact]:
    scene = Scene("surface")
    vertices = scene.add_mesh("mesh").add_primitive("vertices", len(points))
    scene.add_minimize_target(vertices.add_attribute("position", 3, 1, value=points))
    contact = BarrierContact(
        scene.mesh,
        vertices,
        faces,
        activation_distance=dhat,
        **{"stiffness": KAPPA, "projection": "none"} | options,  # type: ignore[arg-type]
    )
    return scene, contact


def areas_of(points: Floats, faces: np.ndarray, edges: np.ndarray) -> tuple[Floats, Floats]:
    """A third of the areas of all triangles at each vertex, and at each edge the part of it that counts; the last edge
    is none."""
    corners = points[faces]
    normals = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    of_vertex = np.zeros(len(points))
    np.add.at(of_vertex, faces, area[:, None] / 3)
    of_edge = np.zeros(len(edges) + 1)
    for number, edge in enumerate(edges):
        own = np.isin(faces, edge).sum(axis=1) == 2
        flat = (np.linalg.norm(normals[own].sum(axis=0)) / area[own].sum()) ** 2 if own.sum() == 2 else 0.0
        of_edge[number] = area[own].sum() / 3 * (1 - (1 - FLAT_SHARE) * flat)
    return of_vertex, of_edge


def weights_of(name: str, pairs: Pairs, of_vertex: Floats, of_edge: Floats) -> Floats:
    """Weights [m^2] of the entries of a kind."""
    of_edges = of_edge[pairs.edges].min(axis=1)
    if "edge_edge" in name or "mollified" in name:
        return of_edges
    if name == "point_triangle":
        return 0.5 * of_vertex[pairs.vertices[:, 0]]
    return 0.5 * (pairs.counts * of_vertex[pairs.vertices[:, :2]]).sum(axis=1) + of_edges


def collision_of(name: str, x: Floats) -> ipctk.NormalCollision:
    """ipctk's collision of a pair in the order of `KINDS`, whose vertices are alone in the world; and its edges."""
    if name == "point_point":
        return ipctk.VertexVertexNormalCollision(0, 1)
    if name == "point_edge":
        return ipctk.EdgeVertexNormalCollision(0, 0)
    if name == "point_triangle":
        return ipctk.FaceVertexNormalCollision(0, 0)
    if name == "edge_edge":
        return ipctk.EdgeEdgeNormalCollision(0, 1, 0.0, ipctk.EdgeEdgeDistanceType.EA_EB)
    (a, b), (c, d) = KINDS[name].edges or ((0, 0), (0, 0))
    threshold = ipctk.edge_edge_mollifier_threshold(x[a], x[b], x[c], x[d])
    return ipctk.EdgeEdgeNormalCollision(0, 1, threshold, getattr(ipctk.EdgeEdgeDistanceType, FEATURES[name]))


def order_of(name: str) -> list[int]:
    """Our vertices in the order of ipctk's stencil: edges one after another, a vertex before its edge or triangle."""
    edges = KINDS[name].edges
    return [*edges[0], *edges[1]] if edges else list(range(KINDS[name].arity))


def oracle(contact: BarrierContact, points: Floats, faces: np.ndarray, dhat: float) -> tuple[float, Floats, Floats]:
    """Potential, gradient and Hessian of all entries."""
    potential = ipctk.BarrierPotential(ipctk.ClampedLogBarrier(), dhat, KAPPA)
    areas = areas_of(points, faces, contact.geometry.edges)
    value, gradient, hessian = 0.0, np.zeros(points.size), np.zeros((points.size, points.size))
    for name, pairs in contact.active.kinds().items():
        for row, weight in zip(pairs.vertices, weights_of(name, pairs, *areas), strict=True):
            ids = row[order_of(name)]
            x = points[ids].reshape(-1)
            collision = collision_of(name, points[row])
            collision.weight = weight / dhat**3
            dofs = (3 * ids[:, None] + np.arange(3)).reshape(-1)
            value += potential(collision, x)
            gradient[dofs] += potential.gradient(collision, x)
            hessian[np.ix_(dofs, dofs)] += potential.hessian(collision, x)
    return value, gradient, hessian


def test_potential_gradient_and_hessian_are_those_of_ipctk() -> None:
    kinds: Counter[str] = Counter()
    for seed, name in enumerate(SCENES):
        mesh, dhat = SCENES[name]
        points, faces = renumbered(mesh, seed)
        scene, contact = scene_of(points, faces, dhat)
        kinds.update({kind: len(pairs) for kind, pairs in contact.active.kinds().items()})
        value, gradient, hessian = oracle(contact, points, faces, dhat)
        assert scene.total_energy() == pytest.approx(value, rel=1e-11)
        (found,) = scene.gradient()
        np.testing.assert_allclose(found, gradient, rtol=0, atol=1e-11 * np.abs(gradient).max())
        exact = scene.hessian(projected=False).to_scipy().toarray()
        np.testing.assert_allclose(exact, hessian, rtol=0, atol=1e-10 * np.abs(hessian).max())
    assert set(kinds) == set(KINDS)
    assert min(kinds.values()) >= 2, kinds


@pytest.mark.parametrize("radius", [0.0, 0.03])
def test_barrier_against_many_digits(radius: float) -> None:
    """-kappa A d_hat (t - 1)^2 log(t) at distances from 1e-6 d_hat to almost d_hat, its slope from the gradient."""
    dhat, area = 0.1, 2.0 / 3.0
    for share in (1e-6, 1e-3, 0.3, 0.9, 1 - 1e-6):
        height = 2 * radius + share * dhat
        points, faces = union(
            (np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]), np.array([[0, 1, 2]], np.int32)),
            (np.array([[0.3, 0.3, height], [1.3, 0.3, 3.0], [0.3, 1.3, 3.0]]), np.array([[0, 1, 2]], np.int32)),
        )
        scene, contact = scene_of(points, faces, dhat, radii=radius, objects={"lower": 3, "upper": 3})
        assert len(contact.active.point_triangle) == len(contact.active) == 1
        area = 0.5 * areas_of(points, faces, contact.geometry.edges)[0][3]
        with mpmath.workdps(40):
            z, xi, d = mpmath.mpf(height), 2 * mpmath.mpf(radius), mpmath.mpf(dhat)

            def energy(x: mpmath.mpf, xi: mpmath.mpf = xi, d: mpmath.mpf = d, area: float = area) -> mpmath.mpf:
                t = (x * x - xi * xi) / (d * d + 2 * xi * d)
                return -KAPPA * area * d * (t - 1) ** 2 * mpmath.log(t)

            value, slope = float(energy(z)), float(mpmath.diff(energy, z))
        # What the height's own rounding does to a gap that is a small part of it.
        rounding = 4e-16 * (1 + height / (share * dhat)) * (1 + 1 / (1 - share))
        assert scene.total_energy() == pytest.approx(value, rel=10 * rounding)
        assert scene.gradient()[0][3 * 3 + 2] == pytest.approx(slope, rel=10 * rounding)


def test_flat_interfaces_do_not_depend_on_the_mesh() -> None:
    """The force between a point's worth of surface and a plane: that of its half area, over a face and over an edge."""
    sheet, _ = SCENES["aligned sheets"]
    below = (sheet[0][: len(sheet[0]) // 2], sheet[1][: len(sheet[1]) // 2])
    forces = []
    for x, y in ((0.4, 0.45), (0.5, 0.5), (1 / 3, 0.4)):
        top = (np.array([[x, y, 0.05], [x + 0.6, y, 5.0], [x, y + 0.6, 5.0]]), np.array([[0, 1, 2]], np.int32))
        points, faces = union(below, top)
        scene, contact = scene_of(points, faces, 0.06)
        of_vertex, _ = areas_of(points, faces, contact.geometry.edges)
        forces.append(-scene.gradient()[0].reshape(-1, 3)[len(below[0]), 2] / of_vertex[-3])
    np.testing.assert_allclose(forces, forces[0], rtol=5e-3)


def test_pressure_is_that_of_the_law() -> None:
    """Points on a half-space have their whole area; the pressure is the derivative of the law, whatever d_hat is."""
    points, faces = move(SCENES["aligned sheets"][0], (0, 0, 0))
    found = []
    for dhat in (0.01, 0.1, 1.0):
        low = points.copy()
        low[:, 2] = 0.4 * dhat + np.where(points[:, 2] > 0.01, 10.0, 0.0)
        scene, contact = scene_of(
            low, faces, dhat, planes=[Plane("floor", (0, 0, 1), (0, 0, 0))], group=np.zeros(len(low), int)
        )
        of_vertex, _ = areas_of(low, faces, contact.geometry.edges)
        near = low[:, 2] < dhat
        found.append(-scene.gradient()[0].reshape(-1, 3)[near, 2] / of_vertex[near])
    ratio = 0.16
    slope = (1 - ratio) * (2 * np.log(ratio) - (1 - ratio) / ratio) * 2 * 0.4
    np.testing.assert_allclose(np.concatenate(found), -KAPPA * slope, rtol=1e-12)


def test_gradients_go_through_areas_and_thresholds() -> None:
    """d^2 E / (dx dX) for positions X at rest, which say how large areas are and from when on edges are parallel."""
    mesh, dhat = SCENES["edges crossing at 0.001"]
    points, faces = mesh
    scene = Scene("surface")
    vertices = scene.add_mesh("mesh").add_primitive("vertices", len(points))
    position = vertices.add_attribute("position", 3, 1, value=points)
    start = points + 0.02 * np.random.default_rng(2).standard_normal(points.shape)
    rest = vertices.add_constant("rest_position", 3, 1, value=start)
    contact = BarrierContact(scene.mesh, vertices, faces, activation_distance=dhat, stiffness=KAPPA, projection="none")
    scene.add_minimize_target(position)
    assert all(len(contact.active.kinds()[name]) for name in KINDS)
    found = scene.mixed_hessian(position, rest).toarray()
    for seed in range(3):
        way = np.random.default_rng(seed).standard_normal(points.shape)
        step = 1e-6
        gradients = []
        for sign in (-1, 1):
            rest.update_value(start + sign * step * way)
            gradients.append(scene.gradient()[0])
        rest.update_value(start)
        expected = (gradients[1] - gradients[0]) / (2 * step)
        np.testing.assert_allclose(found @ way.reshape(-1), expected, rtol=0, atol=1e-7 * np.abs(expected).max())
