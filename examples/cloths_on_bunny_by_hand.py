"""Cloths on a bunny without the kit: energies, contact and Newton's method are written in the language.

Every line of `cloths_on_bunny --barrier paper` that the kit stands for. Beside the language (`yasps`) there are meshes
(`yasps.meshes`) and, as the paper takes these from elsewhere, too, which pairs of the surface are close and how far a
step may go (`CollisionGeometry`). `World` takes bodies whatever parameterises them: many_bunnies_on_cloth_by_hand and
caged_bunny_by_hand bring theirs without a change here.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Never

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, Mesh, NotConvergedError, Primitive, PrimitiveUnion, Scene, SceneError, concat_rows, select
from yasps.contact import CollisionGeometry
from yasps.examples import bunnies_and_cloth as common
from yasps.examples import cloths_on_bunny as kit
from yasps.meshes import TetrahedralMesh, TriangleMesh, cloth_grid, hinge_stiffness, hinges_of, triangle_vertex_masses
from yasps.output import FrameRecorder
from yasps.program import Options, SceneProgram

Floats = NDArray[np.float64]
Ids = NDArray[np.int32]
KAPPA = 1e10  # J/m^4, that of `--barrier paper`

# --- Program ---
PROGRAM = SceneProgram(
    "cloths_on_bunny_by_hand",
    __doc__,
    frames=200,
    time_step=0.01,
    size=40,
    size_means="cells along each side of a cloth; the rabbit is about as fine",
    mesh_means="tetrahedral mesh with y up, instead of the rabbit",
)
PROGRAM.add_argument("--cloths", type=common.number_of, default=1, metavar="N", help="how many fall on the bunny (1)")


# --- Integration ---
@dataclass(eq=False)
class Body:
    """A mesh with a primitive `vertices`, which has `position`, `rest_position`, `mass` and `predicted`."""

    name: str
    mesh: Mesh
    vertices: Primitive
    targets: list[Attribute]
    triangles: Ids  # the surface
    cells: Mapping[str, Ids]
    rest: Floats  # [n, 3], in m
    meets_itself: bool = True
    fixed: dict[Attribute, NDArray[np.bool_]] = field(default_factory=dict)  # instances of targets
    edges: Ids = field(default_factory=lambda: np.empty((0, 2), np.int32))
    points: Ids = field(default_factory=lambda: np.empty(0, np.int32))
    is_fixed: bool = False
    stands_still: bool = False

    def positions(self) -> Floats:
        """[n, 3], in m."""
        return self.vertices["position"].compute().array.reshape(-1, 3)

    def radii(self) -> Floats:
        """[n], in m."""
        return np.zeros(self.vertices.num_instances)


def add_free_vertices(scene: Scene, name: str, x: Floats, mass: Floats) -> tuple[Mesh, Primitive, Attribute]:
    """A mesh whose vertices are its unknowns."""
    mesh = scene.add_mesh(name)
    vertices = mesh.add_primitive("vertices", num_instances=len(x))
    position = vertices.add_attribute("position", 3, 1, value=x)
    vertices.add_constant("rest_position", 3, 1, value=x)
    add_inertia_and_weight(vertices, mass)
    return mesh, vertices, position


def add_soft_bunny(
    scene: Scene, name: str, shape: TetrahedralMesh, *, mass: float, moduli: tuple[float, float]
) -> Body:
    """Stable Neo-Hookean tetrahedra. moduli: Young's modulus [Pa] and Poisson's ratio."""
    masses = shape.vertex_masses(mass / float(shape.volumes().sum()))
    mesh, vertices, position = add_free_vertices(scene, name, shape.vertices, masses)
    tets = mesh.add_primitive("tets", num_instances=len(shape.tets))
    corners = tets.add_connectivity("corners", vertices, shape.tets, 4)
    x = tets.add_attribute("positions", through=corners, source=position)
    edges = (shape.vertices[shape.tets[:, 1:]] - shape.vertices[shape.tets[:, :1]]).swapaxes(1, 2)
    inverse = tets.add_constant("inverse", 3, 3, value=np.linalg.inv(edges))
    volume = tets.add_constant("volume", 1, 1, value=shape.volumes())
    deformation = concat_rows([x.row(k) - x.row(0) for k in (1, 2, 3)]).T * inverse
    elastic = volume * stable_neo_hookean(deformation, *moduli)
    scene.add_energy(tets.add_attribute("elastic", computed_attribute=elastic))
    return Body(name, mesh, vertices, [position], shape.surface_triangles(), {"tetra": shape.tets}, shape.vertices)


def add_cloth(
    scene: Scene, name: str, shape: TriangleMesh, mass: float, stiffness: tuple[float, float, float], *, is_held: bool
) -> Body:
    """Baraff-Witkin triangles, level at rest, and hinges between them. stiffness: to stretch and shear [J/m^2] and of
    bending [J]; is_held: by its corners."""
    stretch, shear, bending = stiffness
    vertices_at_rest, triangles = shape
    corners_at_rest = vertices_at_rest[triangles][:, :, :2]
    edges = (corners_at_rest[:, 1:] - corners_at_rest[:, :1]).swapaxes(1, 2)
    area = 0.5 * np.linalg.det(edges)
    masses = triangle_vertex_masses(vertices_at_rest, triangles, mass / float(area.sum()))
    mesh, vertices, position = add_free_vertices(scene, name, vertices_at_rest, masses)
    faces = mesh.add_primitive("triangles", num_instances=len(triangles))
    corners = faces.add_connectivity("corners", vertices, triangles, 3)
    x = faces.add_attribute("positions", through=corners, source=position)
    inverse = faces.add_constant("inverse", 2, 2, value=np.linalg.inv(edges))
    deformation = concat_rows([x.row(k) - x.row(0) for k in (1, 2)]).T * inverse
    membrane = faces.add_constant("area", 1, 1, value=area) * baraff_witkin(deformation, stretch, shear)
    scene.add_energy(faces.add_attribute("membrane", computed_attribute=membrane))
    ids = hinges_of(triangles)
    hinges = mesh.add_primitive("hinges", num_instances=len(ids))
    ends = hinges.add_connectivity("corners", vertices, ids, 4)
    x = hinges.add_attribute("positions", through=ends, source=position)
    of_hinges = hinges.add_constant("stiffness", 1, 1, value=hinge_stiffness(vertices_at_rest, ids, bending))
    scene.add_energy(hinges.add_attribute("bending", computed_attribute=of_hinges * bent(x)))
    cloth = Body(name, mesh, vertices, [position], triangles, {"triangle": triangles}, vertices_at_rest)
    if is_held:
        is_fixed = np.isin(
            np.arange(len(vertices_at_rest)), common.cloth_corners(round(len(vertices_at_rest) ** 0.5) - 1)
        )
        cloth.fixed[position] = is_fixed
    return cloth


# --- Energy definition ---
def add_inertia_and_weight(vertices: Primitive, mass: Floats) -> None:
    """Of vertices with a position, whatever that is computed from [kg]."""
    scene, position = vertices.scene, vertices["position"]
    m = vertices.add_constant("mass", 1, 1, value=mass)
    off = position - vertices.add_constant("predicted", 3, 1)
    inertia = 0.5 * m * off.dot(off) / (scene["time_step"] * scene["time_step"])
    scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))
    scene.add_energy(vertices.add_attribute("weight", computed_attribute=common.GRAVITY * m * position[2]))


def stable_neo_hookean(f: Attribute, youngs_modulus: float, poisson_ratio: float) -> Attribute:
    """Of a deformation gradient, 3x3 [J/m^3]."""
    shear = youngs_modulus / (2 * (1 + poisson_ratio))
    mu, lam = 4 / 3 * shear, 2 * shear * poisson_ratio / (1 - 2 * poisson_ratio) + 5 / 6 * shear
    stretch, dilation = f.dot(f), f.det() - (1 + 0.75 * mu / lam)
    return 0.5 * mu * (stretch - 3 - (stretch + 1).log()) + 0.5 * lam * dilation * dilation


def baraff_witkin(f: Attribute, stretch: float, shear: float) -> Attribute:
    """Of a deformation gradient, 3x2 [J/m^2]."""
    warp, weft = f.col(0), f.col(1)
    strains = [thread.norm() - 1 for thread in (warp, weft)]
    resisting = [select(strain < 0, kit.COMPRESSION, 1.0) * strain * strain for strain in strains]
    return stretch * (resisting[0] + resisting[1]) + shear * warp.dot(weft) ** 2


def bent(x: Attribute) -> Attribute:
    """Of two triangles along the edge of rows 0 and 1, 4x3."""
    edge, left, right = (x.row(k) - x.row(0) for k in (1, 2, 3))
    first, second = edge.cross(left), right.cross(edge)
    turn = first / first.norm() - second / second.norm()
    return turn.dot(turn)


# --- Collision ---
def points_apart(x: Attribute) -> Attribute:
    """Squared distance of points 0 and 1 [m^2]."""
    way = x.row(1) - x.row(0)
    return way.dot(way)


def point_off_line(x: Attribute) -> Attribute:
    """Squared distance of point 0 and the line 1 2 [m^2]."""
    edge = x.row(2) - x.row(1)
    across = (x.row(1) - x.row(0)).cross(edge)
    return across.dot(across) / edge.dot(edge)


def point_off_plane(x: Attribute) -> Attribute:
    """Squared distance of point 0 and the plane 1 2 3 [m^2]."""
    normal = (x.row(2) - x.row(1)).cross(x.row(3) - x.row(1))
    return (x.row(0) - x.row(1)).dot(normal) ** 2 / normal.dot(normal)


def lines_apart(x: Attribute) -> Attribute:
    """Squared distance of the lines 0 1 and 2 3 [m^2]."""
    normal = (x.row(1) - x.row(0)).cross(x.row(3) - x.row(2))
    return (x.row(2) - x.row(0)).dot(normal) ** 2 / normal.dot(normal)


Distance = Callable[[Attribute], Attribute]
KINDS: dict[str, tuple[int, Distance, tuple[int, int, int, int] | None]] = {  # arity, distance, ends of parallel edges
    "point_point": (2, points_apart, None),
    "point_edge": (3, point_off_line, None),
    "point_triangle": (4, point_off_plane, None),
    "edge_edge": (4, lines_apart, None),
    "mollified_edge_edge": (4, lines_apart, (0, 1, 2, 3)),
    "mollified_point_edge": (4, point_off_line, (0, 3, 1, 2)),
    "mollified_point_point": (4, points_apart, (0, 2, 1, 3)),
}


def add_barrier(mesh: Mesh, vertices: PrimitiveUnion, kind: str) -> Primitive:
    """Pairs of one kind and their energy (paper, eq. 8)."""
    arity, squared_distance, ends = KINDS[kind]
    pairs = mesh.add_primitive(kind, 0, is_dynamic=True)
    corners = pairs.add_connectivity("vertices", vertices, [], arity)
    x = pairs.add_attribute("positions", through=corners, source=vertices["position"])
    distance, reach = squared_distance(x), kit.DISTANCE**2
    energy = pairs.add_constant("weight", 1, 1) * KAPPA * ((distance - reach) * (distance / reach).log()) ** 2
    if ends is not None:
        rest = pairs.add_attribute("rest_positions", through=corners, source=vertices["rest_position"])
        (u, v), (u_rest, v_rest) = (
            (y.row(ends[1]) - y.row(ends[0]), y.row(ends[3]) - y.row(ends[2])) for y in (x, rest)
        )
        crossed = u.cross(v).dot(u.cross(v)) / (1e-3 * u_rest.dot(u_rest) * v_rest.dot(v_rest))
        energy = energy * crossed * (2 - crossed)
    mesh.scene.add_energy(pairs.add_attribute("barrier", computed_attribute=energy))
    return pairs


# --- Newton iteration ---
class World:
    """Bodies, contact between them, and steps of backward Euler."""

    def __init__(self, scene: Scene, bodies: Sequence[Body]) -> None:
        """At rest."""
        self.scene, self.bodies, self.time = scene, list(bodies), 0.0
        self.tolerance, self.linear_tolerance = kit.TOLERANCE, 1e-4  # m/s; of the squared preconditioned norm
        self.targets = [target for body in bodies for target in body.targets]
        scene.add_minimize_target(self.targets)
        self.fixed = {target: instances for body in bodies for target, instances in body.fixed.items()}
        self.velocities = [np.zeros_like(body.rest) for body in bodies]
        everything = scene.add_mesh("everything")
        union = everything.add_primitive_union("vertices", [body.vertices for body in bodies])
        self.position = union.add_attribute("position")
        union.add_attribute("rest_position")
        self.pairs = {kind: add_barrier(everything, union, kind) for kind in KINDS}
        groups = [-1 if body.meets_itself else number for number, body in enumerate(bodies)]
        self.geometry = CollisionGeometry(
            np.concatenate([body.rest for body in bodies]),
            np.concatenate([body.triangles + start for body, start in zip(bodies, union.offsets(), strict=False)]),
            kit.DISTANCE,
            group=np.repeat(groups, [len(body.rest) for body in bodies]),
        )
        self.geometry.check_intersection_free(self.positions())

    def positions(self) -> Floats:
        """Of all vertices [m], [n, 3]."""
        return self.position.compute().array.reshape(-1, 3)

    def energy(self, x: Floats) -> float:
        """With the pairs that are close at these positions, where the targets are now [J]."""
        for kind, pairs in self.geometry.active_set(x).kinds().items():
            self.pairs[kind].update(vertices=pairs.vertices, weight=pairs.weight)
        return self.scene.total_energy()

    def move(self, starts: Sequence[Floats], uphill: Sequence[Floats], length: float) -> Floats:
        """Positions after a step of this length against x of H x = g."""
        for target, start, direction in zip(self.targets, starts, uphill, strict=True):
            target.update_value(start - length * direction)
        return self.positions()

    def step(self) -> int:
        """One step; how many Newton iterations it took. Raises NotConvergedError."""
        dt = float(self.scene["time_step"].value[0])
        before = [body.positions() for body in self.bodies]
        for body, x, velocity in zip(self.bodies, before, self.velocities, strict=True):
            body.vertices["predicted"].update_value(x + dt * velocity)
        for iteration in range(1, 501):
            starts, here = [target.value for target in self.targets], self.positions()
            energy = self.energy(here)
            uphill = self.scene.minimize_energy(self.linear_tolerance, fixed=self.fixed)
            there = self.move(starts, uphill, 1.0)
            is_last = bool(np.linalg.norm(there - here, axis=1).max() < self.tolerance * dt)
            length = self.geometry.step_bound(here, there, start_is_free=True)
            while self.energy(self.move(starts, uphill, length)) > energy + 1e-15 * abs(energy):
                length /= 2
                if length < 1e-12:
                    raise NotConvergedError(f"no step along the Newton direction lowers the energy {energy:.6g} J")
            if is_last:
                self.velocities = [(body.positions() - x) / dt for body, x in zip(self.bodies, before, strict=True)]
                self.time += dt
                return iteration
        raise NotConvergedError("no convergence in 500 Newton iterations")

    # --- Program ---
    contact = None

    def velocity_of(self, body: Body) -> Floats:
        """[n, 3] in m/s."""
        return self.velocities[self.bodies.index(body)]

    def contact_forces(self) -> Never:
        """Nobody reads them out here. Raises SceneError."""
        raise SceneError("forces of contact are read out of a Simulation; this world is made by hand")

    def motion(self) -> float:
        """The kinetic energy [J]."""
        masses = [body.vertices["mass"].value for body in self.bodies]
        return sum(0.5 * float(m @ (v * v).sum(axis=1)) for m, v in zip(masses, self.velocities, strict=True))


# --- Initialisation ---
def build(options: Options) -> World:
    """The bunny between the lower cloth and the others."""
    scene = PROGRAM.scene(options)
    scene.add_constant("time_step", 1, 1, value=options.dt)
    shape = common.bunny_shape(options.size, options.mesh).translated((0.0, 0.0, kit.LIFT))
    bodies = [add_soft_bunny(scene, "bunny", shape, mass=kit.MASS, moduli=(kit.YOUNGS_MODULUS, kit.POISSON_RATIO))]
    for number in range(options.cloths + 1):
        width, height = (kit.UPPER_WIDTH, 2.0 * number - 0.2) if number else (kit.WIDTH, 0.0)
        sheet = cloth_grid((width, width), (options.size, options.size), height)
        stiffness = kit.STRETCH, kit.SHEAR, kit.BENDING
        bodies.append(add_cloth(scene, f"cloth_{number}", sheet, kit.MASS, stiffness, is_held=number == 0))
    return World(scene, bodies)


# --- Program ---
def run(program: SceneProgram, arguments: Sequence[str] | None, build: Callable[[Options], World]) -> int:
    """All steps, the results file, and the check of the end. Raises SceneError for `--resume`, CheckFailedError."""
    options = program.options(arguments)
    if options.resume:
        raise SceneError(f"--resume: {program.name} is made by hand and writes no checkpoints; begin again without it")
    world = build(options)
    if options.seed:  # each vertex moves by at most a hundredth of the activation distance in the first step
        random, speed = np.random.default_rng(options.seed), 1e-2 * kit.DISTANCE / options.dt / np.sqrt(3.0)
        world.velocities = [speed * random.uniform(-1.0, 1.0, velocity.shape) for velocity in world.velocities]
    view = common.VIEW
    with FrameRecorder(
        world, options.output, program.name, pictures=not options.headless, view_direction=view
    ) as files:
        files.record(world)
        iterations = 0
        for _ in range(options.frames):
            iterations += world.step()
            world.geometry.check_intersection_free(world.positions())
            files.record(world)
    masses = {body.name: body.vertices["mass"].value for body in world.bodies}
    print(common.check_end(world.bodies, masses, world.motion()))
    print(f"{options.frames} frames: {iterations} Newton iterations")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run cloths_on_bunny_by_hand`."""
    return run(PROGRAM, arguments, build)


if __name__ == "__main__":
    sys.exit(main())
