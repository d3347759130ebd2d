"""Soft bodies of hexahedra or quadratic tetrahedra."""

from __future__ import annotations

from numpy.typing import ArrayLike

from yasps import Attribute, Primitive, Scene, materials
from yasps.bodies.body import Body, checked_density
from yasps.meshes import ElementMesh, GaussPoints, MeshError


class ElementBody(Body):
    """Stable Neo-Hookean finite elements; each node is free, each Gauss point one instance of the energy.

    `vertices`: `position` (a target), `rest_position`, `mass`. `gauss_points`: `nodes`, `positions`, `gradients`,
    `volume`, `deformation_gradient`, `elastic`. `mesh`: `mu`, `lambda` [Pa].
    """

    def __init__(
        self,
        scene: Scene,
        name: str,
        shape: ElementMesh,
        *,
        density: float = 1000.0,
        youngs_modulus: float = 1e5,
        poisson_ratio: float = 0.4,
        radius: ArrayLike = 0.0,
    ) -> None:
        """Adds the body, at rest where the mesh lies.

        shape: hexahedra, or tetrahedra of 4 or 10 nodes. density [kg/m^3]; youngs_modulus [Pa]; radius: of the surface,
        see `Body` [m]. Raises SceneError for numbers out of range, NameTakenError, MeshError.
        """
        density = checked_density(name, density, "kg/m^3")
        materials.stable_neo_hookean_parameters(youngs_modulus, poisson_ratio)
        if not isinstance(shape, ElementMesh):
            raise MeshError(f"{name}: a body of elements is made of an ElementMesh (yasps.meshes), got {shape!r}")
        if shape.kind.startswith("triangle"):
            raise MeshError(f"{name}: {shape} has no volume; soft bodies are of tetrahedra or hexahedra.")
        points, masses, surface = shape.points(), shape.vertex_masses(density), shape.surface_triangles()
        super().__init__(scene, name, shape.vertices, radius)
        self.contact_modulus = float(youngs_modulus)
        self.cells, self.triangles = {shape.kind: shape.cells}, surface
        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(shape.vertices))
        position = self.vertices.add_attribute("position", rows=3, cols=1, value=shape.vertices)
        self.vertices.add_constant("rest_position", rows=3, cols=1, value=shape.vertices)
        self.vertices.add_constant("mass", rows=1, cols=1, value=masses)
        self.targets = self.falling = (position,)
        self.gauss_points = add_elastic_points(self, points, position, youngs_modulus, poisson_ratio)


def add_elastic_points(
    body: Body, points: GaussPoints, position: Attribute, youngs_modulus: float, poisson_ratio: float
) -> Primitive:
    """Adds a primitive `gauss_points` to a body's mesh, with the stable Neo-Hookean energy of elements between nodes of
    this `position`, and `mu` and `lambda` [Pa]. Raises SceneError."""
    mu, lam = materials.stable_neo_hookean_parameters(youngs_modulus, poisson_ratio)
    assert isinstance(position.owner, Primitive)
    primitive = body.mesh.add_primitive("gauss_points", num_instances=len(points.volumes))
    arity = points.nodes.shape[1]
    nodes = primitive.add_connectivity("nodes", position.owner, points.nodes, arity)
    positions = primitive.add_attribute("positions", through=nodes, source=position)
    gradients = primitive.add_constant("gradients", rows=arity, cols=3, value=points.gradients)
    volume = primitive.add_constant("volume", rows=1, cols=1, value=points.volumes)
    deformation = primitive.add_attribute(
        "deformation_gradient", computed_attribute=materials.gauss_deformation(positions, gradients)
    )
    elastic = materials.stable_neo_hookean(
        deformation,
        body.mesh.add_constant("mu", rows=1, cols=1, value=mu),
        body.mesh.add_constant("lambda", rows=1, cols=1, value=lam),
        volume,
    )
    body.add_energy(primitive.add_attribute("elastic", computed_attribute=elastic))
    return primitive
