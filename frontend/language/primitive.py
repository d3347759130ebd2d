"""Primitives and primitive unions (paper, 4.1 and 4.6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from yasps.dialects.mat import spell
from yasps.frontend.errors import ConnectivityError, DataError, SceneError, ShapeMismatchError
from yasps.frontend.language.arrays import checked_count
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.nodes import FloatArray, Stored, United
from yasps.frontend.language.paper_names import PrimitiveBaseNames, PrimitiveNames, PrimitiveUnionNames
from yasps.frontend.language.scene_lock import one_thread_at_a_time
from yasps.frontend.language.spelling import both_spellings

if TYPE_CHECKING:
    from yasps.frontend.language.mesh import Mesh
    from yasps.frontend.scene import Scene


@both_spellings
class PrimitiveBase(PrimitiveBaseNames, Entity):
    """A primitive or a primitive union: something with instances, which can be connected."""

    def __init__(self, name: str, mesh: Mesh) -> None:
        super().__init__(name, mesh)
        self.mesh = mesh
        self.connectivities: dict[str, Connectivity] = {}

    @property
    def scene(self) -> Scene:
        """The scene it belongs to."""
        return self.mesh.scene

    def __getattr__(self, name: str) -> Connectivity:
        """A connectivity by its name."""
        return cast(Connectivity, self._part(name))

    @one_thread_at_a_time
    def add_connectivity(
        self,
        name: str,
        target: PrimitiveBase,
        indices: ArrayLike,
        arity: int | None = None,
        *,
        counts: ArrayLike | None = None,
        longest: int = 1,
    ) -> Connectivity:
        """Connects each instance to `arity` instances of `target` (0-based; paper, 4.4).

        indices: instances x arity of them, flat or in rows; empty for a dynamic primitive until it is known.
        counts: instead of arity, how many of the (flat) indices each instance has; JOINs through such a connectivity of
        variable arity are sums or means (`operation`). longest: how many they may get later without a compile.
        Raises ConnectivityError for a wrong count, type, arity or range; NameTakenError.
        """
        self.check_child_name(name, "a connectivity")
        if not isinstance(target, PrimitiveBase):
            raise ConnectivityError(
                f"{self.label}, connectivity {name!r}: the target must be a primitive, got {target!r}"
            )
        if target.scene is not self.scene:
            raise ConnectivityError(f"{self.label}, connectivity {name!r}: {target.label} belongs to another scene")
        if (arity is None) == (counts is None):
            raise ConnectivityError(f"{self.label}, connectivity {name!r}: give either arity or counts")
        if arity is not None:
            arity = checked_count(arity, f"{self.label}, connectivity {name!r}: arity", 1, ConnectivityError)
        longest = checked_count(longest, f"{self.label}, connectivity {name!r}: longest", 1, ConnectivityError)
        if arity is not None and longest > 1:
            raise ConnectivityError(
                f"{self.label}, connectivity {name!r}: longest is for rows that are given by counts"
            )
        connectivity = Connectivity(name, self, target, indices, arity=arity, counts=counts, longest=longest)
        if self.follows_data and len(connectivity.indices) != self.num_instances:
            if any(len(other.indices) for other in self.connectivities.values()):
                raise ConnectivityError(
                    f"{connectivity.path} has {len(connectivity.indices)} rows, but {self.label} has "
                    f"{self.num_instances} instances by its other connectivities"
                )
            self.set_num_instances(len(connectivity.indices))
        self.connectivities[name] = connectivity
        self._children[name] = connectivity
        return connectivity

    def check_consistent(self) -> None:
        """Raises DataError or ConnectivityError if numbers or indices don't match the current numbers of instances."""
        for connectivity in self.connectivities.values():
            connectivity.check_consistent()
        for attribute in self.attributes.values():
            if isinstance(attribute.node, Stored) and len(attribute.node.array) != self.num_instances:
                raise DataError(
                    f"{self.label} has {self.num_instances} instances, but {attribute.path} has numbers for "
                    f"{len(attribute.node.array)}; set all parts together with update(...)"
                )


