"""What operations mean on [rows, columns] arrays of numbers of any kind: floats, rationals, hyper-dual numbers.

Written anew (determinants by permutations, inverses by cofactors), so it shares no code with the operations it tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Any

import numpy as np
from exact_numbers import HyperDual
from numpy.typing import NDArray

Matrix = NDArray[Any]


def sign(order: tuple[int, ...]) -> int:
    """1 for an even permutation, -1 for an odd one."""
    return 1 - 2 * (sum(order[i] > order[j] for i in range(len(order)) for j in range(i + 1, len(order))) % 2)


def determinant(m: Matrix) -> Any:
    """Sum over permutations (Leibniz)."""
    total = None
    for order in permutations(range(len(m))):
        term = m[0, order[0]]
        for row in range(1, len(m)):
            term = term * m[row, order[row]]
        term = term if sign(order) > 0 else -term
        total = term if total is None else total + term
    return total


def cofactors(m: Matrix) -> Matrix:
    """Signed minors."""
    if len(m) == 1:
        return m**0
    result = np.empty_like(m)
    for i, j in np.ndindex(m.shape):
        minor = determinant(np.delete(np.delete(m, i, 0), j, 1))
        result[i, j] = minor if (i + j) % 2 == 0 else -minor
    return result


def product(a: Matrix, b: Matrix) -> Matrix:
    """Matrix product."""
    result = np.empty((a.shape[0], b.shape[1]), np.result_type(a, b))
    for i, j in np.ndindex(result.shape):
        result[i, j] = total([a[i, k] * b[k, j] for k in range(len(b))])
    return result


def total(entries: Sequence[Any]) -> Any:
    """Sum without a start value."""
    result = entries[0]
    for entry in entries[1:]:
        result = result + entry
    return result


def one(entry: Any) -> Matrix:
    """A 1x1 matrix."""
    result = np.empty((1, 1), object if not isinstance(entry, float | complex | np.number) else type(entry))
    result[0, 0] = entry
    return result


def cross(a: Matrix, b: Matrix) -> Matrix:
    """Cross product."""
    x, y = a.ravel(), b.ravel()
    result = np.empty_like(x)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        result[k] = x[i] * y[j] - x[j] * y[i]
    return result.reshape(a.shape)


def embedded(m: Matrix, row: int, col: int, rows: int, cols: int) -> Matrix:
    """Inside a matrix of zeros."""
    result = np.empty((rows, cols), m.dtype)
    zero = m[0, 0] - m[0, 0]
    for i, j in np.ndindex(rows, cols):
        inside = row <= i < row + m.shape[0] and col <= j < col + m.shape[1]
        result[i, j] = m[i - row, j - col] if inside else zero
    return result


def frozen(a: Matrix) -> Matrix:
    """Without its infinitesimal parts, if it has any."""
    result = a.copy()
    result.ravel()[:] = [HyperDual(e.value) if isinstance(e, HyperDual) else e for e in a.ravel()]
    return result


def taken(where: Matrix, a: Any, b: Any) -> Matrix:
    """a where it holds, b elsewhere."""
    result: Matrix = np.where(where, a, b)
    return result


def as_truth(like: Matrix, holds: Matrix) -> Matrix:
    """Ones where it holds and zeros elsewhere, numbers like those given."""
    unit = like[0, 0] ** 0
    return taken(holds, unit, unit - unit)


def chosen(condition: Matrix, a: Matrix, b: Matrix) -> Matrix:
    """a where the condition (1x1, or one for each entry) is not 0, else b."""
    zero = condition - condition
    return taken((condition < zero) | (zero < condition), a, b)


def smaller(a: Matrix, b: Matrix) -> Matrix:
    """Entry by entry; the first at a tie."""
    return taken(b < a, b, a)


def greater(a: Matrix, b: Matrix) -> Matrix:
    """Entry by entry; the first at a tie."""
    return taken(a < b, b, a)
