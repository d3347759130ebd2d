"""Soft and stiff bunnies fall on a cloth with fixed corners.

Section 9.2 of the paper with z up: `cloths_on_bunny` with bunnies in place of the upper cloths. Each is 1 m across its
diagonal; every other one is an affine body, with 12 unknowns. Section 9.2 gives no materials: these are those of the
same bodies in section 9.3 (table 5). Units: see `cloths_on_bunny`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from yasps import Scene
from yasps.bodies import AffineBody, Cloth, SoftBody
from yasps.examples import bunnies_and_cloth as common
from yasps.meshes import TetrahedralMesh, cloth_grid
from yasps.program import Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

# --- Setup ---
MASS = 1.0  # kg, of a soft bunny and of the cloth
YOUNGS_MODULUS, POISSON_RATIO = 3.17e4, 0.226  # Pa, of a soft bunny
STIFF_MASS, STIFF_MODULUS = 0.5, 9.88e6  # kg and Pa, of a stiff bunny
WIDTH = 5.0  # m, of the cloth
THICKNESS = 1e-3  # m, of the cloth
STRETCH, SHEAR, BENDING = 3.55e5 * THICKNESS, 1.00e5 * THICKNESS, 0.25 * 0.05 / 3  # J/m^2, J/m^2, J
COMPRESSION = 0.01  # of the stretch stiffness where the cloth is shortened
DISTANCE = 1e-3  # m, of activation
STIFFNESS = {"log": None, "paper": 1e10}  # J/m^4, of contact; None: by the moduli of bodies
TOLERANCE = 1e-2  # m/s, of Newton's method

# --- Program ---
PROGRAM = SceneProgram(
    "many_bunnies_on_cloth",
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


# --- Initialisation ---
def build(options: Options) -> Simulation:
    """The bunnies above the cloth."""
    scene = PROGRAM.scene(options)
    shape = common.bunny_shape(options.size, options.mesh)
    bunnies = []
    for number in range(options.bunnies):
        add_bunny = add_stiff_bunny if number % 2 else add_soft_bunny
        bunnies.append(add_bunny(scene, f"bunny_{number}", shape.translated(common.place_of_bunny(number))))
    cloth = add_cloth(scene, "cloth_0", WIDTH, 0.0, options.size)
    # --- Newton iteration ---
    simulation = Simulation(
        scene,
        [*bunnies, cloth],
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
    """Entry point of `yasps run many_bunnies_on_cloth`."""
    colors = common.colors_of(PROGRAM.options(arguments).bunnies)
    return PROGRAM.run(arguments, build, check, view_direction=common.VIEW, colors=colors)


if __name__ == "__main__":
    sys.exit(main())
