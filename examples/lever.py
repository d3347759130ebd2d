"""A lever on a spring, and two masses on springs from its ends; all of it is angles (the paper, 10.7 and figure 29).

The springs are zigzags of stiff links whose joints are elastic: each is a chain of angles between its links, and an
angle by which it hangs. The lever has one angle for both of its arms. So where a mass is depends on all angles of the
upper spring, of the lever and of its own spring, by two sums of any length: those of the angles that turn a link, and
those of the links on the way to the mass. Only the masses have inertia. What they pull with must therefore balance the
moment of every joint at any time; `check` computes that by hand.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from yasps import Scene, SceneError
from yasps.bodies import Body
from yasps.meshes import box
from yasps.parameterisations import turned
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import BDF2, NewtonSettings

LINK = 0.05  # m, of a zigzag; its first and its last are half as long
SLANT = np.radians(60.0)  # of a link, from the vertical
STIFFNESS = 0.5  # N m / rad, of a joint
ARM = 0.2  # m, of the lever
DROOP = np.radians(20.0)  # of its arms, from the horizontal: brings the lever back
MASSES = 0.2, 0.25  # kg
BLOCK = 0.06  # m, side of a mass in pictures
ROD = 0.005  # m, radius of a link in pictures
GRAVITY = 9.8  # m/s^2
BALANCE = 1e-6  # share of the largest moment that may be out of balance at a joint
DRIFT = 0.01  # weights times the lever's arm: energy that may have come from nowhere

PROGRAM = SceneProgram("lever", __doc__, frames=300, time_step=0.005, size=10, size_means="links of each spring")

Vectors = NDArray[np.float64]


class Mobile(Body):
    """Links that hang from the origin in the plane y = 0 and turn about joints.

    `joints`: `angle` [rad], a target; `rest_angle` [rad], `stiffness` [N m / rad], `bend` [J]. `links`: `joints`, those
    that turn it; `direction`, the sum of their angles [rad]; `rest_arm` and `arm`, from its start to its end [m].
    `vertices`: `links`, those on the way to it; `position`, their arms' sum and an `offset` [m]; `mass` [kg].
    """

    def __init__(self, scene: Scene, name: str, links: int) -> None:
        """The upper spring, the lever, and two lower springs with the masses; all springs of so many links, at rest."""
        self.rest_angles: list[float] = []
        self.stiffness: list[float] = []
        self.joints_of: list[list[int]] = []
        self.rest_arms: list[tuple[float, float, float]] = []
        self.way_to: list[list[int]] = []
        upper = self._add_spring([], links)
        tipping = self._add_joint(0.0, 0.0)
        ends = []
        for side in (-1.0, 1.0):
            half = (side * ARM * np.cos(DROOP), 0.0, -ARM * np.sin(DROOP))
            ends.append(self._add_spring(self._add_link(upper, [tipping], half), links))
        # Vertex 0 is the origin, vertex k + 1 the end of link k; then come the corners of the masses.
        block = box((BLOCK, BLOCK, BLOCK), (1, 1, 1)).translated((0.0, 0.0, -0.5 * BLOCK))
        ways = [[], *self.way_to, *(way for way in ends for _ in block.vertices)]
        offsets = np.vstack([np.zeros((len(self.way_to) + 1, 3)), block.vertices, block.vertices])
        mass = np.zeros(len(ways))
        mass[[way[-1] + 1 for way in ends]] = MASSES
        super().__init__(scene, name, np.zeros((len(ways), 3)), np.full(len(ways), ROD))
        self.edges = np.array([[(way[-2] + 1 if way[1:] else 0), way[-1] + 1] for way in self.way_to], np.int32)
        corners = len(self.way_to) + 1 + np.arange(2) * len(block.vertices)
        self.triangles = np.concatenate([block.surface_triangles() + start for start in corners]).astype(np.int32)
        self.cells = {"line": self.edges, "triangle": self.triangles}

        joints = self.mesh.add_primitive("joints", num_instances=len(self.rest_angles))
        angle = joints.add_attribute("angle", 1, 1, value=self.rest_angles)
        off = angle - joints.add_constant("rest_angle", 1, 1, value=self.rest_angles)
        stiffness = joints.add_constant("stiffness", 1, 1, value=self.stiffness)
        self.add_energy(joints.add_attribute("bend", computed_attribute=0.5 * stiffness * off * off))

        sticks = self.mesh.add_primitive("links", num_instances=len(self.rest_arms))
        turning = sticks.add_connectivity(
            "joints", joints, list(chain(*self.joints_of)), counts=_counts(self.joints_of)
        )
        direction = sticks.add_attribute("direction", through=turning, source=angle, operation="sum")
        rest_arm = sticks.add_constant("rest_arm", 3, 1, value=self.rest_arms)
        along_x, along_z = (self.mesh.add_constant(f"along_{axis}", 3, 1, value=v) for axis, v in _PLANE.items())
        arm = sticks.add_attribute("arm", computed_attribute=turned(rest_arm, direction, along_x, along_z))

        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(ways))
        way = self.vertices.add_connectivity("links", sticks, list(chain(*ways)), counts=_counts(ways))
        end = self.vertices.add_attribute("end", through=way, source=arm, operation="sum")
        offset = self.vertices.add_constant("offset", 3, 1, value=offsets)
        self.vertices.add_attribute("position", computed_attribute=end.reshape(3, 1) + offset)
        self.vertices.add_constant("mass", 1, 1, value=mass)
        self.angle, self.targets = angle, (angle,)
        self.arms = {angle: float(np.linalg.norm(self.rest_arms, axis=1).sum())}
        self.rest = self.positions()

    def _add_joint(self, rest_angle: float, stiffness: float) -> int:
        self.rest_angles.append(rest_angle)
        self.stiffness.append(stiffness)
        return len(self.rest_angles) - 1

    def _add_link(self, way: list[int], joints: list[int], arm: tuple[float, float, float]) -> list[int]:
        """A link at the end of others; the way to its own end."""
        self.joints_of.append(list(joints))
        self.rest_arms.append(arm)
        self.way_to.append([*way, len(self.way_to)])
        return self.way_to[-1]

    def _add_spring(self, way: list[int], links: int) -> list[int]:
        """A zigzag that hangs on a hinge at the end of other links; the way to its own end."""
        joints: list[int] = []
        for number in range(links):
            rest_angle = 2 * SLANT * (1 if number % 2 == 0 else -1) if number else 0.0
            joints.append(self._add_joint(rest_angle, STIFFNESS if number else 0.0))
            length = LINK if 0 < number < links - 1 else 0.5 * LINK
            way = self._add_link(way, joints, (length * np.sin(SLANT), 0.0, -length * np.cos(SLANT)))
        return way


_PLANE = {"x": (1.0, 0.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _counts(lists: Sequence[Sequence[int]]) -> list[int]:
    return [len(one) for one in lists]


def build(options: Options) -> Simulation:
    """The lever and its masses, let go where all springs are at rest and the lever is level."""
    if options.size < 2:
        raise SceneError(f"--size: a zigzag has at least 2 links, got {options.size}")
    scene = PROGRAM.scene(options)
    mobile = Mobile(scene, "mobile", options.size)
    # Angles are far from linear: with Hessians that are always projected a step takes up to 100 iterations, not 3.
    settings = NewtonSettings(
        velocity_tolerance=1e-4,
        relative_force_tolerance=1e-8,
        solver="direct",
        projection="on-demand",
        max_iterations=500,
    )
    return Simulation(
        scene,
        [mobile],
        time_step=options.dt,
        gravity=(0.0, 0.0, -GRAVITY),
        contact=False,
        integrator=BDF2,
        settings=settings,
    )


def out_of_balance(simulation: Simulation) -> tuple[Vectors, Vectors]:
    """Of each joint its elastic moment, and the moment about it that nothing balances [N m]: the forces of weight and
    inertia are those of the step, and each link carries those of all that hangs on it."""
    (mobile,) = simulation.moving
    assert isinstance(mobile, Mobile)
    x, predicted = mobile.positions(), mobile.vertices["predicted"].value.reshape(-1, 3)
    pull = -(x - predicted) / float(simulation.effective_step.value[0]) ** 2 - [0.0, 0.0, GRAVITY]
    pull *= mobile.mass.value[:, None]
    carried = np.zeros((len(mobile.way_to), 3))
    for link, way in enumerate(mobile.way_to):
        carried[way] += pull[link + 1]
    start, end = (x[mobile.edges[:, side]] for side in (0, 1))
    turning = (end - start)[:, 0] * carried[:, 2] - (end - start)[:, 2] * carried[:, 0]
    elastic = np.array(mobile.stiffness) * (mobile.angle.value - mobile.rest_angles)
    left = -elastic
    for link, joints in enumerate(mobile.joints_of):
        left[joints] += turning[link]
    return elastic, left


def check(simulation: Simulation, options: Options) -> str:
    """Weight and inertia of the masses balance every joint, and no energy came from nowhere."""
    (mobile,) = simulation.moving
    assert isinstance(mobile, Mobile)
    if simulation.frame == 0:
        return "nothing has moved yet"
    elastic, left = out_of_balance(simulation)
    largest, share = float(np.abs(elastic).max()), float(np.abs(left).max() / np.abs(elastic).max())
    if share > BALANCE:
        raise CheckFailedError(f"joint {np.abs(left).argmax()} is out of balance by {share:.2g} of the largest moment")
    weight = GRAVITY * mobile.mass.value
    fallen = float(weight @ (mobile.rest - mobile.positions())[:, 2])
    bent = 0.5 * float(np.array(mobile.stiffness) @ (mobile.angle.value - mobile.rest_angles) ** 2)
    motion = simulation.stepper.kinetic_energy()
    if bent + motion - fallen > DRIFT * weight.sum() * ARM:
        raise CheckFailedError(
            f"springs and motion have {bent + motion:.3g} J, but only {fallen:.3g} J came from falling"
        )
    return (
        f"after {simulation.time:.2f} s all joints are in balance to {share:.1g} of the largest, {largest:.3g} N m;"
        f" of {fallen:.4g} J from falling {bent:.4g} J are in the springs and {motion:.4g} J in motion"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run lever`."""
    return PROGRAM.run(arguments, build, check, view_direction=(0.15, -1.0, 0.1))


if __name__ == "__main__":
    sys.exit(main())
