"""What an attribute is: numbers of the user, a JOIN, a UNION, a name for an expression, or an operation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from xdsl.ir import Attribute as IrAttribute

from yasps.dialects.mat import MatOp

if TYPE_CHECKING:
    from yasps.frontend.language.attribute import Attribute
    from yasps.frontend.language.connectivity import Connectivity

FloatArray = NDArray[np.float64]


class Stored:
    """An attribute whose numbers the user supplies: `array` is [instances, rows, columns].

    `version` counts how often they were set in place.
    """

    def __init__(self, array: FloatArray, constant: bool) -> None:
        self.array = array
        self.constant = constant
        self.version = 0


@dataclass(frozen=True)
class Joined:
    """JOIN of `source` through `connectivity`; of a variable arity, their "sum" or "mean"."""

    connectivity: Connectivity
    source: Attribute
    operation: str | None = None


@dataclass(frozen=True)
class United:
    """UNION of the members' attributes, in the order of the primitive union."""

    members: tuple[Attribute, ...]


@dataclass(frozen=True)
class Named:
    """A name given to an expression."""

    expression: Attribute


@dataclass(frozen=True)
class Computed:
    """An operation of the `mat` dialect on other attributes."""

    op_class: type[MatOp]
    operands: tuple[Attribute, ...]
    properties: tuple[tuple[str, IrAttribute], ...]


Node = Stored | Joined | United | Named | Computed


def operands_of(node: Node) -> tuple[Attribute, ...]:
    """The attributes that this one is computed from directly."""
    match node:
        case Stored():
            return ()
        case Joined():
            return (node.source,)
        case United():
            return node.members
        case Named():
            return (node.expression,)
        case Computed():
            return node.operands


@dataclass(frozen=True)
class ComputedValue:
    """Numbers of an attribute. `value`: flat, as the paper has it; `array`: [instances, rows, columns]."""

    array: FloatArray

    @property
    def value(self) -> FloatArray:
        """All entries, instance by instance, row-major."""
        return self.array.reshape(-1)
