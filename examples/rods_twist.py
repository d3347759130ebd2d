"""Four soft bars are twisted at both ends, at first each by itself and then around each other.

Both ends of each bar are pinned, and the pins turn about the common axis, in opposite directions: they are exactly
where they shall be at the end of each step. No tetrahedron turns inside out, and the bars press on each other without
crossing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from yasps.bodies import SoftBody
from yasps.meshes import box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

LENGTH, SIDE = 0.4, 0.03  # m, of a bar
SPACING = 0.04  # m, between the middles of neighbours
STIFFNESS, DENSITY = 1e4, 1000.0  # Pa, kg/m^3
RATE = np.radians(72.0)  # rad/s, of each end
DISTANCE = 5e-4  # m, of activation
TOUCHES = np.radians(120.0)  # by each end: from then on the bars press on each other

PROGRAM = SceneProgram(
    "rods_twist",
    __doc__,
    frames=200,
    time_step=0.025,
    size=2,
    size_means="cells along the sides of a bar's cross-section",
)


def turning(start: NDArray[np.float64], rate: float) -> Callable[[float], NDArray[np.float64]]:
    """Places at a time [s] of points that turn about the x axis; rate [rad/s]."""
    return lambda time: np.asarray(Rotation.from_rotvec([rate * time, 0.0, 0.0]).apply(start))


def build(options: Options) -> Simulation:
    """Four bars along x around the axis, without gravity."""
    scene = PROGRAM.scene(options)
    along = round(options.size * LENGTH / SIDE)
    shape = box((LENGTH, SIDE, SIDE), (along, options.size, options.size))
    bars = [
        SoftBody(
            scene,
            f"bar_{number}",
            shape.translated((0.0, y * SPACING / 2, z * SPACING / 2)),
            density=DENSITY,
            youngs_modulus=STIFFNESS,
        )
        for number, (y, z) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1)))
    ]
    simulation = Simulation(scene, bars, time_step=options.dt, gravity=(0.0, 0.0, 0.0), activation_distance=DISTANCE)
    for bar in bars:
        for end in (-1.0, 1.0):
            held = held_vertices(bar, end)
            simulation.pin(bar, held, motion=turning(bar.rest[held], end * RATE))
    return simulation


def held_vertices(bar: SoftBody, end: float) -> NDArray[np.int64]:
    """Those of the face at the left end (-1) or at the right one (1)."""
    return np.flatnonzero(np.abs(bar.rest[:, 0] - end * LENGTH / 2) < 1e-9)


def check(simulation: Simulation, options: Options) -> str:
    """The ends are where they shall be, nothing is inside out, and after a while all bars press on others."""
    bars = [body for body in simulation.moving if isinstance(body, SoftBody)]
    angle = RATE * simulation.time
    volumes = []
    for bar in bars:
        for end in (-1.0, 1.0):
            held = held_vertices(bar, end)
            off = float(np.abs(bar.positions()[held] - turning(bar.rest[held], end * RATE)(simulation.time)).max())
            if not off < 1e-9:
                raise CheckFailedError(f"the pinned end of {bar.name} is {off:.1e} m from where it shall be")
        volumes.append(np.linalg.det(bar.tets["deformation_gradient"].compute().array.reshape(-1, 3, 3)))
    least = float(np.min(volumes))
    if not least > 0:
        raise CheckFailedError(f"a tetrahedron has turned inside out: its volume is {least:.2f} of that at rest")
    told = (
        f"each end has turned by {np.degrees(angle):.0f} degrees; the least volume of a tetrahedron is {least:.2f} of"
        " that at rest"
    )
    if angle < TOUCHES:
        return told
    forces = simulation.contact_forces()
    pressing = np.linalg.norm(forces.between_bodies(), axis=2).max(axis=1)
    if not pressing.min() > 0:
        raise CheckFailedError(
            f"{forces.names[int(pressing.argmin())]} touches no other bar at {np.degrees(angle):.0f} degrees"
        )
    return (
        f"{told}; every bar presses on another with at least {pressing.min():.3f} N, in {len(forces.normal)} contacts"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run rods_twist`."""
    return PROGRAM.run(arguments, build, check)


if __name__ == "__main__":
    sys.exit(main())
