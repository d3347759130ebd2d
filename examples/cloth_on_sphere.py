"""A cloth falls on a sphere, the sphere begins to turn, and friction takes the cloth along and folds it.

The cloth is cotton, 0.5 m wide and 1 mm thick: soft up to a stretch of 10 %, stiff beyond
(`materials.strain_limiting`, added to the body). Its corners lie on the ground and lag behind.
`--turning 0 --friction 0 --size 100` is a scene that simulators are often compared by: 10,201 vertices that fall on a
sphere at rest.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from yasps import materials
from yasps.bodies import Cloth, HalfSpace, MovingObstacle
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, cloth_grid, sphere
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

SIDE, THICKNESS = 0.5, 1e-3  # m, of the cloth
RADIUS, CENTRE = 0.12, 0.125  # m: of the sphere, and its middle above the ground
GAP = 0.01  # m, from the sphere to the cloth at the start
DISTANCE = 5e-4  # m, of activation
AREA_DENSITY = 0.2  # kg/m^2
STRETCH, SHEAR, BENDING = 2.5, 1.0, 1e-6  # J/m^2, J/m^2, J: Young's modulus of 5000 Pa times the thickness
LIMIT, LIMIT_STIFFNESS = 0.1, 1e6  # Green strain and Pa: beyond that strain the threads are taut
BEGINS, REACHES = 0.6, 1.0  # s: the sphere begins to turn, turns at full speed
SLIP_SPEED = 5e-3  # m/s
HOLDS = 0.3  # from this coefficient of friction on the sphere takes the cloth along

PROGRAM = SceneProgram(
    "cloth_on_sphere", __doc__, frames=250, time_step=0.01, size=32, size_means="cells along each side of the cloth"
)
PROGRAM.add_argument("--friction", type=float, default=0.4, help="coefficient everywhere (default 0.4)")
PROGRAM.add_argument(
    "--turning", type=float, default=180.0, help="speed of the sphere in degrees a second (default 180)"
)


def angle_of_sphere(time: float, turning: float) -> float:
    """By how much the sphere has turned [rad]; its speed grows evenly from `BEGINS` to `REACHES`."""
    speeding_up = REACHES - BEGINS
    t = max(time - BEGINS, 0.0)
    seconds = 0.5 * t**2 / speeding_up if t < speeding_up else t - 0.5 * speeding_up
    return float(np.radians(turning) * seconds)


def build(options: Options) -> Simulation:
    """The cloth above the sphere, and the ground at z = 0."""
    scene = PROGRAM.scene(options)
    shape = cloth_grid((SIDE, SIDE), (options.size, options.size), CENTRE + RADIUS + GAP)
    cloth = Cloth(
        scene,
        "cloth",
        shape,
        area_density=AREA_DENSITY,
        stretch=STRETCH,
        shear=SHEAR,
        bending=BENDING,
        radius=0.5 * THICKNESS,
    )
    elements = cloth.triangle_elements
    limit = materials.strain_limiting(
        elements["deformation_gradient"], LIMIT, LIMIT_STIFFNESS, elements["rest_area"], THICKNESS
    )
    cloth.add_energy(elements.add_attribute("strain_limit", computed_attribute=limit))

    solid = sphere(RADIUS, 4000)
    used, triangles = np.unique(solid.surface_triangles(), return_inverse=True)
    ball = solid.vertices[used]

    def motion(time: float) -> NDArray[np.float64]:
        turn = Rotation.from_rotvec([0.0, 0.0, angle_of_sphere(time, options.turning)])
        return np.asarray(turn.apply(ball) + np.array([0.0, 0.0, CENTRE]))

    below = MovingObstacle(
        scene, "sphere", TriangleMesh(motion(0.0), triangles.reshape(-1, 3).astype(np.int32)), motion=motion
    )
    return Simulation(
        scene,
        [cloth, below, HalfSpace(scene, "ground")],
        time_step=options.dt,
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=options.friction),
        eps_v=SLIP_SPEED,
    )


def turned(simulation: Simulation) -> float:
    """By how much the cloth on top of the sphere has turned [rad], in (-pi, pi]."""
    cloth = simulation.moving[0]
    start, now = cloth.rest[:, :2], cloth.positions()[:, :2]
    on_top = np.linalg.norm(start, axis=1) < 0.5 * RADIUS
    start, now = start[on_top], now[on_top] - now[on_top].mean(axis=0)
    return float(np.arctan2((start[:, 0] * now[:, 1] - start[:, 1] * now[:, 0]).sum(), (start * now).sum()))


def check(simulation: Simulation, options: Options) -> str:
    """The cloth lies on the sphere, hardly stretched beyond the limit, and goes along with it if there is friction."""
    (cloth,) = (body for body in simulation.moving if isinstance(body, Cloth))
    if simulation.time < BEGINS:
        raise CheckFailedError(
            f"the cloth has come to lie on the sphere at {BEGINS} s; the run ended at {simulation.time:.2f} s"
        )
    x = cloth.positions()
    depth = float((RADIUS - np.linalg.norm(x - [0.0, 0.0, CENTRE], axis=1)).max())
    if depth > 0:
        raise CheckFailedError(f"the cloth is inside the sphere, {depth:.1e} m deep")
    middle = float(np.linalg.norm(x[len(x) // 2, :2]))
    if not (x[:, 2].max() > CENTRE + 0.9 * RADIUS and middle < 0.5 * RADIUS):
        raise CheckFailedError(f"the cloth slipped off the sphere: its middle is {middle:.3f} m from the axis")
    gradient = cloth.mesh.triangles["deformation_gradient"].compute().array.reshape(-1, 3, 2)
    strain = 0.5 * float(np.linalg.svd(gradient, compute_uv=False).max() ** 2 - 1)
    if not strain < 2 * LIMIT:
        raise CheckFailedError(f"the cloth is strained by {strain:.3f}; threads are taut from {LIMIT} on")
    of_sphere, of_cloth = angle_of_sphere(simulation.time, options.turning), turned(simulation)
    lag = abs((of_sphere - of_cloth + np.pi) % (2 * np.pi) - np.pi)
    if options.friction >= HOLDS and lag > np.radians(30.0):
        raise CheckFailedError(
            f"the cloth is {np.degrees(lag):.0f} degrees behind the sphere, friction {options.friction}"
        )
    if options.friction == 0.0 and abs(of_cloth) > np.radians(10.0):
        raise CheckFailedError(f"the cloth has turned by {np.degrees(of_cloth):.0f} degrees without friction")
    return (
        f"the sphere has turned by {np.degrees(of_sphere):.0f} degrees, the cloth on it is {np.degrees(lag):.1f} off;"
        f" largest strain {strain:.3f}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run cloth_on_sphere`."""
    return PROGRAM.run(
        arguments, build, check, view_direction=(0.35, -1.0, 0.4), colors={"cloth": "#c2185b", "sphere": "#f2b134"}
    )


if __name__ == "__main__":
    sys.exit(main())
