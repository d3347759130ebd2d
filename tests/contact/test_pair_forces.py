"""Forces of pairs in closed form against complex steps of the energy, written down plainly."""

from __future__ import annotations

import numpy as np
import pytest

from yasps.contact.kinds import KINDS
from yasps.contact.pair_forces import barrier_slopes, closest_points, friction_slopes, lagged_points, mollifiers

STEP = 1e-30
RNG = np.random.default_rng(11)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray((a * b).sum(axis=-1))


def plain_weights(kind: str, x: np.ndarray) -> np.ndarray:
    """Closest-point weights from the normal equations; complex corners [n, arity, 3]."""
    one, nought = np.ones(len(x), x.dtype), np.zeros(len(x), x.dtype)
    if kind.endswith("point_point"):
        return np.stack([-one, one, nought, nought][: x.shape[1]], axis=1)
    if kind.endswith("point_edge"):
        e = x[:, 2] - x[:, 1]
        t = dot(x[:, 0] - x[:, 1], e) / dot(e, e)
        return np.stack([-one, 1 - t, t, nought][: x.shape[1]], axis=1)
    if kind == "point_triangle":
        a, b, o = x[:, 2] - x[:, 1], x[:, 3] - x[:, 1], x[:, 0] - x[:, 1]
    else:
        a, b, o = x[:, 1] - x[:, 0], x[:, 2] - x[:, 3], x[:, 2] - x[:, 0]
    aa, ab, bb, ao, bo = dot(a, a), dot(a, b), dot(b, b), dot(a, o), dot(b, o)
    det = aa * bb - ab * ab
    u, v = (ao * bb - bo * ab) / det, (bo * aa - ao * ab) / det
    if kind == "point_triangle":
        return np.stack([-one, 1 - u - v, u, v], axis=1)
    return np.stack([u - 1, -u, 1 - v, v], axis=1)


def plain_energy(kind: str, barrier: str, x: np.ndarray, radii: np.ndarray, reach: float) -> np.ndarray:
    g = plain_weights(kind, x)
    r = np.einsum("na,nad->nd", g, x)
    xi = (g * np.sign(g.real) * radii).sum(axis=1)
    excess, activation = dot(r, r) - xi * xi, reach * reach + 2 * reach * xi
    if barrier == "log":
        energy = -3.0 * (1 - excess / activation) ** 2 * np.log(excess / activation)
    else:
        energy = 3.0 * ((excess - activation) * np.log(excess / activation)) ** 2
    edges = KINDS[kind].edges
    if edges is not None:
        (a, b), (c, d) = edges
        normal = np.cross(x[:, b] - x[:, a], x[:, d] - x[:, c])
        ratio = dot(normal, normal) / 7.0
        energy = energy * ratio * (2 - ratio)
    return np.asarray(energy)


def pairs(kind: str) -> np.ndarray:
    """Corners whose closest points lie inside both pieces, about 0.3 apart."""
    count = 50
    first, second = RNG.normal(size=(2, count, 3))
    up = np.cross(first, second)
    up *= RNG.uniform(0.2, 0.4, (count, 1)) / np.linalg.norm(up, axis=1, keepdims=True)
    s, t = RNG.uniform(0.2, 0.8, (2, count, 1))
    if kind.endswith("edge_edge"):
        x = [-s * first, (1 - s) * first, up - t * second, up + (1 - t) * second]
    elif kind == "point_triangle":
        x = [up, -0.3 * first - 0.2 * second, 0.7 * first - 0.2 * second, 0.8 * second - 0.3 * first]
    elif kind.endswith("point_edge"):
        x = [up, -s * first, (1 - s) * first, up + second]
    else:
        x = [0 * up, up, first, second]
    return np.stack(x[: KINDS[kind].arity], axis=1) + RNG.normal(size=3)


