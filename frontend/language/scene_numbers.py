"""All numbers and indices of a scene by name, and digests of its formulas: what a state is made of, and what tells one
scene from another."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.frontend.errors import SceneError
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.connectivity import Connectivity
from yasps.frontend.language.nodes import Computed, Joined, Stored, operands_of
from yasps.frontend.language.primitive import Primitive, PrimitiveBase

if TYPE_CHECKING:
    from yasps.frontend.language.entity import Entity
    from yasps.frontend.scene import Scene

Numbers = NDArray[Any]


def entities_of(scene: Scene) -> Iterator[Entity]:
    """The scene, its meshes and their primitives, in the order in which they were made."""
    yield scene
    for mesh in scene._children.values():
        yield mesh
        yield from mesh._children.values()


def _parts_of(entity: Entity) -> dict[str, Attribute | Connectivity]:
    """What numbers of an entity a user sets, by their names."""
    stored = {name: one for name, one in entity.attributes.items() if isinstance(one.node, Stored)}
    return {**stored, **(entity.connectivities if isinstance(entity, PrimitiveBase) else {})}


def _array_of(part: Attribute | Connectivity) -> Numbers:
    """Its numbers as they are, read-only."""
    if isinstance(part, Connectivity):
        return part.indices
    assert isinstance(part.node, Stored)
    view = part.node.array.view()
    view.flags.writeable = False
    return view


def numbers_of(scene: Scene) -> dict[str, Numbers]:
    """See `Scene.numbers`."""
    return {part.path: _array_of(part) for entity in entities_of(scene) for part in _parts_of(entity).values()}


def set_numbers(scene: Scene, values: Mapping[str, ArrayLike]) -> None:
    """See `Scene.set_numbers`."""
    left = {path: np.asarray(value) for path, value in values.items()}
    changes = []
    for entity in entities_of(scene):
        given = {name: (part, left.pop(part.path)) for name, part in _parts_of(entity).items() if part.path in left}
        new = {name: both for name, both in given.items() if not np.array_equal(_array_of(both[0]), both[1])}
        for part, value in new.values():
            if isinstance(part, Connectivity):
                part.checked_parts(_rows(part, value))  # raises before anything is set
            else:
                part._checked_values(value)
        if new:
            changes.append((entity, new))
    if left:
        raise SceneError(f"{scene.label} has no stored numbers or indices {next(iter(left))!r}")
    before = {part.path: _array_of(part).copy() for _, new in changes for part, _ in new.values()}
    try:
        for entity, new in changes:
            _set_parts(entity, new)
    except BaseException:  # parts of a dynamic primitive that don't fit together
        set_numbers(scene, before)
        raise


def _set_parts(entity: Entity, new: Mapping[str, tuple[Attribute | Connectivity, Numbers]]) -> None:
    if isinstance(entity, Primitive) and entity.is_dynamic:
        entity.update(**{name: _rows(part, value) for name, (part, value) in new.items()})
        return
    for part, value in new.values():
        if isinstance(part, Connectivity):
            part._replace(part.checked_parts(_rows(part, value)))
        else:
            part.update_value(value)


def _rows(part: Attribute | Connectivity, value: Numbers) -> Any:
    """What `update` takes for numbers, or for the rows of a connectivity; -1 fills up those of a variable arity."""
    if not (isinstance(part, Connectivity) and part.is_variable):
        return value
    there = value >= 0
    return value[there], there.sum(axis=1)


def formulas_of(scene: Scene) -> dict[str, str]:
    """See `Scene.formulas`."""
    known: dict[Attribute, str] = {}
    for energy in scene.energies:
        stack = [energy]
        while stack:
            attribute = stack[-1]
            missing = [one for one in operands_of(attribute.node) if one not in known]
            stack.extend(missing)
            if not missing:
                known[stack.pop()] = _digest(attribute, [known[one] for one in operands_of(attribute.node)])
    return {energy.path: known[energy] for energy in scene.energies}


def _digest(attribute: Attribute, operands: list[str]) -> str:
    """Of an attribute whose operands have these digests."""
    node = attribute.node
    words = [type(node).__name__, str(attribute.shape), *operands]
    match node:
        case Stored():
            words.append(f"{attribute.path} {node.constant}")
        case Joined():
            words.append(f"{node.connectivity.path} {node.operation}")
        case Computed():
            words += [node.op_class.name, *(f"{name} {value}" for name, value in node.properties)]
    return hashlib.blake2b("\n".join(words).encode(), digest_size=8).hexdigest()
