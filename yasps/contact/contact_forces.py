"""What contact does at the present state: forces, energies and gaps of each close pair, as arrays, and sums of them.

All numbers are of the energies that the solver minimises: the same pairs, weights, laws and radii. Forces are minus
their derivatives by positions of vertices, whatever parameterises these (see `yasps.contact.pair_forces`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import DataError, SceneError
from yasps.contact.active_set import Floats, Ids, PlanePairs
from yasps.contact.barrier_contact import BarrierContact
from yasps.contact.kinds import Kind
from yasps.contact.pair_forces import (
    FIRST_PIECE,
    barrier_slopes,
    closest_points,
    friction_slopes,
    lagged_points,
    mollifiers,
)
from yasps.contact.pair_primitive import PairPrimitive
from yasps.frontend.language.arrays import real_numbers


@dataclass(frozen=True)
class ContactPairs:
    """Pairs that push or rub, m of them; a pair of a vertex and a half-space has one vertex."""

    kind: NDArray[np.str_]
    """[m], as in `ActiveSet`."""
    vertices: Ids
    """[m, 4] of the scene; -1 where there are fewer."""
    bodies: Ids
    """[m, 2]: numbers of the bodies of the first and of the second piece."""
    point: Floats
    """[m, 3] [m]: half-way between the closest points."""
    normal: Floats
    """[m, 3]: unit vector from the second piece to the first."""
    gap: Floats
    """[m]: distance less the radii [m]."""
    energy: Floats
    """[m] [J]."""
    forces: Floats
    """[m, 4, 3]: force on each vertex [N]; 0 where there is none."""
    on_first: Floats
    """[m, 3]: force on the first piece [N]. The second piece gets the opposite."""

    def __len__(self) -> int:
        return len(self.gap)

    @property
    def normal_force(self) -> Floats:
        """[m]: force on the first piece along the normal [N]; negative for pairs of negative weight."""
        return np.asarray((self.on_first * self.normal).sum(axis=1), np.float64)


@dataclass(frozen=True)
class FrictionPairs(ContactPairs):
    """Pairs that rub. Point, normal and gap are those of when friction was lagged; the energy is its potential."""

    load: Floats
    """[m]: the lagged normal force [N]."""
    slip: Floats
    """[m, 3]: how far the second piece has come along the first since the beginning of the step [m]."""
    slides: NDArray[np.bool_]
    """[m]: whether that is the slip length or more, so that friction has all of its force."""


AnyPairs = TypeVar("AnyPairs", bound=ContactPairs)


@dataclass(frozen=True)
class ContactForces:
    """Forces of contact at one state. Bodies are numbered as in `names`; half-spaces come last."""

    names: tuple[str, ...]
    body_of: Ids
    """[n]: the body of each vertex."""
    positions: Floats
    """[n, 3] of all vertices [m]."""
    areas: Floats
    """[n]: surface area at rest that each vertex stands for [m^2]; 0 inside bodies."""
    masses: Floats
    """[n]: of each vertex [kg]; 0 where nothing moves it or nobody said."""
    normal: ContactPairs
    """The barrier's pairs."""
    friction: FrictionPairs
    """The pairs that rub: those that were near when friction was lagged."""

    def number_of(self, name: str) -> int:
        """The number of a body. Raises SceneError for names of none."""
        if name not in self.names:
            raise SceneError(f"{name!r} is no body of this contact; there are {', '.join(map(repr, self.names))}")
        return self.names.index(name)

    def on_vertices(self, part: str = "both") -> Floats:
        """Force on each vertex [N], [n, 3]. part: "normal", "friction" or "both", else SceneError."""
        found = np.zeros((len(self.body_of), 3))
        for pairs in self._parts(part):
            there = pairs.vertices >= 0
            np.add.at(found, pairs.vertices[there], pairs.forces[there])
        return found

    def between_bodies(self, part: str = "both") -> Floats:
        """Force on body i by body j [N], [bodies, bodies, 3]: [i, j] is minus [j, i]; on the diagonal, what a body does
        to itself, which is 0."""
        count = len(self.names)
        found = np.zeros((count, count, 3))
        for pairs in self._parts(part):
            first, second = pairs.bodies.T
            others = first != second
            sign = np.where(first < second, 1.0, -1.0)[:, None]
            smaller, larger = np.minimum(first, second), np.maximum(first, second)
            np.add.at(found, (smaller[others], larger[others]), (sign * pairs.on_first)[others])
        return np.asarray(found - found.transpose(1, 0, 2), np.float64)

    def on_bodies(self, part: str = "both") -> Floats:
        """Sum of the forces on each body [N], [bodies, 3]."""
        return np.asarray(self.between_bodies(part).sum(axis=1), np.float64)

    def centres(self) -> Floats:
        """Centres of mass [m], [bodies, 3]; without mass the middle of the vertices, of half-spaces the
        origin."""
        count = len(self.names)
        mass = np.bincount(self.body_of, self.masses, minlength=count)
        weights = np.where(mass[self.body_of] > 0, self.masses, 1.0)
        total = np.bincount(self.body_of, weights, minlength=count)
        sums = [np.bincount(self.body_of, weights * x, minlength=count) for x in self.positions.T]
        return np.asarray(np.stack(sums, axis=1) / np.maximum(total, 1e-300)[:, None], np.float64)

    def torques(self, about: ArrayLike | None = None, part: str = "both") -> Floats:
        """Sum of the torques on each body [N m], [bodies, 3], about its centre of mass, or about one point of one's own
        for all, [3], or one each, [bodies, 3]. Raises DataError for points of another shape."""
        about = self.centres() if about is None else self._points(about)
        found = np.zeros((len(self.names), 3))
        for pairs in self._parts(part):
            there = pairs.vertices >= 0
            ids, forces = pairs.vertices[there], pairs.forces[there]
            owners = self.body_of[ids]
            np.add.at(found, owners, np.cross(self.positions[ids] - about[owners], forces))
            of_space = pairs.kind == "half_space"
            owners = pairs.bodies[of_space, 1]
            arms = self.positions[pairs.vertices[of_space, 0]] - about[owners]
            np.add.at(found, owners, np.cross(arms, -pairs.on_first[of_space]))
        return found

    def _points(self, about: ArrayLike) -> Floats:
        points = real_numbers(about, "about")
        if points.shape not in ((3,), (len(self.names), 3)):
            raise DataError(f"about is one point [3], or one for each body, [{len(self.names)}, 3], got {points.shape}")
        return np.broadcast_to(points, (len(self.names), 3))

    def pressures(self) -> Floats:
        """Size of the normal force on each vertex over its area [Pa], [n]; 0 where it has no area."""
        size = np.linalg.norm(self.on_vertices("normal"), axis=1)
        return np.asarray(np.divide(size, self.areas, out=np.zeros_like(size), where=self.areas > 0), np.float64)

    def _parts(self, part: str) -> list[ContactPairs]:
        parts: dict[str, list[ContactPairs]] = {"normal": [self.normal], "friction": [self.friction]}
        parts["both"] = [self.normal, self.friction]
        if part not in parts:
            raise SceneError(f"part is one of {', '.join(map(repr, parts))}, got {part!r}")
        return parts[part]


