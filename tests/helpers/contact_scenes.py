"""Scenes of bodies that touch, soft or affine, all of one structure each, so that they compile once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ipctk
import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, Primitive, Scene
from yasps.frontend import materials
from yasps.frontend.contact import BarrierContact
from yasps.frontend.newton import BackwardEuler, MovingPart, NewtonSettings
from yasps.frontend.shapes import TriangleMesh
from yasps.frontend.tetrahedral_mesh import TetrahedralMesh

Floats = NDArray[np.float64]
KINDS = ("soft", "affine")
STEP = 0.01  # s


@dataclass(frozen=True)
class Body:
    """One body: its shape where it starts, velocity [m/s], density [kg/m^3]."""

    shape: TetrahedralMesh
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density: float = 1000.0


@dataclass(frozen=True)
class ContactScene:
    """Bodies and what stands still, with a stepper."""

    scene: Scene
    stepper: BackwardEuler
    contact: BarrierContact
    still: Attribute
    """Positions of what stands still."""
    triangles: NDArray[np.int32]
    masses: Floats

    def mean_velocity(self) -> Floats:
        """Momentum over mass, [3]."""
        return self.stepper.momentum() / self.masses.sum()

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
    gravity: ArrayLike = (0.0, 0.0, -9.8),
    youngs_modulus: float = 1e5,
    settings: NewtonSettings = NewtonSettings(),
    rest: ArrayLike | None = None,
) -> ContactScene:
    """Builds the scene. All numbers that differ between scenes are constants of it, and none is in a formula.

    distance: of activation [m]; force: scale of a pair's force [N]. rest: positions of all vertices at rest, for
    contact. settings: by default the stepper's own defaults.
    """
    scene = Scene(kind)
    mesh = scene.add_mesh("bodies")
    mesh.add_constant("step", 1, 1, value=STEP)
    mesh.add_constant("acceleration", 3, 1, value=gravity)
    shapes = [body.shape for body in bodies]
    masses = np.concatenate([body.shape.vertex_masses(body.density) for body in bodies])
    owner = np.repeat(np.arange(len(shapes)), [len(shape.vertices) for shape in shapes])
    vertices = mesh.add_primitive("vertices", len(owner))
    add = _add_soft if kind == "soft" else _add_affine
    position, falling = add(vertices, shapes, owner, youngs_modulus)
    part = _add_weight_and_inertia(vertices, position, masses, np.concatenate([shape.vertices for shape in shapes]))

    points = np.concatenate([obstacle.vertices for obstacle in obstacles])
    still = scene.add_mesh("obstacles").add_primitive("vertices", len(points))
    still.add_constant("position", 3, 1, value=points)
    everything = scene.add_mesh("everything")
    union = everything.add_primitive_union("vertices", [vertices, still])
    union.add_attribute("position")
    starts = np.cumsum([0, *(len(part.vertices) for part in (*shapes, *obstacles))]).tolist()
    faces = [shape.surface_triangles() for shape in shapes] + [obstacle.triangles for obstacle in obstacles]
    triangles = np.concatenate([part + start for part, start in zip(faces, starts, strict=False)]).astype(np.int32)
    group = np.full(union.num_instances, -1)
    if kind == "affine":
        group[: len(owner)] = owner
    names = [f"body {k}" for k in range(len(shapes))] + [f"obstacle {k}" for k in range(len(obstacles))]
    contact = BarrierContact(
        everything,
        union,
        triangles,
        activation_distance=distance,
        stiffness=force / distance**3,
        fixed=np.arange(union.num_instances) >= len(owner),
        group=group,
        objects=dict(zip(names, np.diff(starts).tolist(), strict=True)),
        **({} if rest is None else {"rest_positions": rest}),
    )
    stepper = BackwardEuler(scene, [part], STEP, contact, accelerations={falling: gravity}, settings=settings)
    stepper.velocities[0][:] = np.array([body.velocity for body in bodies])[owner]
    return ContactScene(scene, stepper, contact, still["position"], triangles, masses)


def _add_soft(
    vertices: Primitive, shapes: Sequence[TetrahedralMesh], owner: NDArray[np.int_], youngs_modulus: float
) -> tuple[Attribute, Attribute]:
    """Free vertices and stable Neo-Hookean tetrahedra; the positions, and the target that falls freely."""
    mesh = vertices.mesh
    points = np.concatenate([shape.vertices for shape in shapes])
    starts = np.searchsorted(owner, np.arange(len(shapes)))
    corners = np.concatenate([shape.tets + start for shape, start in zip(shapes, starts, strict=True)])
    position = vertices.add_attribute("position", 3, 1, value=points)
    tets = mesh.add_primitive("tets", len(corners))
    x = tets.add_attribute(
        "positions", through=tets.add_connectivity("corners", vertices, corners, 4), source=position
    )
    inverse, volume = materials.rest_shape(points, corners)
    f = materials.deformation_gradient(x, tets.add_constant("inverse", 3, 3, value=inverse))
    mu, lam = materials.stable_neo_hookean_parameters(youngs_modulus, 0.4)
    elastic = materials.stable_neo_hookean(
        f,
        mesh.add_constant("mu", 1, 1, value=mu),
        mesh.add_constant("lambda", 1, 1, value=lam),
        tets.add_constant("volume", 1, 1, value=volume),
    )
    mesh.scene.add_energy(tets.add_attribute("elastic", computed_attribute=elastic))
    mesh.scene.add_minimize_target(position)
    return position, position


def _add_affine(
    vertices: Primitive, shapes: Sequence[TetrahedralMesh], owner: NDArray[np.int_], youngs_modulus: float
) -> tuple[Attribute, Attribute]:
    """One affine body for each shape, 100 times as stiff; the positions, and the target that falls freely."""
    mesh = vertices.mesh
    centers = np.array([shape.vertices.mean(axis=0) for shape in shapes])
    points = np.concatenate([shape.vertices for shape in shapes])
    body = mesh.add_primitive("body", len(shapes))
    matrix = body.add_attribute("matrix", 3, 3, value=np.tile(np.eye(3), (len(shapes), 1, 1)))
    translation = body.add_attribute("translation", 3, 1, value=centers)
    volumes = np.array([shape.volumes().sum() for shape in shapes])
    stiffness = body.add_constant("stiffness", 1, 1, value=100 * youngs_modulus * volumes)
    energy = materials.affine_orthogonality(matrix, stiffness)
    mesh.scene.add_energy(body.add_attribute("orthogonality", computed_attribute=energy))
    of_body = vertices.add_connectivity("of_body", body, owner, 1)
    rest = vertices.add_constant("rest", 3, 1, value=points - centers[owner])
    own_matrix = vertices.add_attribute("matrix", through=of_body, source=matrix).reshape(3, 3)
    own_translation = vertices.add_attribute("translation", through=of_body, source=translation).reshape(3, 1)
    position = vertices.add_attribute("position", computed_attribute=own_matrix * rest + own_translation)
    mesh.scene.add_minimize_target([matrix, translation])
    return position, translation


def _add_weight_and_inertia(vertices: Primitive, position: Attribute, masses: Floats, start: Floats) -> MovingPart:
    mesh = vertices.mesh
    mass = vertices.add_constant("mass", 1, 1, value=masses)
    predicted = vertices.add_constant("predicted", 3, 1, value=start)
    weight = -(mass * position.dot(mesh["acceleration"]))
    inertia = materials.inertia(position, predicted, mass, mesh["step"])
    mesh.scene.add_energy(vertices.add_attribute("weight", computed_attribute=weight))
    mesh.scene.add_energy(vertices.add_attribute("inertia", computed_attribute=inertia))
    return MovingPart(position, predicted, mass)
