"""Blocks on a turning disc: friction holds those near the axis, and those farther out slide off.

A block at the distance r from the axis needs the acceleration w^2 r, and friction has mu g at most. So with a
coefficient of 0.5 and 4 rad/s blocks go round for ever up to r = 0.306 m, and none stays beyond; with 0.05 only those
within 3 cm do.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from yasps.bodies import AffineBody, Body, HalfSpace, MovingObstacle
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

RADIUS, THICKNESS = 0.5, 0.03  # m, of the disc
RATE = 4.0  # rad/s
BELOW = 0.15  # m, from the top of the disc down to the ground
BLOCK = (0.05, 0.05, 0.03)  # m
NEAREST, FARTHEST = 0.08, 0.44  # m: blocks stand from here to there
GRAVITY = 9.8  # m/s^2
DISTANCE = 1e-3  # m, of activation
SLIP_SPEED = 1e-3  # m/s: friction that holds lets things creep slower than this
MARGIN = 0.1  # blocks nearer to the limit than this share of it may do either

PROGRAM = SceneProgram("turntable", __doc__, frames=200, time_step=0.01, size=8, size_means="blocks")
PROGRAM.add_argument("--friction", type=float, default=0.5, help="coefficient everywhere (default 0.5)")


def disc(corners: int = 64) -> TriangleMesh:
    """A closed disc with its top at z = 0."""
    angles = 2 * np.pi * np.arange(corners) / corners
    rim = np.column_stack([RADIUS * np.cos(angles), RADIUS * np.sin(angles), np.zeros(corners)])
    down = np.array([0.0, 0.0, -THICKNESS])
    points = np.vstack([rim, rim + down, np.zeros(3), down])
    this, after = np.arange(corners), np.roll(np.arange(corners), -1)
    top, bottom = np.full(corners, 2 * corners), np.full(corners, 2 * corners + 1)
    corner_lists = [
        (this, after, top),
        (after + corners, this + corners, bottom),
        (this, this + corners, after),
        (after, this + corners, after + corners),
    ]
    return TriangleMesh(points, np.concatenate([np.stack(ids, axis=1) for ids in corner_lists]).astype(np.int32))


def places(count: int) -> NDArray[np.float64]:
    """Where the blocks stand, [n, 2] in m: each farther out than the one before it, and 137.5 degrees on."""
    distances = np.linspace(NEAREST, FARTHEST, count)
    angles = np.radians(137.5) * np.arange(count)
    return np.asarray(distances[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))


def build(options: Options) -> Simulation:
    """The blocks on the disc, all of which turns already."""
    scene = PROGRAM.scene(options)
    blocks = []
    for number, (x, y) in enumerate(places(options.size)):
        shape = box(BLOCK, (1, 1, 1)).rotated((0.0, 0.0, 1.0), float(np.arctan2(y, x)))
        shape = shape.translated((x, y, 0.5 * BLOCK[2] + 0.98 * DISTANCE))
        blocks.append(AffineBody(scene, f"block_{number}", shape))
    table = disc()

    def motion(time: float) -> NDArray[np.float64]:
        return np.asarray(Rotation.from_rotvec([0.0, 0.0, RATE * time]).apply(table.vertices))

    turning = MovingObstacle(scene, "table", table, motion=motion)
    velocities: dict[Body, NDArray[np.float64]] = {
        block: RATE * block.rest[:, [1, 0, 2]] * [-1.0, 1.0, 0.0] for block in blocks
    }
    return Simulation(
        scene,
        [*blocks, turning, HalfSpace(scene, "ground", height=-BELOW)],
        time_step=options.dt,
        gravity=(0.0, 0.0, -GRAVITY),
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=options.friction),
        eps_v=SLIP_SPEED,
        velocities=velocities,
        settings=NewtonSettings(
            velocity_tolerance=0.1 * SLIP_SPEED, relative_force_tolerance=1e-3, solver="direct", max_iterations=500
        ),
    )


def check(simulation: Simulation, options: Options) -> str:
    """Blocks within mu g / w^2 of the axis are where they were on the disc, those beyond are farther out."""
    limit = options.friction * GRAVITY / RATE**2
    starts = np.linalg.norm(places(options.size), axis=1)
    ends = np.array(
        [np.linalg.norm(body.positions().mean(axis=0)[:2]) for body in simulation.moving if body.name != "table"]
    )
    outwards = ends - starts
    holds, slides = starts < (1 - MARGIN) * limit, starts > (1 + MARGIN) * limit
    creep = SLIP_SPEED * simulation.time + DISTANCE
    # The least that a block slides: with half of the acceleration that friction lacks, for at most a quarter of a turn.
    seconds = min(simulation.time, 0.25 * 2 * np.pi / RATE)
    way = 0.25 * (RATE**2 * starts - options.friction * GRAVITY) * seconds**2
    for number in np.flatnonzero(holds & (np.abs(outwards) > creep)):
        raise CheckFailedError(
            f"block {number} started {starts[number]:.3f} m from the axis, where friction holds it, and is"
            f" {1e3 * outwards[number]:.1f} mm farther out after {simulation.time:.2f} s"
        )
    for number in np.flatnonzero(slides & (outwards < way)):
        raise CheckFailedError(
            f"block {number} started {starts[number]:.3f} m from the axis, where friction can't hold it, and is only"
            f" {1e3 * outwards[number]:.1f} mm farther out after {simulation.time:.2f} s"
        )
    return (
        f"friction holds blocks up to {limit:.3f} m from the axis: {holds.sum()} are carried, {slides.sum()} slid off,"
        f" {(~holds & ~slides).sum()} near the limit; largest creep"
        f" {1e3 * np.abs(outwards[holds]).max(initial=0.0):.2f} mm"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run turntable`."""
    return PROGRAM.run(arguments, build, check, view_direction=(0.35, -1.0, 0.7))


if __name__ == "__main__":
    sys.exit(main())
