"""Scenes of bodies that touch, soft and affine.

They all have the structure of the example `two_bunnies`, down to the names, so that code that was compiled for any of
them serves all others: it depends neither on the shapes nor on how many there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ipctk
import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, Mesh, Primitive, Scene, materials
from yasps.contact import BarrierContact
from yasps.meshes import TetrahedralMesh, TriangleMesh
from yasps.stepping import MovingPart, NewtonReport, NewtonSettings, TimeStepper

Floats = NDArray[np.float64]
STEP = 0.01  # s
GRAVITY = 9.8  # m/s^2
YOUNGS_MODULUS = {"soft": 1e5, "affine": 1e7}  # Pa
KINDS = tuple(YOUNGS_MODULUS)
GRAIN = TetrahedralMesh(
    0.05 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) + 100.0, np.array([[0, 1, 2, 3]])
)
"""Far away, where a scene has no body of a kind."""
DEFAULT = NewtonSettings()


@dataclass(frozen=True)
class Body:
    """One body: its shape at rest, velocity [m/s], density [kg/m^3]; where its vertices start, if not at rest."""

    shape: TetrahedralMesh
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density: float = 1000.0
    start: Floats | None = None

    def positions(self) -> Floats:
        return self.shape.vertices if self.start is None else self.start


@dataclass(frozen=True)
class ContactScene:
    """Bodies of one kind and what stands still, with a stepper."""

    scene: Scene
    stepper: TimeStepper
    contact: BarrierContact
    moving: Attribute
    """Positions of the bodies' vertices."""
    still: Attribute
    """Positions of what stands still."""
    triangles: NDArray[np.int32]
    part: int
    """Which of the stepper's parts the bodies are."""

    def step(self) -> NewtonReport:
        """One time step. The grain gets no velocity: what falls fast takes accuracy from the linear solver's others."""
        report = self.stepper.step()
        self.stepper.velocities[1 - self.part][:] = 0.0
        return report

    def mean_velocity(self) -> Floats:
        """Momentum over mass of the bodies, [3]."""
        mass: Floats = self.stepper.parts[self.part].mass.value
        return np.asarray(mass @ self.stepper.velocities[self.part] / mass.sum())

    def intersects(self) -> bool:
        """Whether surfaces cross or touch, as ipctk sees it."""
        points = np.asfortranarray(self.contact.positions())
        faces = np.asfortranarray(self.triangles)
        mesh = ipctk.CollisionMesh(points, ipctk.edges(faces), faces)
        return bool(ipctk.has_intersections(mesh, points, ipctk.BruteForce()))


def contact_scene(
    kind: str,
    bodies: Sequence[Body],
    obstacles: Sequence[TriangleMesh],
    *,
    distance: float = 1e-3,
    force: float = 10.0,
    youngs_modulus: float | None = None,
    settings: NewtonSettings = DEFAULT,
    rest_positions: ArrayLike | None = None,
) -> ContactScene:
    """Builds a scene of soft or affine bodies above obstacles.

    distance: of activation [m]; force: scale of a pair's force [N]. rest_positions: of contact.
    """
    scene = Scene("two_bunnies")
    spare = [Body(GRAIN)]
    soft, stiff = (bodies, spare) if kind == "soft" else (spare, bodies)
    modulus = YOUNGS_MODULUS | ({} if youngs_modulus is None else {kind: youngs_modulus})
    soft_part = _add_soft(scene.add_mesh("soft"), soft, modulus["soft"])
    stiff_part, translation = _add_stiff(scene.add_mesh("stiff"), stiff, modulus["affine"])
    points = np.concatenate([obstacle.vertices for obstacle in obstacles])
    still = scene.add_mesh("ground").add_primitive("vertices", num_instances=len(points))
    still.add_constant("position", rows=3, cols=1, value=points)

    everything = scene.add_mesh("everything")
    union = everything.add_primitive_union("vertices", [scene.soft.vertices, scene.stiff.vertices, still])
    union.add_attribute("position")
    shapes = [body.shape for body in (*soft, *stiff)]
    counts = [len(shape.vertices) for shape in (*shapes, *obstacles)]
    starts = np.cumsum([0, *counts]).tolist()
    faces = [*(shape.surface_triangles() for shape in shapes), *(obstacle.triangles for obstacle in obstacles)]
    triangles = np.concatenate([part + start for part, start in zip(faces, starts, strict=False)]).astype(np.int32)
    owner = np.repeat(np.arange(len(counts)), counts)
    is_fixed = owner >= len(shapes)
    names = [f"{word} {k}" for word, group in (("soft", soft), ("affine", stiff)) for k in range(len(group))]
    names += [f"obstacle {k}" for k in range(len(obstacles))]
    contact = BarrierContact(
        everything,
        union,
        triangles,
        activation_distance=distance,
        barrier="paper",
        stiffness=force / distance**3,
        rest_positions=rest_positions,
        fixed=is_fixed,
        group=np.where((owner >= len(soft)) & ~is_fixed, owner, -1),
        objects=dict(zip(names, counts, strict=True)),
    )
    scene.add_minimize_target([soft_part.position, scene.stiff.body["affine_matrix"], translation])
    falling = (0.0, 0.0, -GRAVITY)
    stepper = TimeStepper(
        scene,
        [soft_part, stiff_part],
        STEP,
        contact,
        accelerations={soft_part.position: falling, translation: falling},
        settings=settings,
    )
    for velocities, group in zip(stepper.velocities, (soft, stiff), strict=True):
        velocities[:] = np.repeat([body.velocity for body in group], [len(b.shape.vertices) for b in group], axis=0)
    part = KINDS.index(kind)
    return ContactScene(scene, stepper, contact, stepper.parts[part].position, still["position"], triangles, part)


