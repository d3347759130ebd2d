"""Functions of one number that work entry by entry: the table that everything else reads.

A row makes the operation `mat.NAME` with its derivative, the method `a.NAME()`, NumPy's function on attributes, the
scalar operation, the call in C++ and CUDA, the interpreter's meaning, and tests of all of that. After a change of the
table, `python tools/write_stubs.py` and `python docs/update_excerpts.py` renew what type checkers and readers see.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import special
from xdsl.dialects import math as math_dialect
from xdsl.ir import Operation, SSAValue

if TYPE_CHECKING:
    from yasps.dialects.mat.builder import MatBuilder

EVERYWHERE = (-math.inf, math.inf)


@dataclass(frozen=True)
class ScalarFunction:
    """y = f(x) of a number."""

    name: str
    """In the language, of the operation, and of the function in C and CUDA."""
    about: str
    """What it is, as docstrings begin: "Sine"."""
    operation: type[Operation]
    """Of the dialect `math`."""
    of_float: Callable[[float], float]
    """Its value on one number; raises ValueError or OverflowError where there is none."""
    ufunc: np.ufunc
    """NumPy's or SciPy's function of this meaning, which users may call on attributes."""
    derivative: Callable[[MatBuilder, SSAValue, SSAValue], SSAValue]
    """f'(x) from a builder, x and y."""
    tangent: str
    """The derivative rule as the documents write it, da being the tangent of x."""
    domain: tuple[float, float] = EVERYWHERE
    of_complex: Callable[[NDArray[Any]], NDArray[Any]] | None = None
    """The analytic continuation for complex step, where `ufunc` has none."""

    def evaluate(self, x: NDArray[Any]) -> NDArray[Any]:
        """f of every entry; of complex ones too."""
        if self.of_complex is not None and np.iscomplexobj(x):
            return self.of_complex(x)
        return np.asarray(self.ufunc(x))


def _arcsine_derivative(b: MatBuilder, x: SSAValue) -> SSAValue:
    """1 / sqrt((1 - x) (1 + x)), which does not cancel near 1 and -1."""
    return b.power(b.sqrt(b.hadamard(b.plus(b.neg(x), 1.0), b.plus(x, 1.0))), -1.0)


def _complex_cube_root(x: NDArray[Any]) -> NDArray[Any]:
    """The branch that is real on real numbers."""
    sign = np.where(np.real(x) < 0, -1.0, 1.0)
    return np.asarray(sign * (sign * x) ** (1 / 3))


FUNCTIONS = (
    ScalarFunction(
        "sqrt", "Square root", math_dialect.SqrtOp, math.sqrt, np.sqrt,
        lambda b, x, y: b.scale(b.number(0.5), b.power(y, -1.0)),
        "da / (2 sqrt(a)), entry by entry; infinite at 0", (0.0, math.inf),
    ),
    ScalarFunction(
        "exp", "Exponential", math_dialect.ExpOp, math.exp, np.exp,
        lambda b, x, y: y,
        "exp(a) o da",
    ),
    ScalarFunction(
        "expm1", "exp(a) - 1, exact near 0,", math_dialect.ExpM1Op, math.expm1, np.expm1,
        lambda b, x, y: b.apply("exp", x),
        "exp(a) o da",
    ),
    ScalarFunction(
        "log", "Natural logarithm", math_dialect.LogOp, math.log, np.log,
        lambda b, x, y: b.power(x, -1.0),
        "da / a, entry by entry; infinite at 0", (0.0, math.inf),
    ),
    ScalarFunction(
        "log1p", "log(1 + a), exact near 0,", math_dialect.Log1pOp, math.log1p, np.log1p,
        lambda b, x, y: b.power(b.plus(x, 1.0), -1.0),
        "da / (1 + a), entry by entry; infinite at -1", (-1.0, math.inf),
    ),
    ScalarFunction(
        "cbrt", "Cube root", math_dialect.CbrtOp, lambda x: float(np.cbrt(x)), np.cbrt,
        lambda b, x, y: b.scale(b.number(1 / 3), b.power(y, -2.0)),
        "da / (3 cbrt(a)^2), entry by entry; infinite at 0",
        of_complex=_complex_cube_root,
    ),
    ScalarFunction(
        "sin", "Sine", math_dialect.SinOp, math.sin, np.sin,
        lambda b, x, y: b.apply("cos", x),
        "cos(a) o da",
    ),
    ScalarFunction(
        "cos", "Cosine", math_dialect.CosOp, math.cos, np.cos,
        lambda b, x, y: b.neg(b.apply("sin", x)),
        "-sin(a) o da",
    ),
    ScalarFunction(
        "tan", "Tangent", math_dialect.TanOp, math.tan, np.tan,
        lambda b, x, y: b.plus(b.power(y, 2.0), 1.0),
        "(1 + tan(a)^2) o da",
    ),
    ScalarFunction(
        "asin", "Arc sine", math_dialect.AsinOp, math.asin, np.arcsin,
        lambda b, x, y: _arcsine_derivative(b, x),
        "da / sqrt((1 - a)(1 + a)), entry by entry; infinite at -1 and 1", (-1.0, 1.0),
    ),
    ScalarFunction(
        "acos", "Arc cosine", math_dialect.AcosOp, math.acos, np.arccos,
        lambda b, x, y: b.neg(_arcsine_derivative(b, x)),
        "-da / sqrt((1 - a)(1 + a)), entry by entry; infinite at -1 and 1", (-1.0, 1.0),
    ),
    ScalarFunction(
        "atan", "Arc tangent", math_dialect.AtanOp, math.atan, np.arctan,
        lambda b, x, y: b.power(b.plus(b.power(x, 2.0), 1.0), -1.0),
        "da / (1 + a^2), entry by entry",
    ),
    ScalarFunction(
        "sinh", "Hyperbolic sine", math_dialect.SinhOp, math.sinh, np.sinh,
        lambda b, x, y: b.apply("cosh", x),
        "cosh(a) o da",
    ),
    ScalarFunction(
        "cosh", "Hyperbolic cosine", math_dialect.CoshOp, math.cosh, np.cosh,
        lambda b, x, y: b.apply("sinh", x),
        "sinh(a) o da",
    ),
    ScalarFunction(
        "tanh", "Hyperbolic tangent", math_dialect.TanhOp, math.tanh, np.tanh,
        # Not 1 - tanh^2, of which nothing is left where tanh is nearly 1.
        lambda b, x, y: b.power(b.apply("cosh", x), -2.0),
        "da / cosh(a)^2, entry by entry",
    ),
    ScalarFunction(
        "erf", "Error function", math_dialect.ErfOp, math.erf, special.erf,
        lambda b, x, y: b.scale(b.number(2 / math.sqrt(math.pi)), b.apply("exp", b.neg(b.power(x, 2.0)))),
        "2 / sqrt(pi) exp(-a^2) o da",
    ),
)  # fmt: skip
"""In the order in which documents list them."""
