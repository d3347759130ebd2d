"""What can be said of a simulation's state by others than yasps: intersections and distances, by ipctk."""

from __future__ import annotations

import ipctk
import numpy as np
from exact_pairs import distance
from numpy.typing import NDArray

from yasps.bodies import Body, HalfSpace
from yasps.simulation import Simulation

Floats = NDArray[np.float64]


def bodies_with_surface(simulation: Simulation) -> list[Body]:
    """All but half-spaces."""
    return [body for body in simulation.bodies if not isinstance(body, HalfSpace)]


def collision_mesh(simulation: Simulation) -> tuple[ipctk.CollisionMesh, Floats, NDArray[np.int32]]:
    """ipctk's mesh of all surfaces, the positions now, and the number of each vertex' body."""
    bodies = bodies_with_surface(simulation)
    counts = [len(body.rest) for body in bodies]
    starts = np.cumsum([0, *counts])[:-1]
    points = np.asfortranarray(np.concatenate([body.positions() for body in bodies]))
    faces = np.concatenate([body.triangles + start for body, start in zip(bodies, starts, strict=True)])
    faces = np.asfortranarray(faces.astype(np.int32))
    return ipctk.CollisionMesh(points, ipctk.edges(faces), faces), points, np.repeat(np.arange(len(bodies)), counts)


def surfaces_intersect(simulation: Simulation) -> bool:
    """Whether surfaces cross or touch, or a vertex is in a half-space."""
    mesh, points, _ = collision_mesh(simulation)
    if ipctk.has_intersections(mesh, points, ipctk.BruteForce()):
        return True
    return any(
        float(((body.positions() - half_space.plane.point) @ np.array(half_space.plane.normal)).min()) <= 0.0
        for half_space in simulation.bodies
        if isinstance(half_space, HalfSpace)
        for body in bodies_with_surface(simulation)
        if not body.is_fixed
    )


def least_distance_between_bodies(simulation: Simulation) -> float:
    """Least distance of two surfaces of different bodies that are near each other [m], rounded once; infinite if none
    are. ipctk says which pieces are near, but not how far apart: its distance of edges that are nearly parallel may be
    0 where they are not."""
    mesh, points, owner = collision_mesh(simulation)
    # A filter in Python would wait for the interpreter that waits for ipctk's threads.
    mesh.can_collide = ipctk.make_vertex_patches_filter(owner.astype(np.int32))
    near = ipctk.Candidates()
    near.build(mesh, points, 0.5 * simulation.activation_distance, ipctk.BruteForce())
    return min(
        (
            distance(points[pair.vertex_ids(mesh.edges, mesh.faces)], is_triangle)
            for pairs, is_triangle in ((near.ee_candidates, False), (near.fv_candidates, True))
            for pair in pairs
        ),
        default=np.inf,
    )


def contact_forces_on(simulation: Simulation, body: Body) -> Floats:
    """Contact forces on the vertices of a body [N], [n, 3], normal and tangential together."""
    forces = simulation.contact_forces()
    return np.asarray(forces.on_vertices()[forces.body_of == forces.number_of(body.name)])
