"""A beam that is straight when it sags: the shape at rest that its weight bends into a given one.

The beam is held at one end. Its elastic energy reads the positions at rest as an attribute, so that derivatives by
them are the compiler's; found is where each vertex has to be at rest, by Gauss-Newton steps through the equilibrium.
Then the beam is put there, is let go, and sags into the straight shape.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps import concat_rows, materials
from yasps.bodies import SoftBody
from yasps.inverse import PRECISE, Constant, Squares, Trajectory, fit, scaled
from yasps.meshes import TetrahedralMesh, box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

LENGTH, THICKNESS = 0.4, 0.08  # m
DENSITY, YOUNGS_MODULUS, POISSON_RATIO = 1000.0, 2e5, 0.4  # kg/m^3, Pa
FOREVER = 1e3  # s: a time step of this length ends in equilibrium
WITHIN = 1e-3  # of the sag: how near to the given shape the beam must come
STILL = 1e-3  # of the beam's length a second: slower than this, it has come to rest

PROGRAM = SceneProgram(
    "shape_of_rest", __doc__, frames=60, time_step=0.1, size=8, size_means="cells along the beam, at least 2"
)


def straight(options: Options) -> TetrahedralMesh:
    """The given shape."""
    across = max(1, round(options.size * THICKNESS / LENGTH))
    return box((LENGTH, THICKNESS, THICKNESS), (options.size, across, across))


def held(shape: TetrahedralMesh) -> NDArray[np.int64]:
    """The vertices of the left end."""
    x = shape.vertices[:, 0]
    return np.flatnonzero(x < x.min() + 1e-9)


def beam(options: Options, rest: NDArray[np.float64], start: NDArray[np.float64], time_step: float) -> Simulation:
    """The beam with its left end held, at the start [n, 3]; rest: positions at rest [n, 3]."""
    scene, shape = PROGRAM.scene(options), straight(options)
    body = SoftBody(scene, "beam", shape, density=DENSITY, youngs_modulus=YOUNGS_MODULUS, poisson_ratio=POISSON_RATIO)
    # The body's own energy has numbers made of the shape at rest; this one is of the attribute itself.
    scene.remove_energy(body.energies.pop())
    tets, at_rest = body.tets, body.vertices["rest_position"]
    a, b, c, d = tets.add_attribute("rest_positions", through=tets.corners, source=at_rest)
    edges = concat_rows([b - a, c - a, d - a]).T
    f = materials.deformation_gradient(tets["positions"], edges.inverse())
    elastic = materials.stable_neo_hookean(f, body.mu, body.lam, edges.det() / 6)
    body.add_energy(tets.add_attribute("elastic_of_rest", computed_attribute=elastic))
    at_rest.update_value(rest)
    body.position.update_value(start)
    simulation = Simulation(scene, [body], time_step=time_step, contact=False, settings=PRECISE)
    simulation.pin(body, held(shape))
    return simulation


class ShapeOfRest:
    """Finds the shape at rest. sag, left: the farthest that a vertex of a beam made straight is from the given shape,
    and of the one that was found [m]."""

    def __init__(self) -> None:
        self.sag = self.left = np.nan

    def build(self, options: Options) -> Simulation:
        """The beam in the shape that was found."""
        goal = straight(options).vertices
        simulation = beam(options, goal, goal, FOREVER)
        (body,) = simulation.moving
        place = body.vertices.add_constant("goal", 3, 1, value=goal)
        away = body.vertices.add_attribute("away", computed_attribute=body.position - place)
        trajectory = Trajectory(simulation, 1)
        trajectory.run()
        self.sag = float(np.linalg.norm(away.value.reshape(-1, 3), axis=1).max())
        rest = Constant(body.vertices["rest_position"])
        fit(
            trajectory,
            Squares(away, weight=1 / self.sag**2),
            rest,
            method="trust-ncg",
            transforms={rest: scaled(self.sag)},
            max_iterations=30,
            options={"gtol": 1e-6, "initial_trust_radius": 10.0, "max_trust_radius": 1e3},
        )
        found = rest.value(trajectory).reshape(-1, 3)
        start, end = found.copy(), held(straight(options))
        start[end] = goal[end]
        return beam(options, found, start, options.dt)

    def check(self, simulation: Simulation, options: Options) -> str:
        """The beam hangs still, in the given shape."""
        (body,) = simulation.moving
        speed = float(np.abs(simulation.velocity_of(body)).max())
        if speed > STILL * LENGTH:
            raise CheckFailedError(f"the beam still moves at {speed:.2g} m/s after {simulation.time:.2f} s")
        self.left = float(np.linalg.norm(body.positions() - straight(options).vertices, axis=1).max())
        if self.left > WITHIN * self.sag:
            raise CheckFailedError(f"the beam is {self.left:.2g} m off; made straight, it sags by {self.sag:.3f} m")
        return (
            f"a beam that is straight at rest sags by {1e3 * self.sag:.1f} mm; this one is {1e3 * self.left:.2g} mm off"
            " the straight shape"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run shape_of_rest`; 1 if the beam sags into another shape."""
    program = ShapeOfRest()
    return PROGRAM.run(arguments, program.build, program.check)


if __name__ == "__main__":
    sys.exit(main())
