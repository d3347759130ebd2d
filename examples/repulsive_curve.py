"""A closed curve on a rabbit repels itself, by way of a sphere (the paper, 9.5).

1. The rabbit's surface is smoothed until it is a sphere: bending that knows no shape but a round one, Baraff-Witkin
   triangles, a pull to the sphere around the middle, and contact that keeps it from going through itself. Beside these
   terms of the paper, a little of a Neo-Hookean membrane keeps triangles from losing all of their area.
2. The curve lives on that sphere: its points are stored directions over their lengths. A penalty of inverse lengths
   makes it longer, contact keeps it apart, and bending, which the paper does not name, decides how wide its bends are.
   What a point weighs is the density there, area on the rabbit over area on the sphere: heavy points move less.
3. Triangles and weights of its points carry the curve back to the rabbit.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, Scene, materials
from yasps.bodies import Body, Obstacle
from yasps.contact import ContactTable
from yasps.meshes import TriangleMesh, hinges_of, rabbit, triangle_areas
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import NewtonSettings

# Of the smoothing; energies in joules of a rabbit 1 m high, steps of half a second in which it forgets its velocity.
BENDING, STRETCH, AREA, MASS = 3.0, 0.02, 0.005, 10.0  # J/m, J/m^2, J/m^2, kg
PULL, GROWTH = 0.05, 1.7  # J/m^4 of the pull to the sphere at first, and its growth a step later
RABBIT = 1500  # vertices, with those inside; the ears of finer ones fold before they are round, and `check` says so
TOLERANCE = 1e-2  # m/s, of Newton's method; with a larger one the ears do not straighten out
ROUND, MOST_STEPS = 0.01, 60  # spread of the radii at the end, in radii; steps
# Of the curve on the unit sphere.
THRUST, STIFFNESS, WEIGHT = 0.9, 3e-3, 3000.0  # N at first, N m^2 of bending, kg of the curve where the density is 1
DISTANCE = 0.07  # of activation
GROWS = 0.02  # least growth of the curve a second, in shares of its length, in the first ten seconds
SCALE = 2.5  # of the rabbit beside the sphere in pictures
ASIDE = np.array([2.6, 0.0, 0.0])  # where it stands

PROGRAM = SceneProgram("repulsive_curve", __doc__, frames=40, time_step=1.0, size=200, size_means="points of the curve")

Vectors = NDArray[np.float64]


@dataclass(frozen=True)
class SphereMap:
    """A surface, and its vertices on the unit sphere. spread: of their radii before these were made 1."""

    vertices: Vectors
    triangles: NDArray[np.int32]
    on_sphere: Vectors
    spread: float

    def facing(self) -> Vectors:
        """Six times the volume between each triangle on the sphere and the middle, [m]; negative if it is flipped."""
        return np.asarray(np.linalg.det(self.on_sphere[self.triangles]))

    def density(self) -> Vectors:
        """Area on the surface over that on the sphere, the mean of each vertex' triangles, [n]; 1 on the whole."""
        before, after = (triangle_areas(x, self.triangles) for x in (self.vertices, self.on_sphere))
        shares = np.repeat((before / before.sum()) / (after / after.sum()), 3)
        corners = self.triangles.ravel()
        return np.bincount(corners, shares) / np.bincount(corners)

    def places(self, points: Vectors) -> tuple[NDArray[np.int32], Vectors]:
        """Of points on the sphere [n, 3] the corners of the triangle that the line to each goes through, [n, 3], and
        their weights [n, 3]."""
        weights = np.einsum("mij,nj->nmi", np.linalg.inv(self.on_sphere[self.triangles].transpose(0, 2, 1)), points)
        chosen = weights.min(axis=2).argmax(axis=1)
        weights = weights[np.arange(len(points)), chosen]
        return self.triangles[chosen], weights / weights.sum(axis=1, keepdims=True)


