"""Barrier energies of close pairs, the forces that follow from them, and the mollifier of nearly parallel edges.

Distances enter squared. A pair with offset xi (the sum of both radii) at distance d has the excess D - xi^2, D = d^2,
and is active where that is below (d_hat + xi)^2 - xi^2 = d_hat (d_hat + 2 xi) (Li et al. 2021, C-IPC, section 5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from yasps import Attribute


def excess_of(squared_distance: Attribute, offset: Attribute | None) -> Attribute:
    """D - xi^2 [m^2]; D where there is no offset."""
    return squared_distance if offset is None else squared_distance - offset * offset


def range_of(reach: Attribute, squared_reach: Attribute, offset: Attribute | None) -> Attribute:
    """The excess up to which a pair is active, d_hat^2 + 2 xi d_hat [m^2]."""
    return squared_reach if offset is None else squared_reach + 2 * reach * offset


def barrier(excess: Attribute, activation: Attribute, scale: Attribute) -> Attribute:
    """-scale (t - 1)^2 log(t) of t = excess / activation in (0, 1) [J] (Li et al. 2020, eq. 6, as in 2023, section 4).

    It grows without bound as t goes to 0 and reaches 0 at 1 with two continuous derivatives. scale [J]: kappa [Pa]
    times the area [m^2] times d_hat [m]. Without offset this is -kappa A (D - H)^2 log(D / H) / d_hat^3,
    H = d_hat^2: kappa is a pressure whatever the mesh, d_hat and the time step are.
    """
    ratio = excess / activation
    gap = 1 - ratio
    return -scale * gap * gap * ratio.log()


def barrier_slope(excess: Attribute, activation: Attribute, scale: Attribute) -> Attribute:
    """Derivative of `barrier` by the excess, negative [J/m^2]."""
    ratio = excess / activation
    gap = 1 - ratio
    return scale / activation * gap * (2 * ratio.log() - gap / ratio)


def paper_barrier(excess: Attribute, activation: Attribute, scale: Attribute) -> Attribute:
    """scale (D - H)^2 log(D / H)^2 of an excess 0 < D < H, its `activation` (paper, eq. 8).

    It grows without bound as D goes to 0 and reaches 0 at H with three continuous derivatives. scale: kappa [J/m^4].
    """
    gap = excess - activation
    ratio = (excess / activation).log()
    return scale * gap * gap * ratio * ratio


def paper_barrier_slope(excess: Attribute, activation: Attribute, scale: Attribute) -> Attribute:
    """Derivative of `paper_barrier` by the excess, negative [J/m^2]."""
    gap = excess - activation
    ratio = (excess / activation).log()
    return 2 * scale * gap * ratio * (ratio + gap / excess)


@dataclass(frozen=True)
class BarrierLaw:
    """A barrier: its energy and slope, as functions of excess, activation and scale, and the unit of its stiffness."""

    energy: Callable[[Attribute, Attribute, Attribute], Attribute]
    slope: Callable[[Attribute, Attribute, Attribute], Attribute]
    unit: str


BARRIERS: dict[str, BarrierLaw] = {
    "log": BarrierLaw(barrier, barrier_slope, "Pa"),
    "paper": BarrierLaw(paper_barrier, paper_barrier_slope, "J/m^4"),
}


def mollifier(first: Attribute, second: Attribute, threshold: Attribute) -> Attribute:
    """(c/e) (2 - c/e) with c = |u x v|^2 < e: takes the barrier of two edges to 0 as they become parallel.

    Li et al. 2020, eq. 24. threshold e: see `mollifier_threshold`.
    """
    normal = first.cross(second)
    ratio = normal.dot(normal) / threshold
    return ratio * (2 - ratio)


def mollifier_threshold(first: Attribute, second: Attribute) -> Attribute:
    """1e-3 |U|^2 |V|^2 of the edge vectors at rest (Li et al. 2020, eq. 24)."""
    return 1e-3 * first.dot(first) * second.dot(second)
