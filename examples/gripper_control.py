"""Two fingers carry a soft block along a given path, and the path of the fingers is what is found.

The fingers close on the block, which hangs between them by friction, gives way and lags behind. Where they have to be
at a few times, so that the block's middle is where it shall be at all times, comes from Gauss-Newton steps with exact
derivatives through the whole motion: fingers, contact, friction and the soft block. At first the fingers hold the block
where it is.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import FloatArray
from yasps.bodies import HalfSpace, MovingObstacle, SoftBody
from yasps.contact import ContactTable
from yasps.inverse import PRECISE, MotionOf, Parameter, PerStep, Squares, Trajectory, fit, scaled
from yasps.meshes import TriangleMesh, box
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

SIDE, STIFFNESS = 0.06, 5e4  # m, Pa: of the block
FINGER = (0.015, 0.04, 0.04)  # m: thickness, width, height
OPEN, SQUEEZE = 5e-3, 4e-3  # m: how far each finger is off at the start, how far it presses in
ACTIVATION = 1e-3  # m
FRICTION = 0.8
CLOSED = 0.2  # s: the fingers have closed
WAY = (0.08, 0.0, 0.1)  # m: from where the block lies to where it shall be at the end
KEYS = 4
"""Times at which the fingers have places of their own, evenly from when they have closed to the end."""
WITHIN = 0.05
"""Of the error at first: how small the root mean square distance to the path must get."""

PROGRAM = SceneProgram(
    "gripper_control", __doc__, frames=40, time_step=0.02, size=2, size_means="cells along each side of the block"
)
PROGRAM.add_argument("--iterations", type=int, default=8, help="Gauss-Newton steps at most (8)")


def smooth(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """From 0 at share 0 to 1 at share 1, at rest at both."""
    t = np.clip(share, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def rows_of(options: Options) -> NDArray[np.float64]:
    """Times of the rows of motions [s]."""
    return np.asarray(options.dt * np.arange(options.frames + 1), np.float64)


class FingerPath(Parameter):
    """Where both fingers are at the key times, beyond their closing: [keys, 2], along x and up [m]; in between they go
    straight."""

    def __init__(self, fingers: Sequence[MovingObstacle], times: NDArray[np.float64], end: float) -> None:
        """times [s]: of the rows of the fingers' motions."""
        self.name = "the path of the fingers"
        self.motions = [MotionOf(finger) for finger in fingers]
        self.closing = [np.array(finger.motion, np.float64) for finger in fingers]
        self.keys = np.zeros((KEYS, 2))
        at = np.linspace(CLOSED, end, KEYS + 1)
        self.shares = np.stack([np.interp(times, at, unit) for unit in np.eye(KEYS + 1)[1:]], axis=1)
        """How much of each key the fingers have gone at each row, [rows, keys]."""

    def _ways(self, keys: FloatArray) -> FloatArray:
        """Of all rows and directions, [rows, 1, 3, ...], for keys [keys, 2, ...]."""
        moved = np.tensordot(self.shares, keys, axes=1)
        return np.stack([moved[:, 0], np.zeros_like(moved[:, 0]), moved[:, 1]], axis=1)[:, None]

    def value(self, trajectory: Trajectory) -> FloatArray:
        """[keys, 2]."""
        return self.keys.copy()

    def set(self, trajectory: Trajectory, values: ArrayLike) -> None:
        """Gives the fingers their motions."""
        self.keys = self.checked(trajectory, values)
        for motion, closing in zip(self.motions, self.closing, strict=True):
            motion.set(trajectory, closing + self._ways(self.keys))

    def prepare(self, inputs: Any, trajectory: Trajectory) -> None:
        """That of the motions."""
        for motion in self.motions:
            motion.prepare(inputs, trajectory)

    def gradient(self, inputs: Any, trajectory: Trajectory) -> FloatArray:
        """[keys, 2]."""
        of_rows = sum(motion.gradient(inputs, trajectory).sum(axis=1) for motion in self.motions)
        return np.asarray(self.shares.T @ np.asarray(of_rows)[:, [0, 2]])

    def spread(self, inputs: Any, trajectory: Trajectory, columns: FloatArray) -> None:
        """To all vertices of both fingers."""
        ways = self._ways(columns.reshape(KEYS, 2, -1))
        for motion, closing in zip(self.motions, self.closing, strict=True):
            table = np.broadcast_to(ways, (*closing.shape, columns.shape[1]))
            motion.spread(inputs, trajectory, table.reshape(-1, columns.shape[1]))