class Skin(Body):
    """The surface while it becomes a sphere of a radius around the origin; `pull` [J/m^4] grows from step to step."""

    def __init__(self, scene: Scene, shape: TriangleMesh, radius: float) -> None:
        """Adds it where the mesh lies."""
        super().__init__(scene, "skin", shape.vertices)
        self.contact_modulus = 100.0
        self.cells, self.triangles = {"triangle": shape.triangles}, shape.triangles
        areas, count = triangle_areas(*shape), len(shape.vertices)
        self.vertices = self.mesh.add_primitive("vertices", num_instances=count)
        x = self.vertices.add_attribute("position", 3, 1, value=shape.vertices)
        self.vertices.add_constant("rest_position", 3, 1, value=shape.vertices)
        self.vertices.add_constant("mass", 1, 1, value=np.full(count, MASS / count))
        self.targets = (x,)

        hinges = hinges_of(shape.triangles)
        lengths = np.linalg.norm(shape.vertices[hinges[:, 0]] - shape.vertices[hinges[:, 1]], axis=1)
        bends = self.mesh.add_primitive("hinges", num_instances=len(hinges))
        four = bends.add_attribute("x", through=bends.add_connectivity("corners", self.vertices, hinges, 4), source=x)
        bending = materials.hinge_bending(four, bends.add_constant("stiffness", 1, 1, value=BENDING * lengths))
        self.add_energy(bends.add_attribute("bending", computed_attribute=bending))

        faces = self.mesh.add_primitive("triangles", num_instances=len(shape.triangles))
        corners = faces.add_connectivity("corners", self.vertices, shape.triangles, 3)
        three = faces.add_attribute("x", through=corners, source=x)
        inverse, rest_areas = materials.rest_triangles(shape.vertices, shape.triangles, (1.0, 0.3, 0.2))
        area = faces.add_constant("area", 1, 1, value=rest_areas)
        f = materials.triangle_deformation(three, faces.add_constant("inverse", 2, 2, value=inverse))
        for name, energy in (
            ("stretch", materials.baraff_witkin(f, STRETCH, STRETCH, area)),
            ("no_collapse", materials.neo_hookean_membrane(f, AREA, area, 1.0)),
        ):
            self.add_energy(faces.add_attribute(name, computed_attribute=energy))

        self.pull = self.mesh.add_constant("pull", 1, 1, value=PULL)
        off = x.norm() - radius
        towards = 0.5 * float(areas.sum()) / count * self.pull * off * off
        self.add_energy(self.vertices.add_attribute("to_sphere", computed_attribute=towards))


def smoothed(options: Options) -> SphereMap:
    """The rabbit's surface as a sphere; after the last step its vertices are put on it."""
    mesh = rabbit(RABBIT)
    used, triangles = np.unique(mesh.surface_triangles(), return_inverse=True)
    vertices = mesh.vertices[used] - mesh.vertices[used].mean(axis=0)
    shape = TriangleMesh(vertices, triangles.reshape(-1, 3).astype(np.int32))
    radius = float(np.sqrt(triangle_areas(*shape).sum() / (4 * np.pi)))
    skin = Skin(PROGRAM.scene(options), shape, radius)
    simulation = Simulation(
        skin.scene,
        [skin],
        time_step=0.5,
        gravity=(0.0, 0.0, 0.0),
        activation_distance=1e-3,
        settings=NewtonSettings(velocity_tolerance=TOLERANCE, solver="direct", max_iterations=500),
    )
    for _ in range(MOST_STEPS):
        simulation.step()
        simulation.set_velocity(skin, (0.0, 0.0, 0.0))
        radii = np.linalg.norm(skin.positions(), axis=1)
        spread = float(radii.std() / radii.mean())
        if spread < ROUND:
            break
        if (np.linalg.det(skin.positions()[shape.triangles]) > 0.0).all():  # all of it is seen from the middle
            skin.pull.update_value(skin.pull.value * GROWTH)
    simulation.check_intersection_free()
    return SphereMap(vertices, shape.triangles, skin.positions() / radii[:, None], spread)


