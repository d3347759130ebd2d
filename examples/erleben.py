"""Ten degenerate contacts side by side: spikes on spikes, wedges in cracks, cubes along cliffs and over internal edges.

After Erleben 2018, "Methodology for assessing mesh-based contact point methods". Points meet points and edges meet
edges in exact alignment, where methods that look for normals or penetration depths fail. `--case cliff_edges` runs one
alone. Nothing crosses, no energy comes from nowhere, and without friction what slides over internal edges goes on
straight.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import numpy as np

from yasps.bodies import AffineBody, Body, HalfSpace, Obstacle, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import TetrahedralMesh, TriangleMesh, box, ground
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

SIZE = 0.1  # m, of a cube, and height of spikes and wedges
SHARP = 0.02  # m, half the width of a spike or a wedge at its base
DISTANCE = 1e-3  # m, of activation
GAP = 0.98 * DISTANCE  # between surfaces at the start
SPEED = 0.5  # m/s: of what falls, downwards; of what slides, along y
SLIP_SPEED = 1e-3  # m/s
START = -1.5 * SIZE  # m, along y, of what slides
APART, ROWS_APART, IN_A_ROW = 0.25, 0.45, 5  # m, m: cases stand in two rows
GRAVITY = 9.8  # m/s^2

Things = tuple[TetrahedralMesh, list[TriangleMesh]]
"""What moves, and what stands still."""


def spike() -> TetrahedralMesh:
    """A thin tetrahedron, its tip down at the origin."""
    angles = 2 * np.pi * np.arange(3) / 3
    base = np.column_stack([SHARP * np.cos(angles), SHARP * np.sin(angles), np.full(3, SIZE)])
    return TetrahedralMesh(np.vstack([np.zeros(3), base]), np.array([[0, 1, 2, 3]], np.int32))


def wedge() -> TetrahedralMesh:
    """A prism, its sharp edge along y down at the origin."""
    profile = [(0.0, 0.0), (SHARP, SIZE), (-SHARP, SIZE)]
    points = np.array([[x, y, z] for y in (-SIZE / 2, SIZE / 2) for x, z in profile])
    return TetrahedralMesh(
        points, np.array([[0, 1, 2, 5], [0, 1, 5, 4], [0, 4, 5, 3]])[:, [0, 2, 1, 3]].astype(np.int32)
    )


def cube() -> TetrahedralMesh:
    """Standing on the origin."""
    return box((SIZE,) * 3, (1, 1, 1)).translated((0.0, 0.0, SIZE / 2))


def upside_down(shape: TetrahedralMesh) -> TetrahedralMesh:
    """Tip or edge up."""
    return shape.rotated((0.0, 1.0, 0.0), np.pi)


def across(shape: TetrahedralMesh) -> TetrahedralMesh:
    """Turned by a quarter."""
    return shape.rotated((0.0, 0.0, 1.0), np.pi / 2)


def still(*shapes: TetrahedralMesh) -> list[TriangleMesh]:
    """Their surfaces."""
    return [TriangleMesh(shape.vertices, shape.surface_triangles()) for shape in shapes]


def crack() -> list[TriangleMesh]:
    """Two cubes with a narrow gap along y between them, level at z = 0."""
    way = 0.5 * (SIZE + SHARP)
    return still(cube().translated((-way, 0.0, -SIZE)), cube().translated((way, 0.0, -SIZE)))


def hole() -> list[TriangleMesh]:
    """A pit of four slopes that meet in a point below the origin."""
    rim = np.array([[x, y, 0.0] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]) * [2 * SHARP, 2 * SHARP, 1.0]
    points = np.vstack([[0.0, 0.0, -SIZE], rim])
    return [TriangleMesh(points, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]], np.int32))]


def lying(shape: TetrahedralMesh, half_width: float) -> TetrahedralMesh:
    """On the face whose far end is half_width off the middle, at the start of the floor, sharp end first."""
    turned = across(shape).rotated((1.0, 0.0, 0.0), np.pi / 2 - np.arctan2(half_width, SIZE))
    return turned.translated((0.0, START, -turned.vertices[:, 2].min()))


def floor() -> list[TriangleMesh]:
    """Level, and cut into so many triangles that edges lie across the way."""
    return [ground((1.5 * SIZE, 6 * SIZE), 0.0, (3, 12))]


FALLING: dict[str, Callable[[], Things]] = {
    "spikes": lambda: (spike(), still(upside_down(spike()))),
    "spike_wedge": lambda: (spike(), still(upside_down(wedge()))),
    "wedges": lambda: (across(wedge()), still(upside_down(wedge()))),
    "spike_hole": lambda: (spike(), hole()),
    "spike_crack": lambda: (spike(), crack()),
    "wedge_crack": lambda: (wedge(), crack()),
    "cliff_edges": lambda: (cube(), still(cube().translated((0.0, 0.0, -SIZE)))),
}
SLIDING: dict[str, Callable[[], Things]] = {
    "sliding_spike": lambda: (lying(spike(), SHARP / 2), floor()),
    "sliding_wedge": lambda: (lying(wedge(), SHARP), floor()),
    "internal_edges": lambda: (cube().translated((0.0, START, 0.0)), floor()),
}
CASES = FALLING | SLIDING

PROGRAM = SceneProgram("erleben", __doc__, frames=50, time_step=0.01)
PROGRAM.add_argument("--case", choices=["all", *CASES], default="all", help="which one (default all, side by side)")
PROGRAM.add_argument("--friction", type=float, default=0.0, help="coefficient everywhere (default 0)")
PROGRAM.add_argument("--soft", action="store_true", help="soft bodies instead of stiff ones")


def joined(shapes: list[TriangleMesh]) -> TriangleMesh:
    """Several surfaces as one."""
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes[:-1])])
    return TriangleMesh(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.triangles + start for shape, start in zip(shapes, starts, strict=True)]).astype(np.int32),
    )


def build(options: Options) -> Simulation:
    """The cases in two rows, and a ground below all of them."""
    names = list(CASES) if options.case == "all" else [options.case]
    scene = PROGRAM.scene(options)
    bodies: list[AffineBody | SoftBody] = []
    obstacles: list[Obstacle] = []
    velocities: dict[Body, tuple[float, float, float]] = {}
    for number, name in enumerate(names):
        shape, around = CASES[name]()
        row, column = divmod(number, IN_A_ROW)
        place = np.array([(column - 0.5 * (min(len(names), IN_A_ROW) - 1)) * APART, row * ROWS_APART, 0.0])
        moved = shape.translated(place + np.array([0.0, 0.0, GAP]))
        if options.soft:
            body: AffineBody | SoftBody = SoftBody(scene, name, moved, youngs_modulus=1e6)
        else:
            body = AffineBody(scene, name, moved, youngs_modulus=1e8)
        bodies.append(body)
        velocities[body] = (0.0, 0.0, -SPEED) if name in FALLING else (0.0, SPEED, 0.0)
        surface = joined(around)
        obstacles.append(Obstacle(scene, f"below_{name}", TriangleMesh(surface.vertices + place, surface.triangles)))
    return Simulation(
        scene,
        [*bodies, *obstacles, HalfSpace(scene, "ground", height=-SIZE - DISTANCE)],
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
    """No energy was gained, and without friction what slides has its speed and its height."""
    bodies = simulation.moving
    if options.frames == 0:
        raise CheckFailedError("nothing has moved in 0 frames")
    masses = [np.asarray(body.mass.value) for body in bodies]
    starts = [body.rest for body in bodies]
    begin = sum(
        float(m.sum()) * 0.5 * SPEED**2 + GRAVITY * float(m @ x[:, 2]) for m, x in zip(masses, starts, strict=True)
    )
    energies = simulation.report().energies  # what is elastic comes out of these
    end = sum(energies[kind] for kind in ("kinetic", "gravity", "contact"))
    if not end < begin + 1e-6 * abs(begin):
        raise CheckFailedError(f"the energy grew from {begin:.6f} J to {end:.6f} J")
    told = f"energy fell from {begin:.4f} to {end:.4f} J"
    sliding = [(body, m) for body, m in zip(bodies, masses, strict=True) if body.name in SLIDING]
    if options.friction > 0 or not sliding:
        return f"{told}; nothing crosses after {simulation.time:.2f} s"
    worst = 0.0
    for body, mass in sliding:
        velocity = mass @ simulation.velocity_of(body) / mass.sum()
        worst = max(worst, float(np.abs(velocity - [0.0, SPEED, 0.0]).max()))
        if not worst < 0.01 * SPEED:
            raise CheckFailedError(
                f"{body.name} slides at {velocity.round(4).tolist()} m/s over internal edges; it began with {SPEED} m/s"
                " along y"
            )
    return (
        f"{told}; after {simulation.time:.2f} s what slides over internal edges has its velocity within"
        f" {100 * worst / SPEED:.2g} %"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run erleben`."""
    return PROGRAM.run(arguments, build, check, view_direction=(0.35, -1.0, 0.6))


if __name__ == "__main__":
    sys.exit(main())
