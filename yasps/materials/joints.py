"""Energies of joints between two frames, each made of material points of a body.

A frame is 4x3: its origin [m], then three vectors, orthonormal when the joint is made: an axis and two across it. Where
it comes from, a rotation or points of soft tetrahedra, these functions need not know.
"""

from __future__ import annotations

from yasps import Attribute, as_attribute, atan2, constant, maximum, select
from yasps.materials.scalar import Scalar


def frame_of(positions: Attribute, weights: Attribute) -> Attribute:
    """A frame, 4x3, as weighted sums of four material points. positions: 4x3 (a JOIN) [m]; weights: 4x4, a row for the
    origin, adding up to 1, and one for each vector, adding up to 0."""
    return weights * positions


def held_together(first: Attribute, second: Attribute, stiffness: Scalar) -> Attribute:
    """Energy [J] that keeps two origins together: k/2 |o_2 - o_1|^2. stiffness k [N/m]."""
    gap = second.row(0) - first.row(0)
    return 0.5 * as_attribute(stiffness) * gap.dot(gap)


def aligned(first: Attribute, second: Attribute, stiffness: Attribute) -> Attribute:
    """Energy [J] that keeps vectors of two frames equal: the sum of r_i/2 |e_i2 - e_i1|^2. stiffness r: 3x1 [J]; 0 for
    those that may turn. For a small angle it is r/2 angle^2 for each of the two vectors that turn."""
    total = constant(0.0)
    for k in range(3):
        difference = second.row(k + 1) - first.row(k + 1)
        total = total + 0.5 * stiffness[k] * difference.dot(difference)
    return total


def on_the_axis(first: Attribute, second: Attribute, stiffness: Scalar) -> Attribute:
    """Energy [J] that keeps the second origin on the axis of the first frame: k/2 ((d . e_2)^2 + (d . e_3)^2), d from
    the first origin to the second one. stiffness k [N/m]."""
    way = second.row(0) - first.row(0)
    across, other = way.dot(first.row(2)), way.dot(first.row(3))
    return 0.5 * as_attribute(stiffness) * (across * across + other * other)


def joint_angle(first: Attribute, second: Attribute, reference: Scalar) -> Attribute:
    """Angle [rad] by which the second frame is turned against the first one about the axis, counter-clockwise seen
    against it: within pi of the reference, a constant, so that a reference that follows counts whole turns.

    atan2(e_3 . f_2 - e_2 . f_3, e_2 . f_2 + e_3 . f_3) of the vectors e and f across the axis, which averages over both
    where frames bend (as libuipc's revolute joint does).
    """
    e2, e3, f2, f3 = first.row(2), first.row(3), second.row(2), second.row(3)
    sine, cosine = e3.dot(f2) - e2.dot(f3), e2.dot(f2) + e3.dot(f3)
    reference = as_attribute(reference)
    s, c = reference.sin(), reference.cos()
    return reference + atan2(sine * c - cosine * s, cosine * c + sine * s)


def motor(angle: Attribute, aim: Scalar, stiffness: Scalar, torque: Scalar) -> Attribute:
    """Energy [J] of a motor: k/2 (angle - aim)^2 as long as its torque k |angle - aim| is below the largest one, from
    there on T (|angle - aim| - T / (2 k)), so that it pulls with the largest. aim [rad], stiffness k [N m / rad],
    torque T [N m]; a stiffness of 0 is no motor."""
    off = (angle - as_attribute(aim)).abs()
    stiffness, torque = as_attribute(stiffness), as_attribute(torque)
    return select(
        stiffness * off <= torque,
        0.5 * stiffness * off * off,
        torque * (off - 0.5 * torque / select(stiffness > 0, stiffness, constant(1.0))),
    )


def angle_limits(angle: Attribute, least: Scalar, most: Scalar, stiffness: Scalar) -> Attribute:
    """Energy [J] that grows beyond an angle's limits [rad]: k/3 of the cube of how far beyond; twice continuously
    differentiable. stiffness k [N m / rad^2]."""
    over = maximum(angle - as_attribute(most), constant(0.0))
    under = maximum(as_attribute(least) - angle, constant(0.0))
    return as_attribute(stiffness) / 3 * (over**3 + under**3)
