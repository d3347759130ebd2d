"""The paper writes `addMesh(numInstances=...)`, Python writes `add_mesh(num_instances=...)`; both work everywhere."""

from __future__ import annotations

import functools
import inspect
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
        translated: dict[str, Any] = {}
        for key, value in keywords.items():
            if snake_case(key) in translated:
                raise TypeError(f"{function.__qualname__}() got {snake_case(key)} twice, in both spellings")
            translated[snake_case(key)] = value
        return function(*arguments, **translated)

    return wrapper


def both_spellings(cls: type[T]) -> type[T]:
    """Class decorator: every public method and property of several words is there in camelCase too.

    Type checkers don't see what it adds: for them the names stand in paper_names.pyi, the base class `...Names` of each
    class. A method of one word (`solve`) keeps its name; those that have keywords of several words are decorated by
    `paper_spelling` and show type checkers both by overloads.
    """
    for name, member in list(vars(cls).items()):
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            setattr(cls, camel_case(name), member)
        elif inspect.isfunction(member) and "_" in name:
            setattr(cls, camel_case(name), paper_spelling(member))
    return cls
