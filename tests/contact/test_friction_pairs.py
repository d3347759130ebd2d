"""Friction of single pairs of every kind, degenerate and nearly parallel ones too, against 60 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from exact_pairs import exact, minus
from kind_pairs import exact_way, pairs_of
from numpy.typing import NDArray

from yasps import Scene, constant
from yasps.contact import KINDS
from yasps.contact.friction import slip_of, smoothed_distance

Floats = NDArray[np.float64]
SLIP_LENGTH = 1e-5
STRENGTH = 0.7


def ways_of(pairs: Floats) -> Floats:
    """Ways of all corners: pieces that don't move, that stick, slip a little and slide far."""
    rng = np.random.default_rng(4)
    lengths = SLIP_LENGTH * np.resize([0.0, 1e-6, 0.3, 0.99, 1.01, 30.0], len(pairs))
    return lengths[:, None, None] * rng.standard_normal(pairs.shape)


def computed(name: str, pairs: Floats, ends: Floats) -> tuple[Floats, Floats, Floats]:
    """Energies, gradients and exact Hessians of pairs whose corners went to the ends, each pair by itself."""
    kind = KINDS[name]
    mesh = Scene("pairs").add_mesh("mesh")
    vertices = mesh.add_primitive("vertices", pairs.shape[0] * kind.arity)
    position = vertices.add_attribute("position", 3, 1, value=ends.reshape(-1, 3))
    before = vertices.add_constant("before", 3, 1, value=pairs.reshape(-1, 3))
    pair = mesh.add_primitive("pair", len(pairs))
    numbers = np.arange(vertices.num_instances).reshape(len(pairs), -1)
    corners = pair.add_connectivity("corners", vertices, numbers, kind.arity)
    x = pair.add_attribute("x", through=corners, source=position)
    lagged = pair.add_attribute("lagged", through=corners, source=before)
    slip = slip_of(kind, x - lagged, lagged)
    energy = STRENGTH * smoothed_distance(slip, constant(SLIP_LENGTH))
    if kind.edges is not None:
        (a, b), (c, d) = kind.edges
        first, second = lagged.row(b) - lagged.row(a), lagged.row(d) - lagged.row(c)
        normal = first.cross(second)
        energy = energy * normal.dot(normal) / (first.dot(first) * second.dot(second)) * 2e3
    mesh.scene.add_energy(pair.add_attribute("friction", computed_attribute=energy))
    mesh.scene.add_minimize_target(position)
    size = 3 * kind.arity
    hessian = mesh.scene.hessian(projected=False).to_scipy().toarray()
    blocks = np.array([hessian[k : k + size, k : k + size] for k in range(0, len(hessian), size)])
    return pair["friction"].value, mesh.scene.gradient()[0].reshape(len(pairs), -1), blocks


def expected(name: str, pair: Floats, end: Floats) -> tuple[float, Floats, Floats]:
    """The same of one pair, from closest points in rational numbers."""
    kind = KINDS[name]
    with mpmath.workdps(60):

        def number(fraction: object) -> mpmath.mpf:
            return mpmath.mpf(fraction.numerator) / fraction.denominator  # type: ignore[attr-defined]

        corners = exact(pair)
        shares, direction = exact_way(name, corners)
        g = np.array([number(share) for share in shares], object)
        n = np.array([number(entry) for entry in direction], object)
        ways = [minus(after, before) for after, before in zip(exact(end), corners, strict=True)]
        way = np.array([[number(entry) for entry in row] for row in ways], object)
        plane = np.eye(3, dtype=object) - np.outer(n, n) / (n @ n)
        slip = plane @ (g @ way)
        y, e = mpmath.sqrt(slip @ slip), mpmath.mpf(SLIP_LENGTH)
        strength = mpmath.mpf(STRENGTH)
        if kind.edges is not None:
            u, v = (np.array([number(corners[q][k] - corners[p][k]) for k in range(3)], object) for p, q in kind.edges)
            strength *= 2000 * (1 - (u @ v) ** 2 / (u @ u) / (v @ v))
        slides = y >= e
        value = y if slides else e / 3 + y * y / e - y**3 / (3 * e * e)
        flat = 1 / y if slides else 2 / e - y / e**2
        steep = 0 if slides else 2 / e - 2 * y / e**2
        along = slip / y if y > 0 else slip
        small = flat * (plane - np.outer(along, along)) + steep * np.outer(along, along)
        gradient = strength * flat * np.outer(g, slip).ravel()
        hessian = strength * np.kron(np.outer(g, g), small)
        return float(strength * value), gradient.astype(float), hessian.astype(float)


@pytest.mark.parametrize("name", KINDS)
def test_friction_of_pairs(name: str) -> None:
    """What is lost of the place where nearly parallel edges are nearest, the mollifier takes away."""
    pairs = pairs_of(name)[:24]
    ends = pairs + ways_of(pairs)
    for pair, end, value, gradient, hessian in zip(pairs, ends, *computed(name, pairs, ends), strict=True):
        true_value, true_gradient, true_hessian = expected(name, pair, end)
        way = SLIP_LENGTH + np.abs(end - pair).max()
        assert value == pytest.approx(true_value, rel=1e-10, abs=1e-10 * STRENGTH * way)
        np.testing.assert_allclose(gradient, true_gradient, rtol=0, atol=1e-10 * STRENGTH)
        np.testing.assert_allclose(hessian, true_hessian, rtol=0, atol=1e-10 * STRENGTH / SLIP_LENGTH)
