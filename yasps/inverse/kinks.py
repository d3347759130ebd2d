"""States at which the derivative of a step has a jump, so that it is that of one side."""

from __future__ import annotations

import numpy as np

from yasps import FloatArray
from yasps.contact import BarrierContact
from yasps.contact.active_set import Pairs, PlanePairs
from yasps.contact.pair_forces import closest_points

NEAR = 1e-9
"""Share of the activation distance, or of an edge, within which a pair sits on a kink."""


def kinks_of(contact: BarrierContact) -> list[str]:
    """What sits on one where the scene is, in words: pairs whose gap is the activation distance, and those whose
    closest point is on the rim of a face or at the end of an edge, where another formula of the distance begins."""
    found = []
    positions, radii = contact.positions(), contact.parts.points["radius"].value
    reach = contact.geometry.activation_distance
    for kind, pairs in contact.active.kinds().items():
        if len(pairs) == 0:
            continue
        points = closest_points(kind, _corners(contact, positions, pairs))
        offsets = points.offset(kind, radii[pairs.vertices])
        gap = np.linalg.norm(points.way, axis=1) - pairs.share * offsets
        named = pairs.vertices[np.abs(gap - reach) < NEAR * reach]
        if len(named):
            found.append(f"{kind} of vertices {named[0].tolist()} is exactly at the activation distance")
        inside = points.of_parameters.any(axis=1) & (not kind.startswith("mollified"))
        named = pairs.vertices[(np.abs(points.weights[:, inside]) < NEAR).any(axis=1)]
        if len(named):
            found.append(
                f"{kind} of vertices {named[0].tolist()} is closest on the rim of a face or at the end of an edge"
            )
    return found


def _corners(contact: BarrierContact, positions: FloatArray, pairs: Pairs) -> FloatArray:
    """[n, rows, 3], as the kind has them."""
    corners = positions[pairs.vertices]
    if not isinstance(pairs, PlanePairs):
        return corners
    planes = np.stack([contact.half_spaces.normals[pairs.planes], contact.half_spaces.points[pairs.planes]], axis=1)
    return np.concatenate([corners, planes], axis=1)
