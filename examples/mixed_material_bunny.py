"""A bunny of four parts: its middle is fixed, its ends are affine bodies, all else is soft (the paper, 9.4).

Ears and feet have been spun in opposite directions; what is soft between them and the middle swings them to and fro.

Each part is a primitive of its own: vertices that are stored variables, vertices that follow one of two affine bodies,
and constants. A UNION makes one primitive of all of them, and what is written on that knows nothing of parts: inertia,
gravity and contact by the kit, and here the elastic energy, of tetrahedra whose corners may be of any part.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yasps import Scene, materials
from yasps.bodies import Body
from yasps.contact import narrowest_gap
from yasps.meshes import TetrahedralMesh, rabbit, read_tetrahedral_mesh, signed_volumes
from yasps.parameterisations import affine_position
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation
from yasps.stepping import BDF2, NewtonSettings

HEIGHT = 0.2  # m, of the bunny
END, MIDDLE = 0.25, 0.06  # shares of the height: of each affine body, and of what is fixed
DENSITY, YOUNGS_MODULUS, POISSON_RATIO = 1000.0, 1e4, 0.4  # kg/m^3, Pa, none; of what is soft
STIFF_MODULUS = 1e7  # Pa, of the ends
SPIN = 25.0  # rad/s, of the upper end at the start; the lower one turns the other way
DISTANCE = 5e-4  # m, of activation, or less where the bunny is narrower itself
STIFF = 1e-2  # strain that an end may have
TOLERANCE = 2e-3  # m/s, of Newton's method
GRAVITY = 9.8  # m/s^2

PROGRAM = SceneProgram(
    "mixed_material_bunny",
    __doc__,
    frames=100,
    time_step=0.005,
    size=3000,
    size_means="vertices of the rabbit",
    mesh_means="tetrahedral mesh of a bunny, y up, instead of the rabbit",
)


def height_share(shape: TetrahedralMesh) -> NDArray[np.float64]:
    """How high each vertex is, from 0 at the feet to 1 at the ears."""
    height = shape.vertices[:, 2]
    return np.asarray((height - height.min()) / np.ptp(height))


class MixedBunny(Body):
    """`soft`, `stiff` and `fixed`: the vertices of the parts; `ends`: two affine bodies; `vertices`: the UNION."""

    def __init__(self, scene: Scene, name: str, shape: TetrahedralMesh) -> None:
        """Adds the bunny where the mesh lies; the parts lie above each other."""
        share = height_share(shape)
        parts = {"stiff": np.abs(share - 0.5) >= 0.5 - END, "fixed": np.abs(share - 0.5) <= 0.5 * MIDDLE}
        parts["soft"] = ~(parts["stiff"] | parts["fixed"])
        # Members of a UNION follow each other, so vertices are numbered part by part.
        order = np.concatenate([np.flatnonzero(parts[part]) for part in ("soft", "stiff", "fixed")])
        place = np.argsort(order).astype(np.int32)
        shape = TetrahedralMesh(shape.vertices[order], place[shape.tets])
        of = {part: shape.vertices[is_in[order]] for part, is_in in parts.items()}
        mass = shape.vertex_masses(DENSITY)
        super().__init__(scene, name, shape.vertices)
        self.contact_modulus = YOUNGS_MODULUS
        self.cells, self.triangles = {"tetra": shape.tets}, shape.surface_triangles()

        # Each vertex of what is soft is a variable of its own.
        soft = self.mesh.add_primitive("soft", num_instances=len(of["soft"]))
        free = soft.add_attribute("position", rows=3, cols=1, value=of["soft"])

        # Each vertex of an end is A r + t of one of two affine bodies.
        end_of = (of["stiff"][:, 2] > of["fixed"][:, 2].mean()).astype(int)
        centers = np.array([of["stiff"][end_of == end].mean(axis=0) for end in (0, 1)])
        self.ends = self.mesh.add_primitive("ends", num_instances=2)
        self.matrix = self.ends.add_attribute("affine_matrix", rows=3, cols=3, value=[np.eye(3)] * 2)
        translation = self.ends.add_attribute("translation", rows=3, cols=1, value=centers)
        stiffnesses = STIFF_MODULUS * np.bincount(end_of, mass[parts["stiff"][order]]) / DENSITY
        stiffness = self.ends.add_constant("stiffness", 1, 1, value=stiffnesses)
        rigid = materials.affine_orthogonality(self.matrix, stiffness)
        self.add_energy(self.ends.add_attribute("orthogonality", computed_attribute=rigid))
        stiff = self.mesh.add_primitive("stiff", num_instances=len(of["stiff"]))
        of_end = stiff.add_connectivity("of_end", self.ends, end_of, 1)
        a, t = (stiff.add_attribute(n, through=of_end, source=self.ends[n]) for n in ("affine_matrix", "translation"))
        from_center = stiff.add_constant("from_center", rows=3, cols=1, value=of["stiff"] - centers[end_of])
        stiff.add_attribute("position", computed_attribute=affine_position(a, t, from_center))

        # The middle is constant.
        self.fixed = self.mesh.add_primitive("fixed", num_instances=len(of["fixed"]))
        self.fixed.add_constant("position", rows=3, cols=1, value=of["fixed"])

        # From here on there are only vertices.
        self.vertices = self.mesh.add_primitive_union("vertices", [soft, stiff, self.fixed])
        position = self.vertices.add_attribute("position")
        self.vertices.add_constant("rest_position", rows=3, cols=1, value=shape.vertices)
        self.vertices.add_constant("mass", rows=1, cols=1, value=mass)
        tets = shape.tets[(shape.tets < len(of["soft"])).any(axis=1)]  # the others can't be deformed by anything
        elements = self.mesh.add_primitive("tets", num_instances=len(tets))
        corners = elements.add_connectivity("corners", self.vertices, tets, 4)
        x = elements.add_attribute("positions", through=corners, source=position)
        inverse, volumes = materials.rest_shape(shape.vertices, tets)
        gradient = materials.deformation_gradient(x, elements.add_constant("inverse", 3, 3, value=inverse))
        mu, lam = materials.stable_neo_hookean_parameters(YOUNGS_MODULUS, POISSON_RATIO)
        rest_volume = elements.add_constant("rest_volume", 1, 1, value=volumes)
        elastic = materials.stable_neo_hookean(gradient, mu, lam, rest_volume)
        self.add_energy(elements.add_attribute("elastic", computed_attribute=elastic))

        self.targets, self.falling = (free, self.matrix, translation), (free, translation)
        self.arms = {self.matrix: float(np.linalg.norm(of["stiff"] - centers[end_of], axis=1).max())}


def bunny(options: Options) -> TetrahedralMesh:
    """The bunny, its middle at the origin."""
    if options.mesh is None:
        shape = rabbit(options.size)
    else:
        shape = read_tetrahedral_mesh(options.mesh).rotated((1.0, 0.0, 0.0), 0.5 * np.pi)
    low, high = shape.bounds
    return shape.translated(-0.5 * (low + high)).scaled(HEIGHT / (high - low)[2])


def start_velocities(mixed: MixedBunny) -> NDArray[np.float64]:
    """Of all vertices [m/s], [n, 3]: turning about the z axis, faster and faster from the middle to the ends."""
    inner, outer = 0.5 * MIDDLE, 0.5 - END
    spin = SPIN * np.interp(mixed.rest[:, 2] / HEIGHT, [-outer, -inner, inner, outer], [-1.0, 0.0, 0.0, 1.0])
    return np.asarray(spin[:, None] * np.cross([0.0, 0.0, 1.0], mixed.rest))


def build(options: Options) -> Simulation:
    """The bunny alone, its ears and feet turning about the z axis."""
    scene = PROGRAM.scene(options)
    shape = bunny(options)
    mixed = MixedBunny(scene, "bunny", shape)
    return Simulation(
        scene,
        [mixed],
        time_step=options.dt,
        gravity=(0.0, 0.0, -GRAVITY),
        activation_distance=min(DISTANCE, 0.8 * narrowest_gap(shape, 2 * DISTANCE)),
        velocities={mixed: start_velocities(mixed)},
        integrator=BDF2,
        settings=NewtonSettings(velocity_tolerance=TOLERANCE, max_iterations=500),
    )


def turns(mixed: MixedBunny) -> NDArray[np.float64]:
    """How far each end has turned about the z axis [rad], [2]."""
    matrices = mixed.matrix.value.reshape(2, 3, 3)
    return np.arctan2(matrices[:, 1, 0] - matrices[:, 0, 1], matrices[:, 0, 0] + matrices[:, 1, 1])


def check(simulation: Simulation, options: Options) -> str:
    """Each part is what it is said to be, nothing is inside out, and no motion came from nowhere."""
    (mixed,) = simulation.moving
    assert isinstance(mixed, MixedBunny)
    x, fixed = mixed.positions(), mixed.fixed
    if not np.array_equal(x[-fixed.num_instances :], mixed.rest[-fixed.num_instances :]):
        raise CheckFailedError("the middle has moved")
    matrices = mixed.matrix.value.reshape(2, 3, 3)
    strain = float(np.abs(matrices.transpose(0, 2, 1) @ matrices - np.eye(3)).max())
    if strain > STIFF:
        raise CheckFailedError(f"an end is strained by {strain:.2g}, though it is stiff")
    volumes = signed_volumes(x, mixed.cells["tetra"]) / signed_volumes(mixed.rest, mixed.cells["tetra"])
    if volumes.min() <= 0.0:
        raise CheckFailedError(f"tetrahedron {volumes.argmin()} is inside out")
    mass = mixed.mass.value
    given = 0.5 * float(mass @ (start_velocities(mixed) ** 2).sum(axis=1))
    given += GRAVITY * float(mass @ (mixed.rest - x)[:, 2])
    motion = simulation.stepper.kinetic_energy()
    if motion > given * (1 + 1e-6):
        raise CheckFailedError(f"the bunny moves with {motion:.6g} J, but was given {given:.6g} J by spin and weight")
    feet, ears = np.degrees(turns(mixed))
    return (
        f"after {simulation.time:.3f} s ears and feet have turned by {ears:.0f} and {feet:.0f} degrees; the middle has"
        f" not moved, ends are strained by {strain:.1g}, the flattest tetrahedron has {volumes.min():.2f} of its volume"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `yasps run mixed_material_bunny`."""
    return PROGRAM.run(arguments, build, check, view_direction=(1.0, -0.6, 0.4), speed=0.3)


if __name__ == "__main__":
    sys.exit(main())
