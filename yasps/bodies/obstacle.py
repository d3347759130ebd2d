"""What others meet and what does not move."""

from __future__ import annotations

from yasps import Scene
from yasps.bodies.body import Body
from yasps.meshes import TriangleMesh, ground


class Obstacle(Body):
    """A fixed surface. `vertices`: `position` and `rest_position`, both constant."""

    def __init__(self, scene: Scene, name: str, shape: TriangleMesh) -> None:
        """Adds the obstacle where the mesh lies. Raises NameTakenError."""
        super().__init__(scene, name)
        self.rest, self.cells, self.triangles = shape.vertices, {"triangle": shape.triangles}, shape.triangles
        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(shape.vertices))
        self.vertices.add_constant("position", rows=3, cols=1, value=shape.vertices)
        self.vertices.add_constant("rest_position", rows=3, cols=1, value=shape.vertices)


class Ground(Obstacle):
    """A level square of two triangles."""

    def __init__(self, scene: Scene, name: str = "ground", *, height: float = 0.0, size: float = 10.0) -> None:
        """height: z [m]; size: length of a side [m], its middle above the origin. Raises MeshError, NameTakenError."""
        super().__init__(scene, name, ground((size, size), height))
        self.height = height