def contact_forces(contact: BarrierContact, masses: Floats | None = None) -> ContactForces:
    """What contact does at the present positions; masses: of all vertices [kg], [n], for centres of mass. Nothing is
    changed; weights and areas are compiled at the first call."""
    contact.update()
    positions = contact.positions()
    objects = contact.geometry.objects
    names = (*objects, *contact.half_spaces.names)
    body_of = np.repeat(np.arange(len(objects), dtype=np.int32), list(objects.values()))
    found = [
        _pairs_of(_Entries.of(contact, name, positions, body_of))
        for name, pairs in contact.active.kinds().items()
        if len(pairs)
    ]
    return ContactForces(
        names=names,
        body_of=body_of,
        positions=positions,
        areas=_areas(contact),
        masses=np.zeros(len(positions)) if masses is None else masses,
        normal=_joined(ContactPairs, found),
        friction=_joined(FrictionPairs, _rubbing(contact, positions, body_of)),
    )


def _areas(contact: BarrierContact) -> Floats:
    """Surface area at rest that each vertex stands for [m^2], [n]."""
    measures = contact.parts.measures
    if measures is None:
        return contact.geometry.rest_areas()
    return np.asarray(2 * measures.points["half_area"].compute().array.reshape(-1), np.float64)


@dataclass(frozen=True)
class _Entries:
    """Numbers of all pairs of one kind, n of them."""

    kind: Kind
    name: str
    vertices: Ids
    """[n, arity]"""
    corners: Floats
    """[n, rows, 3]: positions of the vertices; for a half-space, the vertex, normal and a point of the plane."""
    bodies: Ids
    """[n, 2]"""
    weight: Floats
    scale: Floats
    """What multiplies the barrier besides the weight."""
    reach: float
    barrier: str
    radii: Floats
    """[n, arity] [m], share included."""
    radii_vary: bool
    threshold: Floats

    @staticmethod
    def of(contact: BarrierContact, name: str, positions: Floats, body_of: Ids) -> _Entries:
        """Those of a kind of the contact's active set."""
        pairs, parts = contact.active.kinds()[name], contact.parts
        primitive = contact.primitives[name].primitive
        kind = contact.primitives[name].kind
        corners = positions[pairs.vertices]
        bodies = body_of[pairs.vertices[:, list(kind.sides)]]
        if isinstance(pairs, PlanePairs):
            corners, bodies = _with_planes(contact, corners, bodies, pairs.planes)
        stiffness, reach = (
            parts.laws["stiffness"].value[contact.laws_of_pairs(name, pairs)],
            float(parts.reach.value[0]),
        )
        radii = np.zeros(pairs.vertices.shape)
        if parts.is_thick:
            radii = pairs.share[:, None] * parts.points["radius"].value[pairs.vertices]
        return _Entries(
            kind,
            name,
            pairs.vertices,
            corners,
            bodies.astype(np.int32),
            primitive["weight"].compute().array.reshape(-1),
            stiffness if parts.measures is None else stiffness * reach,
            reach,
            "paper" if parts.measures is None else "log",
            radii,
            parts.radii_vary,
            primitive["threshold"].compute().array.reshape(-1) if kind.edges is not None else np.empty(0),
        )


