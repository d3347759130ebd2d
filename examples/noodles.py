"""Noodles fall into a bowl: thin rods with thickness and friction, which meet each other edge against edge.

Each noodle is a chain of straight segments that stretch and bend (`yasps.bodies.Rod`), 0.25 m long and 4 mm thick. At
the end all of them are in the bowl, none is stretched, and the bowl carries their mass times gravity and acceleration.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps.bodies import HalfSpace, Obstacle, Rod
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

LENGTH, RADIUS = 0.25, 2e-3  # m, of a noodle
SEGMENTS = 50  # of each
DENSITY, STIFFNESS = 1000.0, 1e5  # kg/m^3, Pa
SPACING, WAVE = 0.012, 0.003  # m: between noodles, and how far their middles are off a straight line
SMALLEST_BOWL = 0.09  # m, radius of its sphere
SHARE = 0.95  # of the sphere's lower half that the bowl is
DISTANCE = 5e-4  # m, of activation
SLIP_SPEED = 5e-3  # m/s
FALLEN = 0.45  # s: the ends have come down into the bowl

PROGRAM = SceneProgram(
    "noodles", __doc__, frames=160, time_step=0.005, size=5, size_means="noodles along each side of a square of them"
)
PROGRAM.add_argument("--friction", type=float, default=0.2, help="coefficient everywhere (default 0.2)")


def bowl_radius(count: int) -> float:
    """Of a bowl that a square of so many noodles along its sides falls into [m]."""
    return max(SMALLEST_BOWL, 0.9 * count * SPACING)


def bowl(radius: float, around: int = 48, rings: int = 14) -> TriangleMesh:
    """The lower part of a sphere around the origin, a sheet of triangles that faces inwards. radius [m]."""
    angles = 2 * np.pi * np.arange(around) / around
    slopes = np.linspace(0.0, 0.5 * np.pi * SHARE, rings + 1)[1:]
    points = [[0.0, 0.0, -radius]]
    points += [
        [radius * np.sin(s) * np.cos(a), radius * np.sin(s) * np.sin(a), -radius * np.cos(s)]
        for s in slopes
        for a in angles
    ]
    ring = 1 + np.arange(rings * around).reshape(rings, around)
    inner, outer, after = ring[:-1], ring[1:], np.roll(ring, -1, axis=1)
    triangles = [np.stack([np.zeros(around, int), ring[0], after[0]], axis=-1)]
    triangles += [np.stack([inner, outer, after[1:]], axis=-1).reshape(-1, 3)]
    triangles += [np.stack([inner, after[1:], after[:-1]], axis=-1).reshape(-1, 3)]
    return TriangleMesh(np.array(points), np.concatenate(triangles).astype(np.int32))


def strands(count: int) -> list[NDArray[np.float64]]:
    """The noodles upright on a square grid, each a little wavy in its own direction, [SEGMENTS + 1, 3] each."""
    random = np.random.default_rng(1)
    height = np.linspace(0.0, LENGTH, SEGMENTS + 1)
    middle = 0.5 * (count - 1)
    found = []
    for i in range(count):
        for j in range(count):
            direction = random.uniform(0.0, 2 * np.pi)
            wave = WAVE * np.sin(np.pi * height / LENGTH)
            x = (i - middle) * SPACING + wave * np.cos(direction)
            y = (j - middle) * SPACING + wave * np.sin(direction)
            found.append(np.stack([x, y, height + random.uniform(0.0, 0.02) - 0.5 * bowl_radius(count)], axis=1))
    return found


def build(options: Options) -> Simulation:
    """The noodles above the bowl, whose lowest point is on the ground."""
    scene = PROGRAM.scene(options)
    radius = bowl_radius(options.size)
    noodles = Rod(scene, "noodles", strands(options.size), radius=RADIUS, density=DENSITY, youngs_modulus=STIFFNESS)
    return Simulation(
        scene,
        [noodles, Obstacle(scene, "bowl", bowl(radius)), HalfSpace(scene, "ground", height=-radius - DISTANCE)],
        time_step=options.dt,
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=options.friction),
        eps_v=SLIP_SPEED,
    )


def check(simulation: Simulation, options: Options) -> str:
    """All noodles are in the bowl, hardly stretched, and the bowl carries them."""
    if simulation.time < FALLEN:
        raise CheckFailedError(
            f"the noodles are down in the bowl after {FALLEN} s; the run ended at {simulation.time:.2f} s"
        )
    noodles = simulation.moving[0]
    x, radius = noodles.positions(), bowl_radius(options.size)
    outside = float(np.linalg.norm(x, axis=1).max())
    if not outside < radius:
        raise CheckFailedError(
            f"a noodle is {outside:.3f} m from the middle of the bowl, whose radius is {radius:.3f} m"
        )
    first, second = x[noodles.edges].transpose(1, 0, 2)
    rest = np.linalg.norm(np.diff(noodles.rest[noodles.edges], axis=1)[:, 0], axis=1)
    stretch = float(np.abs(np.linalg.norm(second - first, axis=1) / rest - 1).max())
    if not stretch < 0.05:
        raise CheckFailedError(f"a segment of a noodle is stretched or shortened by {100 * stretch:.1f} %")
    forces = simulation.contact_forces()
    on_bowl = -float(forces.on_bodies()[forces.number_of("bowl"), 2])
    weight = 9.8 * float(noodles.mass.value.sum())
    terms = simulation.forces_by_term()
    needed = -sum(
        float(terms[f"noodles.vertices.{name}"]["noodles.vertices.position"][:, 2].sum())
        for name in ("gravity", "inertia")
    )
    if not abs(on_bowl - needed) < 0.01 * weight:
        raise CheckFailedError(f"the bowl carries {on_bowl:.4f} N, the noodles' m (g + a) is {needed:.4f} N")
    return (
        f"{options.size**2} noodles lie in the bowl, up to {1e3 * (x[:, 2].max() + radius):.0f} mm high, stretched by"
        f" at most {100 * stretch:.2f} %; the bowl carries {on_bowl:.4f} N, they weigh {weight:.4f} N"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run noodles`."""
    return PROGRAM.run(
        arguments, build, check, view_direction=(0.3, -1.0, 1.2), colors={"noodles": "#f2b134", "bowl": "#5c7fa8"}
    )


if __name__ == "__main__":
    sys.exit(main())
