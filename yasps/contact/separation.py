"""Small overlaps of bodies are taken away before the first step, by moving vertices as little as possible.

Every piece that is on the wrong side, crosses or is too near gives one inequality n . (sum of g_i x_i) >= gap: n points
from the second body to the first, g are the weights of the two places that have to part. What moves least and obeys
all of them is a quadratic program; its solution is looked at anew, what is found then is added, until nothing is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from yasps import IntersectionError, SceneError
from yasps.contact.active_set import Floats, Ids
from yasps.contact.contact_table import ContactTable
from yasps.contact.kinds import KINDS
from yasps.contact.pair_forces import closest_points
from yasps.contact.solid_geometry import shortest_exits
from yasps.contact.start_state import StartBody, Surfaces
from yasps.frontend.language.arrays import positive_number

ROUNDS = 40
"""So often is looked whether something is still too near."""
STEPS = 400
"""Iterations of one quadratic program."""
SMOOTH = 10.0
"""Stiffness of the springs along the edges of soft bodies, in masses of a vertex: how far a push spreads."""
MORE = 1.02
"""The gap aimed at, in gaps wished for: the quadratic program leaves a little undone."""


@dataclass(frozen=True)
class Separation:
    """What `separate` did."""

    moved: dict[str, float]
    """Body -> the longest way of one of its vertices [m], of the bodies that moved."""
    gap: float
    """The least gap between bodies that there is now at least [m]."""

    def __str__(self) -> str:
        if not self.moved:
            return f"all bodies were {self.gap:.3g} m apart already"
        ways = ", ".join(f"{name!r} by up to {way:.3g} m" for name, way in self.moved.items())
        return f"moved {ways}; all bodies are at least {self.gap:.3g} m apart"


def separate(
    bodies: Sequence[StartBody],
    *,
    gap: float | None = None,
    largest_share: float = 0.1,
    table: ContactTable | None = None,
) -> Separation:
    """Moves bodies that overlap, touch or are too near each other apart, by as little as possible, and says how far.

    Soft bodies and cloth are bent by displacements of their vertices that spread along their edges; what its vertices
    do not move one by one (a stiff body) is only translated; fixed bodies stay. Of two, the heavier moves less. A
    surface that crosses itself is parted, too, but pieces of one body that are merely near each other stay as they are.

    gap: least distance of different bodies, less their radii, afterwards [m]; default 1/1000 of the diagonal of the box
    around what moves, which is the activation distance that a `Simulation` chooses. largest_share: overlaps deeper, and
    ways longer, than this share of the diagonal of the smaller body are no small ones. table: bodies that don't meet by
    it may overlap.

    Call it before the simulation is made. Raises IntersectionError for overlaps that are too large or that no small
    motion takes away, and SceneError for wrong arguments; all bodies are then where they were.
    """
    if not 0 < largest_share <= 1:
        raise SceneError(f"largest_share is a share of a body's size between 0 and 1, got {largest_share}")
    surfaces = Surfaces(bodies, table)
    free = [body for body in bodies if not body.is_fixed]
    if not free:
        raise SceneError("nothing can be moved: all bodies are fixed")
    if gap is None:
        gap = 1e-3 * float(np.linalg.norm(np.ptp(np.concatenate([body.positions() for body in free]), axis=0)))
    gap = positive_number(gap, "gap", "m", SceneError)
    start = surfaces.positions
    sizes = np.array([np.linalg.norm(np.ptp(part, axis=0)) for part in surfaces.parts])
    for overlap, pair in surfaces.overlaps():
        allowed = largest_share * float(sizes[list(pair)].min())
        if overlap.depth > allowed:
            raise IntersectionError(
                f"nothing was moved: {overlap}. That is no small overlap, which are up to {allowed:.3g} m deep here"
                f" ({largest_share:g} of the smaller body's size): place the bodies farther apart"
            )
    motion = _Motion(surfaces)
    flipped = {flip.body: len(flip.elements) for flip in surfaces.flipped()}
    wanted = _Inequalities(motion)
    for _ in range(ROUNDS):
        if not wanted.look(gap):
            break
        surfaces.move_to(start + motion.displacements(wanted.solve()))
    else:
        left = "\n".join(str(overlap) for overlap, _ in surfaces.overlaps()) or "bodies are nearer than the gap"
        raise IntersectionError(
            f"nothing was moved: {ROUNDS} attempts did not part the bodies by {gap:.3g} m. What is left: {left}. Try a"
            " smaller gap, or move the bodies by hand"
        )
    ways = [
        np.linalg.norm(new - old, axis=1).max(initial=0.0)
        for new, old in zip(surfaces.parts, motion.parts, strict=True)
    ]
    for body, way, size in zip(surfaces.bodies, ways, sizes, strict=True):
        if way > largest_share * size:
            raise IntersectionError(
                f"nothing was moved: {body.name!r} would have to go {way:.3g} m, which is more than"
                f" {largest_share:g} of its size: place the bodies farther apart"
            )
    for flip in surfaces.flipped():
        if len(flip.elements) > flipped.get(flip.body, 0):
            raise IntersectionError(
                f"nothing was moved: to part the bodies, {flip.body!r} would be bent so much that {flip}. Try a smaller"
                " gap, or place the bodies farther apart"
            )
    motion.apply()
    moved = {body.name: float(way) for body, way in zip(surfaces.bodies, ways, strict=True) if way > 0}
    return Separation(moved, gap)


class _Motion:
    """What can move: nodes with three coordinates each, a stiff body being one, and what moving them costs."""

    def __init__(self, surfaces: Surfaces) -> None:
        self.surfaces = surfaces
        self.parts = surfaces.parts
        self.node = np.full(len(surfaces.positions), -1)
        """The node that carries each vertex; -1: none."""
        costs, count = [], 0
        for number, body in enumerate(surfaces.bodies):
            here = slice(int(surfaces.starts[number]), int(surfaces.starts[number + 1]))
            if body.is_fixed:
                continue
            mass = np.asarray(body.mass.value, np.float64).reshape(-1)
            if any(target is body.position for target in body.targets):
                self.node[here] = count + np.arange(len(mass))
                costs.append(_cost_of_bending(body, mass))
            elif len(body.falling) == 1 and len(body.falling[0].value) == 3:
                self.node[here] = count
                costs.append(sparse.csc_array([[mass.sum()]]))
            else:
                raise SceneError(
                    f"{body.name} can't be moved by separate: its positions are no target, nor has it one translation"
                    " (`falling`)"
                )
            count += costs[-1].shape[0]
        self.count = count
        self._solver = splu(sparse.block_diag(costs, format="csc"))

    def cheapest(self, forces: Floats) -> Floats:
        """Displacements of the nodes [nodes, 3] under forces on them: the inverse of the cost."""
        return np.asarray(self._solver.solve(forces))

    def displacements(self, nodes: Floats) -> Floats:
        """Of all vertices, [n, 3]."""
        return np.where((self.node >= 0)[:, None], nodes[self.node], 0.0)

    def apply(self) -> None:
        """Moves the bodies to where the surfaces are."""
        for body, old, new in zip(self.surfaces.bodies, self.parts, self.surfaces.parts, strict=True):
            if body.is_fixed or np.array_equal(old, new):
                continue
            if any(target is body.position for target in body.targets):
                body.position.update_value(new)
            else:
                (translation,) = body.falling
                translation.update_value(translation.value + (new - old)[0])


def _cost_of_bending(body: StartBody, mass: Floats) -> sparse.csc_array:
    """Masses, and springs along all edges of the elements."""
    cells = body.cells.get("tetra", body.triangles)
    ends = [(k, j) for k in range(cells.shape[1]) for j in range(k)]
    edges = np.unique(np.sort(np.concatenate([cells[:, pair] for pair in ends]), axis=1), axis=0)
    a, b = edges[:, 0], edges[:, 1]
    strength = SMOOTH * 0.5 * (mass[a] + mass[b])
    rows, columns = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
    values = np.concatenate([strength, strength, -strength, -strength])
    springs = sparse.coo_array((values, (rows, columns)), shape=(len(mass), len(mass)))
    return sparse.csc_array(springs + sparse.diags_array(mass))


class _Inequalities:
    """All inequalities found so far, over displacements of the nodes from the start."""

    def __init__(self, motion: _Motion) -> None:
        self.motion = motion
        self.start = motion.surfaces.positions
        self._rows: list[sparse.csr_array] = []
        self._sides: list[Floats] = []
        self._multipliers = np.empty(0)

    def look(self, gap: float) -> bool:
        """Adds what is on the wrong side, crosses or is nearer than the gap; False if nothing is."""
        surfaces = self.motion.surfaces
        crossings = surfaces.crossings()
        for (first, second), (edges, numbers) in crossings.items():
            seen: list[Ids] = []
            if first != second:
                for a, b in ((first, second), (second, first)):
                    side = surfaces.wrong_side(a, b, edges, numbers)
                    length = np.linalg.norm(side.way, axis=1, keepdims=True)
                    direction = side.way / np.maximum(length, 1e-300)
                    vertices = np.column_stack([side.vertices, side.corners])
                    weights = np.column_stack([np.ones(len(vertices)), -side.weights])
                    chosen = length[:, 0] > surfaces.touching
                    self._add(vertices[chosen], weights[chosen], direction[chosen], gap)
                    seen.append(side.vertices[chosen])
            parted = np.concatenate([np.empty(0, np.int32), *seen])
            corners = surfaces.triangles[numbers]
            left = ~np.isin(np.column_stack([edges, corners]), parted).any(axis=1)
            self._add(*_parting(surfaces.positions, edges[left], corners[left]), gap)
        active = surfaces.geometry_for(gap).active_set(surfaces.positions)
        found = bool(crossings)
        for name, pairs in active.kinds().items():
            vertices = pairs.vertices
            points = closest_points(name, surfaces.positions[vertices])
            distance, thickness = surfaces.gaps(name, vertices, surfaces.positions)
            direction = -points.way / np.maximum(distance, 1e-300)[:, None]
            owners = np.sort(surfaces.body_of(vertices[:, list(KINDS[name].sides)]), axis=1)
            crossing = np.array([tuple(pair) in crossings for pair in owners.tolist()], bool)
            names = [tuple(surfaces.bodies[k].name for k in pair) for pair in owners.tolist()]
            others = (owners[:, 0] != owners[:, 1]) & np.array([surfaces.meet(*pair) for pair in names], bool)
            near = others & (distance - thickness < gap)
            chosen = near & ~crossing & (distance > 0)
            found = found or bool((near | (distance <= surfaces.touching)).any())
            self._add(vertices[chosen], -points.weights[chosen], direction[chosen], gap)
        for _, plane, ids, gaps in surfaces.in_planes(gap):
            normal = np.array(plane.normal)
            level = float(normal @ plane.point)
            self._add(ids[:, None], np.ones((len(ids), 1)), np.tile(normal, (len(ids), 1)), gap, level)
            found = found or bool((gaps < gap).any())
        return found

    def _add(
        self, vertices: ArrayLike, weights: ArrayLike, directions: ArrayLike, gap: float, level: float = 0.0
    ) -> None:
        ids, shares, n = np.asarray(vertices), np.asarray(weights, np.float64), np.asarray(directions, np.float64)
        node = self.motion.node[ids]
        coefficients = np.where(node >= 0, shares, 0.0)[:, :, None] * n[:, None, :]
        columns = 3 * np.maximum(node, 0)[:, :, None] + np.arange(3)
        rows = np.broadcast_to(np.arange(len(ids))[:, None, None], columns.shape)
        table = (coefficients.reshape(-1), (rows.reshape(-1), columns.reshape(-1)))
        self._rows.append(sparse.csr_array(sparse.coo_array(table, shape=(len(ids), 3 * self.motion.count))))
        now = np.einsum("kv,kvd,kd->k", shares, self.start[ids], n)
        radii = (np.abs(shares) * self.motion.surfaces.radii[ids]).sum(axis=1)
        self._sides.append(MORE * gap + radii + level - now)

    def solve(self) -> Floats:
        """Displacements of the nodes [nodes, 3] that cost least: accelerated projected gradients of the dual problem
        (Beck and Teboulle 2009), started from the last multipliers."""
        matrix, sides = sparse.vstack(self._rows, format="csr"), np.concatenate(self._sides)
        old = np.concatenate([self._multipliers, np.zeros(len(sides) - len(self._multipliers))])
        moved = self._moved(matrix)
        step, probe = 0.0, np.ones(len(sides))
        for _ in range(30):
            probe = matrix @ moved(probe / np.linalg.norm(probe))
            step = float(np.linalg.norm(probe))
            if step == 0.0:
                raise IntersectionError("nothing was moved: only fixed bodies would have to move")
        ahead, momentum = old, 1.0
        for _ in range(STEPS):
            new = np.maximum(0.0, ahead + (sides - matrix @ moved(ahead)) / (1.1 * step))
            if np.dot(ahead - new, new - old) > 0:
                momentum = 1.0
            following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
            ahead = new + (momentum - 1.0) / following * (new - old)
            old, momentum = new, following
            if (sides - matrix @ moved(new) <= 1e-3 * np.abs(sides).max()).all():
                break
        self._multipliers = old
        return np.asarray(moved(old).reshape(-1, 3), np.float64)

    def _moved(self, matrix: sparse.csr_array) -> Callable[[Floats], Floats]:
        """From multipliers to displacements of the nodes, flat."""
        transposed = matrix.T.tocsr()

        def moved(multipliers: Floats) -> Floats:
            return self.motion.cheapest((transposed @ multipliers).reshape(-1, 3)).reshape(-1)

        return moved


def _parting(positions: Floats, edges: Ids, triangles: Ids) -> tuple[Ids, Floats, Floats]:
    """Vertices [k, 5], weights and directions that take edges off the triangles that they cross, the shortest way."""
    ends, corners = positions[edges], positions[triangles]
    _, direction = shortest_exits(ends, corners)
    place = _crossing_weights(ends, corners)
    along = np.concatenate([np.einsum("kcd,kd->kc", part, direction) for part in (ends, corners)], axis=1)
    size = np.abs(along).max(axis=1, keepdims=True, initial=1e-300)
    size = np.maximum(np.ptp(along, axis=1, keepdims=True), 1e-12 * size)
    last = np.concatenate(
        [along[:, :2].min(axis=1, keepdims=True)] * 2 + [along[:, 2:].max(axis=1, keepdims=True)] * 3, 1
    )
    weights = np.where(np.abs(along - last) <= 1e-9 * size, np.maximum(place, 1e-6), 0.0)
    weights[:, :2] /= weights[:, :2].sum(axis=1, keepdims=True)
    weights[:, 2:] /= -weights[:, 2:].sum(axis=1, keepdims=True)
    return np.concatenate([edges, triangles], axis=1), weights, direction


def _crossing_weights(ends: Floats, corners: Floats) -> NDArray[np.float64]:
    """Weights [k, 5] of the ends and corners in the place where edge and triangle cross."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = np.einsum("kcd,kd->kc", ends - corners[:, :1], normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(heights[:, 0] / (heights[:, 0] - heights[:, 1]), nan=0.5)
        share = np.clip(share, 0.0, 1.0)[:, None]
        place = (1 - share) * ends[:, 0] + share * ends[:, 1]
        areas = np.stack(
            [
                np.einsum("kd,kd->k", np.cross(q - place, r - place), normal)
                for q, r in (
                    (corners[:, 1], corners[:, 2]),
                    (corners[:, 2], corners[:, 0]),
                    (corners[:, 0], corners[:, 1]),
                )
            ],
            axis=1,
        )
        weights = np.nan_to_num(areas / np.einsum("kd,kd->k", normal, normal)[:, None], nan=1 / 3)
    return np.asarray(np.concatenate([1 - share, share, weights], axis=1), np.float64)
