"""What a table of mutations consists of."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutation:
    """One mistake that a developer could make, and the tests that must see it.

    file: below the top folder. right: a text that occurs exactly once in it; wrong: what takes its place. tests: files
    or tests as pytest names them; as few as will do, so that a mutation costs seconds.
    """

    title: str
    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]
