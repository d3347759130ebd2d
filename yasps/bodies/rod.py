"""Thin rods: hair, threads, cables, noodles."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Scene, SceneError, materials
from yasps.bodies.body import Body, checked_density
from yasps.frontend.language.arrays import positive_number
from yasps.meshes.tetrahedral_mesh import Float64Array, Int32Array


class Rod(Body):
    """Round rods of straight segments that stretch and bend; each vertex is free. Straight at rest, and without twist.

    `vertices`: `position` (a target), `rest_position`, `mass`. `segments`: `ends`, `positions`, `rest_length` [m],
    `stretching`. `bends`, one for each vertex between two segments: `corners`, `positions`, `rest_length` [m] of both,
    `bending`. `mesh`: `stretch_stiffness` E A [N], `bend_stiffness` E I [N m^2].
    """

    def __init__(
        self,
        scene: Scene,
        name: str,
        points: ArrayLike | Sequence[ArrayLike],
        *,
        radius: float,
        density: float = 1000.0,
        youngs_modulus: float = 1e6,
    ) -> None:
        """Adds one rod, or several that have all numbers in common.

        points: of the centre line of one open rod [n, 3], or a list of these, each of its own length; segments are
        unstretched there, and where they meet at an angle the rod is bent. radius [m]: of the round cross-section, and
        of contact; density [kg/m^3]; youngs_modulus E [Pa].

        A rod resists stretching by E pi r^2 and bending by E pi r^4 / 4 (`materials.rod_stretching`, `rod_bending`);
        what turns about its own axis costs nothing. With rest curvature or twist, write
        `materials.rod_material_bending` and `rod_twisting`. Raises SceneError, DataError, ShapeMismatchError,
        NameTakenError.
        """
        radius = positive_number(radius, f"{name}: radius", "m", SceneError)
        density = checked_density(name, density, "kg/m^3")
        youngs_modulus = positive_number(youngs_modulus, f"{name}: youngs_modulus", "Pa", SceneError)
        strands = _strands(name, points)
        section = np.pi * radius**2
        starts = np.cumsum([0, *(len(strand) for strand in strands)])
        rest = np.concatenate(strands)
        edges = _runs(starts, 2)
        lengths = np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)
        super().__init__(scene, name, rest, radius)
        self.contact_modulus = youngs_modulus
        self.triangles, self.edges = np.empty((0, 3), np.int32), edges
        self.cells = {"line": edges}
        self.vertices = self.mesh.add_primitive("vertices", num_instances=len(rest))
        position = self.vertices.add_attribute("position", rows=3, cols=1, value=rest)
        self.vertices.add_constant("rest_position", rows=3, cols=1, value=rest)
        mass = np.bincount(edges.ravel(), np.repeat(0.5 * density * section * lengths, 2), len(rest))
        self.vertices.add_constant("mass", rows=1, cols=1, value=mass)
        self.targets = self.falling = (position,)

        self.segments = self.mesh.add_primitive("segments", num_instances=len(edges))
        ends = self.segments.add_connectivity("ends", self.vertices, edges, 2)
        x = self.segments.add_attribute("positions", through=ends, source=position)
        rest_length = self.segments.add_constant("rest_length", rows=1, cols=1, value=lengths)
        stiffness = self.mesh.add_constant("stretch_stiffness", 1, 1, value=youngs_modulus * section)
        stretching = materials.rod_stretching(x, rest_length, stiffness)
        self.add_energy(self.segments.add_attribute("stretching", computed_attribute=stretching))

        triples = _runs(starts, 3)
        if len(triples) == 0:  # single segments can't bend
            return
        self.bends = self.mesh.add_primitive("bends", num_instances=len(triples))
        corners = self.bends.add_connectivity("corners", self.vertices, triples, 3)
        x = self.bends.add_attribute("positions", through=corners, source=position)
        both = np.linalg.norm(np.diff(rest[triples], axis=1), axis=2).sum(axis=1)
        rest_length = self.bends.add_constant("rest_length", rows=1, cols=1, value=both)
        stiffness = self.mesh.add_constant("bend_stiffness", 1, 1, value=youngs_modulus * section * radius**2 / 4)
        bending = materials.rod_bending(x, rest_length, stiffness)
        self.add_energy(self.bends.add_attribute("bending", computed_attribute=bending))


def _strands(name: str, points: ArrayLike | Sequence[ArrayLike]) -> list[Float64Array]:
    """The points of each rod, [n, 3]. Raises SceneError, DataError, ShapeMismatchError."""
    one: Any = points
    given = list(one) if isinstance(one, list | tuple) or np.ndim(one) == 3 else [one]
    if given and np.ndim(given[0]) == 1:  # a list of points: one rod
        given = [one]
    if not given:
        raise SceneError(f"{name}: points are those of at least one rod, got none")
    for strand in given:
        materials.rod_tangents(strand)
    return [np.array(strand, np.float64) for strand in given]


def _runs(starts: NDArray[np.int64], count: int) -> Int32Array:
    """So many vertices in a row, at every place where they belong to one rod, [m, count]; starts: first vertices of the
    rods, and the number of all."""
    firsts = [np.arange(start, end - count + 1) for start, end in pairwise(starts.tolist())]
    return (np.concatenate(firsts)[:, None] + np.arange(count)).astype(np.int32)
