"""An arch of loose stones: with a coefficient of friction of 0.5 it stands, with 0.2 its feet slide apart and it falls.

The stones are affine bodies, cut across a catenary, the line along which a hanging chain pulls; turned upside down it
is the line along which the arch pushes, so no joint between two stones needs friction. Only the feet do: they stand
on level abutments and push outwards at a third of their weight, the cotangent of the slope there.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from yasps import Scene
from yasps.bodies import AffineBody, HalfSpace, Obstacle
from yasps.contact import ContactTable
from yasps.meshes import TetrahedralMesh, TriangleMesh, box
from yasps.output import FrameRecorder
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

FOOT_SLOPE = 3.0  # of the catenary at its ends: friction above 1/3 holds the feet
SCALE = 0.5  # m, a of z = -a cosh(x / a)
THICKNESS = 0.16  # m
DEPTH = 0.2  # m
DISTANCE = 1e-3  # m, of activation
GAP = 0.995 * DISTANCE  # between stones at the start: near where they come to rest
BELOW = 0.4  # m, from the tops of the abutments down to the ground
SLIP_SPEED = 1e-3  # m/s


def arch_stones(count: int = 25) -> list[TetrahedralMesh]:
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


def masonry_arch(
    friction: float, count: int = 25, scene: Scene | None = None, *, slip_speed: float = SLIP_SPEED
) -> Simulation:
    """The arch between two abutments with level tops, above the ground. slip_speed [m/s]: what friction holds creeps
    slower than this."""
    scene = scene or Scene("masonry_arch")
    stones = [
        AffineBody(scene, f"stone_{number}", shape, density=2300.0, youngs_modulus=1e9)
        for number, shape in enumerate(arch_stones(count))
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
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=friction),
        eps_v=slip_speed,
        settings=NewtonSettings(
            velocity_tolerance=0.1 * slip_speed, relative_force_tolerance=1e-3, solver="direct", max_iterations=500
        ),
    )


def crown_height(simulation: Simulation) -> float:
    """Height of the middle of the stone at the top above the abutments [m]."""
    stones = [body for body in simulation.bodies if body.name.startswith("stone_")]
    return float(stones[len(stones) // 2].positions()[:, 2].mean())


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run masonry_arch`."""
    parser = argparse.ArgumentParser(prog="yasps run masonry_arch", description=__doc__)
    parser.add_argument("--friction", type=float, default=0.5, help="coefficient everywhere (default 0.5)")
    parser.add_argument("--stones", type=int, default=25, help="how many (default 25)")
    parser.add_argument("--frames", type=int, default=100, help="time steps of 0.01 s (default 100)")
    parser.add_argument("--output", type=Path, default=Path("output/masonry_arch"), help="folder for files")
    parser.add_argument("--no-pictures", action="store_true", help="no picture and no animation")
    options = parser.parse_args(arguments)
    simulation = masonry_arch(options.friction, options.stones)
    before = crown_height(simulation)
    with FrameRecorder(simulation, options.output, "masonry_arch", pictures=not options.no_pictures) as files:
        simulation.run(options.frames, files)
    print(f"after {simulation.time:.2f} s the crown is {1e3 * (before - crown_height(simulation)):.2f} mm lower")
    return 0


if __name__ == "__main__":
    sys.exit(main())
