"""Numbers without rounding: rationals that take in floats exactly, and hyper-dual numbers over them.

e + a e1 + b e2 + c e1 e2 with e1^2 = e2^2 = 0: f(x + u e1 + w e2) = f + (g.u) e1 + (g.w) e2 + (u^T H w) e1 e2 (Fike and
Alonso 2011).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Exact:
    """A rational number; a float beside it counts as the rational it is (`Fraction` would become a float)."""

    value: Fraction

    def __eq__(self, other: object) -> bool:
        return self.value == fraction(other)

    def __hash__(self) -> int:
        return hash(self.value)

    def __lt__(self, other: Any) -> bool:
        return self.value < fraction(other)

    def __le__(self, other: Any) -> bool:
        return self.value <= fraction(other)

    def __gt__(self, other: Any) -> bool:
        return self.value > fraction(other)

    def __ge__(self, other: Any) -> bool:
        return self.value >= fraction(other)

    def __add__(self, other: Any) -> Exact:
        return Exact(self.value + fraction(other))

    __radd__ = __add__

    def __neg__(self) -> Exact:
        return Exact(-self.value)

    def __sub__(self, other: Any) -> Exact:
        return Exact(self.value - fraction(other))

    def __rsub__(self, other: Any) -> Exact:
        return Exact(fraction(other) - self.value)

    def __mul__(self, other: Any) -> Exact:
        return Exact(self.value * fraction(other))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Exact:
        return Exact(self.value / fraction(other))

    def __rtruediv__(self, other: Any) -> Exact:
        return Exact(fraction(other) / self.value)

    def __pow__(self, exponent: float) -> Exact:
        assert exponent == int(exponent), "only whole exponents are rational"
        return Exact(self.value ** int(exponent))


def fraction(number: Any) -> Fraction:
    """Any number as a rational, exactly."""
    return number.value if isinstance(number, Exact) else Fraction(number)


@dataclass(frozen=True, slots=True)
class HyperDual:
    """value + first e1 + second e2 + both e1 e2, all rational; ordered by value."""

    value: Fraction
    first: Fraction = Fraction(0)
    second: Fraction = Fraction(0)
    both: Fraction = Fraction(0)

    def of(self, f: Fraction, slope: Fraction, curvature: Fraction) -> HyperDual:
        """A function of this number, for its value and first two derivatives here."""
        return HyperDual(
            f, slope * self.first, slope * self.second, slope * self.both + curvature * self.first * self.second
        )

    def __lt__(self, other: HyperDual) -> bool:
        return self.value < other.value

    def __le__(self, other: HyperDual) -> bool:
        return self.value <= other.value

    def __abs__(self) -> HyperDual:
        """With the slope 1 at 0, as the language says."""
        return self.of(abs(self.value), Fraction(1 if self.value >= 0 else -1), Fraction(0))

    def __add__(self, other: HyperDual) -> HyperDual:
        return HyperDual(
            self.value + other.value,
            self.first + other.first,
            self.second + other.second,
            self.both + other.both,
        )

    def __neg__(self) -> HyperDual:
        return HyperDual(-self.value, -self.first, -self.second, -self.both)

    def __sub__(self, other: HyperDual) -> HyperDual:
        return self + -other

    def __mul__(self, other: HyperDual) -> HyperDual:
        return HyperDual(
            self.value * other.value,
            self.value * other.first + self.first * other.value,
            self.value * other.second + self.second * other.value,
            self.value * other.both + self.first * other.second + self.second * other.first + self.both * other.value,
        )

    def __truediv__(self, other: HyperDual) -> HyperDual:
        return self * other**-1

    def __pow__(self, exponent: int) -> HyperDual:
        p, x = exponent, self.value
        slope = p * x ** (p - 1) if p else Fraction(0)
        curvature = p * (p - 1) * x ** (p - 2) if p not in (0, 1) else Fraction(0)
        return self.of(x**p, slope, curvature)


def array_of(make: Callable[..., Any], *parts: NDArray[Any]) -> NDArray[Any]:
    """`make` on the entries of equally shaped arrays."""
    result = np.empty(parts[0].shape, object)
    result.ravel()[:] = [make(*entries) for entries in zip(*(part.ravel() for part in parts), strict=True)]
    return result
