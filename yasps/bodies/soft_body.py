"""Soft bodies of tetrahedra."""

from __future__ import annotations

from numpy.typing import ArrayLike

from yasps import Scene, materials
from yasps.bodies.body import Body, checked_density
from yasps.meshes import TetrahedralMesh, TriangleMesh, tetrahedra_of


class SoftBody(Body):
    """Stable Neo-Hookean tetrahedra; each vertex is free.

    `vertices`: `position` (a target), `rest_position`, `mass`. `tets`: `corners`, `positions`, `rest_edges_inverse`,
    `rest_volume`, `deformation_gradient`, `elastic`. `mesh`: `mu`, `lambda` [Pa], which `set_stiffness` changes.
    """

    def __init__(
        self,
        scene: Scene,
        name: str,
        shape: TetrahedralMesh | TriangleMesh,
        *,
        density: float = 1000.0,
        youngs_modulus: float = 1e5,
        poisson_ratio: float = 0.4,
        radius: ArrayLike = 0.0,
    ) -> None:
        """Adds the body, at rest where the mesh lies.

        shape: tetrahedra, or a closed triangle surface, whose inside `tetrahedralize` meshes. density [kg/m^3];
        youngs_modulus [Pa]; radius: of the surface, see `Body` [m].

        Raises SceneError for numbers out of range, NameTakenError, MeshError.
        """
        mu, lam = materials.stable_neo_hookean_parameters(youngs_modulus, poisson_ratio)
        density = checked_density(name, density, "kg/m^3")
        shape = tetrahedra_of(shape)
        inverse, volume = materials.rest_shape(shape.vertices, shape.tets)
        super().__init__(scene, name, shape.vertices, radius)
        self.contact_modulus = float(youngs_modulus)
        self.cells, self.triangles = {"tetra": shape.tets}, shape.surface_triangles()
        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(shape.vertices))
        position = self.vertices.add_attribute("position", rows=3, cols=1, value=shape.vertices)
        self.vertices.add_constant("rest_position", rows=3, cols=1, value=shape.vertices)
        self.vertices.add_constant("mass", rows=1, cols=1, value=shape.vertex_masses(density))
        self.targets = self.falling = (position,)

        self.tets = self.mesh.add_primitive("tets", num_instances=len(shape.tets))
        corners = self.tets.add_connectivity("corners", self.vertices, shape.tets, 4)
        positions = self.tets.add_attribute("positions", through=corners, source=position)
        rest_edges_inverse = self.tets.add_constant("rest_edges_inverse", rows=3, cols=3, value=inverse)
        rest_volume = self.tets.add_constant("rest_volume", rows=1, cols=1, value=volume)
        deformation = self.tets.add_attribute(
            "deformation_gradient", computed_attribute=materials.deformation_gradient(positions, rest_edges_inverse)
        )
        self.mu = self.mesh.add_constant("mu", rows=1, cols=1, value=mu)
        self.lam = self.mesh.add_constant("lambda", rows=1, cols=1, value=lam)
        elastic = materials.stable_neo_hookean(deformation, self.mu, self.lam, rest_volume)
        self.add_energy(self.tets.add_attribute("elastic", computed_attribute=elastic))

    def set_stiffness(self, youngs_modulus: float, poisson_ratio: float) -> None:
        """Changes the material [Pa] between steps; nothing is compiled again. Contact keeps the stiffness that it has.
        Raises SceneError."""
        mu, lam = materials.stable_neo_hookean_parameters(youngs_modulus, poisson_ratio)
        self.mu.update_value(mu)
        self.lam.update_value(lam)
