"""Stiff bodies with twelve unknowns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, FloatArray, Mesh, Primitive, Scene, SceneError, materials
from yasps.bodies.body import Body, checked_density
from yasps.frontend.language.arrays import positive_number
from yasps.meshes import TetrahedralMesh, TriangleMesh, tetrahedra_of
from yasps.parameterisations import affine_position


class AffineBody(Body):
    """Every vertex is A r + t, and A stays nearly a rotation (Lan et al. 2022; paper, 10.1).

    `body`: `affine_matrix` A and `translation` t (targets), `stiffness` [J], `orthogonality`. `vertices`: `position`,
    `rest_position` r [m], counted from the middle of the vertices, `mass`.
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
        youngs_modulus [Pa]: times the volume, it resists stretch and shear; radius: of the surface, see `Body` [m].

        Raises SceneError for numbers out of range, NameTakenError, MeshError.
        """
        density = checked_density(name, density, "kg/m^3")
        youngs_modulus = positive_number(youngs_modulus, f"{name}: youngs_modulus", "Pa", SceneError)
        shape = tetrahedra_of(shape)
        super().__init__(scene, name, shape.vertices, radius)
        self.contact_modulus = youngs_modulus
        self.cells, self.triangles = {"tetra": shape.tets}, shape.surface_triangles()
        self.body = self.mesh.add_primitive("body", num_instances=1)
        center = shape.vertices.mean(axis=0)
        matrix = self.body.add_attribute("affine_matrix", rows=3, cols=3, value=np.eye(3))
        translation = self.body.add_attribute("translation", rows=3, cols=1, value=center)
        stiffness = self.body.add_constant("stiffness", 1, 1, value=youngs_modulus * shape.volumes().sum())
        orthogonality = materials.affine_orthogonality(matrix, stiffness)
        self.add_energy(self.body.add_attribute("orthogonality", computed_attribute=orthogonality))
        self.targets, self.falling = (matrix, translation), (translation,)
        self.arms = {matrix: float(np.linalg.norm(shape.vertices - center, axis=1).max())}
        mass = shape.vertex_masses(density)
        self.vertices = vertices_of(self.mesh, self.body, matrix, translation, rest=shape.vertices - center, mass=mass)


def vertices_of(
    mesh: Mesh, body: Primitive, matrix: Attribute, translation: Attribute, *, rest: FloatArray, mass: FloatArray
) -> Primitive:
    """A primitive `vertices` that goes along with one body: `position` is matrix r + translation.

    matrix: 3x3, translation: 3x1 [m], both of the body. rest: r, `rest_position` [m], [n, 3]; mass [kg], [n].
    """
    vertices = mesh.add_primitive("vertices", num_instances=len(rest))
    of_body = vertices.add_connectivity("of_body", body, np.zeros(len(rest), int), 1)
    own_matrix = vertices.add_attribute("matrix", through=of_body, source=matrix)
    own_translation = vertices.add_attribute("translation", through=of_body, source=translation)
    place = vertices.add_constant("rest_position", rows=3, cols=1, value=rest)
    vertices.add_attribute("position", computed_attribute=affine_position(own_matrix, own_translation, place))
    vertices.add_constant("mass", rows=1, cols=1, value=mass)
    return vertices
