"""Rotations by a rotation vector.

R = exp([w]) R_0, with R_0 a constant. Where w is added to R_0 after each step and starts at 0 again
(`recentred_rotation`), it stays far from 2 pi, where exp loses a direction; only a turn of more than that within one
step would meet it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from yasps import Attribute, concat_cols, concat_rows, constant, identity, stumpff
from yasps.frontend.language.arrays import real_numbers


def cross_matrix(v: Attribute) -> Attribute:
    """[v], 3x3, of a 3x1 (or 1x3) v: [v] x is the cross product of v and x."""
    x, y, z, no = v.reshape(3, 1)[0], v.reshape(3, 1)[1], v.reshape(3, 1)[2], constant(0.0)
    rows = [[no, -z, y], [z, no, -x], [-y, x, no]]
    return concat_rows([concat_cols(row) for row in rows])


def rotation_matrix(vector: Attribute) -> Attribute:
    """exp([w]), 3x3: the rotation by |w| [rad] about w, 3x1 (or 1x3), counter-clockwise seen against it.

    Rodrigues' formula, I + sin(|w|)/|w| [w] + (1 - cos |w|)/|w|^2 [w]^2, with Stumpff functions of w . w: smooth at 0.
    """
    s, cross = vector.dot(vector), cross_matrix(vector)
    return identity(3) + stumpff(1, s) * cross + stumpff(2, s) * (cross * cross)


def recentred_rotation(vector: ArrayLike, base: ArrayLike) -> NDArray[np.float64]:
    """exp([w]) R_0 in numbers, [n, 3, 3], for the constant of the next step, whose rotation vector begins at 0.

    vector: [n, 3] or flat; base R_0: [n, 3, 3] or flat. What has gathered of rounding is taken out of R_0. Raises
    DataError.
    """
    turns = Rotation.from_rotvec(real_numbers(vector, "the rotation vector").reshape(-1, 3))
    bases = Rotation.from_matrix(real_numbers(base, "the base rotation").reshape(-1, 3, 3))
    return np.asarray((turns * bases).as_matrix())
