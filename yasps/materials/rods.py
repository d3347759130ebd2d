"""Energies of thin rods: chains of straight segments that stretch, bend and twist.

A segment may carry a material frame, one angle away from a reference frame. The reference frame of a segment is a
director (a unit vector across it) at the state where the step began; from there it goes along with the segment by
parallel transport, the smallest rotation between the two tangents. So a user keeps, as constants, the positions and
directors of that state, and renews them after each step (`transported_directors`, `reference_twists`). Bergou et al.
2008, "Discrete elastic rods"; Bergou et al. 2010, "Discrete viscous threads".
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, SceneError, ShapeMismatchError, as_attribute, atan2, concat_rows
from yasps.frontend.language.arrays import real_numbers
from yasps.materials.scalar import Scalar
from yasps.materials.springs import spring


def rod_stretching(positions: Attribute, rest_length: Scalar, stiffness: Scalar) -> Attribute:
    """Stretching energy [J] of a segment: E A / 2 (l / L - 1)^2 L.

    positions: 2x3, its ends (a JOIN); rest_length L [m]; stiffness E A [N]: Young's modulus times cross-section.
    """
    return spring(positions, rest_length, as_attribute(stiffness) / as_attribute(rest_length))


def curvature_binormal(positions: Attribute) -> Attribute:
    """(k b) of the vertex between two segments, 1x3, without a unit: 2 e x f / (|e| |f| + e . f).

    Its length is 2 tan(angle / 2) of the angle between the segments; it stands on both. positions: 3x3, the vertex
    before, this one, the next (a JOIN). Infinite where the rod is folded back. Bergou et al. 2008, eq. 1.
    """
    before, after = _edges(positions)
    return 2 * before.cross(after) / (before.norm() * after.norm() + before.dot(after))


def rod_bending(positions: Attribute, rest_length: Scalar, stiffness: Scalar) -> Attribute:
    """Bending energy [J] of the vertex between two segments, straight at rest, of a round rod: E I |k b|^2 / L.

    positions: 3x3, as `curvature_binormal` has them; rest_length L [m]: of both segments together; stiffness E I
    [N m^2], Young's modulus times the second moment of area, pi r^4 / 4. Bergou et al. 2008, section 4.2.1.
    """
    binormal = curvature_binormal(positions)
    return as_attribute(stiffness) / as_attribute(rest_length) * binormal.dot(binormal)


def material_curvature(positions: Attribute, previous: Attribute, directors: Attribute, angles: Attribute) -> Attribute:
    """Curvature of the vertex between two segments about the material axes, 2x1, without a unit.

    ((k b) . m_2, -(k b) . m_1), with the mean of both segments' axes: bending towards the first axis m_1, and towards
    the second. positions: 3x3, as `curvature_binormal` has them; previous: the same where the step began, constants;
    directors: 2x3, reference directors of the two segments at that state, constants; angles: 2x1, from the reference
    director to the first material axis, about the tangent, unknowns. Bergou et al. 2010, section 3.
    """
    binormal = curvature_binormal(positions)
    first, second = zip(*_material_axes(positions, previous, directors, angles), strict=True)
    return concat_rows([0.5 * binormal.dot(second[0] + second[1]), -0.5 * binormal.dot(first[0] + first[1])])


def rod_material_bending(
    curvature: Attribute, rest_curvature: Attribute, rest_length: Scalar, stiffness: Attribute
) -> Attribute:
    """Bending energy [J] of the vertex between two segments, of a rod of any cross-section: sum of
    B_k (kappa_k - kappa_0k)^2 / L over both axes.

    curvature: see `material_curvature`; rest_curvature: the same at rest, a constant 2x1; rest_length L [m]: of both
    segments together; stiffness: 2x1 [N m^2], B_1 against bending towards the first axis, B_2 towards the second.
    """
    change = curvature - rest_curvature.reshape(2, 1)
    return change.hadamard(change).dot(stiffness.reshape(2, 1)) / as_attribute(rest_length)


def rod_twist(
    positions: Attribute, previous: Attribute, directors: Attribute, angles: Attribute, reference_twist: Scalar
) -> Attribute:
    """Angle by which a rod is twisted at the vertex between two segments, 1x1, of any number of turns.

    The difference of the segments' angles, and the angle from the first reference frame, taken to the second segment by
    parallel transport, to the second reference frame. positions, previous, directors, angles: see `material_curvature`;
    reference_twist: the second of these angles where the step began, a constant (see `reference_twists`). Bergou et al.
    2010, section 3.
    """
    turned = as_attribute(reference_twist)
    before, after = (edge / edge.norm() for edge in _edges(positions))
    first, second = _reference_directors(positions, previous, directors)
    first = _transported(first, before, after)
    first = turned.cos() * first + turned.sin() * after.cross(first)
    change = atan2(first.cross(second).dot(after), first.dot(second))
    return angles[1] - angles[0] + turned + change


def rod_twisting(twist: Attribute, rest_twist: Scalar, rest_length: Scalar, stiffness: Scalar) -> Attribute:
    """Twisting energy [J] of the vertex between two segments: G J (m - m_0)^2 / L.

    twist m: see `rod_twist`; rest_twist m_0: the same at rest; rest_length L [m]: of both segments together; stiffness
    G J [N m^2], shear modulus times the torsion constant, pi r^4 / 2. Bergou et al. 2008, section 4.2.2.
    """
    change = twist - as_attribute(rest_twist)
    return as_attribute(stiffness) / as_attribute(rest_length) * change * change


def _edges(positions: Attribute) -> tuple[Attribute, Attribute]:
    if positions.shape != (3, 3):
        raise ShapeMismatchError(
            f"two segments that meet have 3x3 positions, got {positions.path} {positions.shape}: the vertex before, "
            "theirs, the next"
        )
    return positions.row(1) - positions.row(0), positions.row(2) - positions.row(1)


def _reference_directors(
    positions: Attribute, previous: Attribute, directors: Attribute
) -> tuple[Attribute, Attribute]:
    """The directors of both segments, taken from where the step began to the positions now."""
    if directors.shape != (2, 3):
        raise ShapeMismatchError(f"two segments have 2x3 directors, got {directors.path} {directors.shape}")
    moved = []
    for k, (old, new) in enumerate(zip(_edges(previous), _edges(positions), strict=True)):
        moved.append(_transported(directors.row(k), old / old.norm(), new / new.norm()))
    return moved[0], moved[1]


def _material_axes(
    positions: Attribute, previous: Attribute, directors: Attribute, angles: Attribute
) -> list[tuple[Attribute, Attribute]]:
    """First and second material axis of both segments."""
    if angles.size != 2:
        raise ShapeMismatchError(f"two segments have two angles, got {angles.path} {angles.shape}")
    axes = []
    moved = _reference_directors(positions, previous, directors)
    for edge, director, angle in zip(_edges(positions), moved, angles.reshape(2, 1), strict=True):
        across = (edge / edge.norm()).cross(director)
        axes.append((angle.cos() * director + angle.sin() * across, angle.cos() * across - angle.sin() * director))
    return axes


def _transported(vector: Attribute, start: Attribute, end: Attribute) -> Attribute:
    """The vector, orthogonal to the unit vector `start`, under the smallest rotation that takes start to `end`."""
    return vector - end.dot(vector) / (1 + start.dot(end)) * (start + end)


# -- frames as numbers ---------------------------------------------------------------------------------------------


def rod_directors(points: ArrayLike) -> NDArray[np.float64]:
    """Reference directors of the segments of an open rod through the points [n, 3]: [n - 1, 3], without twist.

    The first is any that is orthogonal to its segment, the others follow by parallel transport along the rod. Raises
    ShapeMismatchError for wrong shapes, DataError for wrong numbers, SceneError for a segment of no length or a rod
    that folds back.
    """
    tangents = rod_tangents(points)
    axis = np.eye(3)[np.argmin(np.abs(tangents[0]))]
    across = np.cross(tangents[0], axis)
    directors = [across / np.linalg.norm(across)]
    for start, end in pairwise(tangents):
        directors.append(transported_directors(directors[-1][None], start[None], end[None])[0])
    return np.array(directors)


def rod_tangents(points: ArrayLike) -> NDArray[np.float64]:
    """Unit vectors along the segments of an open rod through the points [n, 3]: [n - 1, 3].

    Raises ShapeMismatchError for wrong shapes, DataError for wrong numbers, SceneError for a segment of no length.
    """
    x = real_numbers(points, "points of a rod")
    if x.ndim != 2 or x.shape[1] != 3 or len(x) < 2:
        raise ShapeMismatchError(f"a rod goes through points [n, 3], at least two, got shape {x.shape}")
    edges = np.diff(x, axis=0)
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    short = np.flatnonzero(~(lengths > 0))
    if short.size:
        raise SceneError(f"segment {short[0]} of the rod has no length ({short.size} segments have none)")
    return np.asarray(edges / lengths, np.float64)


def transported_directors(directors: ArrayLike, start: ArrayLike, end: ArrayLike) -> NDArray[np.float64]:
    """Directors [m, 3] of segments whose tangents went from `start` to `end` [m, 3], by parallel transport.

    Of length 1 and orthogonal to the new tangents to rounding, however often it is called. Raises ShapeMismatchError
    for wrong shapes, DataError for wrong numbers, SceneError for a segment that turned round.
    """
    names = ("directors", "tangents at the start", "tangents at the end")
    u, a, b = (real_numbers(array, name) for array, name in zip((directors, start, end), names, strict=True))
    if u.ndim != 2 or u.shape[1] != 3 or u.shape != a.shape or u.shape != b.shape:
        raise ShapeMismatchError(
            f"directors and tangents of m segments are [m, 3] each, got shapes {u.shape}, {a.shape} and {b.shape}"
        )
    cosine = np.einsum("ij,ij->i", a, b)
    folded = np.flatnonzero(~(cosine > -1 + 1e-12))
    if folded.size:
        raise SceneError(
            f"segment {folded[0]} turned round by half a turn: there is no smallest rotation; take shorter steps"
        )
    moved = u - (np.einsum("ij,ij->i", b, u) / (1 + cosine))[:, None] * (a + b)
    moved -= np.einsum("ij,ij->i", moved, b)[:, None] * b
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True), np.float64)


def reference_twists(tangents: ArrayLike, directors: ArrayLike, previous: ArrayLike = 0.0) -> NDArray[np.float64]:
    """Twist of the reference frames of an open rod at its inner vertices, [m - 1].

    The angle from the director of one segment, taken to the next by parallel transport, to the director there.
    tangents, directors: [m, 3]; previous: the twists before, of which those are taken that differ by less than half a
    turn. Raises ShapeMismatchError for wrong shapes, DataError for wrong numbers, SceneError for a rod that folds back.
    """
    t, u = real_numbers(tangents, "tangents"), real_numbers(directors, "directors")
    moved = transported_directors(u[:-1], t[:-1], t[1:])
    sine = np.einsum("ij,ij->i", np.cross(moved, u[1:]), t[1:])
    twists = np.arctan2(sine, np.einsum("ij,ij->i", moved, u[1:]))
    before = np.broadcast_to(real_numbers(previous, "previous twists"), twists.shape)
    return np.asarray(twists + 2 * np.pi * np.round((before - twists) / (2 * np.pi)), np.float64)
