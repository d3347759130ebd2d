"""A bunny in a cage of cubes falls on a cloth with a soft and a stiff one.

Section 9.3 of the paper with z up: `many_bunnies_on_cloth` with one more bunny, whose vertices follow the corners of a
grid of cubes (8 weights each). The corners are its unknowns, its energy is that of the cubes, each of them six
tetrahedra (`--element tet4`) or a hexahedron with eight Gauss points (`--element hex8`), by the share of it that the
bunny fills. Its surface collides, the cage does not. Materials: table 5, but for the stiffness of the cage. With the 0.1 kPa that
stand there its 6.2 kg flatten it at once (their weight alone is a pressure of 0.7 kPa), so it has the 31.7 kPa of the
soft bunny. Units: see `cloths_on_bunny`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from yasps.bodies import AffineBody, Body, CagedBody, Cloth, SoftBody
from yasps.examples.bunnies_and_cloth import VIEW, bunny_shape, check_end, cloth_corners, place_of_bunny
from yasps.meshes import cloth_grid
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
STRETCH, SHEAR, BENDING = 3.55e5 * THICKNESS, 1.00e5 * THICKNESS, 0.25 * THICKNESS  # J/m^2, J/m^2, J
COMPRESSION = 0.01  # of the stretch stiffness where the cloth is shortened
DISTANCE = 1e-3  # m, of activation
STIFFNESS = {"log": 0.1 * YOUNGS_MODULUS, "paper": 1e10}  # Pa and J/m^4, of contact
TOLERANCE = 1e-2  # m/s, of Newton's method

PROGRAM = SceneProgram(
    "caged_bunny",
    __doc__,
    frames=200,
    time_step=0.01,
    size=40,
    size_means="cells along each side of the cloth; the rabbits are about as fine",
    mesh_means="tetrahedral mesh with y up, instead of the rabbit",
)
PROGRAM.add_argument("--bunnies", type=int, default=2, metavar="N", help="how many others, soft and stiff in turn (2)")
PROGRAM.add_argument("--element", choices=tuple(ELEMENTS), default="tet4", help="of the cage (tet4)")
PROGRAM.add_argument("--barrier", choices=tuple(STIFFNESS), default="log", help="of contact (log)")


def build(options: Options) -> Simulation:
    """The bunnies above the cloth."""
    scene = PROGRAM.scene(options)
    shape = bunny_shape(options.size, options.mesh)
    # --- Integration ---
    bunnies: list[Body] = []
    for number in range(options.bunnies):
        placed = shape.translated(place_of_bunny(number))
        if number % 2 == 1:
            density = STIFF_MASS / float(shape.volumes().sum())
            stiff = AffineBody(scene, f"stiff_{number}", placed, density=density, youngs_modulus=STIFF_MODULUS)
            bunnies.append(stiff)
            continue
        bunny = SoftBody(
            scene,
            f"soft_{number}",
            placed,
            density=MASS / float(shape.volumes().sum()),
            youngs_modulus=YOUNGS_MODULUS,
            poisson_ratio=POISSON_RATIO,
        )
        bunnies.append(bunny)
    caged = CagedBody(
        scene,
        "caged",
        shape.translated(place_of_bunny(options.bunnies)),
        divisions=max(2, options.size // 10),
        element=ELEMENTS[options.element],
        density=CAGED_MASS / float(shape.volumes().sum()),
        youngs_modulus=CAGED_MODULUS,
        poisson_ratio=CAGED_RATIO,
    )
    cloth = Cloth(
        scene,
        "cloth_0",
        cloth_grid((WIDTH, WIDTH), (options.size, options.size)),
        area_density=MASS / WIDTH**2,
        stretch=STRETCH,
        shear=SHEAR,
        bending=BENDING,
        compression=COMPRESSION,
    )
    # --- Collision ---
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
    simulation.pin(cloth, cloth_corners(options.size))
    return simulation


# --- Output ---
def check(simulation: Simulation, options: Options) -> str:
    """See `check_end`."""
    masses = {body.name: body.mass.value for body in simulation.bodies}
    return check_end(simulation.bodies, masses, simulation.stepper.kinetic_energy())


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run caged_bunny`."""
    return PROGRAM.run(arguments, build, check, view_direction=VIEW)


if __name__ == "__main__":
    sys.exit(main())