class Curve(Body):
    """A closed curve on the unit sphere: `vertices` have a `direction`, a target, and its `position` on the sphere."""

    def __init__(self, scene: Scene, start: Vectors) -> None:
        """Adds it; start: its points [n, 3]."""
        super().__init__(scene, "curve", start)
        count = len(start)
        here = np.arange(count)
        self.edges = np.column_stack([here, (here + 1) % count]).astype(np.int32)
        self.triangles, self.cells = np.empty((0, 3), np.int32), {"line": self.edges}
        self.contact_modulus = 10.0
        self.vertices = self.mesh.add_primitive("vertices", num_instances=count)
        direction = self.vertices.add_attribute("direction", 3, 1, value=start)
        length = direction.norm()
        x = self.vertices.add_attribute("position", computed_attribute=direction / length)
        self.vertices.add_constant("rest_position", 3, 1, value=start)
        self.vertices.add_constant("mass", 1, 1, value=np.full(count, WEIGHT / count))
        # The length of a direction means nothing, so it is kept at 1.
        self.add_energy(self.vertices.add_attribute("length", computed_attribute=(length - 1) * (length - 1)))
        self.targets = (direction,)

        two = self._joined("segments", self.edges, x)
        first = float(np.linalg.norm(start[1] - start[0]))
        inverse = THRUST * first**2 / (two.row(1) - two.row(0)).norm()
        self.add_energy(self.mesh.segments.add_attribute("inverse_length", computed_attribute=inverse))
        three = self._joined("bends", np.column_stack([here - 1, here, here + 1]) % count, x)
        bending = materials.rod_bending(three, 2 * first, STIFFNESS)
        self.add_energy(self.mesh.bends.add_attribute("bending", computed_attribute=bending))

    def _joined(self, name: str, of: NDArray[np.int64] | NDArray[np.int32], x: Attribute) -> Attribute:
        """The positions of some points for each instance of a new primitive."""
        primitive = self.mesh.add_primitive(name, num_instances=len(of))
        points = primitive.add_connectivity("points", self.vertices, of, of.shape[1])
        return primitive.add_attribute("x", through=points, source=x)


class OnRabbit(Body):
    """The curve carried back to the rabbit, to be seen; nothing meets it."""

    meets_itself = False

    def __init__(self, scene: Scene, curve: Curve, sphere_map: SphereMap) -> None:
        """Adds it; `map` says where it is."""
        self.curve, self.map = curve, sphere_map
        super().__init__(scene, "on_rabbit", self.places())
        self.edges, self.triangles, self.cells = curve.edges, curve.triangles, curve.cells
        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(self.rest))
        self.vertices.add_constant("position", 3, 1, value=self.rest)
        self.vertices.add_constant("rest_position", 3, 1, value=self.rest)

    @property
    def stands_still(self) -> bool:
        """It goes along with the curve."""
        return False

    def places(self) -> Vectors:
        """Of the curve's points on the rabbit beside the sphere [m], [n, 3]."""
        corners, weights = self.map.places(self.curve.positions())
        return np.asarray(np.einsum("nk,nki->ni", weights, SCALE * self.map.vertices[corners]) + ASIDE)


