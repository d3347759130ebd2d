"""What others meet and what does not move."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from yasps import DataError, Scene
from yasps.bodies.body import Body
from yasps.contact import Plane
from yasps.frontend.language.arrays import positive_number, real_numbers
from yasps.meshes import MeshError, TriangleMesh, ground
from yasps.meshes.tetrahedral_mesh import Float64Array


class Obstacle(Body):
    """A fixed surface. `vertices`: `position` and `rest_position`, both constant."""

    def __init__(self, scene: Scene, name: str, shape: TriangleMesh, *, radius: ArrayLike = 0.0) -> None:
        """Adds the obstacle where the mesh lies; radius: of the surface, see `Body` [m].

        Raises NameTakenError, MeshError, DataError.
        """
        if not isinstance(shape, TriangleMesh):
            raise MeshError(
                f"{name}: an obstacle is a TriangleMesh, got {shape!r}; of tetrahedra take the surface,"
                " TriangleMesh(shape.vertices, shape.surface_triangles())"
            )
        super().__init__(scene, name, shape.vertices, radius)
        self.cells, self.triangles = {"triangle": shape.triangles}, shape.triangles
        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(shape.vertices))
        self._add_position(shape.vertices)
        self.vertices.add_constant("rest_position", rows=3, cols=1, value=shape.vertices)

    def _add_position(self, positions: Float64Array) -> None:
        self.vertices.add_constant("position", rows=3, cols=1, value=positions)


class MovingObstacle(Obstacle):
    """A surface that moves as it is told, whatever is in its way; a simulation moves it.

    motion: where its vertices are [m]: a function of time [s] that gives [n, 3]; an array [steps + 1, n, 3], positions
    at time 0 and at the end of each time step (as long as that was at first), the last ones from then on; an array
    [n, 3], where to be at the end of the next step; or None, where `move_to` says. Vertices move straight within a
    step.

    Within a step vertices are on the way from where they were: `vertices`: `start` [m], `way` [m], both constant, and
    `position`, start + progress way. `course`: `progress`, a target from 0 to 1; `pull` [J] and `aim` of the energy
    `push`, pull / 2 (progress - aim)^2.
    """

    meets_itself = False

    def __init__(
        self,
        scene: Scene,
        name: str,
        shape: TriangleMesh,
        *,
        motion: Callable[[float], ArrayLike] | ArrayLike | None = None,
        radius: ArrayLike = 0.0,
    ) -> None:
        """Adds the obstacle where the mesh lies. Raises NameTakenError, DataError."""
        super().__init__(scene, name, shape, radius=radius)
        self.motion = motion

    def _add_position(self, positions: Float64Array) -> None:
        self.course = self.mesh.add_primitive("course", num_instances=1)
        self.progress = self.course.add_attribute("progress", rows=1, cols=1)
        off = self.progress - self.course.add_constant("aim", 1, 1)
        push = 0.5 * self.course.add_constant("pull", 1, 1) * off * off
        self.add_energy(self.course.add_attribute("push", computed_attribute=push))
        of_course = self.vertices.add_connectivity("of_course", self.course, np.zeros(len(positions), int), 1)
        progress = self.vertices.add_attribute("progress", through=of_course, source=self.progress).reshape(1, 1)
        start = self.vertices.add_constant("start", rows=3, cols=1, value=positions)
        way = self.vertices.add_constant("way", rows=3, cols=1)
        self.vertices.add_attribute("position", computed_attribute=start + progress * way)

    @property
    def stands_still(self) -> bool:
        """It may move, though no energy moves it."""
        return False

    def move_to(self, positions: ArrayLike) -> None:
        """Where its vertices shall be at the end of the next step [m], [n, 3], instead of any other motion."""
        self.motion = positions


class Ground(Obstacle):
    """A level square of two triangles."""

    def __init__(self, scene: Scene, name: str = "ground", *, height: float = 0.0, size: float = 10.0) -> None:
        """height: z [m]; size: length of a side [m], its middle above the origin. Raises MeshError, NameTakenError."""
        super().__init__(scene, name, ground((size, size), height))
        self.height = height


class HalfSpace(Body):
    """All that is below a plane, without end: the ground, a slope, a wall.

    Bodies stay out of it with their vertices alone, so each vertex carries the whole area that it stands for. It has no
    vertices itself; `shape` is a square for pictures.
    """

    def __init__(
        self,
        scene: Scene,
        name: str = "ground",
        *,
        normal: ArrayLike = (0.0, 0.0, 1.0),
        height: float = 0.0,
        size: float = 10.0,
    ) -> None:
        """normal: out of the half-space, of any length but 0; height: of the plane over the origin along the normal
        [m]; size: side of the square that pictures show [m]. Raises DataError, NameTakenError.
        """
        above = real_numbers(height, f"the height of {name}")
        if above.shape != ():
            raise DataError(f"the height of {name} is one number [m], got {height!r}")
        size = positive_number(size, f"the size of {name}", "m")
        direction = real_numbers(normal, f"the normal of {name}")
        length = float(np.linalg.norm(direction))
        if direction.shape != (3,) or not length > 0:
            raise DataError(f"the normal of {name} is a vector [3] that is not 0, got {normal!r}")
        super().__init__(scene, name, np.empty((0, 3)))
        direction, height = direction / length, float(above)
        self.plane = Plane(name, tuple(direction.tolist()), tuple((height * direction).tolist()))
        self.triangles = np.empty((0, 3), np.int32)
        across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
        across /= np.linalg.norm(across)
        other = np.cross(direction, across)
        corners = [0.5 * size * (i * across + j * other) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        self.shape = TriangleMesh(np.array(corners) + height * direction, np.array([[0, 1, 2], [0, 2, 3]]))
        self.cells = {}
        self.vertices = self.mesh.add_primitive("vertices", num_instances=0, is_dynamic=True)

    def positions(self) -> Float64Array:
        """None, [0, 3]."""
        return self.rest
