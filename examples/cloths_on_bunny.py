"""A soft bunny falls on a cloth with fixed corners, and more cloths fall on the bunny.

Section 9.1 of the paper, with its numbers and z up: the bunny is 1 m across its diagonal and weighs 1 kg, and so does
each cloth. The lower one is 5 m wide, the others 3.75 m, 2 m above each other. With `--size 100` and the paper's mesh
(`--mesh bunny_19k.msh`; y is up in mesh files) `--cloths 1`, 2 and 3 are the three rows of its table 1.

Numbers are the paper's, in units that mean something:

- A cloth's stiffness is per area, so its pascals are multiplied by its thickness of 1 mm. So is its bending stiffness:
  0.055 is E h^2 / (24 (1 - nu^2)) of 1 MPa, 0.49 and 1 mm.
- The paper's barrier (`--barrier paper`) is kappa (D - H)^2 log(D / H)^2 with kappa = 1e6, in an energy that is
  multiplied by dt^2: that is 1e10 J/m^4 here. It knows no areas. The default is the barrier in pascals at the same
  distance of 1 mm, a tenth of Young's modulus of the softer of two bodies.
- The mass of the bunny is spread by volume, the paper spreads it evenly over vertices.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from yasps import Scene
from yasps.bodies import Cloth, SoftBody
from yasps.meshes import TetrahedralMesh, cloth_grid, rabbit, read_tetrahedral_mesh
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

DIAGONAL = 1.0  # m, of the box around the bunny
LIFT = 0.8  # m, of its middle above the lower cloth
MASS = 1.0  # kg, of the bunny and of each cloth
YOUNGS_MODULUS, POISSON_RATIO = 10259.25, 0.20457  # Pa, of the bunny
WIDTH = 5.0  # m, of the lower cloth
UPPER_WIDTH = 0.75 * WIDTH
THICKNESS = 1e-3  # m, of the cloths
STRETCH, SHEAR, BENDING = 335570.47 * THICKNESS, 100607.11 * THICKNESS, 0.055 * THICKNESS  # J/m^2, J/m^2, J
COMPRESSION = 0.01  # of the stretch stiffness where a cloth is shortened
DISTANCE = 1e-3  # m, of activation
STIFFNESS = {"log": 0.1 * YOUNGS_MODULUS, "paper": 1e10}  # Pa, J/m^4, of contact


def bunny_shape(size: int, mesh: Path | None) -> TetrahedralMesh:
    """The bunny, its middle at the origin: of a file with y up, or the rabbit, as fine as a cloth of `size` cells."""
    if mesh is not None:
        shape = read_tetrahedral_mesh(mesh).rotated((1.0, 0.0, 0.0), 0.5 * np.pi)
    else:
        shape = rabbit(max(1500, round(1.9 * size**2)))
    low, high = shape.bounds
    return shape.translated(-0.5 * (low + high)).scaled(DIAGONAL / float(np.linalg.norm(high - low)))


def corners_of(cloth: Cloth) -> np.ndarray:
    """The four vertices that are farthest out."""
    return np.argsort(-np.abs(cloth.rest[:, :2]).sum(axis=1), kind="stable")[:4]


def build(options: argparse.Namespace) -> Simulation:
    """The bunny between the lower cloth and the others."""
    scene = Scene("cloths_on_bunny", device=options.device, threads=options.threads)
    shape = bunny_shape(options.size, options.mesh).translated((0.0, 0.0, LIFT))
    bunny = SoftBody(
        scene,
        "bunny",
        shape,
        density=MASS / float(shape.volumes().sum()),
        youngs_modulus=YOUNGS_MODULUS,
        poisson_ratio=POISSON_RATIO,
    )
    cloths = []
    for number in range(options.cloths + 1):
        width = UPPER_WIDTH if number else WIDTH
        cloths.append(
            Cloth(
                scene,
                f"cloth_{number}",
                cloth_grid((width, width), (options.size, options.size), z=2.0 * number - 0.2 if number else 0.0),
                area_density=MASS / width**2,
                stretch=STRETCH,
                shear=SHEAR,
                bending=BENDING,
                compression=COMPRESSION,
            )
        )
    simulation = Simulation(
        scene,
        [bunny, *cloths],
        time_step=options.dt,
        activation_distance=DISTANCE,
        barrier=options.barrier,
        contact_stiffness=STIFFNESS[options.barrier],
        settings=NewtonSettings(velocity_tolerance=1e-2, max_iterations=500),
    )
    simulation.pin(cloths[0], corners_of(cloths[0]))
    return simulation


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run cloths_on_bunny`."""
    parser = argparse.ArgumentParser(prog="yasps run cloths_on_bunny", description=__doc__)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--dt", type=float, default=0.01)
    parser.add_argument("--size", type=int, default=40, help="cells along each side of a cloth")
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--cloths", type=int, default=1, help="above the bunny (default 1)")
    parser.add_argument("--barrier", choices=tuple(STIFFNESS), default="log")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int)
    options = parser.parse_args(arguments)
    simulation = build(options)
    reports = simulation.run(options.frames)
    print(f"{sum(r.iterations for r in reports)} Newton and {sum(r.cg_iterations for r in reports)} CG iterations")
    return 0


if __name__ == "__main__":
    sys.exit(main())
