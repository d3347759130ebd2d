"""What contact and friction must give, by hand: the barrier's pressure, and backward Euler's own sliding block.

Nothing here uses yasps.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq


def pressure_over_stiffness(relative_gap: float) -> float:
    """Pressure over kappa at a gap of so many d_hat, below 1: -2 y beta'(y^2) with beta(t) = -(t - 1)^2 ln t.

    The energy of an area A at a distance d is A kappa d_hat beta(d^2 / d_hat^2), and its slope by d, over A, this.
    """
    t = relative_gap * relative_gap
    slope = -2 * (t - 1) * np.log(t) - (t - 1) ** 2 / t
    return float(-2 * relative_gap * slope)


def relative_gap(pressure: float, stiffness: float) -> float:
    """Gap over d_hat at which the barrier of this stiffness [Pa] bears this pressure [Pa]."""
    wanted = pressure / stiffness
    return float(brentq(lambda y: pressure_over_stiffness(y) - wanted, 1e-9, 1 - 1e-13, xtol=1e-15, rtol=1e-14))


def friction_share(speed: float, slip_speed: float) -> float:
    """f1 of the smoothed Coulomb law: 2 y - y^2 with y = speed / eps_v below 1, else 1."""
    y = min(speed / slip_speed, 1.0)
    return 2 * y - y * y


def next_speed(speed: float, drive: float, hold: float, dt: float, slip_speed: float = 0.0) -> float:
    """Speed after one step of backward Euler under the acceleration drive - hold * f1(speed), from a speed of 0 or
    more.

    slip_speed: eps_v [m/s]; 0 for Coulomb's law itself, where the block stops.
    """
    slipping = speed + dt * (drive - hold)
    if slipping >= slip_speed:
        return slipping
    if slip_speed == 0.0:
        return 0.0
    # v + dt hold (2 v / e - v^2 / e^2) = speed + dt drive, the smaller root.
    a, b, c = -dt * hold / slip_speed**2, 1 + 2 * dt * hold / slip_speed, -(speed + dt * drive)
    return float(-2 * c / (b + np.sqrt(b * b - 4 * a * c)))


def speeds(start: float, drive: float, hold: float, dt: float, *, steps: int, slip_speed: float = 0.0) -> list[float]:
    """Speeds after each of so many steps, see `next_speed`."""
    found = [start]
    for _ in range(steps):
        found.append(next_speed(found[-1], drive, hold, dt, slip_speed))
    return found[1:]


def creep_speed(drive: float, hold: float, slip_speed: float) -> float:
    """Speed at which smoothed friction that could bear `hold` bears `drive`, less than that: f1 = drive / hold."""
    return float(slip_speed * (1 - np.sqrt(1 - drive / hold)))
