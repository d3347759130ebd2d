"""Cloth of triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, Connectivity, Primitive, Scene, SceneError, materials
from yasps.bodies.body import Body, checked_density
from yasps.frontend.language.arrays import positive_number, real_numbers
from yasps.meshes import MeshError, TriangleMesh, hinge_stiffness, hinges_of, triangle_vertex_masses


class Cloth(Body):
    """Baraff-Witkin triangles and hinges that bend; each vertex is free.

    `vertices`: `position` (a target), `rest_position`, `mass`. `triangle_elements`: `corners`, `positions`,
    `rest_edges_inverse`, `rest_area`, `deformation_gradient`, `membrane`. `hinges`: `corners`, `positions`,
    `stiffness` [J], `bending`.
    """

    vertices: Primitive
    hinges: Primitive
    """Not there on a single triangle."""

    def __init__(
        self,
        scene: Scene,
        name: str,
        shape: TriangleMesh,
        *,
        area_density: float = 0.2,
        stretch: float = 1e3,
        shear: float = 1e2,
        bending: float = 1e-5,
        compression: float = 1.0,
        warp: tuple[float, float, float] = (1.0, 0.0, 0.0),
        radius: ArrayLike = 0.0,
        refinable: bool = False,
    ) -> None:
        """Adds the cloth, at rest where the mesh lies.

        area_density [kg/m^2]; stretch, shear [J/m^2]; bending [J]; compression: share of `stretch` that resists
        shortening; warp: direction of the warp threads, projected into each triangle; radius: half the thickness, see
        `Body` [m]. refinable: `Simulation.remesh` will replace the mesh and compiles nothing then, for up to 16
        triangles around a vertex.

        Its contact modulus is `stretch` over the mean length of an edge, that of a solid whose cells of this size give
        way as the cloth does: stiffer contact only makes the steps of Newton's method short.

        Raises SceneError, MeshError, DataError, NameTakenError.
        """
        area_density = checked_density(name, area_density, "kg/m^2")
        stretch = positive_number(stretch, f"{name}: stretch", "J/m^2", SceneError)
        for what, given in (("shear", shear), ("bending", bending), ("compression", compression)):
            number = real_numbers(given, f"{name}: {what}", SceneError)
            if number.shape != () or number < 0:
                raise SceneError(f"{name}: {what} must be a number >= 0, got {given!r}")
        if not isinstance(shape, TriangleMesh):
            raise MeshError(f"{name}: a cloth is a TriangleMesh, got {shape!r}")
        self._area_density, self._bending, self._warp = area_density, bending, warp
        self.room = 16 if refinable else 1
        inverse, area = materials.rest_triangles(shape.vertices, shape.triangles, warp)
        super().__init__(scene, name, shape.vertices, radius)
        sides = shape.vertices[shape.triangles] - shape.vertices[np.roll(shape.triangles, 1, axis=1)]
        self.contact_modulus = stretch / float(np.linalg.norm(sides, axis=2).mean())
        self.cells, self.triangles = {"triangle": shape.triangles}, shape.triangles
        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(shape.vertices))
        position = self.vertices.add_attribute("position", rows=3, cols=1, value=shape.vertices)
        self.vertices.add_constant("rest_position", rows=3, cols=1, value=shape.vertices)
        mass = triangle_vertex_masses(shape.vertices, shape.triangles, area_density)
        self.vertices.add_constant("mass", rows=1, cols=1, value=mass)
        self.targets = self.falling = (position,)

        self.triangle_elements = self.mesh.add_primitive("triangles", num_instances=len(shape.triangles))
        corners = self.triangle_elements.add_connectivity("corners", self.vertices, shape.triangles, 3)
        positions = self.triangle_elements.add_attribute("positions", through=corners, source=position)
        rest_edges_inverse = self.triangle_elements.add_constant("rest_edges_inverse", rows=2, cols=2, value=inverse)
        rest_area = self.triangle_elements.add_constant("rest_area", rows=1, cols=1, value=area)
        deformation = self.triangle_elements.add_attribute(
            "deformation_gradient", computed_attribute=materials.triangle_deformation(positions, rest_edges_inverse)
        )
        membrane = materials.baraff_witkin(
            deformation,
            self.mesh.add_constant("stretch", 1, 1, value=stretch),
            self.mesh.add_constant("shear", 1, 1, value=shear),
            rest_area,
            compression=compression,
        )
        self.add_energy(self.triangle_elements.add_attribute("membrane", computed_attribute=membrane))

        hinges = hinges_of(shape.triangles)
        if len(hinges) == 0:  # a single triangle can't bend
            return
        self.hinges = self.mesh.add_primitive("hinges", num_instances=len(hinges))
        of_hinge = self.hinges.add_connectivity("corners", self.vertices, hinges, 4)
        x = self.hinges.add_attribute("positions", through=of_hinge, source=position)
        stiffness = hinge_stiffness(shape.vertices, hinges, bending)
        bends = materials.hinge_bending(x, self.hinges.add_constant("stiffness", 1, 1, value=stiffness))
        self.add_energy(self.hinges.add_attribute("bending", computed_attribute=bends))

    def resized(self, shape: TriangleMesh) -> tuple[dict[Primitive, int], dict[Attribute | Connectivity, Any]]:
        """What `Scene.resize` takes for another mesh at rest, of the same material, but for positions and for what
        others added to the vertices. `take` follows. Raises MeshError, SceneError."""
        if not isinstance(shape, TriangleMesh):
            raise MeshError(f"{self.name}: a cloth is a TriangleMesh, got {shape!r}")
        inverse, area = materials.rest_triangles(shape.vertices, shape.triangles, self._warp)
        hinges, triangles = hinges_of(shape.triangles), self.triangle_elements
        counts = {self.vertices: len(shape.vertices), triangles: len(shape.triangles)}
        mass = triangle_vertex_masses(shape.vertices, shape.triangles, self._area_density)
        parts: dict[Attribute | Connectivity, Any] = {
            self.vertices["rest_position"]: shape.vertices,
            self.vertices["mass"]: mass,
            triangles.corners: shape.triangles,
            triangles["rest_edges_inverse"]: inverse,
            triangles["rest_area"]: area,
        }
        if hasattr(self, "hinges") != (len(hinges) > 0):
            raise SceneError(
                f"{self.name}: a mesh without hinges can't replace one that has some, nor the other way round"
            )
        if len(hinges) > 0:
            counts[self.hinges] = len(hinges)
            parts[self.hinges.corners] = hinges
            parts[self.hinges["stiffness"]] = hinge_stiffness(shape.vertices, hinges, self._bending)
        return counts, parts

    def take(self, shape: TriangleMesh, radius: ArrayLike) -> None:
        """The mesh that the scene has by now, and the radius of its vertices [m]."""
        self.rest, self.radius = shape.vertices, np.asarray(radius, np.float64)
        self.cells, self.triangles = {"triangle": shape.triangles}, shape.triangles