def _pairs_of(entries: _Entries) -> ContactPairs:
    """Forces of the pairs of one kind."""
    name, kind, x = entries.name, entries.kind, entries.corners
    count, arity = entries.vertices.shape
    points = closest_points(name, x)
    if entries.radii_vary:
        offset, of_offset = points.offset(name, entries.radii), points.offset_slopes(name, entries.radii)
    else:
        offset, of_offset = entries.radii[:, sorted(set(kind.sides))].sum(axis=1), np.zeros((1, arity, 3))
    distance = np.linalg.norm(points.way, axis=1)
    excess, activation = distance**2 - offset**2, entries.reach * (entries.reach + 2 * offset)
    energy, by_excess, by_activation = barrier_slopes(entries.barrier, excess, activation, entries.scale)
    slopes = 2 * by_excess[:, None, None] * points.weights[:, :, None] * points.way[:, None]
    slopes += (2 * entries.reach * by_activation - 2 * offset * by_excess)[:, None, None] * of_offset
    first = np.array(FIRST_PIECE[name])
    on_second = -slopes[:, first].sum(axis=1) if kind.is_plane else slopes[:, ~first].sum(axis=1)
    if kind.edges is not None:
        share, of_share = mollifiers(kind.edges, x, entries.threshold)
        slopes = share[:, None, None] * slopes + energy[:, None, None] * of_share
        on_second, energy = share[:, None] * on_second, share * energy
    weight = entries.weight[:, None]
    forces = np.zeros((count, 4, 3))
    forces[:, :arity] = -weight[:, :, None] * slopes
    vertices = np.full((count, 4), -1, np.int32)
    vertices[:, :arity] = entries.vertices
    return ContactPairs(
        kind=np.full(count, name),
        vertices=vertices,
        bodies=entries.bodies,
        point=_middles(name, x, points.weights, points.way),
        normal=-points.way / distance[:, None],
        gap=distance - offset,
        energy=entries.weight * energy,
        forces=forces,
        on_first=weight * on_second,
    )


def _rubbing(contact: BarrierContact, positions: Floats, body_of: Ids) -> list[FrictionPairs]:
    """The pairs of each kind that rub."""
    if contact.friction is None:
        return []
    return [
        _rubbing_of(contact, name, pairs, positions, body_of)
        for name, pairs in contact.friction.primitives.items()
        if pairs.primitive.num_instances
    ]


