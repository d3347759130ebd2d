"""Chains and trees of links that turn in one plane, by the angles between them.

Sums along the way to the root are JOINs of variable arity, so one formula serves chains of any length:

1. `ancestors(parents)` says of each link which links lie between it and the root, itself included.
2. A JOIN of the links' angles through it, `operation="sum"`, is the direction of each link.
3. `turned(arm, direction, first, second)` is each link's arm from its joint to the next one; a JOIN of the arms through
   the same connectivity, the sum again, is where each link ends.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, ConnectivityError
from yasps.frontend.language.arrays import plain_array


def ancestors(parents: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices and counts of a connectivity from links to links: each link, its parent, and so on to the root.

    parents: of each link, [n]; -1 for a root. Raises ConnectivityError for links that are not there and for loops.
    """
    given = plain_array(parents, "the parents")
    if (
        given.ndim != 1
        or given.dtype.kind not in "iu"
        or (len(given) and not (-1 <= given.min() <= given.max() < len(given)))
    ):
        raise ConnectivityError(f"the parents of {len(given)} links are their numbers, 0 to {len(given) - 1}, or -1")
    ways: list[list[int]] = []
    for link in range(len(given)):
        way = [link]
        while (parent := int(given[way[-1]])) >= 0:
            way.append(parent)
            if len(way) > len(given):
                raise ConnectivityError(f"link {link} is its own ancestor: a closed loop is a tree and a joint")
        ways.append(way)
    return np.array([one for way in ways for one in way], np.int64), np.array([len(way) for way in ways], np.int64)


def turned(vector: Attribute, angle: Attribute, first: Attribute, second: Attribute) -> Attribute:
    """A vector after a turn by an angle [rad] in the plane of two orthonormal vectors, from first to second; all 3x1
    but the angle. What is orthogonal to the plane stays."""
    vector, first, second = (one.reshape(3, 1) for one in (vector, first, second))
    x, y = vector.dot(first), vector.dot(second)
    cosine, sine = angle.cos(), angle.sin()
    return vector + ((cosine - 1) * x - sine * y) * first + (sine * x + (cosine - 1) * y) * second
