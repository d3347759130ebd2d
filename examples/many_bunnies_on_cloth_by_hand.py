"""Many bunnies on a cloth without the kit: what affine bodies add to cloths_on_bunny_by_hand.

That is a primitive with a matrix and a translation, vertices that JOIN both, and an energy. Contact, Newton's method,
soft bunnies and cloth are imported as they are: the UNION of all vertices takes those of an affine body as any others.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps import Attribute, Scene, identity
from yasps.examples import bunnies_and_cloth as common
from yasps.examples import many_bunnies_on_cloth as kit
from yasps.examples.cloths_on_bunny_by_hand import Body, World, add_cloth, add_inertia_and_weight, add_soft_bunny, run
from yasps.meshes import TetrahedralMesh, cloth_grid
from yasps.program import Options, SceneProgram

SOFT = kit.YOUNGS_MODULUS, kit.POISSON_RATIO
SHEET = kit.STRETCH, kit.SHEAR, kit.BENDING

# --- Program ---
PROGRAM = SceneProgram(
    "many_bunnies_on_cloth_by_hand",
    __doc__,
    frames=200,
    time_step=0.01,
    size=40,
    size_means="cells along each side of the cloth; the rabbits are about as fine",
    mesh_means="tetrahedral mesh with y up, instead of the rabbit",
)
PROGRAM.add_argument(
    "--bunnies", type=common.number_of, default=4, metavar="N", help="how many, soft and stiff in turn (4)"
)


# --- Integration ---
def add_stiff_bunny(scene: Scene, name: str, shape: TetrahedralMesh, *, mass: float, youngs_modulus: float) -> Body:
    """An affine body: every vertex is A r + t."""
    mesh, center, volume = scene.add_mesh(name), shape.vertices.mean(axis=0), float(shape.volumes().sum())
    body = mesh.add_primitive("body", num_instances=1)
    matrix = body.add_attribute("matrix", 3, 3, value=np.eye(3))
    translation = body.add_attribute("translation", 3, 1, value=center)
    vertices = mesh.add_primitive("vertices", num_instances=len(shape.vertices))
    of_body = vertices.add_connectivity("of_body", body, np.zeros(len(shape.vertices), int), 1)
    a = vertices.add_attribute("matrix", through=of_body, source=matrix).reshape(3, 3)
    t = vertices.add_attribute("translation", through=of_body, source=translation).reshape(3, 1)
    r = vertices.add_constant("rest_position", 3, 1, value=shape.vertices - center)
    vertices.add_attribute("position", computed_attribute=a * r + t)
    add_inertia_and_weight(vertices, shape.vertex_masses(mass / volume))
    stiffness = body.add_constant("stiffness", 1, 1, value=youngs_modulus * volume)
    scene.add_energy(body.add_attribute("orthogonality", computed_attribute=stiffness * off_rotation(matrix)))
    cells = {"tetra": shape.tets}
    return Body(name, mesh, vertices, [matrix, translation], shape.surface_triangles(), cells, shape.vertices, False)


# --- Energy definition ---
def off_rotation(a: Attribute) -> Attribute:
    """|A^T A - I|^2 / 2 of a matrix, 3x3."""
    strain = a.T * a - identity(3)
    return 0.5 * strain.dot(strain)


# --- Initialisation ---
def add_bunnies(scene: Scene, shape: TetrahedralMesh, count: int) -> list[Body]:
    """Soft and stiff ones in turn."""
    bunnies = []
    for k in range(count):
        name, placed = f"bunny_{k}", shape.translated(common.place_of_bunny(k))
        if k % 2:
            bunnies.append(add_stiff_bunny(scene, name, placed, mass=kit.STIFF_MASS, youngs_modulus=kit.STIFF_MODULUS))
        else:
            bunnies.append(add_soft_bunny(scene, name, placed, mass=kit.MASS, moduli=SOFT))
    return bunnies


def add_sheet(scene: Scene, cells: int) -> Body:
    """The cloth with fixed corners."""
    shape = cloth_grid((kit.WIDTH, kit.WIDTH), (cells, cells))
    return add_cloth(scene, "cloth_0", shape, kit.MASS, SHEET, is_held=True)


def build(options: Options) -> World:
    """The bunnies above the cloth."""
    scene = PROGRAM.scene(options)
    scene.add_constant("time_step", 1, 1, value=options.dt)
    bunnies = add_bunnies(scene, common.bunny_shape(options.size, options.mesh), options.bunnies)
    return World(scene, [*bunnies, add_sheet(scene, options.size)])


# --- Program ---
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run many_bunnies_on_cloth_by_hand`."""
    return run(PROGRAM, arguments, build)


if __name__ == "__main__":
    sys.exit(main())
