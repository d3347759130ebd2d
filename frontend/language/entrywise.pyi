"""Functions of every entry, for type checkers. Written by tools/write_stubs.py."""

import abc

from yasps.dialects.mat.elementwise import TabledFunction
from yasps.frontend.language.attribute import Attribute

class EntrywiseFunctions(abc.ABC):
    @abc.abstractmethod
    def _apply(self, operation: type[TabledFunction]) -> Attribute: ...
    def sqrt(self) -> Attribute:
        """Square root of every entry."""

    def exp(self) -> Attribute:
        """Exponential of every entry."""

    def expm1(self) -> Attribute:
        """exp(a) - 1, exact near 0, of every entry."""

    def log(self) -> Attribute:
        """Natural logarithm of every entry."""

    def log1p(self) -> Attribute:
        """log(1 + a), exact near 0, of every entry."""

    def cbrt(self) -> Attribute:
        """Cube root of every entry."""

    def sin(self) -> Attribute:
        """Sine of every entry."""

    def cos(self) -> Attribute:
        """Cosine of every entry."""

    def tan(self) -> Attribute:
        """Tangent of every entry."""

    def asin(self) -> Attribute:
        """Arc sine of every entry."""

    def acos(self) -> Attribute:
        """Arc cosine of every entry."""

    def atan(self) -> Attribute:
        """Arc tangent of every entry."""

    def sinh(self) -> Attribute:
        """Hyperbolic sine of every entry."""

    def cosh(self) -> Attribute:
        """Hyperbolic cosine of every entry."""

    def tanh(self) -> Attribute:
        """Hyperbolic tangent of every entry."""

    def erf(self) -> Attribute:
        """Error function of every entry."""
