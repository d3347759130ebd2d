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

    A method of one word (`solve`) keeps its name and takes its keyword arguments in both spellings.
    """
    for name, member in list(vars(cls).items()):
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            setattr(cls, camel_case(name), member)
        elif inspect.isfunction(member) and ("_" in name or _has_keywords_of_several_words(member)):
            setattr(cls, camel_case(name), paper_spelling(member))
    return cls


def _has_keywords_of_several_words(function: Callable[..., Any]) -> bool:
    """Any parameter to translate? Not for `**names`, which are the user's own."""
    parameters = inspect.signature(function).parameters.values()
    return any("_" in parameter.name for parameter in parameters if parameter.kind is not parameter.VAR_KEYWORD)