class GripperControl:
    """Finds the path of the fingers. before, after: root mean square distance of the block's middle to its path after
    the fingers have closed [m]."""

    def __init__(self) -> None:
        self.before = self.after = np.nan
        self.places: NDArray[np.float64] = np.empty((0, 3))
        self.distances: list[float] = []

    def scene(self, options: Options) -> tuple[Simulation, list[MovingObstacle]]:
        """The block on the ground at z = 0 between two open fingers, which will close and hold it."""
        scene = PROGRAM.scene(options)
        block = box((SIDE, SIDE, SIDE), (options.size,) * 3).translated((0.0, 0.0, 0.5 * SIDE + 0.98 * ACTIVATION))
        body = SoftBody(scene, "block", block, density=500.0, youngs_modulus=STIFFNESS)
        rows = rows_of(options)
        fingers = []
        for name, side in (("left_finger", -1.0), ("right_finger", 1.0)):
            start = box(FINGER, (1, 1, 1)).translated((side * (0.5 * SIDE + OPEN + 0.5 * FINGER[0]), 0.0, 0.5 * SIDE))
            inwards = -side * (OPEN + SQUEEZE) * smooth(rows / CLOSED)
            motion = start.vertices + inwards[:, None, None] * np.array([1.0, 0.0, 0.0])
            shape = TriangleMesh(start.vertices, start.surface_triangles())
            fingers.append(MovingObstacle(scene, name, shape, motion=motion))
        simulation = Simulation(
            scene,
            [body, *fingers, HalfSpace(scene, "ground")],
            time_step=options.dt,
            activation_distance=ACTIVATION,
            contacts=ContactTable(friction=FRICTION),
            eps_v=1e-2,
            settings=PRECISE,
        )
        return simulation, fingers

    def build(self, options: Options) -> Simulation:
        """The scene with the fingers on the path that was found."""
        end = options.frames * options.dt
        if end < 2 * CLOSED:
            raise CheckFailedError(f"the fingers close until {CLOSED} s; {end:.2f} s are too short: give more --frames")
        rows = rows_of(options)
        simulation, fingers = self.scene(options)
        body = simulation.moving[0]
        share = smooth((rows[1:] - CLOSED) / (end - CLOSED))
        self.places = body.positions().mean(axis=0) + share[:, None] * np.array(WAY)
        count = len(body.rest)
        goal = body.vertices.add_constant("goal", 3, 1)
        middle = body.mesh.add_primitive("middle", 1)
        all_of_it = middle.add_connectivity("vertices", body.vertices, np.arange(count), counts=[count])
        means = {
            name: middle.add_attribute(name, through=all_of_it, source=body.vertices[name], operation="mean")
            for name in ("position", "goal")
        }
        away = middle.add_attribute("away", computed_attribute=means["position"] - means["goal"])
        schedule = PerStep(goal, np.repeat(self.places[:, None], count, axis=1))
        trajectory = Trajectory(simulation, options.frames, schedules=[schedule])
        path = FingerPath(fingers, rows, end)
        closed = [k for k in range(1, options.frames + 1) if rows[k] > CLOSED]
        objective = Squares(away, frames=closed, weight=1 / (len(closed) * SIDE**2))
        self.before = SIDE * np.sqrt(2 * trajectory.gradient(objective, path).value)
        found = fit(
            trajectory,
            objective,
            path,
            method="trust-ncg",
            transforms={path: scaled(SIDE)},
            max_iterations=options.iterations,
            options={"initial_trust_radius": 5.0, "max_trust_radius": 20.0, "gtol": 1e-4},
        )
        final, fingers = self.scene(options)
        last = FingerPath(fingers, rows, end)
        last.set(trajectory, found[path])
        final.after_step.append(self.measure)
        return final

    def measure(self, simulation: Simulation) -> None:
        """After a step: how far the block's middle is from its path."""
        if simulation.time > CLOSED + 1e-9:
            middle = simulation.moving[0].positions().mean(axis=0)
            self.distances.append(float(np.linalg.norm(middle - self.places[simulation.frame - 1])))

    def check(self, simulation: Simulation, options: Options) -> str:
        """The block came along its path, up from the ground."""
        self.after = float(np.sqrt(np.mean(np.square(self.distances))))
        if self.after > WITHIN * self.before:
            raise CheckFailedError(
                f"the block is {1e3 * self.after:.2f} mm off its path; with fingers that stay, {1e3 * self.before:.2f}"
            )
        lowest = float(simulation.moving[0].positions()[:, 2].min())
        return (
            f"with fingers that stay, the block is {1e3 * self.before:.1f} mm off its path, root mean square; on the"
            f" path that was found, {1e3 * self.after:.2f} mm, and in the end {1e3 * lowest:.0f} mm above the ground"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run gripper_control`; 1 if the block leaves its path."""
    program = GripperControl()
    return PROGRAM.run(arguments, program.build, program.check)


if __name__ == "__main__":
    sys.exit(main())
