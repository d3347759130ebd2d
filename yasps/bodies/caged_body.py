"""Soft bodies of many vertices that a coarse grid of cubes moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Scene, SceneError, materials
from yasps.bodies.body import Body, checked_density
from yasps.bodies.element_body import add_elastic_points
from yasps.frontend.language.arrays import checked_count
from yasps.meshes import ElementMesh, GaussPoints, TetrahedralMesh, TriangleMesh, box, hex_box, tetrahedra_of
from yasps.meshes.tetrahedral_mesh import Float64Array
from yasps.parameterisations import caged_position, trilinear_weights

LEAST_FILLED = 0.01
"""Share of a cell that counts as filled at least: a corner that next to nothing holds would be loose."""
CAGE_ELEMENTS = ("hexahedron", "tetra")
"""What a cell of the cage can be made of, by the names of meshio: itself, or six tetrahedra."""


class CagedBody(Body):
    """Vertices inside a grid of cubes whose corners are free; the energy is that of the grid.

    `corners`: `position` (a target), `rest_position`. `vertices`: `position` by trilinear weights, `rest_position`,
    `mass`: the mass matrix of the corners is the consistent one, so linear and angular momentum are the vertices'.
    `gauss_points`: those of the grid's stable Neo-Hookean energy, each by the share of its cell that the shape fills.
    `cage`: the grid of hexahedra.
    """

    def __init__(
        self,
        scene: Scene,
        name: str,
        shape: TetrahedralMesh | TriangleMesh,
        *,
        divisions: int = 4,
        element: str = "hexahedron",
        density: float = 1000.0,
        youngs_modulus: float = 1e5,
        poisson_ratio: float = 0.4,
        radius: ArrayLike = 0.0,
    ) -> None:
        """Adds the body, at rest where the mesh lies.

        shape: tetrahedra, or a closed triangle surface, whose inside `tetrahedralize` meshes. divisions: cubic cells
        along the longest side of the box around it; cells with nothing in them are left out. element: "hexahedron", of
        eight Gauss points a cell, or "tetra", six linear tetrahedra of one each, which are stiffer. density [kg/m^3];
        youngs_modulus [Pa]; radius: of the surface, see `Body` [m].

        Raises SceneError for numbers out of range, NameTakenError, MeshError.
        """
        density = checked_density(name, density, "kg/m^3")
        materials.stable_neo_hookean_parameters(youngs_modulus, poisson_ratio)
        divisions = checked_count(divisions, f"the divisions of {name}", 1)
        if element not in CAGE_ELEMENTS:
            raise SceneError(f"{name}: element is one of {', '.join(map(repr, CAGE_ELEMENTS))}, got {element!r}")
        shape = tetrahedra_of(shape)
        self.cage, filled, owner, weights = _cage_of(shape, divisions)
        super().__init__(scene, name, shape.vertices, radius)
        self.contact_modulus = float(youngs_modulus)
        self.cells, self.triangles = {"tetra": shape.tets}, shape.surface_triangles()
        self.corners = self.mesh.add_primitive("corners", num_instances=len(self.cage.vertices))
        corner_position = self.corners.add_attribute("position", rows=3, cols=1, value=self.cage.vertices)
        self.corners.add_constant("rest_position", rows=3, cols=1, value=self.cage.vertices)
        self.targets = self.falling = (corner_position,)
        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(shape.vertices))
        of_cell = self.vertices.add_connectivity("of_cell", self.corners, self.cage.cells[owner], 8)
        around = self.vertices.add_attribute("corners", through=of_cell, source=corner_position)
        own_weights = self.vertices.add_constant("weights", rows=8, cols=1, value=weights)
        self.vertices.add_attribute("position", computed_attribute=caged_position(around, own_weights))
        self.vertices.add_constant("rest_position", rows=3, cols=1, value=shape.vertices)
        self.vertices.add_constant("mass", rows=1, cols=1, value=shape.vertex_masses(density))
        elements = self.cage if element == "hexahedron" else _cut(self.cage)
        points = elements.points()
        volumes = points.volumes * np.repeat(filled, len(points.volumes) // len(filled))
        self.gauss_points = add_elastic_points(
            self, GaussPoints(points.nodes, points.gradients, volumes), corner_position, youngs_modulus, poisson_ratio
        )


def _cut(cage: ElementMesh) -> ElementMesh:
    """Six tetrahedra of each cube, as in `box`."""
    cube = hex_box(divisions=(1, 1, 1)).cells[0]  # the order of a cell's corners, as numbers in that of `box`
    corners = cage.cells[:, np.argsort(cube)]
    tets = corners[:, box(divisions=(1, 1, 1)).tets].reshape(-1, 4)
    return ElementMesh("tetra", cage.vertices, tets.astype(np.int32))


def _cage_of(
    shape: TetrahedralMesh, divisions: int
) -> tuple[ElementMesh, Float64Array, NDArray[np.int64], Float64Array]:
    """A grid of cubes around the shape, without empty ones; how full each is; each vertex's cell and weights there."""
    low, high = shape.bounds
    side = float((high - low).max()) / divisions
    counts = np.maximum(np.ceil((high - low) / side - 1e-9).astype(int), 1)
    size = tuple((counts * side).tolist())
    grid = hex_box(size, tuple(counts.tolist()))
    vertices = grid.vertices + 0.5 * (low + high)
    centroids = shape.vertices[shape.tets].mean(axis=1)
    owner, weights = trilinear_weights(shape.vertices, vertices, grid.cells)
    of_tets, _ = trilinear_weights(centroids, vertices, grid.cells)
    inside = np.bincount(of_tets, shape.volumes(), len(grid.cells))
    kept = np.union1d(owner, of_tets)
    used, cells = np.unique(grid.cells[kept], return_inverse=True)
    cage = ElementMesh("hexahedron", vertices[used], cells.reshape(-1, 8).astype(np.int32))
    filled = np.clip(inside[kept] / side**3, LEAST_FILLED, None)
    return cage, filled, np.searchsorted(kept, owner), weights
