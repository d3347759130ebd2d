"""What NumPy's functions mean for attributes: `np.sin(a)`, `np.where(c, a, b)`, `np.linalg.norm(a)` and the like.

NumPy asks an attribute first (its protocols `__array_ufunc__` and `__array_function__`). Attributes always have rows
and columns, so results are what NumPy gives, with the axis that it would drop kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from yasps.dialects.scalar.functions import FUNCTIONS
from yasps.frontend.errors import SceneError, ShapeMismatchError
from yasps.frontend.language.attribute import Attribute, as_attribute, concat_cols, concat_rows
from yasps.frontend.language.functions import atan2, eigenvalues, hypot, maximum, minimum, select


def call_ufunc(ufunc: np.ufunc, method: str, inputs: Sequence[Any], keywords: Mapping[str, Any]) -> Attribute:
    """`ufunc(*inputs)`. Raises SceneError for a function that has no meaning here, or for `out=` and the like."""
    meaning = _UFUNCS.get(ufunc)
    if meaning is None or method != "__call__" or keywords:
        called = f"np.{ufunc.__name__}" + ("" if method == "__call__" else f".{method}")
        _refuse(called + (f"(..., {'=..., '.join(keywords)}=...)" if keywords else ""))
    return meaning(*(as_attribute(value) for value in inputs))


def call_function(function: Any, inputs: Sequence[Any], keywords: Mapping[str, Any]) -> Any:
    """`function(*inputs, **keywords)`. Raises SceneError for a function that has no meaning here."""
    meaning = _FUNCTIONS.get(function)
    name = f"{function.__module__}.{function.__name__}".replace("numpy", "np")
    if meaning is None:
        _refuse(name)
    try:
        return meaning(*inputs, **keywords)
    except TypeError as error:
        raise SceneError(f"{name} of attributes: {error}") from error


def _refuse(called: str) -> NoReturn:
    ufuncs = sorted(ufunc.__name__ for ufunc in _UFUNCS)
    functions = sorted(f"{f.__module__}.{f.__name__}".removeprefix("numpy.") for f in _FUNCTIONS)
    raise SceneError(
        f"{called} has no meaning for attributes, which are symbolic; NumPy's functions that have one: "
        f"{', '.join([*ufuncs, *functions])}. Numbers are at compute().array"
    )


def _multiply(a: Attribute, b: Attribute) -> Attribute:
    """`array * attribute` comes here, so it has to be the product that `*` is."""
    return a * b


def _dot(a: Any, b: Any) -> Attribute:
    first, second = as_attribute(a), as_attribute(b)
    if first.is_vector and second.is_vector and first.size == second.size:
        return first.reshape(-1, 1).dot(second.reshape(-1, 1))
    return first * second


def _cross(a: Any, b: Any) -> Attribute:
    return as_attribute(a).cross(as_attribute(b))


def _stack(arrays: Sequence[Any], axis: int = 0) -> Attribute:
    parts = [as_attribute(part) for part in arrays]
    if not parts or not all(part.is_vector for part in parts):
        raise ShapeMismatchError("np.stack of attributes takes numbers and vectors; matrices would need a third axis")
    if axis in (1, -1):
        return concat_cols([part.reshape(-1, 1) for part in parts])
    if axis != 0:
        raise ShapeMismatchError(f"np.stack of attributes along axis {axis}: they have rows (0) and columns (1)")
    return concat_rows([part.reshape(1, -1) for part in parts])


def _concatenate(arrays: Sequence[Any], axis: int = 0) -> Attribute:
    if axis not in (0, 1, -1):
        raise ShapeMismatchError(f"np.concatenate of attributes along axis {axis}: they have rows (0) and columns (1)")
    return concat_rows(arrays) if axis == 0 else concat_cols(arrays)


def _where(condition: Any, then: Any, otherwise: Any) -> Attribute:
    return select(condition, then, otherwise)


def _method(name: str) -> Callable[[Any], Attribute]:
    return lambda a: getattr(as_attribute(a), name)()


_UFUNCS: dict[np.ufunc, Callable[..., Attribute]] = {
    np.add: lambda a, b: a + b,
    np.subtract: lambda a, b: a - b,
    np.multiply: _multiply,
    np.matmul: lambda a, b: a @ b,
    np.divide: lambda a, b: a / b,
    np.power: lambda a, b: a**b,
    np.positive: lambda a: +a,
    np.negative: lambda a: -a,
    np.square: lambda a: a**2,
    np.less: lambda a, b: a < b,
    np.less_equal: lambda a, b: a <= b,
    np.greater: lambda a, b: a > b,
    np.greater_equal: lambda a, b: a >= b,
    np.logical_and: lambda a, b: a & b,
    np.logical_or: lambda a, b: a | b,
    np.logical_not: lambda a: ~a,
    np.bitwise_and: lambda a, b: a & b,
    np.bitwise_or: lambda a, b: a | b,
    np.invert: lambda a: ~a,
    np.maximum: maximum,
    np.minimum: minimum,
    np.arctan2: atan2,
    np.absolute: _method("abs"),
    np.hypot: hypot,
    **{function.ufunc: _method(function.name) for function in FUNCTIONS},
}

_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: _where,
    np.dot: _dot,
    np.cross: _cross,
    np.outer: lambda a, b: as_attribute(a).outer(as_attribute(b)),
    np.stack: _stack,
    np.concatenate: _concatenate,
    np.vstack: concat_rows,
    np.hstack: concat_cols,
    np.transpose: _method("transpose"),
    np.trace: _method("trace"),
    np.sum: _method("sum"),
    np.ravel: _method("flatten"),
    np.reshape: lambda a, shape: as_attribute(a).reshape(shape),
    np.shape: lambda a: a.shape,
    np.ndim: lambda a: a.ndim,
    np.size: lambda a: a.size,
    np.linalg.norm: _method("norm"),
    np.linalg.det: _method("det"),
    np.linalg.inv: _method("inverse"),
    np.linalg.eigvalsh: eigenvalues,
}
