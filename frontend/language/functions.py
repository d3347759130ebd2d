"""Functions of attributes that are no methods: choices, angles, and what is known by eigenvalues and rotations."""

from __future__ import annotations

from typing import Any

import numpy as np
from xdsl.dialects.builtin import IntegerAttr, i64

from yasps.dialects.mat import comparison, spectral, trigonometry
from yasps.frontend.errors import DataError, SceneError, ShapeMismatchError
from yasps.frontend.language.attribute import (
    Attribute,
    as_attribute,
    broadcast,
    combine,
    concat_cols,
    concat_rows,
    identity,
)

LARGEST_STUMPFF_ORDER = trigonometry.LARGEST_ORDER - 4
"""Each derivative takes two orders more."""


def select(condition: Any, then: Any, otherwise: Any) -> Attribute:
    """`then` where the condition holds, `otherwise` elsewhere; both of one shape, or one of them a number.

    condition: a comparison (`a < b`), or anything that is 0 where it does not hold; 1x1, or of the shape of the two for
    a choice entry by entry. Only the derivative of the side taken counts; the condition has none. A 1x1 condition keeps
    the other side's infinities and NaNs out of the derivatives. Raises ShapeMismatchError, LineageError, SceneError.
    """
    if isinstance(condition, bool | np.bool_):
        raise SceneError(
            f"the condition of select is {condition}, which Python decided on the spot: == and != compare whether two "
            "attributes are the same object. Write conditions with <, <=, > and >="
        )
    return combine(comparison.SelectOp, [as_attribute(condition), *broadcast(comparison.SelectOp, then, otherwise)])


def minimum(a: Any, b: Any) -> Attribute:
    """The smaller of two attributes of one shape, or of one and a number, entry by entry.

    At a tie it is the first, as is its derivative.
    """
    return combine(comparison.MinOp, broadcast(comparison.MinOp, a, b))


def maximum(a: Any, b: Any) -> Attribute:
    """The greater of two attributes of one shape, or of one and a number, entry by entry.

    At a tie it is the first, as is its derivative.
    """
    return combine(comparison.MaxOp, broadcast(comparison.MaxOp, a, b))


def atan2(y: Any, x: Any) -> Attribute:
    """The angle of the point (x, y), in radians of (-pi, pi], entry by entry; no derivative at (0, 0)."""
    return combine(trigonometry.Atan2Op, broadcast(trigonometry.Atan2Op, y, x))


def hypot(x: Any, y: Any) -> Attribute:
    """The distance sqrt(x^2 + y^2) of the point (x, y) from 0, entry by entry, without overflow between; no derivative
    at (0, 0)."""
    return combine(trigonometry.HypotOp, broadcast(trigonometry.HypotOp, x, y))


def stumpff(order: int, s: Any) -> Attribute:
    """Stumpff function c_k(s) = 1/k! - s/(k + 2)! + s^2/(k + 4)! - ... for s >= 0, entry by entry; smooth at s = 0.

    With s = r.dot(r) and n its root, c_0 is cos(n), c_1 is sin(n) / n, c_2 is (1 - cos(n)) / n^2, c_3 is
    (n - sin(n)) / n^3, exact to rounding for every n, with all derivatives. The compiler writes these quotients of a
    norm as Stumpff functions itself; call them where it can't see that a number is a norm. For s < -4 they are NaN.

    order: k, of 0 to 5. Raises DataError, LineageError.
    """
    if not isinstance(order, int) or isinstance(order, bool) or not 0 <= order <= LARGEST_STUMPFF_ORDER:
        raise DataError(
            f"the order of a Stumpff function is a whole number of 0 to {LARGEST_STUMPFF_ORDER}, got {order!r}"
        )
    return combine(trigonometry.StumpffOp, [as_attribute(s)], {"order": IntegerAttr(order, i64)})


def eigenvalues(a: Any) -> Attribute:
    """Eigenvalues of a symmetric matrix of 2x2 or 3x3 (of the symmetric part of any other), ascending, one column.

    Where two are equal neither of them has a derivative (NotFiniteError); functions that are symmetric in the two, such
    as sums over all eigenvalues, have their derivatives there, and near there to rounding. Raises ShapeMismatchError.
    """
    return combine(spectral.EigenvaluesOp, [as_attribute(a)])


def polar(a: Any) -> Attribute:
    """The rotation R that is nearest to a matrix F of 2x2 or 3x3: F = R S with a symmetric S = R^T F.

    The eigenvalues of S are the singular values of F, of which the smallest is negative where det F is. R has
    derivatives where the sum of the two smallest is not 0; a flat F is no exception. Raises ShapeMismatchError.
    """
    f = as_attribute(a)
    if f.shape != (2, 2):
        return combine(spectral.PolarOp, [f])
    cosine, sine = f[0, 0] + f[1, 1], f[1, 0] - f[0, 1]
    turned = concat_rows([concat_cols([cosine, -sine]), concat_cols([sine, cosine])])
    return turned / concat_rows([cosine, sine]).norm()


def singular_values(a: Any) -> Attribute:
    """Singular values of a matrix of 2x2, 3x3 or 3x2, descending, one column.

    Of a square matrix the last one has the sign of the determinant, so that nothing breaks where a body turns inside
    out. Functions that are symmetric in them have derivatives where two are equal, single ones do not (as
    `eigenvalues`). Of a square matrix none has where the sum of the two smallest is 0; of 3x2 none where the columns
    are parallel. Raises ShapeMismatchError.
    """
    f = as_attribute(a)
    if f.shape == (3, 2):  # the root of C = F^T F in closed form, from det of the root
        right, area = f.T * f, f.col(0).cross(f.col(1)).norm()
        stretch = (right + area * identity(2)) / (right.trace() + 2 * area).sqrt()
    elif f.shape in ((2, 2), (3, 3)):
        stretch = polar(f).T * f
    else:
        raise ShapeMismatchError(f"singular values are available of 2x2, 3x3 and 3x2, got {f.path} {f.shape}")
    ascending = eigenvalues(stretch)
    return concat_rows([ascending[k] for k in reversed(range(ascending.shape[0]))])
