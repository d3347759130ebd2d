"""A caged bunny without the kit: what a cage adds to many_bunnies_on_cloth_by_hand.

That is a primitive for the corners of the cage, vertices that JOIN the eight corners of their cell with constant
weights, and the energy of soft bunnies on the elements of the cage.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps import Scene
from yasps.examples import bunnies_and_cloth as common
from yasps.examples import caged_bunny as kit
from yasps.examples.cloths_on_bunny_by_hand import Body, Floats, World, add_inertia_and_weight, run, stable_neo_hookean
from yasps.examples.many_bunnies_on_cloth_by_hand import add_bunnies, add_sheet
from yasps.meshes import ElementMesh, TetrahedralMesh, box, hex_box, trilinear_shape
from yasps.program import Options, SceneProgram

# --- Program ---
PROGRAM = SceneProgram(
    "caged_bunny_by_hand",
    __doc__,
    frames=200,
    time_step=0.01,
    size=40,
    size_means="cells along each side of the cloth; the rabbits are about as fine",
    mesh_means="tetrahedral mesh with y up, instead of the rabbit",
)
PROGRAM.add_argument(
    "--bunnies", type=common.number_of, default=2, metavar="N", help="others, soft and stiff in turn (2)"
)
PROGRAM.add_argument("--element", choices=tuple(kit.ELEMENTS), default="tet4", help="of the cage (tet4)")


# --- Integration ---
def cells_of(points: Floats, low: Floats, side: float, counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
    """In which cube of a grid points are, [n], and the weights of its corners, [n, 8]."""
    place = (points - low) / side
    cell = np.clip(np.floor(place).astype(int), 0, counts - 1)
    return np.ravel_multi_index(tuple(cell.T), tuple(counts)), trilinear_shape(2 * (place - cell) - 1)


def add_caged_bunny(scene: Scene, shape: TetrahedralMesh, element: str, divisions: int) -> Body:
    """Vertices in a grid of cubes, so many along the longest side of the box around them; empty ones are left out."""
    low, high = shape.bounds
    side = float((high - low).max()) / divisions
    counts = np.ceil((high - low) / side - 1e-9).astype(int)
    grid = hex_box(tuple(side * counts), tuple(counts.tolist()))
    tets = box(tuple(side * counts), tuple(counts.tolist())).tets.reshape(len(grid.cells), 6, 4)
    low = 0.5 * (low + high - side * counts)
    owner, weights = cells_of(shape.vertices, low, side, counts)
    of_tets, _ = cells_of(shape.vertices[shape.tets].mean(axis=1), low, side, counts)
    kept = np.union1d(owner, of_tets)
    filled = np.bincount(of_tets, shape.volumes(), len(grid.cells))[kept] / side**3
    number = np.full(len(grid.vertices), -1)
    used = np.unique(grid.cells[kept])
    number[used] = np.arange(len(used))
    cells = tets[kept].reshape(-1, 4) if element == "tet4" else grid.cells[kept]
    elements = ElementMesh(kit.ELEMENTS[element], (grid.vertices + 0.5 * (shape.bounds[0] + high))[used], number[cells])

    mesh = scene.add_mesh("caged")
    corners = mesh.add_primitive("corners", num_instances=len(used))
    corner_position = corners.add_attribute("position", 3, 1, value=elements.vertices)
    vertices = mesh.add_primitive("vertices", num_instances=len(shape.vertices))
    of_cell = vertices.add_connectivity("of_cell", corners, number[grid.cells[owner]], 8)
    around = vertices.add_attribute("corners", through=of_cell, source=corner_position)
    w = vertices.add_constant("weights", 1, 8, value=weights)
    vertices.add_attribute("position", computed_attribute=(w * around).T)
    vertices.add_constant("rest_position", 3, 1, value=shape.vertices)
    add_inertia_and_weight(vertices, shape.vertex_masses(kit.CAGED_MASS / float(shape.volumes().sum())))

    points = elements.points()
    arity, each = points.nodes.shape[1], len(points.volumes) // len(kept)
    gauss = mesh.add_primitive("gauss_points", num_instances=len(points.volumes))
    nodes = gauss.add_connectivity("nodes", corners, points.nodes, arity)
    x = gauss.add_attribute("positions", through=nodes, source=corner_position)
    gradients = gauss.add_constant("gradients", arity, 3, value=points.gradients)
    volume = gauss.add_constant("volume", 1, 1, value=points.volumes * np.repeat(np.maximum(filled, 0.01), each))
    # --- Energy definition ---
    elastic = volume * stable_neo_hookean(x.T * gradients, kit.CAGED_MODULUS, kit.CAGED_RATIO)
    scene.add_energy(gauss.add_attribute("elastic", computed_attribute=elastic))
    # --- Integration ---
    surface, cells_shown = shape.surface_triangles(), {"tetra": shape.tets}
    return Body("caged", mesh, vertices, [corner_position], surface, cells_shown, shape.vertices)


# --- Initialisation ---
def build(options: Options) -> World:
    """The bunnies above the cloth."""
    scene = PROGRAM.scene(options)
    scene.add_constant("time_step", 1, 1, value=options.dt)
    shape = common.bunny_shape(options.size, options.mesh)
    bunnies = add_bunnies(scene, shape, options.bunnies)
    placed, divisions = shape.translated(common.place_of_bunny(options.bunnies)), max(2, options.size // 10)
    bunnies.append(add_caged_bunny(scene, placed, options.element, divisions))
    return World(scene, [*bunnies, add_sheet(scene, options.size)])


# --- Program ---
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run caged_bunny_by_hand`."""
    return run(PROGRAM, arguments, build)


if __name__ == "__main__":
    sys.exit(main())
