"""Other numbers of instances of several primitives at once, with the numbers and indices that belong to them.

Meshes that are refined change all together: vertices, triangles and hinges, unions that the vertices are in, and what
is connected to any of these. Generated code knows no number of instances, so that nothing is compiled for it; placement
indices and sparsity are found again before the next result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from yasps.frontend.errors import ConnectivityError, DataError, SceneError
from yasps.frontend.language.arrays import checked_count
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.connectivity import Connectivity, IntArray
from yasps.frontend.language.nodes import FloatArray, Stored
from yasps.frontend.language.primitive import Primitive, PrimitiveBase, PrimitiveUnion
from yasps.frontend.language.scene_numbers import entities_of
from yasps.runtime.device.foreign_arrays import DeviceIndices

if TYPE_CHECKING:
    from yasps.frontend.language.entity import Entity
    from yasps.frontend.scene import Scene

Part = Attribute | Connectivity


def resize(
    scene: Scene, counts: Mapping[Primitive, int], parts: Mapping[Part, Any]
) -> tuple[dict[Primitive, int], dict[Part, Any]]:
    """See `Scene.resize`."""
    sizes = _checked_sizes(scene, counts)
    _check_parts(scene, parts)
    before = {primitive: primitive.num_instances for primitive in sizes}
    change = _Change(scene, {one: before[one] for one, count in sizes.items() if count != before[one]})
    _set_sizes(sizes)
    try:
        indices, numbers = change.new_parts(parts)
    except BaseException:
        _set_sizes(before)
        raise
    kept_indices = {one: (one.stored_indices, one.arity) for one in indices}
    kept_numbers = {node: node.array for _, node in numbers}
    try:
        for connectivity, rows in indices.items():
            connectivity._replace(rows)
        for (_, node), array in numbers.items():
            node.array = array
    except BaseException:  # no memory to fill rows up, or Ctrl-C
        _set_sizes(before)
        for connectivity, (old, arity) in kept_indices.items():
            connectivity._indices, connectivity.arity = old, arity
        for node, kept in kept_numbers.items():
            node.array = kept
        raise
    finally:
        for owner in change.affected:
            scene.size_changed(owner)
        for attribute, _ in numbers:
            assert attribute.owner is not None
            scene.arrays_moved(attribute.owner)
    old_parts: dict[Part, Any] = {one: _as_given(one, rows) for one, (rows, _) in kept_indices.items()}
    return before, old_parts | {attribute: kept_numbers[node] for attribute, node in numbers}


def _as_given(connectivity: Connectivity, rows: IntArray | DeviceIndices) -> Any:
    """Rows as `update_value` takes them."""
    if not connectivity.is_variable:
        return rows
    assert isinstance(rows, np.ndarray)
    return rows[rows >= 0], (rows >= 0).sum(axis=1)


def _set_sizes(sizes: Mapping[Primitive, int]) -> None:
    for primitive, count in sizes.items():
        primitive._num_instances = count


def _checked_sizes(scene: Scene, counts: Mapping[Any, int]) -> dict[Primitive, int]:
    if not isinstance(counts, Mapping):
        raise SceneError(f"resize takes a table, primitive -> new number of instances, got {counts!r}")
    sizes = {}
    for primitive, count in counts.items():
        if isinstance(primitive, PrimitiveUnion):
            members = ", ".join(member.path for member in primitive.members)
            raise SceneError(f"{primitive.label} has the instances of its members: resize those of {members}")
        if not isinstance(primitive, Primitive):
            what = getattr(primitive, "label", None)
            hint = f"{what}, which is one instance of itself" if what else repr(primitive)
            raise SceneError(f"only primitives can be resized, got {hint}")
        if primitive.scene is not scene:
            raise SceneError(f"{primitive.label} belongs to another scene and can't be resized with {scene.label}")
        least = 0 if primitive.is_dynamic else 1
        sizes[primitive] = checked_count(count, f"{primitive.label}: the number of instances", least, SceneError)
    return sizes


def _check_parts(scene: Scene, parts: Mapping[Any, Any]) -> None:
    """Raises SceneError for a key that is no stored attribute or connectivity of the scene."""
    if not isinstance(parts, Mapping):
        raise SceneError(f"resize takes a table, stored attribute or connectivity -> its data, got {parts!r}")
    for part in parts:
        if isinstance(part, Attribute):
            if part.owner is None or not isinstance(part.node, Stored):
                raise SceneError(f"{part.path} is computed and follows by itself; only stored attributes take numbers")
            owner: Entity = part.owner
        elif isinstance(part, Connectivity):
            owner = part.source
        else:
            raise SceneError(f"data are of stored attributes and connectivities, got {part!r}")
        if owner.scene is not scene:
            raise SceneError(f"{part.path} belongs to another scene and can't be resized with {scene.label}")


class _Change:
    """Which parts of a scene must follow when primitives get other sizes.

    Made before that; `old`: those whose number of instances changes, with the number they have now.
    """

    def __init__(self, scene: Scene, old: Mapping[Primitive, int]) -> None:
        self._old = old
        self._primitives = [entity for entity in entities_of(scene) if isinstance(entity, PrimitiveBase)]
        self.affected = [one for one in self._primitives if any(leaf in old for leaf in _leaves(one))]
        """Primitives of another size, and unions that they are in."""

    def new_parts(
        self, parts: Mapping[Part, Any]
    ) -> tuple[dict[Connectivity, IntArray | DeviceIndices], dict[tuple[Attribute, Stored], FloatArray]]:
        """All parts that change, checked against the sizes that are set by now.

        Raises DataError for a part without data or with wrong numbers, ConnectivityError for wrong indices, SceneError
        for too many instances of a union."""
        for owner in self.affected:
            checked_count(owner.num_instances, f"{owner.label}: the number of all instances", 0, SceneError)
        given = self._with_empty_parts(parts)
        self._check_complete(given)
        indices: dict[Connectivity, IntArray | DeviceIndices] = {}
        numbers: dict[tuple[Attribute, Stored], FloatArray] = {}
        for part, value in given.items():
            if isinstance(part, Connectivity):
                indices[part] = part.checked_parts(value)
                _check_length(part.source, len(indices[part]), part.path)
                continue
            assert part.owner is not None
            assert isinstance(part.node, Stored)
            numbers[part, part.node] = part._checked_values(value).copy()
            _check_length(part.owner, len(numbers[part, part.node]), part.path)
        for connectivity in self._leading_to_affected():
            if connectivity not in indices and (rows := self._renumbered(connectivity)) is not None:
                indices[connectivity] = rows
        return indices, numbers

    def _with_empty_parts(self, parts: Mapping[Part, Any]) -> dict[Part, Any]:
        """The parts, with those of what has no instances any more: of these nothing need be given."""
        empty: dict[Part, Any] = {}
        for owner in self.affected:
            if owner.num_instances == 0:
                for part in _parts_of(owner):
                    is_variable = isinstance(part, Connectivity) and part.is_variable
                    empty[part] = ([], []) if is_variable else []
        return {**empty, **parts}

    def _check_complete(self, given: Mapping[Part, Any]) -> None:
        for owner in self.affected:
            missing = [part.path for part in _parts_of(owner) if part not in given]
            if missing:
                raise DataError(
                    f"{owner.label} gets {owner.num_instances} instances, and nothing says what "
                    f"{', '.join(missing)} will be: give all of its stored attributes and connectivities together"
                )

    def _leading_to_affected(self) -> Iterator[Connectivity]:
        for primitive in self._primitives:
            for connectivity in primitive.connectivities.values():
                if connectivity.target in self.affected:
                    yield connectivity

    def _renumbered(self, connectivity: Connectivity) -> IntArray | None:
        """Indices that lead to the same instances as before; None if they are the same.

        Raises ConnectivityError if some lead to a primitive of another size: which of its instances are which now, only
        the user knows.
        """
        rows = connectivity.stored_indices
        if len(rows) == 0:
            return None
        leaves = _leaves(connectivity.target)
        if isinstance(rows, DeviceIndices):
            self._ask_for(connectivity, next(leaf for leaf in leaves if leaf in self._old))
        assert isinstance(rows, np.ndarray)
        sizes = [leaf.num_instances for leaf in leaves]
        starts, old_starts = _starts(sizes), _starts([self._old.get(leaf, leaf.num_instances) for leaf in leaves])
        there = rows >= 0
        of_leaf = np.searchsorted(old_starts, rows[there], side="right") - 1
        for k in np.unique(of_leaf).tolist():
            if leaves[k] in self._old:
                self._ask_for(connectivity, leaves[k])
        moved = rows.copy()
        moved[there] += (starts - old_starts)[of_leaf]
        return None if np.array_equal(moved, rows) else moved

    def _ask_for(self, connectivity: Connectivity, primitive: Primitive) -> None:
        hint = " (if its indices stay, its own .indices)" if not connectivity.is_variable else ""
        raise ConnectivityError(
            f"{connectivity.path} leads to instances of {primitive.label}, which gets {primitive.num_instances} for "
            f"{self._old[primitive]}; give {connectivity.path}, too{hint}"
        )


def _parts_of(owner: PrimitiveBase) -> list[Part]:
    """What a user sets of it."""
    stored = [one for one in owner.attributes.values() if isinstance(one.node, Stored)]
    return [*stored, *owner.connectivities.values()]


def _check_length(owner: Entity, found: int, path: str) -> None:
    """Of data on a dynamic primitive, whose number of instances would otherwise follow from them."""
    if found != owner.num_instances:
        raise DataError(f"{path} has data for {found} instances, but {owner.label} gets {owner.num_instances}")


def _leaves(primitive: PrimitiveBase) -> list[Primitive]:
    """The primitives that instances come from, in order."""
    if isinstance(primitive, PrimitiveUnion):
        return [leaf for member in primitive.members for leaf in _leaves(member)]
    assert isinstance(primitive, Primitive)
    return [primitive]


def _starts(sizes: list[int]) -> NDArray[np.int32]:
    return np.cumsum([0, *sizes])[:-1].astype(np.int32)
