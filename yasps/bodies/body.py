"""What all bodies have in common."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, DataError, Mesh, PrimitiveBase, Scene, SceneError
from yasps.frontend.language.arrays import positive_number, real_numbers
from yasps.meshes.tetrahedral_mesh import Float64Array, Int32Array


class Body:
    """A mesh of the scene with a primitive or UNION `vertices` and, on it, a 3x1 attribute `position`.

    Subclasses set:

    - mesh: of the scene, by the body's name. vertices: of it, with `position` [m] and `rest_position` [m],
      and, unless the body is fixed, `mass` [kg].
    - rest: positions at rest, [n, 3].
    - triangles: surface that takes part in contact, [m, 3]; edges: [k, 2], those of rods, in no triangle; points: ids
      of loose vertices that take part.
    - contact_modulus: how stiff the material is [Pa], for the default stiffness of contact; infinite for an obstacle.
    - cells: what output shows, by the names of meshio.
    - energies: what the body added to the scene.
    - targets: stored variables that move the body; falling: those of them that a uniform acceleration moves.
    - arms: of targets that are no positions, how far at most a vertex moves for a unit of the target [m].
    - history: constants that `start_step` sets and that belong to the state of the body.
    - meets_itself: whether its surface can meet itself; a stiff body's can't.
    - room: for so many triangles around a vertex, should the mesh be replaced, before contact needs a compile.
    """

    mesh: Mesh
    vertices: PrimitiveBase
    rest: Float64Array
    triangles: Int32Array
    edges: Int32Array = np.empty((0, 2), np.int32)
    points: Int32Array = np.empty(0, np.int32)
    contact_modulus: float = np.inf
    cells: Mapping[str, Int32Array]
    targets: tuple[Attribute, ...] = ()
    falling: tuple[Attribute, ...] = ()
    history: tuple[Attribute, ...] = ()
    meets_itself: bool = True
    room: int = 1
    arms: Mapping[Attribute, float] = MappingProxyType({})

    def __init__(self, scene: Scene, name: str, rest: Float64Array, radius: ArrayLike = 0.0) -> None:
        """Adds the mesh. rest: positions of its vertices at rest [m], [n, 3]. radius: half the thickness of its
        surface, one or one a vertex [m].

        Raises NameTakenError, DataError for radii that are no lengths or too many or few.
        """
        if not isinstance(scene, Scene):
            raise SceneError(f"a body is added to a scene, got {scene!r}")
        self.rest = rest
        self.radius = real_numbers(radius, f"the radius of {name}")
        if self.radius.shape not in ((), (len(rest),)) or (self.radius < 0).any():
            raise DataError(
                f"the radius of {name} is a length >= 0, or one for each of {len(rest)} vertices, got {radius!r}"
            )
        self.scene = scene
        self.name = name
        self.mesh = scene.add_mesh(name)
        self.energies: list[Attribute] = []

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r}, {len(self.rest)} vertices>"

    @property
    def is_fixed(self) -> bool:
        """Whether no energy moves it."""
        return not self.targets

    @property
    def stands_still(self) -> bool:
        """Whether its vertices never move."""
        return self.is_fixed

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

    def radii(self) -> Float64Array:
        """The radius of each vertex [m], [n]."""
        return np.broadcast_to(self.radius, (len(self.rest),))

    def start_step(self) -> None:
        """What a body does before each step of a simulation; it moves no vertex. Nothing, by default."""

    def add_energy(self, energy: Attribute, projection: str = "clamp") -> None:
        """Registers an energy [J] of this body with the scene, so that it goes when the body goes."""
        self.scene.add_energy(energy, projection=projection)
        self.energies.append(energy)


def checked_density(name: str, density: float, unit: str) -> float:
    """The density, if it is positive and finite. Raises SceneError."""
    return positive_number(density, f"{name}: density", unit, SceneError)