@both_spellings
class Primitive(PrimitiveNames, PrimitiveBase):
    """A collection of instances. Of a dynamic one their number follows from its data, e.g. contact pairs; that of any
    other changes by `resize` alone."""

    _kind = "primitive"

    def __init__(self, name: str, mesh: Mesh, num_instances: int, is_dynamic: bool) -> None:
        super().__init__(name, mesh)
        self._num_instances = num_instances
        self._is_dynamic = is_dynamic

    @property
    def is_dynamic(self) -> bool:
        """May the number of instances change?"""
        return self._is_dynamic

    @property
    def follows_data(self) -> bool:
        """A dynamic primitive has as many instances as the data it is given."""
        return self._is_dynamic

    @property
    def num_instances(self) -> int:
        """How many instances there are now."""
        return self._num_instances

    def set_num_instances(self, count: int) -> None:
        """Notes the new number of instances of a dynamic primitive; its connectivities and data must follow."""
        count = checked_count(count, f"{self.label}: the number of instances", 0, SceneError)
        if not self.is_dynamic:
            super().set_num_instances(count)
        if count != self._num_instances:
            self._num_instances = count
            self.scene.size_changed(self)

    @one_thread_at_a_time
    def update(self, /, **parts: Any) -> None:
        """Sets several connectivities and stored attributes at once, by name, all or none.

        This is how a dynamic primitive changes its number of instances: what is not given keeps its numbers, so when
        their count changes give all of them. Raises ConnectivityError, DataError, SceneError; nothing is changed then.
        """
        indices: dict[Connectivity, Any] = {}
        numbers: dict[Stored, FloatArray] = {}
        counts: dict[str, int] = {}
        for name, value in parts.items():
            part = self._settable(name)
            if isinstance(part, Connectivity):
                indices[part] = part.checked_parts(value)
                counts[name] = len(indices[part])
            else:
                assert isinstance(part.node, Stored)
                numbers[part.node] = part._checked_values(value).copy()
                counts[name] = len(numbers[part.node])
        if not counts:
            return
        count = next(iter(counts.values()))
        kept = self._counts_without(parts)
        if any(other != count for other in (*counts.values(), *kept.values())):
            listed = ", ".join(f"{name}: {given}" for name, given in counts.items())
            unchanged = ", ".join(f"{name}: {old}" for name, old in kept.items())
            raise DataError(
                f"{self.label}: all parts need the same number of instances, got {listed}"
                + (f"; not given and so kept: {unchanged}" if unchanged else "")
            )
        for connectivity, checked in indices.items():
            connectivity._take_rows(checked)
        for node, array in numbers.items():
            node.array = array
        self.set_num_instances(count)
        if indices:
            self.scene.connectivity_changed(*indices)
        self.scene.arrays_moved(self)

    @one_thread_at_a_time
    def resize(self, count: int, /, **parts: Any) -> None:
        """Another number of instances, with the data of all stored attributes and connectivities, by name.

        See `Scene.resize`, which changes several primitives that belong together, and what leads to them.
        """
        self.scene.resize({self: count}, {self._settable(name): value for name, value in parts.items()})

    def _settable(self, name: str) -> Attribute | Connectivity:
        """The connectivity or stored attribute of this name. Raises SceneError."""
        if name in self.connectivities:
            return self.connectivities[name]
        if name in self.attributes and isinstance(self.attributes[name].node, Stored):
            return self.attributes[name]
        known = ", ".join(self._counts_without({})) or "none"
        raise SceneError(f"{self.label} has no connectivity or stored attribute {name!r}; it has {known}")

    def _counts_without(self, parts: dict[str, Any]) -> dict[str, int]:
        """Instances that each part not named here has numbers for."""
        counts = {name: len(c.stored_indices) for name, c in self.connectivities.items()}
        counts |= {name: len(a.node.array) for name, a in self.attributes.items() if isinstance(a.node, Stored)}
        return {name: count for name, count in counts.items() if name not in parts}


@both_spellings
class PrimitiveUnion(PrimitiveUnionNames, PrimitiveBase):
    """The disjoint union of primitives (and primitive unions), in order: instances of the first come first."""

    _kind = "primitive union"

    def __init__(self, name: str, mesh: Mesh, members: Sequence[PrimitiveBase]) -> None:
        super().__init__(name, mesh)
        self.members = tuple(members)

    @property
    def is_dynamic(self) -> bool:
        """Whether a member is."""
        return any(member.is_dynamic for member in self.members)

    @property
    def num_instances(self) -> int:
        """Instances of all members together."""
        return sum(member.num_instances for member in self.members)

    def set_num_instances(self, count: int) -> None:
        """A union's number of instances follows from its members'."""
        if count != self.num_instances:
            raise SceneError(f"{self.label} has {self.num_instances} instances, those of its members; got {count}")

    def check_consistent(self) -> None:
        """As for a primitive; and raises SceneError if dynamic members have become too many together."""
        super().check_consistent()
        checked_count(self.num_instances, f"{self.label}: the number of all instances", 0, SceneError)

    def offsets(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Where each member's instances start, and the total: int64 [members + 1]."""
        return np.cumsum([0, *(member.num_instances for member in self.members)]).astype(np.int64)

    def offset_of(self, member: PrimitiveBase) -> int:
        """Where the member's instances start."""
        return int(self.offsets()[self.members.index(member)])

    def _add_union(self, name: str) -> Attribute:
        self.check_name(name, "an attribute")
        parts = []
        for member in self.members:
            if name not in member.attributes:
                raise SceneError(
                    f"UNION {self.path}.{name}: {member.label} has no attribute {name!r}; it has "
                    f"{', '.join(member.attributes) or 'none'}"
                )
            parts.append(member.attributes[name])
        if len({part.shape for part in parts}) > 1:
            listed = ", ".join(f"{part.path} {spell(part.shape)}" for part in parts)
            raise ShapeMismatchError(f"UNION {self.path}.{name} needs one shape, got {listed}")
        return self._register(name, Attribute(self, parts[0].shape, United(tuple(parts)), name))
