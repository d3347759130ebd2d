"""Functions of every entry of an attribute, from the table in `dialects/scalar/functions.py`.

Type checkers see entrywise.pyi beside this file, which `python tools/write_stubs.py` writes from the same table.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING

from yasps.dialects.mat.elementwise import TABLED, TabledFunction

if TYPE_CHECKING:
    from yasps.frontend.language.attribute import Attribute


class EntrywiseFunctions(abc.ABC):
    """Base class of `Attribute`: it has a method for each function of the table."""

    @abc.abstractmethod
    def _apply(self, operation: type[TabledFunction]) -> Attribute:
        """The operation on this attribute."""


def _method(operation: type[TabledFunction]) -> Callable[[EntrywiseFunctions], Attribute]:
    def method(self: EntrywiseFunctions) -> Attribute:
        return self._apply(operation)

    method.__name__ = operation.FUNCTION.name
    method.__qualname__ = f"EntrywiseFunctions.{method.__name__}"
    method.__doc__ = f"{operation.FUNCTION.about} of every entry."
    return method


for _name, _operation in TABLED.items():
    setattr(EntrywiseFunctions, _name, _method(_operation))