def _add_soft(mesh: Mesh, bodies: Sequence[Body], youngs_modulus: float) -> MovingPart:
    """Free vertices; stable Neo-Hookean tets, inertia and gravity."""
    counts = [len(body.shape.vertices) for body in bodies]
    rest = np.concatenate([body.shape.vertices for body in bodies])
    start = np.concatenate([body.positions() for body in bodies])
    starts = np.cumsum([0, *counts])
    corner_ids = np.concatenate([body.shape.tets + first for body, first in zip(bodies, starts, strict=False)])
    vertices = mesh.add_primitive("vertices", num_instances=len(rest))
    position = vertices.add_attribute("position", rows=3, cols=1, value=start)
    part = _add_weight_and_inertia(vertices, position, bodies)
    tets = mesh.add_primitive("tets", num_instances=len(corner_ids))
    corners = tets.add_connectivity("corners", vertices, corner_ids, 4)
    inverse, volume = materials.rest_shape(rest, corner_ids)
    positions = tets.add_attribute("positions", through=corners, source=position)
    rest_edges_inverse = tets.add_constant("rest_edges_inverse", rows=3, cols=3, value=inverse)
    rest_volume = tets.add_constant("rest_volume", rows=1, cols=1, value=volume)
    mu, lam = materials.stable_neo_hookean_parameters(youngs_modulus, 0.4)
    elastic = materials.stable_neo_hookean(
        materials.deformation_gradient(positions, rest_edges_inverse),
        mesh.add_constant("mu", rows=1, cols=1, value=mu),
        mesh.add_constant("lambda", rows=1, cols=1, value=lam),
        rest_volume,
    )
    mesh.scene.add_energy(tets.add_attribute("stable_neo_hookean", computed_attribute=elastic))
    return part


def _add_stiff(mesh: Mesh, bodies: Sequence[Body], youngs_modulus: float) -> tuple[MovingPart, Attribute]:
    """One affine body for each shape: every vertex is A r + t. Returns the translations, too."""
    counts = [len(body.shape.vertices) for body in bodies]
    owner = np.repeat(np.arange(len(bodies)), counts)
    centers = np.array([body.shape.vertices.mean(axis=0) for body in bodies])
    points = np.concatenate([body.shape.vertices for body in bodies])
    body = mesh.add_primitive("body", num_instances=len(bodies))
    matrix = body.add_attribute("affine_matrix", rows=3, cols=3, value=np.tile(np.eye(3), (len(bodies), 1, 1)))
    translation = body.add_attribute("translation", rows=3, cols=1, value=centers)
    volumes = np.array([one.shape.volumes().sum() for one in bodies])
    stiffness = body.add_constant("stiffness", 1, 1, value=youngs_modulus * volumes)
    energy = materials.affine_orthogonality(matrix, stiffness)
    mesh.scene.add_energy(body.add_attribute("orthogonality", computed_attribute=energy))
    vertices = mesh.add_primitive("vertices", num_instances=len(points))
    of_body = vertices.add_connectivity("of_body", body, owner, 1)
    rest = vertices.add_constant("rest_position", rows=3, cols=1, value=points - centers[owner])
    own_matrix = vertices.add_attribute("affine_matrix", through=of_body, source=matrix).reshape(3, 3)
    own_translation = vertices.add_attribute("translation", through=of_body, source=translation).reshape(3, 1)
    position = vertices.add_attribute("position", computed_attribute=own_matrix * rest + own_translation)
    return _add_weight_and_inertia(vertices, position, bodies), translation


def _add_weight_and_inertia(vertices: Primitive, position: Attribute, bodies: Sequence[Body]) -> MovingPart:
    start = np.concatenate([body.positions() for body in bodies])
    masses = np.concatenate([body.shape.vertex_masses(body.density) for body in bodies])
    predicted = vertices.add_constant("predicted", rows=3, cols=1, value=start)
    mass = vertices.add_constant("mass", rows=1, cols=1, value=masses)
    weight = materials.gravity(position, mass, (0.0, 0.0, -GRAVITY))
    inertia = materials.inertia(position, predicted, mass, STEP)
    vertices.scene.add_energy(vertices.add_attribute("gravity", computed_attribute=weight))
    vertices.scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))
    return MovingPart(position, predicted, mass)
