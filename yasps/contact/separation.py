"""Small overlaps of bodies are taken away before the first step, by moving vertices as little as possible.

What has to part gives inequalities (see `yasps.contact.partings`). What costs least and obeys all of them is a
quadratic program; its solution is looked at anew, what is found then is added, until nothing is. Bodies are moved as
wholes first; only where that does not do are soft ones bent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from yasps import IntersectionError, SceneError
from yasps.contact.active_set import Floats
from yasps.contact.contact_table import ContactTable
from yasps.contact.partings import Bendings, Inequalities, Translations
from yasps.contact.start_state import SOLIDS, StartBody, Surfaces
from yasps.frontend.language.arrays import positive_number

ROUNDS = 60
"""So often is looked whether bodies moved as wholes are apart."""
BENT_ROUNDS = 25
"""So often where they are bent, too."""
MOST = 3000
"""Inequalities beyond which an overlap is no small one."""
STEPS = 2000
"""Iterations of one quadratic program."""
SMOOTH = 10.0
"""Stiffness of the springs along the edges of soft bodies, in masses of a vertex: how far a push spreads."""


@dataclass(frozen=True)
class Separation:
    """What `separate` did."""

    moved: dict[str, float]
    """Body -> the longest way of one of its vertices [m], of the bodies that moved."""
    gap: float
    """The least gap between bodies that there is now at least [m]."""
    bent: bool
    """Whether soft bodies were bent; otherwise all were moved as wholes."""

    def __str__(self) -> str:
        if not self.moved:
            return f"all bodies were {self.gap:.3g} m apart already"
        ways = ", ".join(f"{name!r} by up to {way:.3g} m" for name, way in self.moved.items())
        how = "moved and bent" if self.bent else "moved"
        return f"{how} {ways}; all bodies are at least {self.gap:.3g} m apart"


def separate(
    bodies: Sequence[StartBody],
    *,
    gap: float | None = None,
    largest_share: float = 0.1,
    table: ContactTable | None = None,
) -> Separation:
    """Moves bodies that overlap, touch or are too near each other apart, by as little as possible, and says how far.

    Bodies are translated; of two, the heavier moves less, and fixed ones stay. Where that does not part them, soft
    bodies and cloth are bent as well, by displacements of their vertices that spread along their edges. Pieces of one
    body that are near each other stay as they are.

    gap: least distance of different bodies, less their radii, afterwards [m]; default 1/1000 of the diagonal of the box
    around what moves, which is the activation distance that a `Simulation` chooses. largest_share: overlaps deeper, and
    ways longer, than this share of the diagonal of the smaller body are no small ones. table: bodies that don't meet by
    it may overlap.

    Call it before the simulation is made. Raises IntersectionError for overlaps that are too large or that no small
    motion takes away and for what crosses itself, SceneError for wrong arguments; all bodies are then where they were.
    """
    if not positive_number(largest_share, "largest_share", "of a body's size", SceneError) <= 1:
        raise SceneError(f"largest_share is a share of a body's size between 0 and 1, got {largest_share}")
    surfaces = Surfaces(bodies, table)
    free = [body for body in surfaces.bodies if not body.is_fixed]
    if not free:
        raise SceneError("nothing can be moved: all bodies are fixed")
    if gap is None:
        gap = 1e-3 * float(np.linalg.norm(np.ptp(np.concatenate([body.positions() for body in free]), axis=0)))
    gap = positive_number(gap, "gap", "m", SceneError)
    start = surfaces.parts
    sizes = np.array([np.linalg.norm(np.ptp(part, axis=0)) for part in start])
    for overlap, pair in surfaces.overlaps():
        allowed = largest_share * float(sizes[list(pair)].min())
        if overlap.depth > allowed:
            raise IntersectionError(
                f"nothing was moved: {overlap}. That is no small overlap, which are up to {allowed:.3g} m deep here"
                f" ({largest_share:g} of the smaller body's size): place the bodies farther apart"
            )
        if pair[0] == pair[-1] and not overlap.in_half_space:
            raise IntersectionError(
                f"nothing was moved: {overlap}. A surface that crosses itself has to be mended by hand"
            )
    can_bend = any(_is_free(body) for body in free)
    flipped = {flip.body: len(flip.elements) for flip in surfaces.flipped()}
    bent, done = False, _part(surfaces, Translations(surfaces), _Program(surfaces, bends=False), gap, ROUNDS)
    if not done and can_bend:
        surfaces.move_to(np.concatenate(start))
        bent, done = True, _part(surfaces, Bendings(surfaces), _Program(surfaces, bends=True), gap, BENT_ROUNDS)
    if not done:
        left = "\n".join(str(overlap) for overlap, _ in surfaces.overlaps()) or "bodies are nearer than the gap"
        raise IntersectionError(
            f"nothing was moved: no small motion was found that parts the bodies by {gap:.3g} m. What was left: {left}."
            " Try a smaller gap, or place the bodies farther apart"
        )
    ways = [np.linalg.norm(new - old, axis=1).max() for new, old in zip(surfaces.parts, start, strict=True)]
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
    for body, old, new in zip(surfaces.bodies, start, surfaces.parts, strict=True):
        if _is_free(body):
            body.position.update_value(new)
        elif not body.is_fixed:
            (translation,) = body.falling
            translation.update_value(translation.value + (new - old)[0])
    moved = {body.name: float(way) for body, way in zip(surfaces.bodies, ways, strict=True) if way > 0}
    return Separation(moved, gap, bent)


def _is_free(body: StartBody) -> bool:
    """Can each of its vertices be moved alone?"""
    return any(target is body.position for target in body.targets)


def _part(surfaces: Surfaces, partings: Translations | Bendings, program: _Program, gap: float, rounds: int) -> bool:
    """Moves the surfaces until nothing has to part any more; False where that does not happen."""
    for _ in range(rounds):
        found = partings.look(gap)
        if not found:
            return True
        ways = program.displacements() if program.add(found) else None
        if ways is None:
            return False
        surfaces.move_to(program.start + ways)
    return not partings.look(gap)


class _Program:
    """The quadratic program: nodes with three coordinates each, a body that moves as a whole being one; what moving
    them costs; and all inequalities so far."""

    def __init__(self, surfaces: Surfaces, *, bends: bool) -> None:
        self.start = surfaces.positions
        self.node = np.full(len(self.start), -1)
        """The node that carries each vertex; -1: none."""
        costs, count = [], 0
        for number, body in enumerate(surfaces.bodies):
            here = slice(int(surfaces.starts[number]), int(surfaces.starts[number + 1]))
            if body.is_fixed:
                continue
            mass = np.asarray(body.mass.value, np.float64).reshape(-1)
            if _is_free(body) and bends:
                self.node[here] = count + np.arange(len(mass))
                costs.append(_cost_of_bending(body, mass))
            elif _is_free(body) or (len(body.falling) == 1 and len(body.falling[0].value) == 3):
                self.node[here] = count
                costs.append(sparse.csc_array([[mass.sum()]]))
            else:
                raise SceneError(
                    f"{body.name} can't be moved by separate: its positions are no target, nor has it one translation"
                    " (`falling`)"
                )
            count += costs[-1].shape[0]
        self._count = count
        self._cost = splu(sparse.block_diag(costs, format="csc"))
        self._answers, self._gram = np.empty((count, 0)), np.empty((0, 0))
        """A^-1 G^T of all rows G, and G A^-1 G^T."""
        self._normals, self._sides, self._multipliers = np.empty((0, 3)), np.empty(0), np.empty(0)

    def add(self, parts: Sequence[Inequalities]) -> bool:
        """Adds inequalities; False if they are too many, or only fixed bodies would have to move."""
        if len(self._sides) + sum(len(part.levels) for part in parts) > MOST:
            return False
        for part in parts:
            nodes = self.node[part.vertices]
            here = np.broadcast_to(np.arange(len(nodes))[:, None], nodes.shape)
            chosen = nodes >= 0
            table = (part.weights[chosen], (nodes[chosen], here[chosen]))
            rows = sparse.coo_array(table, shape=(self._count, len(nodes))).toarray()
            answers = self._cost.solve(rows)
            across, own = self._answers.T @ rows, answers.T @ rows
            if not (own.diagonal() > 0).all():
                return False
            self._gram = np.block([[self._gram, across], [across.T, own]])
            self._answers = np.concatenate([self._answers, answers], axis=1)
            now = np.einsum("kv,kvd,kd->k", part.weights, self.start[part.vertices], part.normals)
            self._normals = np.concatenate([self._normals, part.normals])
            self._sides = np.concatenate([self._sides, part.levels - now])
        return True

    def displacements(self) -> Floats | None:
        """Of all vertices, [n, 3]: what costs least and obeys all inequalities, by accelerated projected gradients of
        the dual problem (Beck and Teboulle 2009), started from the last multipliers. None where they contradict."""
        matrix, sides = self._gram * (self._normals @ self._normals.T), self._sides
        # Rows of like size: the dual problem of light and heavy bodies is badly scaled otherwise.
        size = 1.0 / np.sqrt(matrix.diagonal())
        matrix, sides = size[:, None] * matrix * size, size * sides
        old = np.concatenate([self._multipliers, np.zeros(len(sides) - len(self._multipliers))]) / size
        step = 1.0 / float(np.linalg.norm(matrix, np.inf))
        ahead, momentum = old, 1.0
        for _ in range(STEPS):
            new = np.maximum(0.0, ahead + step * (sides - matrix @ ahead))
            if np.dot(ahead - new, new - old) > 0:
                momentum = 1.0
            following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
            ahead = new + (momentum - 1.0) / following * (new - old)
            old, momentum = new, following
            if (sides - matrix @ new <= 1e-3 * np.abs(sides).max()).all():
                break
        if (sides - matrix @ old > 0.1 * np.abs(sides).max()).any():
            return None
        self._multipliers = old * size
        nodes = self._answers @ (self._multipliers[:, None] * self._normals)
        return np.where((self.node >= 0)[:, None], nodes[self.node], 0.0)


def _cost_of_bending(body: StartBody, mass: Floats) -> sparse.csc_array:
    """Masses, and springs along all edges of the elements."""
    cells = next((cells for kind, cells in body.cells.items() if kind in SOLIDS), body.triangles)
    ends = [(k, j) for k in range(cells.shape[1]) for j in range(k)]
    edges = np.unique(np.sort(np.concatenate([cells[:, pair] for pair in ends]), axis=1), axis=0)
    a, b = edges[:, 0], edges[:, 1]
    strength = SMOOTH * 0.5 * (mass[a] + mass[b])
    rows, columns = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
    values = np.concatenate([strength, strength, -strength, -strength])
    springs = sparse.coo_array((values, (rows, columns)), shape=(len(mass), len(mass)))
    return sparse.csc_array(springs + sparse.diags_array(mass))
