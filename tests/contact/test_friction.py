"""Friction as a function of slip, as scenes compute it, against mpmath."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import Attribute, Scene, constant
from yasps.contact.friction import sliding_distance, smoothed_distance

Floats = NDArray[np.float64]
SLIP_LENGTH = 1e-5
SHARES = (0.0, 1e-300, 1e-20, 1e-9, 0.01, 0.5, 1 - 1e-9, 1.0, 1 + 1e-9, 1.5, 5.0, 9.999, 10.0, 10.5, 1e4)
"""Slips over the slip length."""


def derivatives(energy: Callable[[Attribute, Attribute], Attribute], slips: Floats) -> tuple[Floats, Floats, Floats]:
    """Value, gradient [n, 2] and exact Hessian [n, 2, 2] of an energy of a slip and a slip length."""
    mesh = Scene("slips").add_mesh("mesh")
    pairs = mesh.add_primitive("pairs", len(slips))
    slip = pairs.add_attribute("slip", 2, 1, value=slips)
    length = mesh.add_constant("slip_length", 1, 1, value=SLIP_LENGTH)
    mesh.scene.add_energy(pairs.add_attribute("energy", computed_attribute=energy(slip, length)))
    mesh.scene.add_minimize_target(slip)
    hessian = mesh.scene.hessian(projected=False).to_scipy().toarray()
    blocks = np.array([hessian[k : k + 2, k : k + 2] for k in range(0, len(hessian), 2)])
    return pairs["energy"].value, mesh.scene.gradient()[0].reshape(-1, 2), blocks


def slips_of(shares: tuple[float, ...]) -> Floats:
    """Slips of these lengths over the slip length, in all directions: y = |slip| to rounding."""
    angles = np.arange(len(shares)) * 2.4
    return SLIP_LENGTH * np.array(shares)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


def coefficient(y: mpmath.mpf, static: float, kinetic: float) -> mpmath.mpf:
    """The coefficient of friction at a slip."""
    q = min(max((y / mpmath.mpf(SLIP_LENGTH) - 1) / 9, 0), 1)
    return static + (mpmath.mpf(kinetic) - static) * q**3 * (10 - 15 * q + 6 * q * q)


def force(y: mpmath.mpf, static: float, kinetic: float) -> mpmath.mpf:
    """Friction over the normal force: mu(y) f1(y)."""
    share = y / mpmath.mpf(SLIP_LENGTH)
    return coefficient(y, static, kinetic) * (share * (2 - share) if share < 1 else 1)


def expected(slip: Floats, static: float, kinetic: float) -> tuple[float, Floats, Floats]:
    """Value by quadrature, gradient and Hessian with 50 digits."""
    with mpmath.workdps(50):
        e = mpmath.mpf(SLIP_LENGTH)
        x = [mpmath.mpf(float(entry)) for entry in slip]
        y = mpmath.sqrt(x[0] ** 2 + x[1] ** 2)
        knots = [mpmath.mpf(0), *(k * e for k in (1, 10) if k * e < y), y]
        value = static * e / 3 + mpmath.quad(lambda s: force(s, static, kinetic), knots)
        steep = mpmath.diff(lambda s: force(s, static, kinetic), y, direction=1) if y > 0 else 2 * static / e
        flat = force(y, static, kinetic) / y if y > 0 else 2 * static / e
        along = np.array([entry / y for entry in x] if y > 0 else [1, 0], object)
        hessian = (steep - flat) * np.outer(along, along) + flat * np.eye(2, dtype=object)
        return float(value), (force(y, static, kinetic) * along).astype(float), hessian.astype(float)


@pytest.mark.parametrize(("static", "kinetic"), [(0.5, 0.5), (0.5, 0.3), (0.3, 0.5), (0.4, 0.0)])
def test_static_and_kinetic_friction_against_quadrature(static: float, kinetic: float) -> None:
    slips = slips_of(SHARES)
    value, gradient, hessian = derivatives(
        lambda slip, length: sliding_distance(slip, length, constant(static), constant(kinetic)), slips
    )
    for slip, v, g, h in zip(slips, value, gradient, hessian, strict=True):
        true_value, true_gradient, true_hessian = expected(slip, static, kinetic)
        assert v == pytest.approx(true_value, rel=1e-14)
        np.testing.assert_allclose(g, true_gradient, rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(h, true_hessian, rtol=1e-12, atol=4e-15 / SLIP_LENGTH)


def test_equal_coefficients_are_plain_coulomb_friction_to_the_last_bit() -> None:
    slips = slips_of(SHARES)
    plain = derivatives(lambda slip, length: 0.35 * smoothed_distance(slip, length), slips)
    both = derivatives(lambda slip, length: sliding_distance(slip, length, constant(0.35), constant(0.35)), slips)
    for a, b in zip(plain, both, strict=True):
        np.testing.assert_array_equal(a, b)


def test_all_static_friction_is_there_before_it_falls() -> None:
    """At the slip length the force is the static coefficient, and it goes down to the kinetic one without a jump."""
    _, gradient, _ = derivatives(
        lambda slip, length: sliding_distance(slip, length, constant(0.5), constant(0.3)),
        slips_of((1.0, 3.0, 5.5, 8.0, 10.0, 100.0)),
    )
    forces = np.linalg.norm(gradient, axis=1)
    assert forces[0] == pytest.approx(0.5, rel=1e-14)
    assert forces[2] == pytest.approx(0.4, rel=1e-14)
    np.testing.assert_allclose(forces[-2:], 0.3, rtol=1e-14)
    assert (np.diff(forces[:5]) < 0).all()
