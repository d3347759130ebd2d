"""Meshes: named groups of primitives (paper, 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

from yasps.frontend.errors import SceneError
from yasps.frontend.language.arrays import checked_count
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.paper_names import MeshNames
from yasps.frontend.language.primitive import Primitive, PrimitiveBase, PrimitiveUnion
from yasps.frontend.language.scene_lock import one_thread_at_a_time
from yasps.frontend.language.spelling import both_spellings

if TYPE_CHECKING:
    from yasps.frontend.scene import Scene

    class AnyPrimitive(Primitive, PrimitiveUnion):
        """What `mesh.name` is for type checkers, which don't know what was added under the name: they allow what
        either of the two has."""


@both_spellings
class Mesh(MeshNames, Entity):
    """A group of primitives with attributes of its own; made by `Scene.add_mesh`."""

    _kind = "mesh"

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

    def __getattr__(self, name: str) -> AnyPrimitive:
        """A primitive or primitive union by its name."""
        return cast("AnyPrimitive", self._part(name))

    @one_thread_at_a_time
    def add_primitive(self, name: str, num_instances: int, is_dynamic: bool = False) -> Primitive:
        """Adds a primitive type with this many instances; reached as `mesh.name` afterwards.

        Raises NameTakenError for a bad name, SceneError for a bad number of instances.
        """
        self.check_child_name(name, "a primitive")
        count = checked_count(num_instances, f"{self.label}, primitive {name!r}: num_instances", 0, SceneError)
        if count == 0 and not is_dynamic:
            raise SceneError(
                f"{self.label}, primitive {name!r} has no instances; give num_instances >= 1, or is_dynamic=True "
                "if they come later"
            )
        primitive = Primitive(name, self, count, bool(is_dynamic))
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
        together = sum(member.num_instances for member in members)
        checked_count(together, f"{self.label}, primitive union {name!r}: the number of all instances", 0, SceneError)
        union = PrimitiveUnion(name, self, members)
        self._children[name] = union
        self.scene.structure_changed()
        return union
