"""How bodies meet: friction and stiffness of each pair of them, and whether they meet at all."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yasps import SceneError
from yasps.contact.active_set import Floats, Ids
from yasps.frontend.language.arrays import positive_number, real_numbers

LOGGER = logging.getLogger("yasps")

MODULUS_SHARE = 0.1
"""Default stiffness of a contact over the smaller contact modulus of the two bodies (Li et al. 2023, section 6)."""
FAR_OFF = 100.0
"""A stiffness that differs from the default by more than this factor is announced."""


@dataclass(frozen=True)
class _Entry:
    """What is said of one pair of bodies; None: as for all others."""

    friction: float | None = None
    kinetic_friction: float | None = None
    stiffness: float | None = None
    enabled: bool = True


class ContactTable:
    """Friction and stiffness of contact, for all pairs of bodies and for single ones.

    friction: coefficient of Coulomb friction of pairs that `set` says nothing of; of things at rest where
    kinetic_friction, that of things which slide, differs. stiffness [Pa]: kappa of the barrier; by default a tenth of
    the smaller contact modulus of the two bodies.

    Raises SceneError for numbers out of range.
    """

    def __init__(
        self, friction: float = 0.0, kinetic_friction: float | None = None, stiffness: float | None = None
    ) -> None:
        if friction is None:
            raise SceneError("friction of the contact table is a number, 0 for none, got None")
        self._default = _checked(_Entry(friction, kinetic_friction, stiffness), "the contact table")
        self._pairs: dict[frozenset[str], _Entry] = {}

    def set(
        self,
        first: str,
        second: str,
        *,
        friction: float | None = None,
        kinetic_friction: float | None = None,
        stiffness: float | None = None,
        enabled: bool = True,
    ) -> ContactTable:
        """Says how two bodies meet, by their names in any order; twice the same name: how a body meets itself.

        enabled: False: they go through each other. What is not given is as for all other pairs, but a pair with a
        friction of its own has that of things which slide, too, unless it is given. A simulation reads the table when
        it is made, and when bodies come and go. Returns the table. Raises SceneError for numbers out of range and for
        what is no name.
        """
        what = f"contact of {first!r} and {second!r}"
        for name in (first, second):
            if not isinstance(name, str):
                raise SceneError(f"a contact table knows bodies by their names, got {name!r}: write body.name")
        entry = _checked(_Entry(friction, kinetic_friction, stiffness, enabled), what)
        if friction is None:
            _checked(replace(entry, friction=self._default.friction), what)
        self._pairs[frozenset((first, second))] = entry
        return self

    def of(self, names: Iterable[str]) -> ContactTable:
        """What it says of these bodies alone."""
        few, chosen = copy(self), set(names)
        few._pairs = {pair: entry for pair, entry in self._pairs.items() if pair <= chosen}
        return few

    @property
    def names(self) -> frozenset[str]:
        """Names of bodies that it knows."""
        return frozenset[str]().union(*self._pairs)

    def entry(self, first: str, second: str) -> tuple[float, float, float | None, bool]:
        """Friction, kinetic friction, stiffness (None: the default) and whether two bodies meet."""
        own = self._pairs.get(frozenset((first, second)), _Entry())
        friction = self._default.friction if own.friction is None else own.friction
        assert friction is not None
        kinetic = own.kinetic_friction
        if kinetic is None:
            kinetic = self._default.kinetic_friction if own.friction is None else None
        stiffness = self._default.stiffness if own.stiffness is None else own.stiffness
        return friction, friction if kinetic is None else kinetic, stiffness, own.enabled


@dataclass(frozen=True)
class ContactLaws:
    """The different ways in which vertices meet.

    class_of: int32 [n], the class of each vertex; law_of: int32 [classes, classes], the law of two classes; enabled:
    bool [classes, classes]; stiffness [Pa or J/m^4], friction, kinetic_friction: [laws]. plane_class: int32 [planes].
    """

    class_of: Ids
    plane_class: Ids
    law_of: Ids
    enabled: NDArray[np.bool_]
    stiffness: Floats
    friction: Floats
    kinetic_friction: Floats

    def of(self, first: Ids, second: Ids) -> Ids:
        """The laws of pairs of vertices, [n]."""
        if len(self.stiffness) == 1:
            return np.zeros(len(first), np.int32)
        return np.asarray(self.law_of[self.class_of[first], self.class_of[second]])

    def of_planes(self, vertices: Ids, planes: Ids) -> Ids:
        """The laws of pairs of a vertex and a half-space, [n]."""
        return np.asarray(self.law_of[self.class_of[vertices], self.plane_class[planes]])

    def resized(self, old: Mapping[str, int], new: Mapping[str, int]) -> ContactLaws:
        """The same laws for objects with other numbers of vertices, name -> number in order; there and here alike."""
        first = np.cumsum([0, *old.values()])
        classes = [self.class_of[start] if count else 0 for start, count in zip(first, old.values(), strict=False)]
        return replace(self, class_of=np.repeat(np.array(classes, np.int32), list(new.values())))

    @property
    def has_friction(self) -> bool:
        """Whether any law has."""
        return bool((self.friction > 0).any() or (self.kinetic_friction > 0).any())


def laws_of(
    table: ContactTable,
    objects: Mapping[str, int],
    moduli: Mapping[str, float],
    planes: Sequence[str] = (),
    *,
    stiffness: float | None = None,
) -> ContactLaws:
    """The laws of a scene.

    objects: name -> number of vertices, in order; moduli: name -> contact modulus [Pa], infinite where it is missing;
    planes: names of half-spaces. stiffness: of all pairs of which the table says nothing.

    Raises SceneError for names that two things have, for names in the table that nothing has, for moduli that are not
    positive, and where nothing says how stiff a contact is.
    """
    names = [*objects, *planes]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise SceneError(f"two of the objects and half-spaces are named {twice!r}: give them names of their own")
    for name, modulus in moduli.items():
        if real_numbers(modulus, f"the contact modulus of {name!r}", SceneError, finite=False) != np.inf:
            positive_number(modulus, f"the contact modulus of {name!r}", "Pa", SceneError)
    unknown = sorted(table.names - set(names))
    if unknown:
        raise SceneError(f"the contact table names {unknown[0]!r}, but there are only {', '.join(map(repr, names))}")
    # Bodies of one modulus that the table does not name meet all others in the same way.
    keys = [(name if name in table.names else "", float(moduli.get(name, np.inf))) for name in names]
    classes = list(dict.fromkeys(keys))
    said: set[tuple[float | None, float]] = set()
    rows: dict[tuple[float, float, float], int] = {}
    law_of = np.zeros((len(classes), len(classes)), np.int32)
    enabled = np.ones((len(classes), len(classes)), np.bool_)
    softest = min((modulus for _, modulus in classes), default=np.inf)
    for i, (one, first) in enumerate(classes):
        for j, (other, second) in enumerate(classes[: i + 1]):
            friction, kinetic, own, enabled[i, j] = table.entry(one, other)
            # Two that nothing moves don't push each other; any number will do.
            modulus = min(first, second) if np.isfinite(min(first, second)) else softest
            given = stiffness if own is None else own
            if enabled[i, j] and (given, modulus) not in said:
                said.add((given, modulus))
                _announce(given, modulus, [names[keys.index(classes[k])] for k in (j, i)])
            kappa = MODULUS_SHARE * modulus if given is None else given
            law_of[i, j] = law_of[j, i] = rows.setdefault((kappa, friction, kinetic), len(rows))
            enabled[j, i] = enabled[i, j]
    numbers = np.array(list(rows), np.float64).reshape(-1, 3)
    index = [classes.index(key) for key in keys]
    return ContactLaws(
        class_of=np.repeat(np.array(index[: len(objects)], np.int32), list(objects.values())),
        plane_class=np.array(index[len(objects) :], np.int32),
        law_of=law_of,
        enabled=enabled,
        stiffness=numbers[:, 0].copy(),
        friction=numbers[:, 1].copy(),
        kinetic_friction=numbers[:, 2].copy(),
    )


def _announce(given: float | None, modulus: float, bodies: Sequence[str]) -> None:
    """Says which stiffness [Pa] a pair of bodies, and others like it, has by default; warns of one that is far off.

    Raises SceneError if there is no default.
    """
    default = MODULUS_SHARE * modulus
    what = " and ".join(map(repr, bodies))
    if given is None:
        if not np.isfinite(default):
            raise SceneError(
                f"nothing says how stiff contact of {what} is: give a stiffness [Pa], or bodies with a finite "
                "contact_modulus"
            )
        LOGGER.info("contact of %s: stiffness %.3g Pa, a tenth of the softer modulus", what, default)
    elif np.isfinite(default) and not default / FAR_OFF <= given <= default * FAR_OFF:
        LOGGER.warning(
            "contact of %s: a stiffness of %.3g Pa is far from a tenth of the softer modulus, %.3g Pa: %s",
            what,
            given,
            default,
            "surfaces come very near each other" if given < default else "steps are hard to solve",
        )


def _checked(entry: _Entry, what: str) -> _Entry:
    """The entry with plain floats. Raises SceneError for numbers out of range."""
    numbers: dict[str, float] = {}
    for name in ("friction", "kinetic_friction", "stiffness"):
        value = getattr(entry, name)
        if value is None:
            continue
        is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
        if not (is_number and np.isfinite(value) and value >= 0):
            raise SceneError(f"{name} of {what} must be a number >= 0, got {value!r}")
        numbers[name] = float(value)
    if not isinstance(entry.enabled, bool):
        raise SceneError(f"enabled of {what} is True or False, got {entry.enabled!r}")
    if entry.stiffness == 0:
        raise SceneError(f"stiffness of {what} must be positive; for none at all set enabled=False")
    if entry.friction is not None and (entry.kinetic_friction or 0.0) > entry.friction:
        raise SceneError(
            f"kinetic_friction of {what} is {entry.kinetic_friction}, above friction {entry.friction}: things that "
            "slide would stick harder than things at rest"
        )
    return _Entry(**numbers, enabled=entry.enabled)
