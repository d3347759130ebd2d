"""Springs between two points."""

from __future__ import annotations

from yasps import Attribute, ShapeMismatchError, as_attribute
from yasps.materials.scalar import Scalar


def spring(positions: Attribute, rest_length: Scalar, stiffness: Scalar) -> Attribute:
    """Energy [J] of a spring between two points: k/2 (l - L)^2, l their distance.

    positions: 2x3 (a JOIN); rest_length L [m]; stiffness k [N/m]. A rod of Young's modulus E and cross-section A is a
    spring of k = E A / L. At l = 0 there is no derivative, unless L is 0.
    """
    if positions.shape != (2, 3):
        raise ShapeMismatchError(f"a spring has 2x3 positions, got {positions.path} {positions.shape}")
    excess = (positions.row(1) - positions.row(0)).norm() - as_attribute(rest_length)
    return 0.5 * as_attribute(stiffness) * excess * excess