@pytest.mark.parametrize("barrier", ["log", "paper"])
@pytest.mark.parametrize("kind", KINDS)
def test_slopes_are_those_of_complex_steps(kind: str, barrier: str) -> None:
    x = pairs(kind)
    radii, reach = RNG.uniform(0.0, 0.05, x.shape[:2]), 0.5
    points = closest_points(kind, x)
    np.testing.assert_allclose(points.weights, plain_weights(kind, x), atol=1e-13)
    np.testing.assert_allclose(points.way, np.einsum("na,nad->nd", points.weights, x), atol=1e-13)
    xi, of_xi = points.offset(kind, radii), points.offset_slopes(kind, radii)
    np.testing.assert_allclose(xi, (np.abs(points.weights) * radii).sum(axis=1), rtol=1e-14)
    excess, activation = dot(points.way, points.way) - xi**2, reach**2 + 2 * reach * xi
    energy, by_excess, by_activation = barrier_slopes(barrier, excess, activation, np.full(len(x), 3.0))
    slopes = by_excess[:, None, None] * (
        2 * points.weights[:, :, None] * points.way[:, None] - 2 * xi[:, None, None] * of_xi
    )
    slopes += 2 * reach * by_activation[:, None, None] * of_xi
    edges = KINDS[kind].edges
    if edges is not None:
        share, of_share = mollifiers(edges, x, np.full(len(x), 7.0))
        slopes = share[:, None, None] * slopes + energy[:, None, None] * of_share
        energy = share * energy
    np.testing.assert_allclose(energy, plain_energy(kind, barrier, x, radii, reach), rtol=1e-11)
    expected = np.zeros_like(slopes)
    for k in range(x.shape[1]):
        for axis in range(3):
            moved = x.astype(complex)
            moved[:, k, axis] += 1j * STEP
            expected[:, k, axis] = plain_energy(kind, barrier, moved, radii, reach).imag / STEP
    size = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(slopes / size, expected / size, atol=2e-12)
    np.testing.assert_allclose((slopes / size).sum(axis=1), 0.0, atol=2e-15)
    torque = np.cross(x - x.mean(axis=1, keepdims=True), slopes / size).sum(axis=1)
    np.testing.assert_allclose(torque, 0.0, atol=2e-14)


def test_friction_is_the_derivative_of_its_potential() -> None:
    """The potential is a sum of polynomials, whose complex steps are exact."""
    length, static, kinetic = 1e-3, 0.6, 0.25
    slip = length * np.array([1e-9, 1e-3, 0.5, 0.999, 1.0, 1.5, 4.0, 9.9, 10.0, 11.0, 50.0])
    potential, by_length = friction_slopes(slip, length, np.full(11, static), np.full(11, kinetic))

    def plain(y: np.ndarray) -> np.ndarray:
        smooth = np.where(y.real < length, length / 3 + y**2 / length - y**3 / (3 * length**2), y)
        q = y / (9 * length) - 1 / 9
        lost = np.where(q.real < 0, 0 * q, np.where(q.real < 1, q**4 * (2.5 - 3 * q + q**2), q - 0.5))
        return np.asarray(static * smooth - (static - kinetic) * 9 * length * lost)

    np.testing.assert_allclose(potential, plain(slip + 0j).real, rtol=1e-13)
    np.testing.assert_allclose(by_length * slip, plain(slip + 1j * STEP).imag / STEP, rtol=1e-12)
    np.testing.assert_allclose(by_length[[4, -1]] * slip[[4, -1]], [static, kinetic])
    assert friction_slopes(np.zeros(1), length, np.full(1, static), np.full(1, kinetic))[1] == 2 * static / length


def test_nearly_parallel_edges_have_their_closest_points_inside() -> None:
    x = pairs("mollified_edge_edge")
    weights, way = lagged_points("mollified_edge_edge", x)
    points = closest_points("mollified_edge_edge", x)
    np.testing.assert_allclose(weights, points.weights, atol=1e-12)
    np.testing.assert_allclose(way, points.way, atol=1e-12)
    x[:, 2:] = x[:, :2] + [[[0.1, 0.0, 0.3]]]  # exactly parallel, and the way between the middles is not orthogonal
    weights, way = lagged_points("mollified_edge_edge", x)
    assert ((np.abs(weights) >= 0) & (np.abs(weights) <= 1)).all()
    along = x[:, 1] - x[:, 0]
    away = dot(np.broadcast_to([0.1, 0.0, 0.3], along.shape), along) / dot(along, along)
    inside = np.abs(away) < 1  # the edges lie beside each other somewhere
    assert inside.any()
    cosines = dot(way, along) / np.linalg.norm(along, axis=1) / np.linalg.norm(way, axis=1)
    np.testing.assert_allclose(cosines[inside], 0.0, atol=1e-13)
