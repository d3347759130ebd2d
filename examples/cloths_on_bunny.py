"""A soft bunny falls on a cloth with fixed corners, and more cloths fall on the bunny.

Section 9.1 of the paper with z up: the bunny is 1 m across its diagonal and weighs 1 kg, and so does each cloth. The
lower cloth is 5 m wide, the others are 3.75 m, and 2 m above each other. With `--size 100` and the paper's mesh
(`--mesh bunny_19k.msh`) `--cloths 1`, 2 and 3 are the rows of its table 1.

The numbers are the paper's, in units that mean something:

- A cloth's stiffness against stretch and shear [J/m^2] is the paper's in pascals times the thickness of 1 mm. Against
  bending the paper's public code has k l (theta - theta_0)^2 for a hinge with an edge of length l and k = 0.055 J/m,
  which depends on the mesh. The kit's hinges have 3 B l^2 / A, and B is such that both are the same for the edges along
  the sides of the lower cloth's cells where there are 100 along each side, as in the paper.
- The paper's barrier (`--barrier paper`) is kappa (D - H)^2 log(D / H)^2 of squared distances D with kappa = 1e6 in an
  energy that is multiplied by dt^2; that is 1e10 J/m^4 here. It knows no areas. The default is the kit's barrier in
  pascals, at the same activation distance, with a tenth of the softer body's modulus.
- The bunny's mass is spread by volume; the paper spreads it evenly over vertices.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from yasps import Scene
from yasps.bodies import Cloth, SoftBody
from yasps.examples import bunnies_and_cloth as common
from yasps.meshes import TetrahedralMesh, cloth_grid
from yasps.program import Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

# --- Setup ---
LIFT = 0.8  # m, of the bunny's middle above the lower cloth
MASS = 1.0  # kg, of the bunny and of each cloth
YOUNGS_MODULUS, POISSON_RATIO = 10259.25, 0.20457  # Pa, of the bunny
WIDTH = 5.0  # m, of the lower cloth
UPPER_WIDTH = 3.75  # m, of the others
THICKNESS = 1e-3  # m, of cloths
STRETCH, SHEAR, BENDING = 335570.47 * THICKNESS, 100607.11 * THICKNESS, 0.055 * 0.05 / 3  # J/m^2, J/m^2, J
COMPRESSION = 0.01  # of the stretch stiffness where a cloth is shortened
DISTANCE = 1e-3  # m, of activation
STIFFNESS = {"log": None, "paper": 1e10}  # J/m^4, of contact; None: by the moduli of bodies
TOLERANCE = 1e-2  # m/s, of Newton's method

# --- Program ---
PROGRAM = SceneProgram(
    "cloths_on_bunny",
    __doc__,
    frames=200,
    time_step=0.01,
    size=40,
    size_means="cells along each side of a cloth; the rabbit is about as fine",
    mesh_means="tetrahedral mesh with y up, instead of the rabbit",
)
PROGRAM.add_argument("--cloths", type=common.number_of, default=1, metavar="N", help="how many fall on the bunny (1)")
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


# --- Initialisation ---
def build(options: Options) -> Simulation:
    """The bunny between the lower cloth and the others."""
    scene = PROGRAM.scene(options)
    shape = common.bunny_shape(options.size, options.mesh)
    bunny = add_soft_bunny(scene, "bunny", shape.translated((0.0, 0.0, LIFT)))
    cloths = [add_cloth(scene, "cloth_0", WIDTH, 0.0, options.size)]
    cloths += [
        add_cloth(scene, f"cloth_{number}", UPPER_WIDTH, 2.0 * number - 0.2, options.size)
        for number in range(1, options.cloths + 1)
    ]
    # --- Newton iteration ---
    simulation = Simulation(
        scene,
        [bunny, *cloths],
        time_step=options.dt,
        activation_distance=DISTANCE,
        barrier=options.barrier,
        contact_stiffness=STIFFNESS[options.barrier],
        settings=NewtonSettings(velocity_tolerance=TOLERANCE, max_iterations=500),
    )
    # --- Initialisation ---
    simulation.pin(cloths[0], common.cloth_corners(options.size))
    return simulation


# --- Program ---
def check(simulation: Simulation, options: Options) -> str:
    """See `check_end`."""
    masses = {body.name: body.mass.value for body in simulation.bodies}
    return common.check_end(simulation.bodies, masses, simulation.stepper.kinetic_energy())


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run cloths_on_bunny`."""
    return PROGRAM.run(arguments, build, check, view_direction=common.VIEW)


if __name__ == "__main__":
    sys.exit(main())
