"""The paper writes `addMesh(numInstances=...)`, Python writes `add_mesh(num_instances=...)`; both work everywhere."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


def camel_case(name: str) -> str:
    """`add_mesh` -> `addMesh`."""
    first, *rest = name.split("_")
    return first + "".join(word.capitalize() for word in rest)


def snake_case(name: str) -> str:
    """`addMesh` -> `add_mesh`."""
    return re.sub(r"(?<!^)([A-Z])", lambda match: "_" + match.group(1).lower(), name)


def paper_spelling(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, which also takes its keyword arguments in camelCase."""

    @functools.wraps(function)
    def wrapper(*arguments: Any, **keywords: Any) -> Any:
        return function(*arguments, **{snake_case(key): value for key, value in keywords.items()})

    return wrapper


def both_spellings(cls: type[T]) -> type[T]:
    """Class decorator: every public method and property of several words is there in camelCase too."""
    for name, member in list(vars(cls).items()):
        if name.startswith("_") or "_" not in name:
            continue
        if isinstance(member, property):
            setattr(cls, camel_case(name), member)
        elif callable(member):
            setattr(cls, camel_case(name), paper_spelling(member))
    return cls
