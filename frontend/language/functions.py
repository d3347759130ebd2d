"""Functions of several attributes, as users write them: `select`, `minimum`, `maximum`, `atan2`, `hypot`, `stumpff`."""

from __future__ import annotations

from typing import Any

import numpy as np
from xdsl.dialects.builtin import IntegerAttr, i64

from yasps.dialects.mat import comparison, trigonometry
from yasps.frontend.errors import DataError, SceneError
from yasps.frontend.language.attribute import Attribute, as_attribute, broadcast, combine

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
