"""A cloth falls on a ball, and gets a finer mesh wherever it bends.

Every few frames each triangle that is bent against a neighbour by more than `--angle` is cut through its longest edge,
down to `--finest`: new vertices lie in the middle of old edges, and move as those do. Mass and momentum stay what they
were, nothing crosses that did not cross before, and nothing is compiled.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps.bodies import Cloth, Obstacle
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, cloth_grid, edges_of, hinge_angles, hinges_of, sphere, split_edges
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import RemeshReport, Simulation

SIDE = 0.4  # m, of the cloth
RADIUS = 0.1  # m, of the ball, whose middle is the origin
GAP = 6e-3  # m, from the ball to the cloth at the start
DISTANCE = 2e-3  # m, of activation
STRETCH, SHEAR, BENDING = 500.0, 50.0, 1e-5  # J/m^2, J/m^2, J
FRICTION = 0.3
EVERY = 4
"""Frames from one look at the mesh to the next."""
ROUNDING = 1e-10
"""Relative change of mass and momentum by all meshes together that is none."""

PROGRAM = SceneProgram(
    "refined_cloth", __doc__, frames=60, time_step=0.01, size=10, size_means="cells along each side at the start"
)
PROGRAM.add_argument("--angle", type=float, default=15.0, help="most between two triangles, in degrees (15)")
PROGRAM.add_argument("--finest", type=float, default=0.012, help="shortest edge that is cut, in metres (0.012)")


class Refiner:
    """Looks at the mesh of a cloth after steps, and cuts triangles that are bent.

    angle [rad], finest [m]: as the flags say. reports: of all meshes so far; start: vertices of the first.
    """

    def __init__(self, cloth: Cloth, angle: float, finest: float) -> None:
        self.cloth, self.angle, self.finest = cloth, angle, finest
        self.start = len(cloth.rest)
        self.reports: list[RemeshReport] = []

    def __call__(self, simulation: Simulation) -> None:
        """After a step."""
        if simulation.frame % EVERY == 0 and (marked := self.marked()).any():
            finer = split_edges(TriangleMesh(self.cloth.rest, self.cloth.triangles), marked)
            self.reports.append(simulation.remesh(self.cloth, *finer))

    def marked(self) -> NDArray[np.bool_]:
        """Of all edges (`edges_of`), the longest ones of triangles that are bent, unless they are short already."""
        edges, sides = edges_of(self.cloth.triangles)
        hinges = hinges_of(self.cloth.triangles)
        bent = np.sort(hinges[hinge_angles(self.cloth.positions(), hinges) > self.angle, :2], axis=1).astype(np.int64)
        numbers = edges.astype(np.int64) @ [len(self.cloth.rest), 1]
        is_bent = np.isin(numbers, bent @ [len(self.cloth.rest), 1])
        ends = self.cloth.rest[edges]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        longest = np.take_along_axis(sides, length[sides].argmax(axis=1)[:, None], axis=1)[:, 0]
        marked = np.zeros(len(edges), np.bool_)
        marked[longest[is_bent[sides].any(axis=1)]] = True
        return np.asarray(marked & (length > self.finest))


def build(options: Options) -> Simulation:
    """The cloth above the ball."""
    scene = PROGRAM.scene(options)
    shape = cloth_grid((SIDE, SIDE), (options.size, options.size), RADIUS + GAP)
    cloth = Cloth(scene, "cloth", shape, stretch=STRETCH, shear=SHEAR, bending=BENDING, refinable=True)
    solid = sphere(RADIUS, 1000)
    used, triangles = np.unique(solid.surface_triangles(), return_inverse=True)
    ball = Obstacle(scene, "ball", TriangleMesh(solid.vertices[used], triangles.reshape(-1, 3).astype(np.int32)))
    simulation = Simulation(
        scene,
        [cloth, ball],
        time_step=options.dt,
        activation_distance=DISTANCE,
        contacts=ContactTable(FRICTION),
    )
    simulation.after_step.append(Refiner(cloth, np.radians(options.angle), options.finest))
    return simulation


def check(simulation: Simulation, options: Options) -> str:
    """The mesh got finer, and neither mass nor momentum was lost by it."""
    (refiner,) = (one for one in simulation.after_step if isinstance(one, Refiner))
    cloth, reports = refiner.cloth, refiner.reports
    if not reports:
        raise CheckFailedError(f"after {simulation.time:.2f} s nothing of the cloth is bent by {options.angle} degrees")
    mass = abs(reports[-1].after.mass - reports[0].before.mass) / reports[0].before.mass
    jumps = [float(np.linalg.norm(report.after.momentum - report.before.momentum)) for report in reports]
    momentum = sum(jumps) / max(float(np.linalg.norm(report.before.momentum)) for report in reports)
    if max(mass, momentum) > ROUNDING:
        raise CheckFailedError(f"{len(reports)} meshes changed mass by {mass:.1e} and momentum by {momentum:.1e}")
    lost = sum(report.before.kinetic - report.after.kinetic for report in reports)
    return (
        f"{len(reports)} meshes, from {refiner.start} to {len(cloth.rest)} vertices; mass and momentum stayed to"
        f" {max(mass, momentum):.0e}, {1e3 * lost:.2g} mJ of kinetic energy were lost to them"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run refined_cloth`; 1 if the check fails."""
    return PROGRAM.run(arguments, build, check, view_direction=(1.0, -0.6, 0.45))


if __name__ == "__main__":
    sys.exit(main())
