"""Inertia of a time step, and external forces."""

from __future__ import annotations

from collections.abc import Sequence

from yasps import Attribute, as_attribute
from yasps.frontend.language.arrays import real_numbers
from yasps.materials.scalar import Scalar


def inertia(position: Attribute, predicted: Attribute, mass: Scalar, time_step: Scalar) -> Attribute:
    """Inertia term [J] of backward Euler: m / (2 dt^2) |x - (x_n + dt v_n)|^2.

    predicted: x_n + dt v_n, a constant; mass [kg]; time_step [s].
    """
    offset = position - predicted
    step = as_attribute(time_step)
    return 0.5 * as_attribute(mass) / (step * step) * offset.dot(offset)


def gravity(
    position: Attribute, mass: Scalar, acceleration: Sequence[float] | Attribute = (0.0, 0.0, -9.8)
) -> Attribute:
    """Potential [J] of a uniform field: -m a . x. acceleration [m/s^2], numbers or a 3x1 attribute."""
    field = acceleration if isinstance(acceleration, Attribute) else real_numbers(acceleration, "the acceleration")
    return as_attribute(mass) * position.reshape(3, 1).dot(-field)


def dead_load(position: Attribute, force: Attribute) -> Attribute:
    """Potential [J] of a force [N] on a vertex that keeps its direction: -f . x. Both 3x1."""
    return -position.reshape(3, 1).dot(force)


def anchor(position: Attribute, place: Attribute, stiffness: Scalar) -> Attribute:
    """Energy [J] of a spring of rest length 0 that holds a vertex at a place: k/2 |x - a|^2. stiffness k [N/m]."""
    offset = position.reshape(3, 1) - place.reshape(3, 1)
    return 0.5 * as_attribute(stiffness) * offset.dot(offset)
