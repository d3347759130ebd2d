"""Linear blend skinning: vertices that follow several bones, each by a weight.

An influence is a primitive of its own: one vertex, one bone, one weight. It says where the vertex would be by this
bone, times the weight (`blended`); a JOIN of a vertex over its influences, `operation="sum"`, is its position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, DataError
from yasps.frontend.language.arrays import real_numbers
from yasps.parameterisations.affine import affine_position

ONE = 1e-9
"""How far from 1 the weights of a vertex may add up to."""


@dataclass(frozen=True)
class Influences:
    """Which bone moves which vertex, by how much. Each [influences], in order of vertices."""

    vertices: NDArray[np.int64]
    bones: NDArray[np.int64]
    weights: NDArray[np.float64]
    counts: NDArray[np.int64]
    """Of each vertex, [vertices]: with `np.arange(len(weights))` a connectivity from vertices to influences."""


def influences(weights: ArrayLike) -> Influences:
    """Those of a table of weights, [vertices, bones]; zeros are none.

    Raises DataError unless the weights of each vertex add up to 1, without which it would not follow a translation.
    """
    table = real_numbers(weights, "the weights of bones")
    if table.ndim != 2:
        raise DataError(f"weights of bones are [vertices, bones], got {list(table.shape)}")
    wrong = np.flatnonzero(np.abs(table.sum(axis=1) - 1) > ONE)
    if wrong.size:
        raise DataError(
            f"the weights of vertex {wrong[0]} add up to {table[wrong[0]].sum():.6g} ({wrong.size} vertices are wrong);"
            " they must add up to 1: divide each row by its sum"
        )
    vertices, bones = np.nonzero(table)
    return Influences(vertices, bones, table[vertices, bones], np.count_nonzero(table, axis=1))


def blended(weight: Attribute, matrix: Attribute, translation: Attribute, rest: Attribute) -> Attribute:
    """What one bone gives a vertex [m], 3x1: w (A r + t), A and t from a JOIN of the bone, r of the vertex.

    A is 3x3 or 1x9, t and r 3x1 or 1x3 [m]. r and t are counted as one likes, from the same point for all bones.
    """
    return weight * affine_position(matrix, translation, rest)
