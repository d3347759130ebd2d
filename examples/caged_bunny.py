"""A bunny in a cage of cubes falls on a cloth with a soft and a stiff one.

Section 9.3 of the paper with z up: `many_bunnies_on_cloth` with one more bunny, whose vertices follow the corners of a
grid of cubes (8 weights each). The corners are its unknowns, its energy is that of the cubes, each of them six
tetrahedra (`--element tet4`) or a hexahedron with eight Gauss points (`--element hex8`), by the share of it that the
bunny fills. Its surface collides, the cage does not.

Materials are those of table 5, but for the stiffness of the cage: with the 0.1 kPa that stand there, 6.2 kg flatten it
at once (their weight alone is a pressure of 0.7 kPa at the feet), so it has the 31.7 kPa of the soft bunny. Units: see
`cloths_on_bunny`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from yasps import Scene
from yasps.bodies import AffineBody, CagedBody, Cloth, SoftBody
from yasps.examples import bunnies_and_cloth as common
from yasps.meshes import TetrahedralMesh, cloth_grid
from yasps.program import Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

# --- Setup ---
MASS = 1.0  # kg, of a soft bunny and of the cloth
YOUNGS_MODULUS, POISSON_RATIO = 3.17e4, 0.226  # Pa, of a soft bunny
STIFF_MASS, STIFF_MODULUS = 0.5, 9.88e6  # kg and Pa, of a stiff bunny
CAGED_MASS, CAGED_MODULUS, CAGED_RATIO = 6.2, 3.17e4, 0.25  # kg and Pa, of the caged bunny
ELEMENTS = {"tet4": "tetra", "hex8": "hexahedron"}  # of its cage
WIDTH = 5.0  # m, of the cloth
THICKNESS = 1e-3  # m, of the cloth
STRETCH, SHEAR, BENDING = 3.55e5 * THICKNESS, 1.00e5 * THICKNESS, 0.25 * 0.05 / 3  # J/m^2, J/m^2, J
COMPRESSION = 0.01  # of the stretch stiffness where the cloth is shortened
DISTANCE = 1e-3  # m, of activation
STIFFNESS = {"log": None, "paper": 1e10}  # J/m^4, of contact; None: by the moduli of bodies
TOLERANCE = 1e-2  # m/s, of Newton's method

# --- Program ---
PROGRAM = SceneProgram(
    "caged_bunny",
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
PROGRAM.add_argument("--element", choices=tuple(ELEMENTS), default="tet4", help="of the cage (tet4)")
PROGRAM.add_argument("--barrier", choices=tuple(STIFFNESS), default="log", help="of contact (log)")


# --- Integration ---
def add_soft_bunny(scene: Scene, name: str, shape: TetrahedralMesh) -> SoftBody:
    """Stable Neo-Hookean tetrahedra."""
    return SoftBody(
        scene,
        name,
        shape,
        density=MASS / float(shape.volumes().sum()),
        youngs_modulus=YOUNGS_MODULUS,
        poisson_ratio=POISSON_RATIO,
    )


def add_cloth(scene: Scene, name: str, width: float, height: float, cells: int) -> Cloth:
    """A level square of so many cells along each side."""
    return Cloth(
        scene,
        name,
        cloth_grid((width, width), (cells, cells), height),
        area_density=MASS / width**2,
        stretch=STRETCH,
        shear=SHEAR,
        bending=BENDING,
        compression=COMPRESSION,
    )


def add_stiff_bunny(scene: Scene, name: str, shape: TetrahedralMesh) -> AffineBody:
    """An affine body."""
    density = STIFF_MASS / float(shape.volumes().sum())
    return AffineBody(scene, name, shape, density=density, youngs_modulus=STIFF_MODULUS)


def add_caged_bunny(scene: Scene, name: str, shape: TetrahedralMesh, divisions: int, element: str) -> CagedBody:
    """Vertices in a grid of cubes."""
    return CagedBody(
        scene,
        name,
        shape,
        divisions=divisions,
        element=ELEMENTS[element],
        density=CAGED_MASS / float(shape.volumes().sum()),
        youngs_modulus=CAGED_MODULUS,
        poisson_ratio=CAGED_RATIO,
    )


# --- Initialisation ---
def build(options: Options) -> Simulation:
    """The bunnies above the cloth."""
    scene = PROGRAM.scene(options)
    shape = common.bunny_shape(options.size, options.mesh)
    bunnies = []
    for number in range(options.bunnies):
        add_bunny = add_stiff_bunny if number % 2 else add_soft_bunny
        bunnies.append(add_bunny(scene, f"bunny_{number}", shape.translated(common.place_of_bunny(number))))
    placed, divisions = shape.translated(common.place_of_bunny(options.bunnies)), max(2, options.size // 10)
    caged = add_caged_bunny(scene, "caged", placed, divisions, options.element)
    cloth = add_cloth(scene, "cloth_0", WIDTH, 0.0, options.size)
    # --- Newton iteration ---
    simulation = Simulation(
        scene,
        [*bunnies, caged, cloth],
        time_step=options.dt,
        activation_distance=DISTANCE,
        barrier=options.barrier,
        contact_stiffness=STIFFNESS[options.barrier],
        settings=NewtonSettings(velocity_tolerance=TOLERANCE, max_iterations=500),
    )
    # --- Initialisation ---
    simulation.pin(cloth, common.cloth_corners(options.size))
    return simulation


# --- Program ---
def check(simulation: Simulation, options: Options) -> str:
    """See `check_end`."""
    masses = {body.name: body.mass.value for body in simulation.bodies}
    return common.check_end(simulation.bodies, masses, simulation.stepper.kinetic_energy())


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run caged_bunny`."""
    colors = common.colors_of(PROGRAM.options(arguments).bunnies)
    return PROGRAM.run(arguments, build, check, view_direction=common.VIEW, colors=colors)


if __name__ == "__main__":
    sys.exit(main())
