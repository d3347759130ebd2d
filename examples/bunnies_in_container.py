"""Soft bunnies fall into a glass container, as many as you like, some of them stiff (the paper, 10.2 and E.2).

Four bunnies are in each layer, turned at random. `--affine 1` makes one of them an affine body: contact is the same
energy over the UNION of all vertices then, with twelve unknowns behind those of that bunny. With the paper's mesh
(`--mesh bunny_19k.msh`) `--size 6` to 10 are the rows of its table 3.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps import SceneError
from yasps.bodies import AffineBody, Body, Obstacle, SoftBody
from yasps.contact import ContactTable, narrowest_gap
from yasps.meshes import TetrahedralMesh, TriangleMesh, rabbit, read_tetrahedral_mesh, signed_volumes
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

DIAMETER = 0.2  # m, of a sphere around a bunny
SPACING = 1.02 * DIAMETER  # between the middles of bunnies at the start
ACROSS = 2  # bunnies side by side
WIDTH = ACROSS * SPACING  # m, of the container
YOUNGS_MODULUS, STIFF_MODULUS, POISSON_RATIO = 5e4, 1e7, 0.4  # Pa, Pa, none
DISTANCE = 1e-3  # m, of activation, or less where a bunny is narrower itself
TOLERANCE = 1e-2  # m/s, of Newton's method
CONTACT_STIFFNESS = 5e4  # Pa
GRAVITY = 9.8  # m/s^2
TURNS = 7  # seed of the bunnies' turns
GLASS = "#b8c4d050"

PROGRAM = SceneProgram(
    "bunnies_in_container",
    __doc__,
    frames=100,
    time_step=0.01,
    size=6,
    size_means="bunnies",
    mesh_means="tetrahedral mesh of a bunny, y up, instead of the rabbit",
)
PROGRAM.add_argument("--affine", type=int, default=0, metavar="N", help="how many bunnies are affine bodies (0)")
PROGRAM.add_argument("--vertices", type=int, default=1500, metavar="N", help="of the rabbit (1500)")


def bunny(options: Options) -> TetrahedralMesh:
    """A bunny in a sphere about the origin."""
    if options.mesh is None:
        shape = rabbit(options.vertices)
    else:
        shape = read_tetrahedral_mesh(options.mesh).rotated((1.0, 0.0, 0.0), 0.5 * np.pi)
    low, high = shape.bounds
    shape = shape.translated(-0.5 * (low + high))
    return shape.scaled(0.5 * DIAMETER / float(np.linalg.norm(shape.vertices, axis=1).max()))


def open_box(width: float, height: float) -> TriangleMesh:
    """A floor at z = 0 and four walls around the z axis, seen from inside."""
    corners = 0.5 * width * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    vertices = np.vstack([np.column_stack([corners, np.full(4, z)]) for z in (0.0, height)])
    triangles = [[0, 1, 2], [0, 2, 3]]
    for here, there in ((0, 1), (1, 2), (2, 3), (3, 0)):
        triangles += [[there, here, here + 4], [there, here + 4, there + 4]]
    return TriangleMesh(vertices, np.array(triangles, np.int32))


def build(options: Options) -> Simulation:
    """The container on z = 0, open at the top, and the bunnies in it, layer over layer."""
    scene = PROGRAM.scene(options)
    shape, random = bunny(options), np.random.default_rng(TURNS)
    bunnies: list[Body] = []
    if not 0 <= options.affine <= options.size:
        raise SceneError(
            f"--affine says how many of the {options.size} bunnies are affine bodies, got {options.affine}"
        )
    for number in range(options.size):
        layer, place = divmod(number, ACROSS**2)
        at = (np.array([place % ACROSS, place // ACROSS, layer]) + 0.5) * SPACING - [0.5 * WIDTH, 0.5 * WIDTH, 0.0]
        turned = shape.rotated(random.normal(size=3), random.uniform(0.0, 2 * np.pi)).translated(at)
        if number < options.size - options.affine:
            body: Body = SoftBody(
                scene, f"soft_{number}", turned, youngs_modulus=YOUNGS_MODULUS, poisson_ratio=POISSON_RATIO
            )
        else:
            body = AffineBody(scene, f"stiff_{number}", turned, youngs_modulus=STIFF_MODULUS)
        bunnies.append(body)
    layers = -(-options.size // ACROSS**2)
    container = Obstacle(scene, "container", open_box(WIDTH, layers * SPACING))
    return Simulation(
        scene,
        [*bunnies, container],
        time_step=options.dt,
        gravity=(0.0, 0.0, -GRAVITY),
        activation_distance=min(DISTANCE, 0.8 * narrowest_gap(shape, 2 * DISTANCE)),
        contacts=ContactTable(stiffness=CONTACT_STIFFNESS),
        settings=NewtonSettings(velocity_tolerance=TOLERANCE, max_iterations=500),
    )


def check(simulation: Simulation, options: Options) -> str:
    """All bunnies are in the container, none of their tetrahedra is inside out, and no motion came from nowhere."""
    fallen, flattest = 0.0, 1.0
    for body in simulation.moving:
        x, ids = body.positions(), body.cells["tetra"]
        if np.abs(x[:, :2]).max() > 0.5 * WIDTH or x[:, 2].min() < 0.0:
            raise CheckFailedError(f"{body.name} is not in the container")
        volumes = signed_volumes(x, ids) / signed_volumes(body.rest, ids)
        flattest = min(flattest, float(volumes.min()))
        if flattest <= 0.0:
            raise CheckFailedError(f"tetrahedron {volumes.argmin()} of {body.name} is inside out")
        fallen += GRAVITY * float(body.mass.value @ (body.rest - x)[:, 2])
    motion = simulation.stepper.kinetic_energy()
    if motion > fallen + 1e-6 * abs(fallen):
        raise CheckFailedError(f"the bunnies move with {motion:.6g} J, but only {fallen:.6g} J came from falling")
    return (
        f"after {simulation.time:.2f} s all {len(simulation.moving)} bunnies are in the container; of {fallen:.3g} J"
        f" from falling {motion:.3g} J are left as motion; the flattest tetrahedron has {flattest:.2f} of its volume"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run bunnies_in_container`."""
    return PROGRAM.run(arguments, build, check, colors={"container": GLASS}, view_direction=(0.45, -1.0, 0.5))


if __name__ == "__main__":
    sys.exit(main())
