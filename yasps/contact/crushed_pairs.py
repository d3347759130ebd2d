"""Pairs that are far nearer than any pressure holds them, and what their barriers pull.

Newton's method on a logarithm whose gap is far below where forces balance can do no more than double the gap in a step,
and what the pair slides meanwhile on its curved way takes up that gap again: with a barrier c log(1 / gap), a force F
that it shall bear and a radius of curvature R, gaps settle at 2 c^2 / (F^2 R) and slides at 2 c / F a step, however far
the pair still has to slide. Where directions are long at first and steps end at the collision, gaps fall that far: to
1e-10 m for soft cubes of 0.1 m. A step along H^-1 of the gradient of these barriers alone opens the gaps and slides
nothing, so a line search along it can go as far as forces need.
"""

from __future__ import annotations

import numpy as np

from yasps import FloatArray
from yasps.contact.active_set import Floats, PlanePairs
from yasps.contact.barrier_contact import BarrierContact
from yasps.contact.pair_forces import closest_points
from yasps.contact.rows import row_dots

CRUSHED = 1e-2
"""Share of the activation distance below which a gap is looked at: the barrier bears 200 times its stiffness there."""
ALIKE = 10.0
"""Pairs with gaps up to so many times the smallest are opened together."""


def gaps(contact: BarrierContact) -> dict[str, Floats]:
    """Gap of each pair of the active set [m], by kind."""
    positions, parts = contact.positions(), contact.parts
    found = {}
    for name, pairs in contact.active.kinds().items():
        corners = np.take(positions, pairs.vertices, axis=0)
        if isinstance(pairs, PlanePairs):
            assert parts.planes is not None
            planes = [parts.planes[part].value.reshape(-1, 1, 3)[pairs.planes] for part in ("normal", "point")]
            corners = np.concatenate([corners, *planes], axis=1)
        points = closest_points(name, corners)
        found[name] = np.sqrt(row_dots(points.way, points.way))
        if parts.is_thick:
            radii = pairs.share[:, None] * parts.points["radius"].value[pairs.vertices]
            found[name] -= points.offset(name, radii)
    return found


def crushed_gradient(contact: BarrierContact) -> FloatArray | None:
    """Gradient, by all targets, of the barriers of the pairs with the smallest gaps; None if no pair is crushed.

    Raises NotFiniteError.
    """
    if not contact.active.minimum_gap < CRUSHED * contact.geometry.activation_distance:
        return None
    of_kinds = gaps(contact)
    least = min(float(some.min(initial=np.inf)) for some in of_kinds.values())
    barriers = [pairs.primitive["barrier"].path for pairs in contact.primitives.values()]
    contact.show_only({name: some <= ALIKE * least for name, some in of_kinds.items()})
    try:
        gradients = contact.parts.mesh.scene.compile().gradients(barriers)
    finally:
        contact.show_only({})
    return np.asarray(sum(gradients.values(), start=np.zeros(1)))
