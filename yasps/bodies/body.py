"""What all bodies have in common."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from yasps import Attribute, Mesh, Primitive, Scene, SceneError
from yasps.meshes.tetrahedral_mesh import Float64Array, Int32Array


class Body:
    """A mesh of the scene with a primitive `vertices` and, on it, a 3x1 attribute `position`.

    Subclasses set:

    - mesh: of the scene, by the body's name. vertices: its primitive, with `position` [m] and `rest_position` [m],
      and, unless the body is fixed, `mass` [kg].
    - rest: positions at rest, [n, 3].
    - triangles: surface that takes part in contact, [m, 3].
    - cells: what output shows, by the names of meshio.
    - energies: what the body added to the scene.
    - targets: stored variables that move the body; falling: those of them that a uniform acceleration moves.
    - arms: of targets that are no positions, how far at most a vertex moves for a unit of the target [m].
    - meets_itself: whether its surface can meet itself; a stiff body's can't.
    """

    mesh: Mesh
    vertices: Primitive
    rest: Float64Array
    triangles: Int32Array
    cells: Mapping[str, Int32Array]
    targets: tuple[Attribute, ...] = ()
    falling: tuple[Attribute, ...] = ()
    meets_itself: bool = True
    arms: Mapping[Attribute, float] = MappingProxyType({})

    def __init__(self, scene: Scene, name: str) -> None:
        self.scene = scene
        self.name = name
        self.mesh = scene.add_mesh(name)
        self.energies: list[Attribute] = []

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r}, {len(self.rest)} vertices>"

    @property
    def is_fixed(self) -> bool:
        """Whether nothing moves it."""
        return not self.targets

    @property
    def position(self) -> Attribute:
        """Positions of its vertices [m], 3x1."""
        return self.vertices["position"]

    @property
    def mass(self) -> Attribute:
        """Masses of its vertices [kg], 1x1. Raises SceneError for a fixed body."""
        if self.is_fixed:
            raise SceneError(f"{self.name} is fixed and has no mass")
        return self.vertices["mass"]

    def positions(self) -> Float64Array:
        """Current positions of its vertices [m], [n, 3]."""
        return self.position.compute().array.reshape(-1, 3)

    def add_energy(self, energy: Attribute, projection: str = "clamp") -> None:
        """Registers an energy [J] of this body with the scene, so that it goes when the body goes."""
        self.scene.add_energy(energy, projection=projection)
        self.energies.append(energy)


def check_density(name: str, density: float, unit: str) -> None:
    """Raises SceneError unless it is positive and finite."""
    if not (np.isfinite(density) and density > 0):
        raise SceneError(f"{name}: density must be a positive number of {unit}, got {density}")
