"""Dual numbers over any field: the oracle for derivative rules, with no rounding when the field is exact.

a + b e with e^2 = 0. Nested twice they are hyper-dual numbers and give second derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[Any]


@dataclass(frozen=True)
class Dual:
    """value + tangent e."""

    value: Any
    tangent: Any

    def __add__(self, other: Any) -> Dual:
        v, t = _parts(other)
        return Dual(self.value + v, self.tangent + t)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.tangent)

    def __sub__(self, other: Any) -> Dual:
        v, t = _parts(other)
        return Dual(self.value - v, self.tangent - t)

    def __rsub__(self, other: Any) -> Dual:
        v, t = _parts(other)
        return Dual(v - self.value, t - self.tangent)

    def __mul__(self, other: Any) -> Dual:
        v, t = _parts(other)
        return Dual(self.value * v, self.value * t + self.tangent * v)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        v, t = _parts(other)
        quotient = self.value / v
        return Dual(quotient, (self.tangent - quotient * t) / v)

    def __rtruediv__(self, other: Any) -> Dual:
        return Dual(other, 0) / self

    # The order is that of the values: a choice stays the same in a neighbourhood.

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < _parts(other)[0])

    def __le__(self, other: Any) -> bool:
        return bool(self.value <= _parts(other)[0])

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > _parts(other)[0])

    def __ge__(self, other: Any) -> bool:
        return bool(self.value >= _parts(other)[0])

    def __pow__(self, exponent: int) -> Dual:
        if exponent == 0:
            return Dual(self.value**0, 0 * self.tangent)
        return Dual(self.value**exponent, exponent * self.value ** (exponent - 1) * self.tangent)


def _parts(number: Any) -> tuple[Any, Any]:
    return (number.value, number.tangent) if isinstance(number, Dual) else (number, 0)


def dual_array(values: Numbers, tangents: Numbers) -> Numbers:
    """values + tangents e, entry by entry."""
    result = np.empty(values.shape, object)
    result.ravel()[:] = [Dual(v, t) for v, t in zip(values.ravel(), tangents.ravel(), strict=True)]
    return result


def tangents_of(duals: Numbers) -> Numbers:
    """Tangents, entry by entry; a plain number has none."""
    result = np.empty(duals.shape, object)
    result.ravel()[:] = [_parts(d)[1] for d in duals.ravel()]
    return result


def values_of(duals: Numbers) -> Numbers:
    """Values, entry by entry."""
    result = np.empty(duals.shape, object)
    result.ravel()[:] = [_parts(d)[0] for d in duals.ravel()]
    return result
