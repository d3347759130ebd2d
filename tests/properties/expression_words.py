"""Words of random expressions: how each operation is written in Python, and what it means on numbers of any kind.

Meanings are those of `matrix_meaning`, not the compiler's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matrix_meaning import (
    Matrix,
    as_truth,
    chosen,
    cofactors,
    cross,
    determinant,
    embedded,
    frozen,
    greater,
    one,
    product,
    smaller,
    taken,
    total,
)
from xdsl.dialects.builtin import DenseArrayBase, FloatAttr, f64, i64

from yasps import (
    Attribute,
    Scene,
    atan2,
    concat_cols,
    concat_rows,
    constant,
    eigenvalues,
    hypot,
    maximum,
    minimum,
    polar,
    select,
    stumpff,
)
from yasps.dialects.mat import OPERATIONS as MAT_OPERATIONS
from yasps.dialects.mat import algebra, elementwise, structure
from yasps.dialects.scalar.functions import FUNCTIONS
from yasps.frontend.language.attribute import combine

Shape = tuple[int, int]
Numbers = tuple[int, ...]


# -- names for the lines -----------------------------------------------------------------------------------


def embed(a: Attribute, row: int, col: int, rows: int, cols: int) -> Attribute:
    """The attribute inside a matrix of zeros; no user's word, but what differentiation makes of `block`."""
    place = DenseArrayBase.from_list(i64, [row, col, rows, cols])
    return combine(structure.EmbedOp, [a], {"place": place})


def cofactor(a: Attribute) -> Attribute:
    """Matrix of cofactors; what differentiation makes of `det`."""
    return combine(algebra.CofactorOp, [a])


def power(a: Attribute, exponent: float) -> Attribute:
    """Entry by entry."""
    return combine(elementwise.PowOp, [a], {"exponent": FloatAttr(float(exponent), f64)})


def positive(a: Attribute) -> Attribute:
    """1.5 + a^2, entry by entry."""
    return a.hadamard(a) + constant(np.full(a.shape, 1.5))


WORDS: dict[str, Any] = {
    "Scene": Scene,
    "concat_rows": concat_rows,
    "concat_cols": concat_cols,
    "constant": constant,
    "embed": embed,
    "cofactor": cofactor,
    "power": power,
    "positive": positive,
    "select": select,
    "minimum": minimum,
    "maximum": maximum,
    "atan2": atan2,
    "hypot": hypot,
    "stumpff": stumpff,
    "eigenvalues": eigenvalues,
    "polar": polar,
}


# -- where operations are smooth, and not mostly rounding ------------------------------------------------------


def everywhere(*operands: Matrix) -> bool:
    """Smooth wherever it is defined."""
    del operands
    return True


def apart(a: Matrix, b: Any) -> bool:
    """No entry so near to a tie that rounding, or a pass, could decide it the other way."""
    return bool((abs(a - b) > 1e-6).all())


def has_angle(y: Matrix, x: Matrix) -> bool:
    """Away from the origin, and from the negative x axis where angles jump."""
    return bool((x * x + y * y > 0.05).all() and ((x > 0) | (abs(y) > 0.01)).all())


def has_tangent(a: Matrix) -> bool:
    """A quarter of it is away from the poles."""
    return bool((abs(np.cos(0.25 * a)) > 0.3).all())


def is_regular(a: Matrix) -> bool:
    """A determinant not much smaller than the products it is the sum of: else what is left is rounding."""
    return bool(np.linalg.cond(a) < 100.0)


def symmetric_eigenvalues(a: Matrix) -> Matrix:
    """Of the symmetric part, ascending."""
    return np.linalg.eigvalsh(0.5 * (a + a.T).astype(float))[:, None]


def are_apart(a: Matrix) -> bool:
    """No two eigenvalues so near each other that what single ones do is mostly rounding."""
    return bool((np.diff(symmetric_eigenvalues(a).ravel()) > 0.3).all())


def nearest_rotation(a: Matrix) -> Matrix:
    """By the singular value decomposition."""
    left, _, right = np.linalg.svd(a.astype(float))
    return left @ np.diag([1, 1, np.linalg.det(left) * np.linalg.det(right)]) @ right


