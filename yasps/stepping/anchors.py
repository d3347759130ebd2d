"""Springs that hold vertices at places; which vertices, where and how stiffly may change without compiling."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, Mesh, Primitive, PrimitiveBase, SceneError, materials


class Anchors:
    """A dynamic primitive whose instances are springs of rest length 0 between vertices of `vertices` and places.

    `primitive`: connectivity `vertex`, attributes `place` [m], `stiffness` [N/m], `anchor`, the energy [J], which is
    not registered.
    """

    def __init__(self, mesh: Mesh, name: str, vertices: PrimitiveBase) -> None:
        """Adds the primitive, without any spring, to the mesh. Raises NameTakenError."""
        self.primitive: Primitive = mesh.add_primitive(name, 0, is_dynamic=True)
        vertex = self.primitive.add_connectivity("vertex", vertices, [], 1)
        x = self.primitive.add_attribute("position", through=vertex, source=vertices["position"])
        place = self.primitive.add_constant("place", 3, 1)
        stiffness = self.primitive.add_constant("stiffness", 1, 1)
        self.energy: Attribute = self.primitive.add_attribute(
            "anchor", computed_attribute=materials.anchor(x, place, stiffness)
        )

    def hold(self, vertices: NDArray[np.int64], places: ArrayLike, stiffness: float) -> None:
        """Springs between these vertices [n] and places [n, 3], all of this stiffness [N/m], instead of those before.

        Raises ConnectivityError, DataError; nothing is changed then.
        """
        self.primitive.update(vertex=vertices.reshape(-1, 1), place=places, stiffness=np.full(len(vertices), stiffness))

    def let_go(self) -> None:
        """No spring any more."""
        if self.primitive.num_instances:
            self.hold(np.empty(0, np.int64), np.empty((0, 3)), 0.0)

    def move_to(self, places: ArrayLike) -> None:
        """Other places [m], [n, 3], of the same springs. Raises DataError."""
        self.primitive["place"].update_value(places)


class Pins:
    """Vertices of one body that are held at places by stiff springs."""

    def __init__(self, anchors: Anchors) -> None:
        self._anchors = anchors
        self.primitive = anchors.primitive

    def move_to(self, places: ArrayLike) -> None:
        """Other places [m], [n, 3], for the next step. Raises DataError, SceneError for pins that were released."""
        if self.primitive.num_instances == 0:
            raise SceneError("these pins were released: pin the vertices again")
        self._anchors.move_to(places)

    def release(self) -> None:
        """Lets go of all vertices; nothing is compiled again."""
        self._anchors.let_go()
