"""Indices of rows and columns, as users write them."""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING

import numpy as np
from xdsl.dialects.builtin import DenseArrayBase, i64
from xdsl.ir import Attribute as IrAttribute

from yasps.dialects.mat import spell
from yasps.frontend.errors import ShapeMismatchError

if TYPE_CHECKING:
    from yasps.frontend.language.attribute import Attribute


def integer(value: object, what: str) -> int:
    """The value as an integer; raises ShapeMismatchError for anything else, 1.0 and True included."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return operator.index(value)
    raise ShapeMismatchError(f"{what} must be an integer, got {value!r}")


def integers(*values: int) -> IrAttribute:
    """An array of integers as an operation's property."""
    return DenseArrayBase.from_list(i64, [integer(value, "a number of rows or columns") for value in values])


def wrapped(index: object, length: int, word: str, attribute: Attribute) -> int:
    """The index counted from the start; raises for one out of range."""
    number = integer(index, f"the {word} of {attribute.path}")
    if not -length <= number < length:
        raise ShapeMismatchError(f"{attribute.path} is {spell(attribute.shape)} and has no {word} {number}")
    return number % length


def chosen(index: object, length: int, word: str, attribute: Attribute) -> list[tuple[int, int]]:
    """What an index or a slice chooses of the rows or columns, as (first, how many) of neighbours.

    Raises ShapeMismatchError for an index out of range, a slice of nothing, and for anything else.
    """
    if not isinstance(index, slice):
        return [(wrapped(index, length, word, attribute), 1)]
    numbers = range(length)[index]
    if not numbers:
        raise ShapeMismatchError(f"{attribute.path} is {spell(attribute.shape)}: {index} chooses no {word} of it")
    return [(numbers[0], len(numbers))] if numbers.step == 1 else [(number, 1) for number in numbers]