def has_rotation(a: Matrix) -> bool:
    """The two smallest singular values, one with the sign of det, are far from being opposite."""
    sizes = np.linalg.svd(a.astype(float), compute_uv=False)
    return bool(sizes[1] + sizes[2] * np.sign(np.linalg.det(a.astype(float))) > 0.5)


@dataclass(frozen=True)
class Operation:
    """How it is written (operands {0}, {1}, ...; numbers {n}) and what it means."""

    text: str
    meaning: Callable[..., Matrix]
    ir: str
    """Name of the `mat` operation it becomes."""
    rational: bool = True
    is_smooth: Callable[..., bool] = everywhere
    """Asked of operands that are floats; rational operands may lie on kinks, where slopes are part of the meaning."""

    def written(self, operands: Sequence[str], numbers: Numbers) -> str:
        return self.text.format(*operands, n=", ".join(map(str, numbers)))


OPERATIONS: dict[str, Operation] = {
    "add": Operation("{0} + {1}", lambda a, b: a + b, "add"),
    "sub": Operation("{0} - {1}", lambda a, b: a - b, "sub"),
    "neg": Operation("-{0}", lambda a: -a, "neg"),
    "hadamard": Operation("{0}.hadamard({1})", lambda a, b: a * b, "hadamard"),
    "scale": Operation("{0} * {1}", lambda s, m: m * s[0, 0], "scale"),
    "divide": Operation("{0} / {1}", lambda m, s: m / s[0, 0], "divide"),
    "matmul": Operation("{0} @ {1}", product, "matmul"),
    "gram": Operation("{0}.T @ {0}", lambda a: product(a.T, a), "matmul"),
    "transpose": Operation("{0}.T", lambda a: a.T, "transpose"),
    "dot": Operation("{0}.dot({1})", lambda a, b: one(total(list((a * b).ravel()))), "dot"),
    "cross": Operation("{0}.cross({1})", cross, "cross"),
    "trace": Operation("{0}.trace()", lambda a: one(total([a[k, k] for k in range(len(a))])), "trace"),
    "sum": Operation("{0}.sum()", lambda a: one(total(list(a.ravel()))), "sum"),
    "det": Operation("{0}.det()", lambda a: one(determinant(a)), "det", is_smooth=is_regular),
    "cofactor": Operation("cofactor({0})", cofactors, "cofactor", is_smooth=is_regular),
    "inverse": Operation("{0}.inverse()", lambda a: cofactors(a).T / determinant(a), "inverse", is_smooth=is_regular),
    "reshape": Operation("{0}.reshape({n})", lambda a, r, c: a.reshape(r, c), "reshape"),
    "block": Operation("{0}.block({n})", lambda a, i, j, r, c: a[i : i + r, j : j + c], "block"),
    "embed": Operation("embed({0}, {n})", embedded, "embed"),
    "concat_rows": Operation("concat_rows([{0}, {1}])", lambda a, b: np.concatenate([a, b], 0), "concat_rows"),
    "concat_cols": Operation("concat_cols([{0}, {1}])", lambda a, b: np.concatenate([a, b], 1), "concat_cols"),
    "pow": Operation("power({0}, {n})", lambda a, p: a**p, "pow"),
    "stop_gradient": Operation("{0}.stop_gradient()", frozen, "stop_gradient"),
    "less": Operation("{0} < {1}", lambda a, b: as_truth(a, a < b), "compare", is_smooth=apart),
    "less_equal": Operation("{0} <= {1}", lambda a, b: as_truth(a, a <= b), "compare", is_smooth=apart),
    "greater": Operation("{0} > {1}", lambda a, b: as_truth(a, a > b), "compare", is_smooth=apart),
    "greater_equal": Operation("{0} >= {1}", lambda a, b: as_truth(a, a >= b), "compare", is_smooth=apart),
    "select": Operation("select({0}, {1}, {2})", chosen, "select"),
    "choose": Operation(
        "select({0} <= {1}, {2}, {3})",
        lambda a, b, c, d: taken(a <= b, c, d),
        "select",
        is_smooth=lambda a, b, c, d: apart(a, b),
    ),
    "minimum": Operation("minimum({0}, {1})", smaller, "min", is_smooth=apart),
    "maximum": Operation("maximum({0}, {1})", greater, "max", is_smooth=apart),
    "abs": Operation("{0}.abs()", abs, "abs", is_smooth=lambda a: apart(a, 0.0)),
    "sqrt": Operation("positive({0}).sqrt()", lambda a: (1.5 + a * a) ** 0.5, "sqrt", False),
    "log": Operation("positive({0}).log()", lambda a: np.log(1.5 + a * a), "log", False),
    "exp": Operation("(0.5 * {0}).exp()", lambda a: np.exp(0.5 * a), "exp", False),
    "sin": Operation("{0}.sin()", np.sin, "sin", False),
    "cos": Operation("{0}.cos()", np.cos, "cos", False),
    "norm": Operation("{0}.norm()", lambda a: one(np.sqrt((a * a).sum())), "norm", False),
    "stumpff": Operation(
        "stumpff(1, positive({0}))", lambda a: np.sin((1.5 + a * a) ** 0.5) / (1.5 + a * a) ** 0.5, "stumpff", False
    ),
    "root": Operation("power(positive({0}), -1.5)", lambda a: (1.5 + a * a) ** -1.5, "pow", False),
    "tan": Operation("(0.25 * {0}).tan()", lambda a: np.tan(0.25 * a), "tan", False, has_tangent),
    "asin": Operation("(0.9 * {0}.sin()).asin()", lambda a: np.arcsin(0.9 * np.sin(a)), "asin", False),
    "acos": Operation("(0.8 * {0}.cos()).acos()", lambda a: np.arccos(0.8 * np.cos(a)), "acos", False),
    "atan2": Operation("atan2({0}, {1})", np.arctan2, "atan2", False, has_angle),
    "hypot": Operation("hypot({0}, {1})", np.hypot, "hypot", False, has_angle),
    "eigenvalues": Operation("eigenvalues({0})", symmetric_eigenvalues, "eigenvalues", False, are_apart),
    "polar": Operation("polar({0})", nearest_rotation, "polar", False, has_rotation),
    "shielded": Operation(  # the side not taken may be NaN
        "select({0} > 0.5, {0}.log(), 0.25 * {0})",
        lambda a: taken(a > 0.5, np.log(np.maximum(a, 0.5)), 0.25 * a),
        "log",
        False,
        lambda a: apart(a, 0.5),
    ),
}
for _function in FUNCTIONS:  # inside every domain, and where no slope is infinite
    OPERATIONS.setdefault(
        _function.name,
        Operation(
            f"(0.5 + 0.25 * {{0}}.sin()).{_function.name}()",
            lambda a, f=_function: f.evaluate(0.5 + 0.25 * np.sin(a)),
            _function.name,
            False,
        ),
    )