def _rubbing_of(
    contact: BarrierContact, name: str, pairs: PairPrimitive, positions: Floats, body_of: Ids
) -> FrictionPairs:
    """Friction of one kind: minus load times W'(|u|) along the slip u, which is linear in the positions."""
    assert contact.friction is not None
    kind, links, parts = pairs.kind, pairs.primitive.connectivities, contact.parts
    ids, laws = links["vertices"].indices, links["law"].indices[:, 0]
    lagged, previous = (parts.points[f"{when}_position"].value.reshape(-1, 3)[ids] for when in ("lagged", "previous"))
    corners, bodies = lagged, body_of[ids[:, list(kind.sides)]]
    if kind.is_plane:
        corners, bodies = _with_planes(contact, corners, bodies, links["plane"].indices[:, 0])
    weights, lagged_way = lagged_points(name, corners)
    distance = np.linalg.norm(lagged_way, axis=1)
    normal = lagged_way / distance[:, None]
    relative = np.einsum("na,nad->nd", weights, positions[ids] - previous)
    slip = relative - (relative * normal).sum(axis=1, keepdims=True) * normal
    way, length = np.linalg.norm(slip, axis=1), float(contact.friction.slip_length.compute().array.reshape(-1)[0])
    static, kinetic = (parts.laws[which].value[laws] for which in ("friction", "kinetic_friction"))
    potential, by_slip = friction_slopes(way, length, static, kinetic)
    load = pairs.primitive["normal_force"].compute().array.reshape(-1)
    push = (load * by_slip)[:, None] * slip
    offset = (np.abs(weights) * parts.points["radius"].value[ids]).sum(axis=1)
    if parts.is_thick:
        offset = offset * pairs.primitive["share"].value
    count, arity = ids.shape
    forces, vertices = np.zeros((count, 4, 3)), np.full((count, 4), -1, np.int32)
    forces[:, :arity], vertices[:, :arity] = -weights[:, :, None] * push[:, None], ids
    return FrictionPairs(
        kind=np.full(count, name),
        vertices=vertices,
        bodies=bodies.astype(np.int32),
        point=_middles(name, corners, weights, lagged_way),
        normal=-normal,
        gap=distance - offset,
        energy=load * potential,
        forces=forces,
        on_first=push,
        load=load,
        slip=slip,
        slides=way >= length,
    )


def _with_planes(contact: BarrierContact, corners: Floats, bodies: Ids, planes: Ids) -> tuple[Floats, Ids]:
    """Corners and bodies of vertices near half-spaces, with these."""
    assert contact.parts.planes is not None
    rows = [contact.parts.planes[part].value.reshape(-1, 1, 3)[planes] for part in ("normal", "point")]
    return (
        np.concatenate([corners, *rows], axis=1),
        np.stack([bodies[:, 0], len(contact.geometry.objects) + planes], axis=1),
    )


def _middles(name: str, x: Floats, weights: Floats, way: Floats) -> Floats:
    """Half-way between the closest points, [n, 3] [m]: weights of the second piece sum to 1."""
    first = np.array(FIRST_PIECE[name])
    if first.all():
        return np.asarray(x[:, 0] + 0.5 * way)
    return np.asarray(np.einsum("na,nad->nd", np.where(first, 0.0, weights), x) - 0.5 * way)


def _joined(kind: type[AnyPairs], parts: Sequence[AnyPairs]) -> AnyPairs:
    """All pairs in one."""
    shapes = {"kind": (0,), "vertices": (0, 4), "bodies": (0, 2), "forces": (0, 4, 3)}
    shapes |= dict.fromkeys(("point", "normal", "on_first", "slip"), (0, 3))
    types: dict[str, Any] = {"kind": "<U21", "vertices": np.int32, "bodies": np.int32, "slides": np.bool_}
    return kind(
        **{
            name.name: np.concatenate(
                [
                    np.empty(shapes.get(name.name, (0,)), types.get(name.name, np.float64)),
                    *(getattr(part, name.name) for part in parts),
                ]
            )
            for name in fields(kind)
        }
    )
