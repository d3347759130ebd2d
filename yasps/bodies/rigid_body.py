"""Rigid bodies with six unknowns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from yasps import Scene, SceneError
from yasps.bodies.affine_body import vertices_of
from yasps.bodies.body import Body, checked_density
from yasps.frontend.language.arrays import positive_number
from yasps.meshes import TetrahedralMesh, TriangleMesh, tetrahedra_of
from yasps.parameterisations import recentred_rotation, rotation_matrix


class RigidBody(Body):
    """Every vertex is R r + t, R = exp([w]) R_0 with the rotation vector w.

    `body`: `rotation_vector` w [rad] and `translation` t (targets), `base_rotation` R_0 (constant), `rotation` R.
    `vertices`: `position`, `rest_position` r [m], counted from the centre of mass, `mass`.
    """

    meets_itself = False

    def __init__(
        self,
        scene: Scene,
        name: str,
        shape: TetrahedralMesh | TriangleMesh,
        *,
        density: float = 1000.0,
        youngs_modulus: float = 1e7,
        radius: ArrayLike = 0.0,
    ) -> None:
        """Adds the body where the mesh lies.

        shape: tetrahedra, or a closed triangle surface, whose inside `tetrahedralize` meshes. density [kg/m^3];
        youngs_modulus [Pa]: for the default stiffness of contact alone; radius: of the surface, see `Body` [m].

        Raises SceneError for numbers out of range, NameTakenError, MeshError.
        """
        density = checked_density(name, density, "kg/m^3")
        youngs_modulus = positive_number(youngs_modulus, f"{name}: youngs_modulus", "Pa", SceneError)
        shape = tetrahedra_of(shape)
        super().__init__(scene, name, shape.vertices, radius)
        self.contact_modulus = youngs_modulus
        self.cells, self.triangles = {"tetra": shape.tets}, shape.surface_triangles()
        mass = shape.vertex_masses(density)
        center = mass @ shape.vertices / mass.sum()
        self.body = self.mesh.add_primitive("body", num_instances=1)
        self.rotation_vector = self.body.add_attribute("rotation_vector", rows=3, cols=1)
        self.base_rotation = self.body.add_constant("base_rotation", rows=3, cols=3, value=np.eye(3))
        translation = self.body.add_attribute("translation", rows=3, cols=1, value=center)
        turned = rotation_matrix(self.rotation_vector) * self.base_rotation
        rotation = self.body.add_attribute("rotation", computed_attribute=turned)
        self.targets, self.falling = (self.rotation_vector, translation), (translation,)
        self.arms = {self.rotation_vector: float(np.linalg.norm(shape.vertices - center, axis=1).max())}
        self.history = (self.base_rotation,)
        self.vertices = vertices_of(
            self.mesh, self.body, rotation, translation, rest=shape.vertices - center, mass=mass
        )

    def start_step(self) -> None:
        """Adds the rotation vector to the base rotation and begins at 0 again: no vertex moves by it."""
        vector = self.rotation_vector.value
        if vector.any():
            self.base_rotation.update_value(recentred_rotation(vector, self.base_rotation.value))
            self.rotation_vector.update_value(np.zeros(3))
