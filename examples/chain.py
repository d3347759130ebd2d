"""A chain of steel links, held at both ends, falls into its curve; the links hold each other by contact alone.

The links are affine bodies, each swept along an oval through the holes of its neighbours; the first and the last one
are obstacles. At the end each link still goes through the next (the Gauss linking number of their centre lines is 1 or
-1), and what the two held ones carry is m (g + a), the mass of the others times gravity and acceleration.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from yasps import SceneError
from yasps.bodies import AffineBody, Body, HalfSpace, Obstacle
from yasps.contact import ContactTable
from yasps.meshes import TetrahedralMesh, TriangleMesh, signed_volumes
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

WIRE, BEND, STRAIGHT = 0.006, 0.014, 0.03  # m: radius of the wire, radius of the oval's ends, length of its sides
TAUT = 2 * BEND + STRAIGHT - 2 * WIRE  # m, from the middle of a link to that of the next in a taut chain
SLACK = 0.8  # of that at the start
HEIGHT = 0.5  # of the ends above the ground, in taut chains
DENSITY = 7800.0  # kg/m^3
DISTANCE = 5e-4  # m, of activation
SLIP_SPEED = 1e-3  # m/s
AROUND, ALONG = 10, 28  # corners of a cross-section, and cross-sections of a link
HANGS = 0.4  # s: after this the chain sags

PROGRAM = SceneProgram("chain", __doc__, frames=150, time_step=0.01, size=10, size_means="links, at least 3")
PROGRAM.add_argument("--friction", type=float, default=0.2, help="coefficient everywhere (default 0.2)")


def centre_line() -> NDArray[np.float64]:
    """Points of the oval in the plane z = 0, evenly along it, [ALONG, 3]."""
    arc = np.pi * BEND
    along = np.linspace(0.0, 2 * (arc + STRAIGHT), ALONG, endpoint=False)
    half, rest = np.divmod(along, arc + STRAIGHT)  # each half is one side and the bend after it
    angle = np.clip(rest - STRAIGHT, 0.0, arc) / BEND
    x = np.minimum(rest, STRAIGHT) - 0.5 * STRAIGHT + BEND * np.sin(angle)
    points = np.stack([x, -BEND * np.cos(angle), np.zeros(ALONG)], axis=1)
    return np.asarray(points * np.where(half == 0, 1.0, -1.0)[:, None])


def link() -> TetrahedralMesh:
    """A wire bent along the oval; a vertex of each cross-section is in its middle, the others around it."""
    middle = centre_line()
    tangent = np.roll(middle, -1, axis=0) - np.roll(middle, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0])
    angles = 2 * np.pi * np.arange(AROUND) / AROUND
    spokes = np.cos(angles)[:, None, None] * np.cross(up, tangent) + np.sin(angles)[:, None, None] * up
    points = np.concatenate([middle[None], middle + WIRE * spokes]).transpose(1, 0, 2)
    number = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    tets = []
    for this, after in zip(number, np.roll(number, -1, axis=0), strict=True):
        for k in range(1, AROUND + 1):
            # A prism in three; corners in the same order in all prisms, so that common faces are cut alike.
            i, j = sorted((k, k % AROUND + 1))
            a, b, c = this[[0, i, j]]
            d, e, f = after[[0, i, j]]
            tets += [[a, b, c, f], [a, b, e, f], [a, d, e, f]]
    vertices, corners = points.reshape(-1, 3), np.array(tets, np.int32)
    inside_out = signed_volumes(vertices, corners) < 0
    corners[inside_out] = corners[inside_out][:, [1, 0, 2, 3]]
    return TetrahedralMesh(vertices, corners)


def build(options: Options) -> Simulation:
    """The chain along x, slack and level, each link turned by a quarter against the one before it."""
    if options.size < 3:
        raise SceneError(f"--size: a chain that hangs has at least 3 links, got {options.size}")
    scene = PROGRAM.scene(options)
    shape = link()
    count, pitch = options.size, SLACK * TAUT
    bodies: list[Body] = []
    for number in range(count):
        turned = shape.rotated((1.0, 0.0, 0.0), 0.5 * np.pi * (number % 2) + 0.25 * np.pi)
        placed = turned.translated(((number - 0.5 * (count - 1)) * pitch, 0.0, HEIGHT * count * TAUT))
        if number in (0, count - 1):
            surface = TriangleMesh(placed.vertices, placed.surface_triangles())
            bodies.append(Obstacle(scene, f"link_{number}", surface))
        else:
            bodies.append(AffineBody(scene, f"link_{number}", placed, density=DENSITY, youngs_modulus=1e9))
    return Simulation(
        scene,
        [*bodies, HalfSpace(scene, "ground")],
        time_step=options.dt,
        activation_distance=DISTANCE,
        contacts=ContactTable(friction=options.friction),
        eps_v=SLIP_SPEED,
        settings=NewtonSettings(
            velocity_tolerance=0.1 * SLIP_SPEED, relative_force_tolerance=1e-3, solver="direct", max_iterations=500
        ),
    )


def centre_lines(simulation: Simulation) -> NDArray[np.float64]:
    """Where the centre line of each link is, [links, ALONG, 3] in m."""
    links = [body for body in simulation.bodies if body.name.startswith("link_")]
    return np.stack([body.positions()[:: AROUND + 1] for body in links])


def linking_number(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Gauss's integral over two closed curves [n, 3], with the exact contribution of each two of their segments (Klenin
    and Langowski 2000, method 1a): how often one goes through the other."""
    a, b = first[:, None], np.roll(first, -1, axis=0)[:, None]
    c, d = second[None], np.roll(second, -1, axis=0)[None]
    r13, r14, r23, r24 = c - a, d - a, c - b, d - b
    faces = [np.cross(r13, r14), np.cross(r14, r24), np.cross(r24, r23), np.cross(r23, r13)]
    normals = [face / np.linalg.norm(face, axis=-1, keepdims=True) for face in faces]
    angles = [np.arcsin(np.clip((one * two).sum(axis=-1), -1.0, 1.0)) for one, two in pairwise([*normals, normals[0]])]
    sign = np.sign((np.cross(d - c, b - a) * r13).sum(axis=-1))
    return float((sign * sum(angles)).sum() / (4 * np.pi))


