"""Arrays that users give: what is no plain array of the right type or layout is refused, never converted in silence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.dialects.mat import spell
from yasps.frontend.errors import DataError, ShapeMismatchError, YaspsError
from yasps.runtime.device.foreign_arrays import is_on_device

_Floats = NDArray[np.float64]
GREATEST_INDEX = int(np.iinfo(np.int32).max)
"""Indices and counts are int32 in all that is compiled."""


def plain_array(values: ArrayLike, what: str, error: type[Exception] = DataError) -> NDArray[Any]:
    """The values as a NumPy array of whatever type they have.

    Raises `error`, named by `what`, for ragged lists, for masked entries (a plain array would show what lies under the
    mask), for arrays on a GPU and for what is no array.
    """
    if type(values) is np.ndarray:
        return values
    if is_on_device(values):
        raise error(f"{what} needs an array in the host's memory, got one on a GPU: copy it, e.g. by .get() or .cpu()")
    if _is_masked(values):
        raise error(f"{what} got an array with masked entries: fill them, e.g. by array.filled(0), or leave them out")
    try:
        return np.asarray(values)
    except YaspsError:
        raise  # from Attribute.__array__
    except ValueError as problem:
        raise error(f"{what} needs numbers, got a ragged list: {problem}") from problem
    except (TypeError, RuntimeError, OverflowError) as problem:
        raise error(f"{what} needs numbers, got {type(values).__name__}: {problem}") from problem


def _is_masked(values: object) -> bool:
    if isinstance(values, list | tuple):
        return any(_is_masked(part) for part in values if isinstance(part, list | tuple | np.ma.MaskedArray))
    return isinstance(values, np.ma.MaskedArray) and bool(np.ma.is_masked(values))


def real_numbers(values: ArrayLike, what: str, error: type[Exception] = DataError, *, finite: bool = True) -> _Floats:
    """The values as a C-contiguous float64 array of the same shape; truth values become 0 and 1.

    Raises `error` for what `plain_array` refuses, for complex numbers, text and objects, and unless finite=False for
    NaN and infinity.
    """
    given = plain_array(values, what, error)
    if given.dtype.kind not in "fiub":
        raise error(f"{what} needs real numbers, got {given.dtype}")
    array = np.asarray(given, dtype=np.float64, order="C")
    if finite and not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array.ravel()))
        raise error(f"{what}: entry {bad[0]} is {array.ravel()[bad[0]]} ({bad.size} entries are not finite)")
    return array


def positive_number(value: ArrayLike, what: str, unit: str, error: type[Exception] = DataError) -> float:
    """One finite number above 0, or `error`."""
    number = real_numbers(value, what, error, finite=False)
    if number.shape != () or not 0 < number < np.inf:
        raise error(f"{what} must be positive, one finite number, got {value!r} {unit}")
    return float(number)


def vertices_and_elements(
    vertices: ArrayLike, elements: ArrayLike, corners: int, what: tuple[str, str]
) -> tuple[_Floats, NDArray[Any]]:
    """Positions [n, 3] and vertex indices [m, corners] of a mesh, each index from 0 to n - 1.

    what: names of both. Raises ShapeMismatchError for other shapes, DataError for other types and for an index out of
    range.
    """
    x, t = real_numbers(vertices, what[0]), plain_array(elements, what[1])
    if x.ndim != 2 or x.shape[1] != 3 or t.ndim != 2 or t.shape[1] != corners:
        raise ShapeMismatchError(
            f"{what[0]} must have shape [n, 3] and {what[1]} [m, {corners}], got {x.shape} and {t.shape}"
        )
    if t.dtype.kind not in "iu":
        raise DataError(f"{what[1]} holds vertex indices, which are integers, got {t.dtype}")
    if t.size and not 0 <= t.min() <= t.max() < len(x):
        row = int(np.flatnonzero(((t < 0) | (t >= len(x))).any(axis=1))[0])
        raise DataError(f"{what[1]}: row {row} is {t[row].tolist()}, but there are vertices 0 to {len(x) - 1}")
    return x, t.astype(np.int64)


def checked_count(count: object, what: str, least: int, error: type[Exception] = DataError) -> int:
    """The count as an int; raises `error` unless it is an integer from `least` to what int32 holds."""
    if not isinstance(count, int | np.integer) or isinstance(count, bool) or count < least:
        raise error(f"{what} must be {'a positive integer' if least == 1 else f'an integer >= {least}'}, got {count!r}")
    if count > GREATEST_INDEX:
        raise error(f"{what} is {count}, but instances, rows and columns are counted in int32: up to {GREATEST_INDEX}")
    return int(count)


def in_instances(array: _Floats, count: int | None, shape: tuple[int, int], what: str) -> _Floats:
    """The array as [instances, rows, columns] for matrices of this shape on so many instances.

    It may be flat (row-major, instance by instance), or have the instances as its first axis and then the matrix:
    rows x columns, the same without axes of length 1, or flat. For one instance the matrix alone will do.
    count: None if the number of instances follows from the array.

    Raises DataError for every other layout: it holds the numbers in another order.
    """
    rows, cols = shape
    size = rows * cols
    number = count
    if number is None:
        number = array.size // size if array.ndim == 1 else len(array) if array.ndim else 0
    if array.ndim == 0:
        fits = count == 1 and size == 1
    elif array.ndim == 1:
        fits = array.size == number * size
    else:
        fits = len(array) == number and _is_matrix(array.shape[1:], shape)
    if not fits and not (count == 1 and _is_matrix(array.shape, shape)):
        raise DataError(_wrong_layout(array, count, shape, what))
    return array.reshape(number, rows, cols)


def _is_matrix(given: tuple[int, ...], shape: tuple[int, int]) -> bool:
    return given == (math.prod(shape),) or [k for k in given if k != 1] == [k for k in shape if k != 1]


def _wrong_layout(array: _Floats, count: int | None, shape: tuple[int, int], what: str) -> str:
    rows, cols = shape
    size = rows * cols
    n = "n" if count is None else str(count)
    if count is None:
        needs = f"{spell(shape)} on each of n instances"
        flat = f"(n * {size},)" if size > 1 else "(n,)"
    else:
        needs = f"{count} x {spell(shape)} = {count * size} numbers"
        flat = f"({count * size},)"
    taken = [flat, f"({n}, {size})", f"({n}, {rows}, {cols})", *([f"({rows}, {cols})"] if count == 1 else [])]
    hint = ""
    if array.ndim >= 2 and array.shape[-1] == count != array.shape[0]:
        hint = "; the instances are its last axis: give them as the first, e.g. by np.moveaxis(array, -1, 0)"
    return (
        f"{what} needs {needs}, got {array.size} in shape {array.shape}; shapes {', '.join(dict.fromkeys(taken))} are "
        f"taken{hint}"
    )
