"""An arch of loose stones: with a coefficient of friction of 0.5 it stands, with 0.2 its feet slide apart and it falls.

The stones are affine bodies, cut across a catenary, the line along which a hanging chain pulls; turned upside down it
is the line along which the arch pushes, so no joint between two stones needs friction. Only the feet do: they stand
on level abutments and push outwards at a third of their weight, the cotangent of the slope there.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from yasps.bodies import AffineBody, HalfSpace, Obstacle
from yasps.contact import ContactTable
from yasps.meshes import TetrahedralMesh, TriangleMesh, box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

FOOT_SLOPE = 3.0  # of the catenary at its ends: friction above 1/3 holds the feet
SCALE = 0.5  # m, a of z = -a cosh(x / a)
THICKNESS = 0.16  # m
DEPTH = 0.2  # m
DISTANCE = 1e-3  # m, of activation
GAP = 0.995 * DISTANCE  # between stones at the start: near where they come to rest
BELOW = 0.4  # m, from the tops of the abutments down to the ground
SETTLING = 1e-4  # m: how far the crown of an arch that stands may move until it rests
GRAVITY = 9.8  # m/s^2

PROGRAM = SceneProgram("masonry_arch", __doc__, frames=100, time_step=0.01, size=25, size_means="stones")
PROGRAM.add_argument("--friction", type=float, default=0.5, help="coefficient everywhere (0.5)")
PROGRAM.add_argument(
    "--slip-speed", type=float, default=1e-3, metavar="M/S", help="what friction holds creeps slower than this (1e-3)"
)


def arch_stones(count: int) -> list[TetrahedralMesh]:
    """The stones from the left foot to the right one, `GAP` apart and above z = 0, where the abutments end."""
    half_length = SCALE * FOOT_SLOPE
    length = np.linspace(-half_length, half_length, count + 1)  # along the catenary, from its top
    slope = length / SCALE
    x, z = SCALE * np.arcsinh(slope), SCALE * (np.sqrt(1 + FOOT_SLOPE**2) - np.sqrt(1 + slope**2))
    along = np.stack([np.ones_like(slope), -slope], axis=1) / np.sqrt(1 + slope**2)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    # Level feet, as wide as the last joint is when it is looked at from above.
    across[0], across[-1] = (-1 / along[0, 1], 0.0), (1 / along[-1, 1], 0.0)
    across[[0, -1], 0] = -np.abs(across[[0, -1], 0]) * [1.0, -1.0]
    middle = np.stack([x, z], axis=1)
    shift = 0.5 * GAP * along
    shift[0], shift[-1] = (0.0, GAP), (0.0, -GAP)
    unit = box((1.0, 1.0, 1.0), (1, 1, 1))
    stones = []
    for left in range(count):
        points = np.empty_like(unit.vertices)
        for k, (u, v, w) in enumerate(unit.vertices):  # each -1/2 or 1/2: along the arch, across its depth, outwards
            joint, sign = (left, 1.0) if u < 0 else (left + 1, -1.0)
            place = middle[joint] + w * THICKNESS * across[joint] + sign * shift[joint]
            points[k] = place[0], v * DEPTH, place[1]
        stones.append(TetrahedralMesh(points, unit.tets))
    return stones


def build(options: Options) -> Simulation:
    """The arch between two abutments with level tops, above the ground."""
    scene = PROGRAM.scene(options)
    stones = [
        AffineBody(scene, f"stone_{number}", shape, density=2300.0, youngs_modulus=1e9)
        for number, shape in enumerate(arch_stones(options.size))
    ]
    foot = SCALE * np.arcsinh(FOOT_SLOPE)
    block = box((4 * THICKNESS, 2 * DEPTH, BELOW - GAP), (1, 1, 1))
    abutments = []
    for name, side in (("left_abutment", -1.0), ("right_abutment", 1.0)):
        shape = block.translated((side * foot, 0.0, -0.5 * (BELOW - GAP)))
        abutments.append(Obstacle(scene, name, TriangleMesh(shape.vertices, shape.surface_triangles())))
    return Simulation(
        scene,
        [*stones, *abutments, HalfSpace(scene, "ground", height=-BELOW)],
        time_step=options.dt,
        gravity=(0.0, 0.0, -GRAVITY),
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=options.friction),
        eps_v=options.slip_speed,
        settings=NewtonSettings(
            velocity_tolerance=0.1 * options.slip_speed,
            relative_force_tolerance=1e-3,
            solver="direct",
            max_iterations=500,
        ),
    )


def crown_sinks(simulation: Simulation) -> float:
    """By how much the stone at the top is lower than at the start [m]."""
    crown = simulation.moving[len(simulation.moving) // 2]
    return float(crown.rest[:, 2].mean() - crown.positions()[:, 2].mean())


def check(simulation: Simulation, options: Options) -> str:
    """It stands if friction is above the cotangent of the slope of its feet, else it falls."""
    sinks, needed = crown_sinks(simulation), 1 / FOOT_SLOPE
    what = (
        f"after {simulation.time:.2f} s the crown is {1e3 * sinks:.2f} mm lower, with a coefficient of friction of"
        f" {options.friction}, where {needed:.2f} is needed"
    )
    creeps = SETTLING + options.slip_speed * simulation.time
    if options.friction > needed and abs(sinks) > creeps:
        raise CheckFailedError(f"{what}: the arch does not stand")
    if options.friction < needed and sinks < creeps:
        raise CheckFailedError(f"{what}: the arch does not fall yet; give it more --frames")
    return what


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run masonry_arch`."""
    return PROGRAM.run(arguments, build, check)


if __name__ == "__main__":
    sys.exit(main())
