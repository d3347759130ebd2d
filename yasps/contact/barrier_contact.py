"""Intersection-free contact: IPC barrier energies over the vertices of a scene, whatever parameterises them.

The energies are written once, over a primitive union of vertices; JOIN and UNION carry their derivatives to free
vertices, affine bodies or anything else. Collision geometry (which pairs are close, how far a step may go) is in
collision_geometry.py.

Li et al. 2020 and 2023; paper, section 4.6.3 and eq. 8. Distances enter squared.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import (
    Attribute,
    Connectivity,
    FloatArray,
    IntersectionError,
    Mesh,
    Primitive,
    PrimitiveBase,
    PrimitiveUnion,
    SceneError,
)
from yasps.contact.active_set import ActiveSet, Ids, Pairs, PlanePairs
from yasps.contact.barrier import BARRIERS
from yasps.contact.collision_geometry import Candidates, CollisionGeometry
from yasps.contact.contact_parts import OWN_NAMES, add_parts, radii_vary
from yasps.contact.contact_table import ContactLaws, ContactTable, laws_of
from yasps.contact.friction import Friction, Lag, checked_slip_length
from yasps.contact.half_spaces import HalfSpaces, Plane
from yasps.contact.kinds import HALF_SPACE, KINDS
from yasps.contact.look_ahead import LookAhead
from yasps.contact.object_names import ObjectNames
from yasps.contact.pair_primitive import PairPrimitive
from yasps.contact.rows import longest_way
from yasps.contact.surface_arguments import checked_points, checked_radii
from yasps.frontend.language.arrays import positive_number
from yasps.frontend.language.in_scene import InScene
from yasps.frontend.language.scene_lock import one_thread_at_a_time

LOGGER = logging.getLogger("yasps")

MARGIN = 0.25
"""Ways that leave another by less than this many activation distances share its candidates: a larger margin saves
searches, but brings more pairs to measure at every trial step."""
PROJECTIONS = ("clamp", "abs", "none")
"""Of energies, as `Scene.add_energy` takes them."""


@dataclass(frozen=True)
class ContactPast:
    """What `BarrierContact` remembers of the past: the positions last accepted, [n, 3], and the lag of friction."""

    accepted: FloatArray
    lag: Lag | None


class BarrierContact(InScene):
    """Contact of a scene's surface with itself: one dynamic primitive and one energy for each kind of close pair.

    mesh: where the primitives are added (and its constants `reach` [m] and `squared_reach` [m^2]).
    vertices: a primitive or union with a 3x1 attribute `position`. triangles: [m, 3] into it, the whole surface; edges:
    [k, 2], those of rods and curves, which are in no triangle; points: ids of loose vertices, which are in neither
    and take part. Other vertices take no part, which the logger `yasps` says (level INFO); an object all of whose
    vertices are loose is refused.

    activation_distance: pairs closer than this repel [m]. barrier: "log", whose stiffness is a pressure [Pa] that does
    not depend on mesh, activation distance and time step; or "paper", eq. 8, with a stiffness in J/m^4 and no areas.
    stiffness: of all pairs of which the table says nothing; default: a tenth of the smaller of the moduli, object name
    -> contact modulus [Pa] (infinite for those that are not named). table: friction and stiffness of pairs of objects.
    planes: half-spaces that all vertices stay out of.

    radii: [n] or one, the thickness of the surface around its vertices [m]: pairs touch where they are as far apart as
    the sum of their radii, which are interpolated along edges and triangles.
    rest_positions: [n, 3], where all vertices are at rest, or None for the attribute `rest_position` of the vertices;
    where there is none, the positions now. Areas are of them, and the lengths from when on two edges are parallel.
    fixed: [n] bool, vertices that no energy moves. group: [n] int, pairs inside one group (of a stiff body, say) don't
    repel; negative means no group. objects: name -> number of vertices in order, for messages, moduli and the table;
    default: the members of the union. slip_length: up to which slip within a step pairs with friction stick [m], a
    number or a 1x1 attribute of mesh or scene. room: for so many triangles around a vertex, before `resize` needs a
    compile.

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
        stiffness: float | None = None,
        barrier: str = "log",
        table: ContactTable | None = None,
        moduli: Mapping[str, float] | None = None,
        planes: Sequence[Plane] = (),
        edges: ArrayLike | None = None,
        points: ArrayLike | None = None,
        radii: ArrayLike = 0.0,
        rest_positions: ArrayLike | None = None,
        fixed: ArrayLike | None = None,
        group: ArrayLike | None = None,
        objects: Mapping[str, int] | None = None,
        slip_length: float | Attribute | None = None,
        projection: str = "clamp",
        room: int = 1,
    ) -> None:
        if barrier not in BARRIERS:
            raise SceneError(f"barrier is one of {', '.join(map(repr, BARRIERS))}, got {barrier!r}")
        if projection not in PROJECTIONS:
            raise SceneError(f"projection is one of {', '.join(map(repr, PROJECTIONS))}, got {projection!r}")
        table = ContactTable() if table is None else table
        if not isinstance(table, ContactTable):
            raise SceneError(f"the table is a ContactTable, got {table!r}")
        if not all(isinstance(plane, Plane) for plane in planes):
            raise SceneError(f"planes are a list of Plane (yasps.contact), got {planes!r}")
        law = BARRIERS[barrier]
        if stiffness is not None or barrier == "paper":
            given = np.nan if stiffness is None else stiffness
            stiffness = positive_number(given, "contact stiffness", law.unit, SceneError)
        for name in OWN_NAMES:
            mesh.check_child_name(name, "a part of contact")
        self.position = vertices["position"]
        if self.position.shape != (3, 1):
            raise SceneError(f"contact needs 3x1 positions, but {self.position.path} is {self.position.shape}")
        self._lock, self._scene = mesh.scene.lock, mesh.scene
        positions = self.positions()
        objects = _members_of(vertices) if objects is None else objects
        ObjectNames(objects, len(positions))  # they must add up before laws are made of them
        thickness = checked_radii(radii, len(positions))
        rest = None if rest_positions is None else checked_points(rest_positions, "rest_positions", len(positions))
        has_own_rest = rest is None and "rest_position" in vertices
        if rest is None:
            rest = vertices["rest_position"].compute().array.reshape(-1, 3) if has_own_rest else positions
        moduli = {} if moduli is None or barrier == "paper" else moduli
        self.laws = laws_of(table, objects, moduli, [plane.name for plane in planes], stiffness=stiffness)
        slip_length = checked_slip_length(slip_length, mesh) if self.laws.has_friction else None
        self._planes, self._activation_distance, self._improved_max = (
            list(planes),
            activation_distance,
            barrier != "paper",
        )
        surface = {"edges": edges, "points": points, "fixed": fixed, "group": group, "objects": objects}
        self.geometry, self.half_spaces = self._look_at(self.laws, rest, triangles, thickness, surface)
        self.check_intersection_free(positions)
        _announce_loose_vertices(self.geometry, objects)
        self.parts = add_parts(
            mesh,
            vertices,
            self.geometry,
            self.laws,
            self.half_spaces,
            barrier=barrier,
            rest=None if has_own_rest else rest,
            radii=thickness,
            room=room,
        )
        self.primitives: dict[str, PairPrimitive] = {}
        kinds = KINDS | ({"half_space": HALF_SPACE} if len(planes) else {})
        for name, kind in kinds.items():
            pairs = PairPrimitive(self.parts, name, kind)
            x = pairs.corners("positions", self.position)
            energy = pairs.weight * law.energy(*pairs.excess(x), pairs.scale(pairs.of_law("stiffness")))
            energy = pairs.mollified(energy, x)
            barrier_energy = pairs.primitive.add_attribute("barrier", computed_attribute=energy)
            mesh.scene.add_energy(barrier_energy, projection=projection)
            self.primitives[name] = pairs
        self.ahead = LookAhead(self.parts, self.geometry, self.half_spaces)
        self.friction: Friction | None = None
        if slip_length is not None:
            self.friction = Friction(
                self.parts, kinds, slip_length=slip_length, positions=positions, projection=projection
            )
        self._given: dict[str, Pairs] = {}
        self._kept: Candidates | None = None
        self._where = positions
        self._accepted = positions
        self.active = self._close_pairs(positions)
        self.show_only({})
        self.lag()

    def _look_at(
        self, laws: ContactLaws, rest: FloatArray, triangles: ArrayLike, radii: FloatArray, surface: Mapping[str, Any]
    ) -> tuple[CollisionGeometry, HalfSpaces]:
        """Collision geometry and half-spaces of a surface; surface: what else `CollisionGeometry` takes of it."""
        geometry = CollisionGeometry(
            rest,
            triangles,
            self._activation_distance,
            radii=radii,
            class_of=None if laws.enabled.all() else laws.class_of,
            allowed=None if laws.enabled.all() else laws.enabled,
            improved_max=self._improved_max,
            runtime=self._scene.runtime,
            **surface,
        )
        meets = laws.enabled[laws.plane_class][:, laws.class_of] & geometry.taking_part
        if surface["fixed"] is not None:
            meets = meets & ~np.asarray(surface["fixed"], np.bool_)
        return geometry, HalfSpaces(self._planes, meets, radii, self._activation_distance)

    @one_thread_at_a_time
    def resize(
        self,
        counts: Mapping[Primitive, int],
        parts: Mapping[Attribute | Connectivity, Any],
        triangles: ArrayLike,
        *,
        rest_positions: ArrayLike,
        edges: ArrayLike | None = None,
        points: ArrayLike | None = None,
        radii: ArrayLike = 0.0,
        fixed: ArrayLike | None = None,
        group: ArrayLike | None = None,
        objects: Mapping[str, int] | None = None,
        is_free: bool = False,
    ) -> None:
        """Resizes primitives that the vertices come from, together with their surface, all or none.

        counts, parts: as `Scene.resize` takes them; contact adds its own, and nothing is compiled, but for more
        triangles around a vertex than there is `room` for. The rest describes all of the new surface, as when contact
        was made; rest_positions [n, 3] are those that the parts lead to. Pairs are found anew; friction is lagged at
        the new positions, and slips count from there. is_free: says that nothing was moved and no surfaces cross, for
        callers who set positions and look right after.

        Raises IntersectionError, with names, if surfaces cross at the new positions, or positions were changed from
        outside since the last step and something is in the way. Raises SceneError for other objects than before, for
        pieces of a kind that was not there, and for radii that vary or are there at all only now; what `Scene.resize`
        raises. Nothing has changed then.
        """
        if not is_free:
            self.check_way()
        rest, old = checked_points(rest_positions, "rest_positions"), self.geometry.objects
        objects = {name: len(rest) for name in old} if objects is None else objects
        if list(objects) != list(old):
            raise SceneError(f"contact is of {', '.join(map(repr, old))}, not of {', '.join(map(repr, objects))}")
        thickness = checked_radii(radii, len(rest))
        surface = {"edges": edges, "points": points, "fixed": fixed, "group": group, "objects": objects}
        laws = self.laws.resized(old, objects)
        geometry, half_spaces = self._look_at(laws, rest, triangles, thickness, surface)
        if thickness.any() and not self.parts.is_thick:
            raise SceneError("a surface without thickness got one, which is another formula: make a new contact")
        if radii_vary(geometry, thickness) and not self.parts.radii_vary:
            raise SceneError("the radii of a surface vary now, which is another formula: make a new contact")
        of_surface = self._resized(geometry, thickness, rest)
        undo = self._scene.resize({**counts, **of_surface[0]}, {**parts, **of_surface[1]})
        try:
            where = self.positions()
            if not is_free:
                geometry.check_intersection_free(where)
                half_spaces.check_free(where, geometry.names.of)
            has_own_rest = "vertex" in self.parts.points.connectivities
            if has_own_rest and not np.array_equal(self.parts.vertices["rest_position"].value, rest.ravel()):
                raise SceneError("rest_positions are not those of the vertices after they were resized")
        except BaseException:
            self._scene.resize(*undo)
            raise
        self.laws, self.geometry, self.half_spaces = laws, geometry, half_spaces
        self.ahead.look_at(geometry, half_spaces)
        self._given, self._kept = {}, None
        self._where = self._accepted = where
        self.active = self._close_pairs(where)
        self.show_only({})
        if self.friction is not None:
            self.friction.restart(where)
            self.lag()

    def _resized(
        self, geometry: CollisionGeometry, radii: FloatArray, rest: FloatArray
    ) -> tuple[dict[Primitive, int], dict[Attribute | Connectivity, Any]]:
        """What `Scene.resize` takes for a surface, without pairs."""
        points = self.parts.points
        counts: dict[Primitive, int] = {points: len(rest)}
        parts: dict[Attribute | Connectivity, Any] = {points["radius"]: radii}
        if "vertex" in points.connectivities:
            parts[points.vertex] = np.arange(len(rest))
        else:
            parts[points["rest_position"]] = rest
        if self.parts.measures is not None:
            of_measures = self.parts.measures.resized(geometry, radii)
            counts |= of_measures[0]
            parts |= of_measures[1]
        if self.friction is not None:
            parts |= self.friction.resized(len(rest))
        return counts | self._without_pairs(), parts

    def emptied(self) -> tuple[dict[Primitive, int], dict[Attribute | Connectivity, Any]]:
        """What `Scene.resize` takes when vertices are resized and this contact is used no more, its energies gone."""
        points, parts = self.parts.points, dict[Attribute | Connectivity, Any]()
        if "vertex" in points.connectivities:
            parts[points.vertex] = np.zeros(points.num_instances, np.int32)
        return self._without_pairs(), parts

    def _without_pairs(self) -> dict[Primitive, int]:
        pairs = list(self.primitives.values())
        if self.friction is not None:
            pairs += self.friction.primitives.values()
        return {one.primitive: 0 for one in pairs}

    @property
    def energies(self) -> list[Attribute]:
        """The barriers of all kinds, springs of what is looked ahead of (none between steps), and friction."""
        barriers = [*(pairs.primitive["barrier"] for pairs in self.primitives.values()), self.ahead.energy]
        return barriers if self.friction is None else barriers + self.friction.energies

    def _close_pairs(self, positions: FloatArray, candidates: Candidates | None = None) -> ActiveSet:
        active = self.geometry.active_set(positions, candidates)
        return active.with_half_spaces(*self.half_spaces.close(positions)) if len(self.half_spaces) else active

    def check_intersection_free(self, positions: FloatArray) -> None:
        """Raises IntersectionError, with names, if surfaces cross or touch, or something is in a half-space."""
        self.geometry.check_intersection_free(positions)
        self.half_spaces.check_free(positions, self.geometry.names.of)

    def positions(self) -> FloatArray:
        """Current positions of all vertices, [n, 3]."""
        return self.position.compute().array.reshape(-1, 3)

    @one_thread_at_a_time
    def start_step(self) -> FloatArray:
        """Begins a time step: checks the way of what was moved from outside since the last one (see `check_way`), and
        takes normal forces of friction from the present positions. Slips count from the positions accepted before, so
        obstacles that were moved by hand drag what lies on them. Returns those, [n, 3].

        `TimeStepper.step` does so. Raises IntersectionError.
        """
        before = self._accepted
        self.check_way()
        if self.friction is not None:
            self.friction.start_step(before)
            self.lag()
        return before

    def count_slips_from(self, positions: FloatArray) -> None:
        """Other positions of all vertices [n, 3] from which slips count in this step: a formula for velocities (see
        `Integrator` of `yasps.stepping`) may look farther back."""
        if self.friction is not None:
            self.friction.start_step(positions)

    @one_thread_at_a_time
    def lag(self) -> None:
        """Takes normal forces, closest points and tangent planes of friction from the present positions."""
        if self.friction is not None:
            positions = self.positions()
            pairs = self.update(positions).kinds()
            laws = {name: self.laws_of_pairs(name, of_kind) for name, of_kind in pairs.items()}
            self.friction.take(positions, pairs, laws)

    def save(self) -> ContactPast:
        """What contact remembers of the past, for `load` after a step that failed."""
        return ContactPast(self._accepted, None if self.friction is None else self.friction.save())

    @one_thread_at_a_time
    def load(self, past: ContactPast) -> None:
        """Remembers what it did then: the positions last accepted, and what friction was lagged at. The vertices are
        back where they were."""
        self.update()
        self.accept(past.accepted)
        if self.friction is not None and past.lag is not None:
            self.friction.load(past.lag)

    @property
    def accepted(self) -> FloatArray:
        """The positions last accepted [m], [n, 3]."""
        return self._accepted.copy()

    def paths_of_pairs(self) -> list[str]:
        """Paths of the scene's numbers and indices that contact sets by itself: of pairs, and of the surface when
        friction was lagged."""
        primitives = [pairs.primitive.path for pairs in self.primitives.values()]
        places = []
        if self.friction is not None:
            primitives += [pairs.primitive.path for pairs in self.friction.primitives.values()]
            places = [f"{self.parts.points.path}.{name}" for name in ("lagged_position", "previous_position")]
        starts = tuple(f"{path}." for path in primitives)
        return [path for path in self.parts.mesh.scene.numbers() if path.startswith(starts) or path in places]

    def accept(self, positions: FloatArray) -> None:
        """Notes that the vertices came to these positions [n, 3] on a way that was free of collisions."""
        self._accepted = np.array(positions)

    @one_thread_at_a_time
    def check_way(self, positions: FloatArray | None = None) -> None:
        """Looks for collisions on the straight way from the positions last accepted to these, by default the present
        ones, and accepts these.

        `minimize` and `TimeStepper.step` do so before anything else. Raises IntersectionError that names the vertices
        where surfaces meet on the way or nearly do (see `CollisionGeometry.check_way`); nothing is accepted then.
        """
        where = self.positions() if positions is None else positions
        if np.array_equal(where, self._accepted):
            return
        try:
            self.check_free_way(self._accepted, where)
        except IntersectionError as error:
            raise IntersectionError(
                f"positions were changed since the last step (by update_value?), and something is in the way: {error}."
                " Move things by smaller steps, or round what is in the way; if this was a jump, such as a reset, say"
                " so by reset() of the contact"
            ) from error
        self.accept(where)

    def check_free_way(self, start: FloatArray, end: FloatArray, *, only: NDArray[np.bool_] | None = None) -> None:
        """Raises IntersectionError, with names, if something meets on the straight way from start to end [n, 3], from
        where surfaces are apart. only: bool [n], of surface pieces those of these vertices alone."""
        self.geometry.check_way(start, end, only=only)
        self.half_spaces.check_free(end, self.geometry.names.of)

    @one_thread_at_a_time
    def reset(self) -> None:
        """Takes the present positions for a new start, whatever lies between them and the last ones.

        Raises IntersectionError if surfaces cross or touch there; the last positions are kept then.
        """
        where = self.positions()
        self.check_intersection_free(where)
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
            self.active = self._close_pairs(where, candidates)
            self._where = np.array(where)
            self.show_only({})
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
            margin = MARGIN * geometry.activation_distance
            self._kept = geometry.candidates(start, end, margin=margin, before=self._kept)
        if self._is_short(start, end):
            return 1.0, self._kept
        step = geometry.step_bound(start, end, self._kept, start_is_free=True)
        return min(step, self.half_spaces.step_bound(start, end)), self._kept

    def _is_short(self, start: FloatArray, end: FloatArray) -> bool:
        """Is the way so short that even two vertices that run towards each other keep a tenth of the smallest distance?

        Then the step bound is 1, and no pair has to be looked at. Most ways near a minimum are.
        """
        if not np.array_equal(start, self._where):
            return False
        least = min(self.active.minimum_gap, self.geometry.activation_distance)
        return 0.0 < 2 * longest_way(start, end) <= 0.9 * least

    def show_only(self, chosen: Mapping[str, NDArray[np.bool_]]) -> None:
        """Gives the scene of each of these kinds the pairs of the active set that the mask, [n], chooses, and all pairs
        of the others."""
        kinds = self.active.kinds()
        for name, primitive in self.primitives.items():
            pairs = kinds[name]
            pairs = pairs.chosen(chosen[name]) if name in chosen else pairs
            if name not in self._given or not pairs.same_as(self._given[name]):
                self._given[name] = pairs
                primitive.update(pairs, self.laws_of_pairs(name, pairs))

    def laws_of_pairs(self, name: str, pairs: Pairs) -> Ids:
        """The number of the law of each pair of a kind, [n]."""
        if isinstance(pairs, PlanePairs):
            return self.laws.of_planes(pairs.vertices[:, 0], pairs.planes)
        first, second = KINDS[name].sides
        return self.laws.of(pairs.vertices[:, first], pairs.vertices[:, second])


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
