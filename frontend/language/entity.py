"""What scenes, meshes and primitives share: a place in the lineage, names, attributes."""

from __future__ import annotations

import abc
import re
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from yasps.dialects.mat import spell
from yasps.dialects.rel.body import JOIN_OPERATIONS
from yasps.frontend.errors import (
    ConnectivityError,
    DataError,
    LineageError,
    NameTakenError,
    SceneError,
    ShapeMismatchError,
)
from yasps.frontend.language.arrays import checked_count
from yasps.frontend.language.attribute import Attribute, concat_cols
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.nodes import Joined, Named, Stored
from yasps.frontend.language.paper_names import EntityNames
from yasps.frontend.language.scene_lock import SceneLock, one_thread_at_a_time
from yasps.frontend.language.spelling import both_spellings

if TYPE_CHECKING:
    from yasps.frontend.scene import Scene

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_\-]*")


@both_spellings
class Entity(EntityNames, InScene, abc.ABC):
    """A scene, mesh, primitive or primitive union."""

    _kind = "entity"

    def __init__(self, name: str, parent: Entity | None) -> None:
        self.name = name
        self._parent = parent
        self._path: str | None = None
        self.attributes: dict[str, Attribute] = {}
        self._children: dict[str, Any] = {}

    @property
    @abc.abstractmethod
    def scene(self) -> Scene:
        """The scene it belongs to."""

    @property
    def _lock(self) -> SceneLock:
        return self.scene.lock

    @property
    @abc.abstractmethod
    def num_instances(self) -> int:
        """How many instances it has; meshes and scenes have one."""

    @property
    def is_dynamic(self) -> bool:
        """May the number of instances change?"""
        return False

    @property
    def follows_data(self) -> bool:
        """Does the number of instances follow from the data given? On dynamic primitives it does."""
        return False

    def set_num_instances(self, count: int) -> None:
        """Notes the new number of instances of a dynamic primitive; raises SceneError for a change of anything else."""
        if count != self.num_instances:
            raise SceneError(
                f"{self.label} has {self.num_instances} instances, whatever its data are; got {count}; only "
                "resize(...) of a primitive changes that"
            )

    @property
    def path(self) -> str:
        """Dotted name inside the scene; empty for the scene itself."""
        if self._path is None:
            above = self._parent.path if self._parent is not None else ""
            self._path = f"{above}.{self.name}" if above else self.name
        return self._path

    @property
    def label(self) -> str:
        """Name for messages."""
        return f"{self._kind} {self.path}"

    def lineage(self) -> list[Entity]:
        """Itself, its parent, and so on up to the scene."""
        return [self, *(self._parent.lineage() if self._parent is not None else [])]

    def __repr__(self) -> str:
        return f"<{self._kind} {self.path or self.name}: {self.num_instances} instances>"

    # -- names ---------------------------------------------------------------------------------------------

    def check_name(self, name: object, what: str) -> str:
        """The name, if it can be one and is free here."""
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise NameTakenError(
                f"{name!r} can't name {what}: a name starts with a letter and goes on with letters, digits, _ and -"
            )
        for taken, kind in ((self.attributes, "an attribute"), (self._children, "a part")):
            if name in taken:
                raise NameTakenError(f"{self.label} has {kind} named {name!r} already; choose another name for {what}")
        return name

    def check_child_name(self, name: object, what: str) -> str:
        """As check_name; a child is also reached as a Python attribute, so its name must not hide one of ours."""
        checked = self.check_name(name, what)
        if hasattr(type(self), checked) or checked in self.__dict__:
            raise NameTakenError(f"{checked!r} can't name {what}: {type(self).__name__} has a member of that name")
        return checked

    def _part(self, name: str) -> Any:
        """The part of this name, for `__getattr__`; what that may be is said there."""
        children = self.__dict__.get("_children", {})
        if name in children:
            return children[name]
        known = ", ".join([*children, *(k for k in self.__dict__.get("attributes", {}))]) or "nothing"
        hint = f"; {name!r} is an attribute: write [{name!r}]" if name in self.__dict__.get("attributes", {}) else ""
        raise AttributeError(f"{self._kind} {self.__dict__.get('name', '?')} has no {name!r}; it has {known}{hint}")

    def __contains__(self, name: object) -> bool:
        """Is there an attribute of this name?"""
        return name in self.attributes

    def __iter__(self) -> NoReturn:
        raise TypeError(f"{self.label} can't be iterated over; its attributes are in .attributes")

    def __getitem__(self, name: str | tuple[str, ...]) -> Attribute:
        """The attribute of this name; of several names, all flattened side by side in one row, 1 x (sum of sizes)."""
        if isinstance(name, tuple):
            return self._packed(name)
        if name in self.attributes:
            return self.attributes[name]
        raise SceneError(f"{self.label} has no attribute {name!r}; it has {', '.join(self.attributes) or 'none'}")

    def _packed(self, names: tuple[str, ...]) -> Attribute:
        if not names:
            raise SceneError(f"{self.label}[()] names no attribute; write {self.label}['x', 'y']")
        return concat_cols([part.reshape(1, part.shape[0] * part.shape[1]) for part in map(self.__getitem__, names)])

    # -- attributes ----------------------------------------------------------------------------------------

    @one_thread_at_a_time
    def add_constant(self, name: str, rows: int, cols: int, value: ArrayLike | None = None) -> Attribute:
        """Numbers that never take part in differentiation; zero until `update_value` (or `value`) sets them.

        Their values may still change over time (paper, 4.2). Raises NameTakenError, ShapeMismatchError, DataError.
        """
        return self._add_stored(name, rows, cols, value, constant=True)

    @one_thread_at_a_time
    def add_attribute(
        self,
        name: str,
        rows: int | None = None,
        cols: int | None = None,
        *,
        value: ArrayLike | None = None,
        computed_attribute: Attribute | None = None,
        through: Connectivity | None = None,
        source: Attribute | None = None,
        operation: str | None = None,
    ) -> Attribute:
        """Adds an attribute under a name (paper, 4.2, 4.5, 4.6). Exactly one of:

        - `rows`, `cols`: numbers the user sets, rows x cols on each instance; may be a minimisation target;
        - `computed_attribute`: a name for an expression of this entity's lineage;
        - `through`, `source`: JOIN of `source` (an attribute of the connectivity's target) through the connectivity;
          the result is arity x (rows cols). Through a connectivity of variable arity, with `operation` "sum" or "mean":
          the sum or mean over the connected instances, of the source's shape;
        - on a primitive union, the name alone: UNION of the members' attributes of that name.

        Raises NameTakenError, ShapeMismatchError, LineageError, ConnectivityError, DataError, SceneError.
        """
        given = [
            rows is not None or cols is not None,
            computed_attribute is not None,
            through is not None or source is not None,
        ]
        if sum(given) > 1:
            raise SceneError(
                f"{self.label}, attribute {name!r}: give rows and cols, or computed_attribute, or through and source, "
                "not several of them"
            )
        if value is not None and not given[0]:
            raise SceneError(
                f"{self.label}, attribute {name!r}: value goes with rows and cols; nothing else is set by numbers"
            )
        if computed_attribute is not None:
            return self._add_named(name, computed_attribute)
        if given[2]:
            return self._add_join(name, through, source, operation)
        if given[0]:
            if rows is None or cols is None:
                raise ShapeMismatchError(f"{self.label}, attribute {name!r}: give both rows and cols")
            return self._add_stored(name, rows, cols, value, constant=False)
        return self._add_union(name)

    def _register(self, name: str, attribute: Attribute) -> Attribute:
        self.attributes[name] = attribute
        return attribute

    def _add_stored(self, name: str, rows: int, cols: int, value: ArrayLike | None, constant: bool) -> Attribute:
        self.check_name(name, "an attribute")
        label = f"{self.label}, attribute {name!r}"
        shape = (
            checked_count(rows, f"{label}: rows", 1, ShapeMismatchError),
            checked_count(cols, f"{label}: cols", 1, ShapeMismatchError),
        )
        size = checked_count(shape[0] * shape[1], f"{label}: rows x cols", 1, ShapeMismatchError)
        try:
            stored = Stored(np.zeros((self.num_instances, *shape)), constant)
        except (MemoryError, ValueError) as error:  # ValueError: more bytes than a machine can address
            needed = f"{self.num_instances} x {spell(shape)} numbers are {8e-9 * self.num_instances * size:.3g} GB"
            raise DataError(f"{label}: {needed}, more than there is memory for") from error
        attribute = Attribute(self, shape, stored, name)
        if value is not None:
            numbers = attribute._checked_values(value)
            if len(numbers) != self.num_instances:  # those of a dynamic primitive are given together, by update
                raise DataError(
                    f"{attribute.path} needs numbers for {self.num_instances} instances, got {len(numbers)}"
                )
            stored.array = numbers.copy()
        return self._register(name, attribute)

    def _add_named(self, name: str, expression: Attribute) -> Attribute:
        self.check_name(name, "an attribute")
        if not isinstance(expression, Attribute):
            raise SceneError(
                f"{self.label}, attribute {name!r}: computed_attribute must be an attribute, got {expression!r}"
            )
        if expression.owner is not None and expression.owner not in self.lineage():
            raise LineageError(
                f"{expression.path} lives on {expression.owner.label} and can't be an attribute of {self.label}; JOIN "
                "it through a connectivity instead"
            )
        return self._register(name, Attribute(self, expression.shape, Named(expression), name))

    def _add_join(
        self, name: str, through: Connectivity | None, source: Attribute | None, operation: str | None
    ) -> Attribute:
        self.check_name(name, "an attribute")
        if not isinstance(through, Connectivity) or not isinstance(source, Attribute):
            raise SceneError(
                f"{self.label}, attribute {name!r}: a JOIN needs both through=connectivity and source=attribute"
            )
        if through.source is not self:
            raise ConnectivityError(
                f"{self.label}, attribute {name!r}: {through.path} starts at {through.source.path}, not here; a "
                "JOIN lives on the primitive its connectivity starts at"
            )
        if source.owner is not through.target:
            where = source.owner.label if source.owner is not None else "nowhere"
            raise LineageError(
                f"{self.label}, attribute {name!r}: the source {source.path} lives on {where}, but {through.path} "
                f"leads to {through.target.label}"
            )
        if not through.is_variable:
            if operation is not None:
                raise SceneError(
                    f"{self.label}, attribute {name!r}: {through.path} has the fixed arity {through.arity} and takes "
                    "no "
                    "operation; sum the rows of the JOIN instead"
                )
            shape = (through.arity, source.shape[0] * source.shape[1])
            entries = f"{self.label}, attribute {name!r}: arity x entries of the source"
            checked_count(shape[0] * shape[1], entries, 1, ShapeMismatchError)
            return self._register(name, Attribute(self, shape, Joined(through, source), name))
        if operation not in JOIN_OPERATIONS:
            raise SceneError(
                f"{self.label}, attribute {name!r}: {through.path} has a variable arity, so operation must be one of "
                f"{', '.join(JOIN_OPERATIONS)}, got {operation!r}"
            )
        if operation == "mean" and len(through.indices) and (through.indices[:, 0] < 0).any():
            lonely = int(np.flatnonzero(through.indices[:, 0] < 0)[0])
            raise ConnectivityError(
                f"{self.label}, attribute {name!r}: instance {lonely} of {through.path} is connected to nothing, and "
                "there is "
                'no mean of nothing; use operation="sum"'
            )
        through.needs_neighbours = through.needs_neighbours or operation == "mean"
        return self._register(name, Attribute(self, source.shape, Joined(through, source, operation), name))

    def _add_union(self, name: str) -> Attribute:
        raise ShapeMismatchError(
            f"{self.label}, attribute {name!r}: give rows and cols, computed_attribute, or through and source (a "
            "name alone is a UNION, on primitive unions only)"
        )