COMPARISONS = ("less", "less_equal", "greater", "greater_equal")
FITTING: dict[str, tuple[Shape, ...]] = {
    "cross": ((3, 1), (3, 1)),
    **dict.fromkeys(("scale", "divide"), ((1, 1), (2, 1))),
    "matmul": ((2, 3), (3, 1)),
    "select": ((1, 1), (2, 1), (2, 1)),
    "shielded": ((1, 1),),
    **dict.fromkeys((*COMPARISONS, "choose", "minimum", "maximum", "atan2", "hypot"), ((2, 1), (2, 1))),
    **dict.fromkeys(("trace", "det", "cofactor", "inverse", "eigenvalues", "polar"), ((3, 3),)),
}
"""Inputs that an expression which begins with this operation surely has."""
ONE_SHAPE = ("add", "sub", "hadamard", "dot", "minimum", "maximum", "atan2", "hypot", *COMPARISONS)
"""Of two operands."""
SQUARE = {
    **dict.fromkeys(("trace", "det", "cofactor", "inverse"), (1, 2, 3, 4)),
    "eigenvalues": (2, 3),
    "polar": (3,),
}
"""Words for square matrices, and of which sizes."""

IR_WORDS = {operation.ir for operation in OPERATIONS.values()} | {"constant"}
"""`mat` operations these programs reach; `identity` comes in with derivatives, `calculus` holds the compiler's own."""
ALL_WORDS = {op.word() for op in MAT_OPERATIONS}