def check(simulation: Simulation, options: Options) -> str:
    """Every link goes through the next, none is farther from it than it can be, and the held ones carry the others."""
    lines = centre_lines(simulation)
    for number, (first, second) in enumerate(pairwise(lines)):
        linked = linking_number(first, second)
        if not abs(abs(linked) - 1.0) < 1e-6:
            raise CheckFailedError(f"link {number} does not go through link {number + 1}: linking number {linked:.3f}")
    middles = lines.mean(axis=1)
    apart = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    if not apart.max() < TAUT + DISTANCE:
        raise CheckFailedError(
            f"two links are {1e3 * apart.max():.2f} mm apart, a taut chain's are {1e3 * TAUT:.2f} mm"
        )
    if simulation.time < HANGS:
        raise CheckFailedError(f"the chain hangs after {HANGS} s; the run ended at {simulation.time:.2f} s")
    sag = float(middles[0, 2] - middles[:, 2].min())
    if not sag > 0.1 * len(lines) * TAUT:
        raise CheckFailedError(f"the chain sags by {sag:.3f} m only; taut it is {len(lines) * TAUT:.3f} m long")
    forces = simulation.contact_forces()
    on_bodies = forces.on_bodies()
    carried = -float(on_bodies[0, 2] + on_bodies[len(lines) - 1, 2])
    weight = 9.8 * sum(float(body.mass.value.sum()) for body in simulation.moving)
    terms = simulation.forces_by_term()
    needed = -sum(
        float(terms[f"{body.name}.vertices.{name}"][f"{body.name}.body.translation"][0, 2])
        for body in simulation.moving
        for name in ("gravity", "inertia")
    )
    if not abs(carried - needed) < 0.01 * weight:
        raise CheckFailedError(f"the held links carry {carried:.3f} N, the others' m (g + a) is {needed:.3f} N")
    return (
        f"{len(lines)} links hang {sag:.3f} m deep, each through the next; the held ones carry {carried:.3f} N,"
        f" m (g + a) is {needed:.3f} N and the weight {weight:.3f} N"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run chain`."""
    return PROGRAM.run(arguments, build, check)


if __name__ == "__main__":
    sys.exit(main())
