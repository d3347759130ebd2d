"""Contact that is not there yet: what a direction of Newton's method would run into, as springs.

The quadratic model of a Newton step knows the barriers of pairs that are close now. Of what is farther away than the
activation distance it knows nothing, so that the step leads through it and is cut short at the first of these pairs,
for all vertices of the scene. Here the pairs in the way are constraints on the direction, linear in positions as in
sequential quadratic programming: along the normal with which a pair would meet, its closest points at that time keep
some of their gap. They enter as springs that push where a constraint is broken (a quadratic penalty).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps.contact.active_set import Floats, Ids
from yasps.contact.collision_geometry import Candidates, CollisionGeometry
from yasps.contact.contact_parts import ContactParts
from yasps.contact.half_spaces import HalfSpaces

KEPT = 0.9
"""Share of its gap, or of the activation distance if that is less, that a pair keeps by its constraint: so near that
its barrier acts in the next iteration, and so far that it does not push it back over several."""


@dataclass(frozen=True)
class Constraints:
    """Half-spaces of all positions x: the sum of weights_i normal . x_i over a pair's vertices is at least `least`."""

    vertices: Ids
    """[m, 4]; vertices with weight 0 may be any."""
    weights: Floats
    """[m, 4]"""
    normals: Floats
    """[m, 3], unit vectors."""
    least: Floats
    """[m], [m]."""

    def __len__(self) -> int:
        return len(self.least)

    def heights(self, positions: Floats) -> Floats:
        """The sums at these positions [m]."""
        return np.asarray(np.einsum("mi,mid,md->m", self.weights, positions[self.vertices], self.normals))

    def lacking(self, positions: Floats) -> Floats:
        """By how much each is broken at these positions [m]; 0 if it is not."""
        return np.asarray(np.maximum(self.least - self.heights(positions), 0.0))

    def chosen(self, mask: NDArray[np.bool_]) -> Constraints:
        """Those where the mask [m] says so."""
        return Constraints(*(value[mask] for value in vars(self).values()))

    def without(self, others: Constraints) -> Constraints:
        """Those of pairs that the others have none of."""
        if len(self) == 0 or len(others) == 0:
            return self
        _, group = np.unique(np.concatenate([self.vertices, others.vertices]), axis=0, return_inverse=True)
        group = group.ravel()
        return self.chosen(~np.isin(group[: len(self)], group[len(self) :]))

    def and_also(self, others: Constraints) -> Constraints:
        """Both."""
        pairs = zip(vars(self).values(), vars(others).values(), strict=True)
        return Constraints(*(np.concatenate(both) for both in pairs))


class LookAhead:
    """Springs for pairs that are in the way of a direction: a dynamic primitive `ahead`, which is empty in between."""

    def __init__(self, parts: ContactParts, geometry: CollisionGeometry, half_spaces: HalfSpaces) -> None:
        """Adds the primitive and its energy, without springs. Raises NameTakenError."""
        self.look_at(geometry, half_spaces)
        self._springs = parts.mesh.add_primitive("ahead", 0, is_dynamic=True)
        corners = self._springs.add_connectivity("vertices", parts.vertices, [], 4)
        x = self._springs.add_attribute("positions", through=corners, source=parts.vertices["position"])
        along = self._springs.add_constant("along", 4, 3)  # weight times normal: kernels keep less at a time
        least, stiffness = self._springs.add_constant("least", 1, 1), self._springs.add_constant("stiffness", 1, 1)
        lacking = least - x.dot(along)
        self.energy = self._springs.add_attribute("push", computed_attribute=0.5 * stiffness * lacking * lacking)
        parts.mesh.scene.add_energy(self.energy)

    def look_at(self, geometry: CollisionGeometry, half_spaces: HalfSpaces) -> None:
        """Another surface of the vertices."""
        self._geometry, self._half_spaces = geometry, half_spaces

    def constraints(self, start: Floats, end: Floats, candidates: Candidates) -> Constraints:
        """Of all pairs and half-spaces that are in the way from start to end [n, 3]. None is broken at the start."""
        geometry, planes = self._geometry, self._half_spaces
        found = geometry.meetings(start, end, candidates)
        length = np.linalg.norm(found.ways, axis=1)
        sure = length > 0
        normals = found.ways[sure] / length[sure, None]
        kept = found.offsets[sure] + KEPT * np.minimum(found.gaps[sure], geometry.activation_distance)
        surfaces = Constraints(found.vertices[sure], found.weights[sure], normals, kept)
        if len(planes):
            vertices, which, gaps = planes.meetings(start, end)
            normals = planes.normals[which]
            heights = np.einsum("md,md->m", normals, planes.points[which]) + planes.radii_of(vertices)
            kept = heights + KEPT * np.minimum(gaps, geometry.activation_distance)
            ids, weights = np.repeat(vertices[:, None], 4, axis=1), np.tile([1.0, 0.0, 0.0, 0.0], (len(vertices), 1))
            surfaces = surfaces.and_also(Constraints(ids, weights, normals, kept))
        # Pieces that turn may be nearer along the normal of their meeting now than they shall be kept.
        least = surfaces.least - surfaces.lacking(start)
        return Constraints(surfaces.vertices, surfaces.weights, surfaces.normals, least)

    def show(self, constraints: Constraints, stiffness: float) -> None:
        """Gives the scene springs for these constraints, all of them pushing or pulling; stiffness [N/m]."""
        self._springs.update(
            vertices=constraints.vertices,
            along=constraints.weights[:, :, None] * constraints.normals[:, None, :],
            least=constraints.least,
            stiffness=np.full(len(constraints), stiffness),
        )

    def hide(self) -> None:
        """Takes all springs away."""
        nothing = np.empty((0, 3))
        self.show(Constraints(np.empty((0, 4), np.int32), np.empty((0, 4)), nothing, np.empty(0)), 0.0)
