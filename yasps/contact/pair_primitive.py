"""A dynamic primitive for one kind of contact, with what energies of contact read on it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, concat_rows, minimum
from yasps.contact.active_set import Ids, Pairs, PlanePairs
from yasps.contact.barrier import excess_of, mollifier, mollifier_threshold, range_of
from yasps.contact.contact_parts import ContactParts
from yasps.contact.kinds import Kind


class PairPrimitive:
    """A dynamic primitive whose instances are pairs of one kind.

    weight: [m^2], or a number of pairs where contact has no areas. Corners x of a pair: see `corners`.
    """

    def __init__(self, parts: ContactParts, name: str, kind: Kind, *, names_points: bool = False) -> None:
        """Adds the primitive to the mesh, without instances. names_points: corners of attributes of the points will be
        asked for. Raises NameTakenError."""
        self.parts, self.kind = parts, kind
        self.primitive = parts.mesh.add_primitive(name, 0, is_dynamic=True)
        self.vertices = self.primitive.add_connectivity("vertices", parts.vertices, [], kind.arity)
        self._law = self.primitive.add_connectivity("law", parts.laws, [], 1)
        self._counted = kind.counted if parts.measures is not None else 0
        self._names_points = names_points or parts.is_thick or kind.edges is not None
        if self._names_points:
            self._to_points = self.primitive.add_connectivity("points", parts.points, [], kind.arity)
        if kind.is_plane:
            assert parts.planes is not None
            self._plane = self.primitive.add_connectivity("plane", parts.planes, [], 1)
        self.weight = self._weight()
        if parts.is_thick:
            self._radii = self._of_points("radius")
            self._share = self.primitive.add_constant("share", 1, 1)
        if kind.edges is not None:
            rest = self._of_points("rest_position")
            (a, b), (c, d) = kind.edges
            self._threshold = self.primitive.add_attribute(
                "threshold",
                computed_attribute=mollifier_threshold(rest.row(b) - rest.row(a), rest.row(d) - rest.row(c)),
            )

    def of_law(self, name: str) -> Attribute:
        """A number of the pair's law: `stiffness`, `friction` or `kinetic_friction`."""
        return self.primitive.add_attribute(name, through=self._law, source=self.parts.laws[name])

    def corners(self, name: str, source: Attribute) -> Attribute:
        """The corners of a pair as its kind wants them, [arity, 3]: a 3x1 attribute of the vertices, or of the points,
        at its vertices. Below that of a vertex near a plane come the plane's normal and a point of it."""
        through = self.vertices if source.owner is self.parts.vertices else self._to_points
        rows = self.primitive.add_attribute(name, through=through, source=source)
        if not self.kind.is_plane:
            return rows
        assert self.parts.planes is not None
        plane = [
            self.primitive.add_attribute(f"{name}_{part}", through=self._plane, source=self.parts.planes[part])
            for part in ("normal", "point")
        ]
        return concat_rows([rows, *plane])

    def _of_points(self, name: str) -> Attribute:
        return self.primitive.add_attribute(f"{name}s", through=self._to_points, source=self.parts.points[name])

    def _weight(self) -> Attribute:
        measures, kind = self.parts.measures, self.kind
        if measures is None:
            return self.primitive.add_constant("weight", 1, 1)
        weight: Attribute | None = None
        if kind.counted:
            # By themselves: an area is a sum over triangles, and those of all points would be worked out.
            counted = self.primitive.add_connectivity("counted", self.parts.points, [], kind.counted)
            areas = self.primitive.add_attribute("areas", through=counted, source=measures.points["half_area"])
            if kind.is_plane:
                weight = 2 * areas  # nobody else takes the other half
            elif kind.of_edges:
                weight = self.primitive.add_constant("counts", kind.counted, 1).dot(areas)
            else:
                weight = areas
        if kind.of_edges:
            edges = self.primitive.add_connectivity("edges", measures.edges, [], 2)
            one, other = self.primitive.add_attribute("edge_areas", through=edges, source=measures.edges["half_area"])
            of_edges = 2 * minimum(one, other)  # a short edge on a long one touches it along the short one
            weight = of_edges if weight is None else weight + of_edges
        assert weight is not None
        return self.primitive.add_attribute("weight", computed_attribute=weight)

    # -- energies ------------------------------------------------------------------------------------------

    def offset(self, x: Attribute) -> Attribute | None:
        """The sum of both radii [m] where a pair with these corners touches; None if nothing has a radius."""
        if not self.parts.is_thick:
            return None
        if self.parts.radii_vary:
            return self._share * self.kind.weights(x).abs().dot(self._radii)
        return self._share * sum(self._radii.row(side) for side in dict.fromkeys(self.kind.sides))

    def excess(self, x: Attribute) -> tuple[Attribute, Attribute]:
        """Excess and activation of `BarrierLaw` [m^2] of a pair with these corners."""
        offset = self.offset(x)
        excess = excess_of(self.kind.squared_distance(x), offset)
        return excess, range_of(self.parts.reach, self.parts.squared_reach, offset)

    def scale(self, stiffness: Attribute) -> Attribute:
        """What multiplies the barrier, apart from weight and mollifier."""
        return stiffness if self.parts.measures is None else stiffness * self.parts.reach

    def mollified(self, value: Attribute, x: Attribute) -> Attribute:
        """A value times the mollifier of a pair with these corners."""
        if self.kind.edges is None:
            return value
        (a, b), (c, d) = self.kind.edges
        return value * mollifier(x.row(b) - x.row(a), x.row(d) - x.row(c), self._threshold)

    # -- instances -----------------------------------------------------------------------------------------

    def update(self, pairs: Pairs, laws: Ids) -> None:
        """Makes these pairs, with these laws [n], the instances."""
        given: dict[str, NDArray[Any]] = {"vertices": pairs.vertices, "law": laws.reshape(-1, 1)}
        if self._names_points:
            given["points"] = pairs.vertices
        if self._counted:
            given["counted"] = pairs.vertices[:, : self._counted]
        if self.parts.measures is None:
            given["weight"] = pairs.weight
        elif self.kind.of_edges:
            given["edges"] = pairs.edges
            if self.kind.counted:
                given["counts"] = pairs.counts[:, : self.kind.counted].astype(np.float64)
        if self.parts.is_thick:
            given["share"] = pairs.share
        if isinstance(pairs, PlanePairs):
            given["plane"] = pairs.planes.reshape(-1, 1)
        self.primitive.update(**given)
