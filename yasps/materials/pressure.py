"""Pressure inside closed surfaces."""

from __future__ import annotations

from yasps import Attribute, ShapeMismatchError, as_attribute
from yasps.materials.scalar import Scalar


def enclosed_volume(positions: Attribute) -> Attribute:
    """What a triangle adds to the volume [m^3] of the closed surface it belongs to: x_0 . (x_1 x x_2) / 6.

    positions: 3x3, one vertex a row (a JOIN), counter-clockwise seen from outside. It is the volume over the triangle
    seen from the origin; only the sum over a closed surface has a meaning of its own (Gauss' theorem).
    """
    if positions.shape != (3, 3):
        raise ShapeMismatchError(f"a triangle has 3x3 positions, got {positions.path} {positions.shape}")
    return positions.det() / 6


def inner_pressure(positions: Attribute, pressure: Scalar) -> Attribute:
    """A triangle's share of the potential [J] of a constant pressure in a closed surface: -p times `enclosed_volume`.

    Its forces are p times the area along the normal, wherever the surface goes; over an open surface it is no
    potential of that. pressure [Pa]: inside less outside. The potential has no lower bound: something must hold the
    surface. Bonet and Wood 2008, section 8.4 (normal pressure forces).
    """
    return -as_attribute(pressure) * enclosed_volume(positions)