def build(options: Options) -> Simulation:
    """The curve on the sphere at the origin, and the rabbit beside it."""
    sphere_map = smoothed(options)
    density = sphere_map.density()
    scene = PROGRAM.scene(options)
    angle = np.linspace(0.0, 2 * np.pi, options.size, endpoint=False)
    start = np.column_stack([np.cos(angle), np.sin(angle), 0.2 * np.sin(3 * angle) + 0.05 * np.cos(5 * angle)])
    curve = Curve(scene, start / np.linalg.norm(start, axis=1, keepdims=True))
    shown = OnRabbit(scene, curve, sphere_map)
    ball = Obstacle(scene, "sphere", TriangleMesh(0.99 * sphere_map.on_sphere, sphere_map.triangles))
    animal = Obstacle(scene, "rabbit", TriangleMesh(SCALE * sphere_map.vertices + ASIDE, sphere_map.triangles))
    contacts = ContactTable()
    for first, second in ((curve, shown), (curve, ball), (curve, animal), (shown, ball), (shown, animal)):
        contacts.set(first.name, second.name, enabled=False)
    simulation = Simulation(
        scene,
        [curve, shown, ball, animal],
        time_step=options.dt,
        gravity=(0.0, 0.0, 0.0),
        activation_distance=DISTANCE,
        contacts=contacts,
        settings=NewtonSettings(velocity_tolerance=1e-3, solver="direct", projection="on-demand", max_iterations=500),
    )

    def take_density(simulation: Simulation) -> None:
        corners, weights = sphere_map.places(curve.positions())
        curve.mass.update_value(WEIGHT / len(corners) * (weights * density[corners]).sum(axis=1))

    def follow(simulation: Simulation) -> None:
        simulation.set_velocity(curve, (0.0, 0.0, 0.0))
        shown.position.update_value(shown.places())

    simulation.before_step.append(take_density)
    simulation.after_step.append(follow)
    return simulation


def length_of(points: Vectors, edges: NDArray[np.int32]) -> float:
    """Of all edges together."""
    return float(np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1).sum())


def crossings(points: Vectors, edges: NDArray[np.int32]) -> int:
    """How many pairs of arcs of a curve on the unit sphere cross."""
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    normals = np.cross(a, b)
    side_a, side_b = a @ normals.T, b @ normals.T  # of the ends of each arc, from the great circle of each other
    parted = (side_a * side_b < 0) & (side_a * side_b < 0).T
    near = (a + b) @ (a + b).T > 0
    apart = ~(edges[:, :, None, None] == edges.T[None, None]).any(axis=(1, 2))
    return int(np.triu(parted & near & apart).sum())


def check(simulation: Simulation, options: Options) -> str:
    """A sphere without flipped triangles, on it a longer curve that does not cross itself, and that on the rabbit."""
    curve, shown = simulation.bodies[:2]
    assert isinstance(curve, Curve)
    assert isinstance(shown, OnRabbit)
    sphere_map, x = shown.map, curve.positions()
    if sphere_map.spread > ROUND:
        raise CheckFailedError(f"radii of the smoothed rabbit still differ by {100 * sphere_map.spread:.2f} %")
    if flipped := int((sphere_map.facing() <= 0.0).sum()):
        raise CheckFailedError(f"{flipped} triangles are flipped on the sphere")
    if (off := float(np.abs(np.linalg.norm(x, axis=1) - 1.0).max())) > 1e-12:
        raise CheckFailedError(f"the curve is off the sphere by {off:.2g}")
    if crossed := crossings(x, curve.edges):
        raise CheckFailedError(f"the curve crosses itself {crossed} times")
    start, now = (length_of(points, curve.edges) for points in (curve.rest, x))
    if now < start * (1 + GROWS * min(simulation.time, 10.0)):
        raise CheckFailedError(f"the curve is {now:.3g} long after {simulation.time:.3g} s, and was {start:.3g} long")
    corners, weights = sphere_map.places(x)
    back = np.einsum("nk,nki->ni", weights, sphere_map.on_sphere[corners])
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    if weights.min() < -1e-9 or np.abs(back - x).max() > 1e-9:
        raise CheckFailedError("some points of the curve are in no triangle of the rabbit")
    on_rabbit = length_of(shown.positions(), curve.edges) / SCALE
    return (
        f"the rabbit's radii differ by {100 * sphere_map.spread:.2f} % and no triangle is flipped; after"
        f" {simulation.time:.0f} s the curve is {now:.3g} long on the unit sphere, {start:.3g} before, and"
        f" {on_rabbit:.3g} m on the rabbit, and does not cross itself"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run repulsive_curve`."""
    return PROGRAM.run(arguments, build, check, view_direction=(0.3, -1.0, 0.3), speed=10.0)


if __name__ == "__main__":
    sys.exit(main())
