"""Two fingers lift a soft ball by friction alone, and the force that lifts it is read out as it happens.

The fingers are obstacles that close, rise and stand still as a function of time says. Each line that is printed has the
forces of both fingers and of the ground on the ball, and m (g + a), its mass times gravity and its own acceleration,
which they add up to. With too little friction (`--friction 0.1`) the ball slips out and stays on the ground.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps.bodies import HalfSpace, MovingObstacle, SoftBody
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, box, sphere
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

RADIUS = 0.04  # m, of the ball
STIFFNESS = 5e4  # Pa, Young's modulus of the ball
FINGER = (0.015, 0.05, 0.06)  # m: thickness, width, height
OPEN, SQUEEZE = 0.3, 0.12  # of the ball's radius: how far each finger is off at the start, how far it presses in
LIFT = 0.12  # m
DISTANCE = 5e-4  # m, of activation
CLOSED, RISING, RAISED = 0.25, 0.3, 0.8  # s: the fingers have closed, begin to rise, stand still again
STILL = 1.0  # s: what hangs has come to rest
HOLDS, SLIPS = 0.3, 0.15  # coefficients of friction: from here on the ball is lifted, up to there it is not

PROGRAM = SceneProgram(
    "gripper", __doc__, frames=120, time_step=0.01, size=1000, size_means="vertices of the ball, at least 100"
)
PROGRAM.add_argument("--friction", type=float, default=0.5, help="coefficient everywhere (default 0.5)")


def smooth(time: float, start: float, end: float) -> float:
    """From 0 at the start to 1 at the end, at rest at both."""
    t = min(max((time - start) / (end - start), 0.0), 1.0)
    return t * t * (3 - 2 * t)


def build(options: Options) -> Simulation:
    """The ball on the ground at z = 0 between two open fingers."""
    scene = PROGRAM.scene(options)
    shape = sphere(RADIUS, options.size)
    ball = SoftBody(
        scene,
        "ball",
        shape.translated((0.0, 0.0, 0.98 * DISTANCE - shape.vertices[:, 2].min())),
        youngs_modulus=STIFFNESS,
    )
    block = box(FINGER, (1, 1, 1))
    fingers = []
    for name, side in (("left_finger", -1.0), ("right_finger", 1.0)):
        start = block.translated((side * ((1 + OPEN) * RADIUS + 0.5 * FINGER[0]), 0.0, RADIUS))

        def motion(time: float, start: NDArray[np.float64] = start.vertices, side: float = side) -> NDArray[np.float64]:
            inwards = (OPEN + SQUEEZE) * RADIUS * smooth(time, 0.0, CLOSED)
            return np.asarray(start + np.array([-side * inwards, 0.0, LIFT * smooth(time, RISING, RAISED)]))

        fingers.append(
            MovingObstacle(scene, name, TriangleMesh(start.vertices, start.surface_triangles()), motion=motion)
        )
    simulation = Simulation(
        scene,
        [ball, *fingers, HalfSpace(scene, "ground")],
        time_step=options.dt,
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=options.friction),
    )
    simulation.after_step.append(print_forces)
    return simulation


def lifting_forces(simulation: Simulation) -> tuple[float, float, float]:
    """Upward forces on the ball [N]: of both fingers, of the ground, and m (g + a), which balances both."""
    forces = simulation.contact_forces()
    on_ball = forces.between_bodies()[forces.number_of("ball")]
    fingers = sum(on_ball[forces.number_of(name), 2] for name in ("left_finger", "right_finger"))
    terms = simulation.forces_by_term()
    needed = -sum(
        terms[f"ball.vertices.{name}"]["ball.vertices.position"][:, 2].sum() for name in ("gravity", "inertia")
    )
    return float(fingers), float(on_ball[forces.number_of("ground"), 2]), float(needed)


def print_forces(simulation: Simulation) -> None:
    """A line for every tenth step."""
    if simulation.frame % 10 == 0:
        fingers, ground, needed = lifting_forces(simulation)
        print(f"{simulation.time:.2f} s: fingers {fingers:6.3f} N, ground {ground:6.3f} N, m (g + a) {needed:6.3f} N")


def check(simulation: Simulation, options: Options) -> str:
    """The ball hangs between the fingers, which carry its weight; or with little friction it lies on the ground."""
    if simulation.time < STILL:
        raise CheckFailedError(
            f"the fingers stand still at {RAISED} s and the ball hangs at {STILL} s; the run ended at"
            f" {simulation.time:.2f} s: give it more --frames"
        )
    ball = simulation.moving[0]
    height, weight = float(ball.positions()[:, 2].min()), 9.8 * float(ball.mass.value.sum())
    fingers, _, needed = lifting_forces(simulation)
    is_lifted = height > 0.8 * LIFT
    if is_lifted and options.friction <= SLIPS:
        raise CheckFailedError(
            f"the ball is lifted by {height:.3f} m with a friction of {options.friction}, which can't hold it"
        )
    if not is_lifted and options.friction >= HOLDS:
        raise CheckFailedError(f"the ball is {height:.3f} m high, the fingers rose by {LIFT} m: it slipped")
    if not is_lifted:
        return f"the ball slipped out of the fingers: {height:.4f} m high, friction {options.friction}"
    if not abs(fingers - weight) < 0.01 * weight:
        raise CheckFailedError(
            f"the ball hangs still, but the fingers lift it with {fingers:.4f} N; it weighs {weight:.4f} N"
        )
    if not abs(fingers - needed) < 1e-3 * weight:
        raise CheckFailedError(f"the fingers lift with {fingers:.5f} N, m (g + a) is {needed:.5f} N")
    return f"the ball hangs {height:.3f} m high; the fingers lift with {fingers:.4f} N, it weighs {weight:.4f} N"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run gripper`."""
    return PROGRAM.run(arguments, build, check, fields=("velocity", "contact_force"))


if __name__ == "__main__":
    sys.exit(main())
