"""Intersection-free contact: IPC barrier energies over the vertices of a scene, whatever parameterises them.

The energies are written once, over a primitive union of vertices; JOIN and UNION carry their derivatives to free
vertices, affine bodies or anything else. Collision geometry (which pairs are close, how far a step may go) is in
collision_geometry.py.

Li et al. 2020; paper, section 4.6.3 and eq. 8. Distances enter squared.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, FloatArray, IntersectionError, Mesh, Primitive, PrimitiveBase, PrimitiveUnion, SceneError
from yasps.contact.active_set import ActiveSet, Pairs
from yasps.contact.collision_geometry import Candidates, CollisionGeometry
from yasps.contact.kinds import KINDS
from yasps.contact.surface_arguments import checked_points
from yasps.frontend.language.arrays import positive_number
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.scene_lock import one_thread_at_a_time

LOGGER = logging.getLogger("yasps")


def barrier(squared_distance: Attribute, squared_reach: Attribute, stiffness: Attribute) -> Attribute:
    """kappa (D - H)^2 log(D / H)^2 of a squared distance 0 < D < H = d_hat^2 (paper, eq. 8).

    It grows without bound as D goes to 0 and reaches 0 at H with three continuous derivatives. stiffness [J/m^4].
    """
    gap = squared_distance - squared_reach
    ratio = (squared_distance / squared_reach).log()
    return stiffness * gap * gap * ratio * ratio


def mollifier(first: Attribute, second: Attribute, threshold: Attribute) -> Attribute:
    """(c/e) (2 - c/e) with c = |u x v|^2 < e: takes the barrier of two edges to 0 as they become parallel.

    Li et al. 2020, eq. 24. threshold e = 1e-3 |U|^2 |V|^2 of the edges at rest.
    """
    normal = first.cross(second)
    ratio = normal.dot(normal) / threshold
    return ratio * (2 - ratio)


MARGIN = 0.25
"""Ways that leave another by less than this many activation distances share its candidates: a larger margin saves
searches, but brings more pairs to measure at every trial step."""


class BarrierContact(InScene):
    """Contact of a scene's surface with itself: one dynamic primitive and one energy for each kind of close pair.

    mesh: where the primitives are added (and its constants `squared_reach` [m^2] and `stiffness` [J/m^4]).
    vertices: a primitive or union with a 3x1 attribute `position`. triangles: [m, 3] into it, the whole surface; edges:
    [k, 2], those of rods and curves, which are in no triangle. Vertices in none of them take no part, which the logger
    `yasps` says (level INFO); an object all of whose vertices are loose is refused.
    activation_distance: pairs closer than this repel [m]. stiffness [J/m^4]: kappa of eq. 8.
    rest_positions: [n, 3], where all vertices are at rest: the edges' lengths there say from when on two edges count as
    parallel. Default: the positions now, which is right if nothing is deformed now.
    fixed: [n] bool, vertices that no energy moves. group: [n] int, pairs inside one group (of a stiff body, say) don't
    repel; negative means no group. objects: name -> number of vertices in order, for messages; default: the members
    of the union.

    Every state that `minimize` accepts is joined to the one before it by a way without collision. Positions that were
    changed from outside in between are held against the last accepted ones, see `check_way` and `reset`.

    Raises SceneError, DataError, ConnectivityError, NameTakenError, IntersectionError (if surfaces intersect now);
    nothing is added then.
    """

    def __init__(
        self,
        mesh: Mesh,
        vertices: PrimitiveBase,
        triangles: ArrayLike,
        *,
        activation_distance: float,
        stiffness: float,
        edges: ArrayLike | None = None,
        rest_positions: ArrayLike | None = None,
        fixed: ArrayLike | None = None,
        group: ArrayLike | None = None,
        objects: Mapping[str, int] | None = None,
        projection: str = "clamp",
    ) -> None:
        stiffness = positive_number(stiffness, "contact stiffness", "J/m^4", SceneError)
        for name in ("squared_reach", "stiffness", "at_rest", *KINDS):
            mesh.check_child_name(name, "a part of contact")
        self.position = vertices["position"]
        if self.position.shape != (3, 1):
            raise SceneError(f"contact needs 3x1 positions, but {self.position.path} is {self.position.shape}")
        self._lock = mesh.scene.lock
        positions = self.positions()
        objects = _members_of(vertices) if objects is None else objects
        rest = positions if rest_positions is None else checked_points(rest_positions, "rest_positions", len(positions))
        self.geometry = CollisionGeometry(
            rest,
            triangles,
            activation_distance,
            edges=edges,
            fixed=fixed,
            group=group,
            objects=objects,
            runtime=mesh.scene.runtime,
        )
        self.geometry.check_intersection_free(positions)
        _announce_loose_vertices(self.geometry, objects)
        reach = mesh.add_constant("squared_reach", 1, 1, value=activation_distance**2)
        kappa = mesh.add_constant("stiffness", 1, 1, value=stiffness)
        at_rest = mesh.add_primitive("at_rest", len(rest))
        rest_position = at_rest.add_constant("position", 3, 1, value=rest)
        self.primitives: dict[str, Primitive] = {}
        for name, kind in KINDS.items():
            primitive = mesh.add_primitive(name, 0, is_dynamic=True)
            pairs = primitive.add_connectivity("vertices", vertices, [], kind.arity)
            x = primitive.add_attribute("positions", through=pairs, source=self.position)
            weight = primitive.add_constant("weight", 1, 1)
            energy = weight * barrier(kind.squared_distance(x), reach, kappa)
            if kind.edges is not None:
                same = primitive.add_connectivity("at_rest", at_rest, [], kind.arity)
                x0 = primitive.add_attribute("rest_positions", through=same, source=rest_position)
                (a, b), (c, d) = kind.edges
                first, second = x0.row(b) - x0.row(a), x0.row(d) - x0.row(c)
                threshold = 1e-3 * first.dot(first) * second.dot(second)
                energy = energy * mollifier(x.row(b) - x.row(a), x.row(d) - x.row(c), threshold)
            mesh.scene.add_energy(primitive.add_attribute("barrier", computed_attribute=energy), projection=projection)
            self.primitives[name] = primitive
        self._given: dict[str, Pairs] = {}
        self._kept: Candidates | None = None
        self._where = positions
        self._accepted = positions
        self.active = self.geometry.active_set(positions)
        self._apply(self.active)

    def positions(self) -> FloatArray:
        """Current positions of all vertices, [n, 3]."""
        return self.position.compute().array.reshape(-1, 3)

    def accept(self, positions: FloatArray) -> None:
        """Notes that the vertices came to these positions [n, 3] on a way that was free of collisions."""
        self._accepted = np.array(positions)

    @one_thread_at_a_time
    def check_way(self, positions: FloatArray | None = None) -> None:
        """Looks for collisions on the straight way from the positions last accepted to these, by default the present
        ones, and accepts these.

        `minimize` and `BackwardEuler.step` do so before anything else. Raises IntersectionError that names the vertices
        where surfaces meet on the way or nearly do (see `CollisionGeometry.check_way`); nothing is accepted then.
        """
        where = self.positions() if positions is None else positions
        if np.array_equal(where, self._accepted):
            return
        try:
            self.geometry.check_way(self._accepted, where)
        except IntersectionError as error:
            raise IntersectionError(
                f"positions were changed since the last step (by update_value?), and something is in the way: {error}."
                " Move things by smaller steps, or round what is in the way; if this was a jump, such as a reset, say"
                " so by reset() of the contact"
            ) from error
        self.accept(where)

    @one_thread_at_a_time
    def reset(self) -> None:
        """Takes the present positions for a new start, whatever lies between them and the last ones.

        Raises IntersectionError if surfaces cross or touch there; the last positions are kept then.
        """
        where = self.positions()
        self.geometry.check_intersection_free(where)
        self.update(where)
        self.accept(where)

    @one_thread_at_a_time
    def update(self, positions: FloatArray | None = None, candidates: Candidates | None = None) -> ActiveSet:
        """Finds the close pairs at the current positions and gives them to the scene.

        Costs next to nothing at the positions of the last update. A kind whose pairs are the same as before is left
        alone, so that the sparsity of the Hessian is not worked out again for nothing.
        """
        where = self.positions() if positions is None else positions
        if not np.array_equal(where, self._where):
            self.active = self.geometry.active_set(where, candidates)
            self._where = np.array(where)
            self._apply(self.active)
        return self.active

    @one_thread_at_a_time
    def free_step(self, start: FloatArray, end: FloatArray) -> tuple[float, Candidates]:
        """Largest step in [0, 1] from start straight towards end [n, 3] that is free of collisions, and the pairs to
        give to `update` anywhere on that way.

        start must be free of intersections; every earlier step was bounded, so it is. Pairs are found with a margin
        and kept for the next ways, since these get ever shorter while Newton's method converges.
        """
        geometry = self.geometry
        if self._kept is None or not geometry.covers(self._kept, start, end):
            self._kept = geometry.candidates(start, end, margin=MARGIN * geometry.activation_distance)
        if self._is_short(start, end):
            return 1.0, self._kept
        return geometry.step_bound(start, end, self._kept, start_is_free=True), self._kept

    def _is_short(self, start: FloatArray, end: FloatArray) -> bool:
        """Is the way so short that even two vertices that run towards each other keep a tenth of the smallest distance?

        Then the step bound is 1, and no pair has to be looked at. Most ways near a minimum are.
        """
        if not np.array_equal(start, self._where):
            return False
        least = min(self.active.minimum_gap, self.geometry.activation_distance)
        way = end - start
        longest = float(np.sqrt(np.einsum("ij,ij->i", way, way).max(initial=0.0)))
        return 0.0 < 2 * longest <= 0.9 * least

    def _apply(self, active: ActiveSet) -> None:
        for name, pairs in active.kinds().items():
            if name in self._given and pairs.same_as(self._given[name]):
                continue
            self._given[name] = pairs
            parts = {"vertices": pairs.vertices, "weight": pairs.weight}
            if KINDS[name].edges is not None:
                parts["at_rest"] = pairs.vertices
            self.primitives[name].update(**parts)


def _members_of(vertices: PrimitiveBase) -> dict[str, int]:
    """The numbers of vertices of a union's members, or of a primitive."""
    members = vertices.members if isinstance(vertices, PrimitiveUnion) else (vertices,)
    return {member.path: member.num_instances for member in members}


def _announce_loose_vertices(geometry: CollisionGeometry, objects: Mapping[str, int]) -> None:
    """Raises SceneError for an object of which nothing takes part in contact, and logs how many vertices do not."""
    start = 0
    for name, count in objects.items():
        taking_part = geometry.taking_part[start : start + count]
        if count > 0 and not taking_part.any():
            raise SceneError(
                f"none of the {count} vertices of {name!r} is in a triangle or an edge, so they would go through"
                " everything: give their triangles or edges, too, or leave them out of the union"
            )
        if not taking_part.all():
            loose = np.flatnonzero(~taking_part)
            LOGGER.info(
                "contact: %d of %d vertices of '%s' are in no triangle or edge and take no part, first vertex %d;"
                " that is right for the inside of tetrahedral meshes only",
                len(loose),
                count,
                name,
                loose[0],
            )
        start += count
