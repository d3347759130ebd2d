"""Meshes: named groups of primitives (paper, 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from yasps.frontend.entity import Entity
from yasps.frontend.errors import SceneError
from yasps.frontend.primitive import Primitive, PrimitiveBase, PrimitiveUnion
from yasps.frontend.scene_lock import one_thread_at_a_time
from yasps.frontend.spelling import both_spellings

if TYPE_CHECKING:
    from yasps.frontend.scene import Scene


@both_spellings
class Mesh(Entity):
    """A group of primitives with attributes of its own; made by `Scene.add_mesh`."""

    kind = "mesh"

    def __init__(self, name: str, scene: Scene) -> None:
        super().__init__(name, scene)
        self._scene = scene

    @property
    def scene(self) -> Scene:
        """The scene it belongs to."""
        return self._scene

    @property
    def num_instances(self) -> int:
        """A mesh is one instance of itself."""
        return 1

    @one_thread_at_a_time
    def add_primitive(self, name: str, num_instances: int, is_dynamic: bool = False) -> Primitive:
        """Adds a primitive type with this many instances; reached as `mesh.name` afterwards.

        Raises NameTakenError for a bad name, SceneError for a bad number of instances.
        """
        self.check_child_name(name, "a primitive")
        if not isinstance(num_instances, int | np.integer) or isinstance(num_instances, bool) or num_instances < 0:
            raise SceneError(
                f"{self.label}, primitive {name!r}: num_instances must be an integer >= 0, got {num_instances!r}"
            )
        if num_instances == 0 and not is_dynamic:
            raise SceneError(
                f"{self.label}, primitive {name!r} has no instances; give num_instances >= 1, or is_dynamic=True "
                "if they come later"
            )
        primitive = Primitive(name, self, int(num_instances), bool(is_dynamic))
        self._children[name] = primitive
        self.scene.structure_changed()
        return primitive

    @one_thread_at_a_time
    def add_primitive_union(self, name: str, members: Sequence[PrimitiveBase]) -> PrimitiveUnion:
        """Adds the union of primitives, of unions too, of any meshes of the scene (paper, 4.6).

        Raises NameTakenError, SceneError.
        """
        self.check_child_name(name, "a primitive union")
        if not isinstance(members, Sequence):
            raise SceneError(f"{self.label}, primitive union {name!r}: give a list of primitives, got {members!r}")
        members = list(members)
        if not members:
            raise SceneError(f"{self.label}, primitive union {name!r} needs at least one member")
        for member in members:
            if not isinstance(member, PrimitiveBase):
                raise SceneError(f"{self.label}, primitive union {name!r}: members are primitives, got {member!r}")
            if member.scene is not self.scene:
                raise SceneError(f"{self.label}, primitive union {name!r}: {member.label} belongs to another scene")
        if len(set(members)) != len(members):
            raise SceneError(f"{self.label}, primitive union {name!r} names the same member twice")
        union = PrimitiveUnion(name, self, members)
        self._children[name] = union
        self.scene.structure_changed()
        return union
