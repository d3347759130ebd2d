"""What a contact table takes, and what it says of a pair."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from yasps import SceneError
from yasps.contact import ContactTable


def test_a_pair_has_its_own_numbers_and_those_of_all() -> None:
    table = ContactTable(0.5, 0.4, stiffness=1e4).set("a", "b", friction=np.float32(0.25)).set("c", "c", stiffness=2)
    table.set("a", "c", kinetic_friction=0.1, enabled=False)
    assert table.entry("b", "a") == (0.25, 0.25, 1e4, True)
    assert table.entry("c", "c") == (0.5, 0.4, 2.0, True)
    assert table.entry("c", "a") == (0.5, 0.1, 1e4, False)
    assert table.entry("x", "y") == (0.5, 0.4, 1e4, True)
    few = table.of(["a", "b", "x"])
    assert (few.names, few.entry("a", "b"), few.entry("a", "c")) == (
        {"a", "b"},
        (0.25, 0.25, 1e4, True),
        few.entry("x", "x"),
    )
    assert table.names == {"a", "b", "c"}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ContactTable(-0.1), "friction of the contact table must be a number >= 0, got -0.1"),
        (lambda: ContactTable("0.5"), "must be a number >= 0, got '0.5'"),
        (lambda: ContactTable(True), "must be a number >= 0, got True"),
        (lambda: ContactTable([0.5]), "must be a number >= 0, got"),
        (lambda: ContactTable(None), "friction of the contact table is a number, 0 for none"),
        (lambda: ContactTable(np.nan), "must be a number >= 0, got nan"),
        (lambda: ContactTable(0.1, 0.2), "kinetic_friction of the contact table is 0.2, above friction 0.1"),
        (lambda: ContactTable(0.3).set("a", "b", kinetic_friction=0.5), "'a' and 'b' is 0.5, above friction 0.3"),
        (lambda: ContactTable().set("a", "b", stiffness=0), "stiffness of contact of 'a' and 'b' must be positive"),
        (lambda: ContactTable().set("a", "b", enabled="no"), "enabled of .* is True or False, got 'no'"),
        (lambda: ContactTable().set("a", object()), "knows bodies by their names, got <object"),
    ],
)
def test_what_is_refused(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        make()


def test_a_refused_pair_is_as_before() -> None:
    table = ContactTable(0.3)
    with pytest.raises(SceneError, match="above friction"):
        table.set("a", "b", kinetic_friction=0.5)
    assert table.entry("a", "b") == (0.3, 0.3, None, True)
    assert not table.names
