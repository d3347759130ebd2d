"""Lagged smoothed Coulomb friction (Li et al. 2020, section 5).

At the beginning of a step, or of a lagging pass, normal forces, closest points and tangent planes of all close pairs
are fixed; friction then has a potential. Its argument is the slip: how far one piece has moved along the other since
the beginning of the step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from yasps import Attribute, Connectivity, FloatArray, Mesh, SceneError, constant, maximum, select
from yasps.contact.active_set import Ids, Pairs
from yasps.contact.contact_parts import ContactParts
from yasps.contact.kinds import Kind
from yasps.contact.pair_primitive import PairPrimitive
from yasps.frontend.language.arrays import positive_number

KINETIC_FROM = 10.0
"""Slip, in slip lengths, from which on friction is kinetic."""


def smoothed_distance(slip: Attribute, slip_length: Attribute) -> Attribute:
    """F of the length y of a slip [m], any shape: e/3 + y^2/e - y^3/(3 e^2) below the slip length e, y from there on.

    Twice continuously differentiable, at y = 0 too: F' = f1 = 2 y/e - y^2/e^2, then 1. Derivatives of the norm at 0 are
    the compiler's; they are right to rounding there and near it.
    """
    y = slip.norm()
    share = y / slip_length
    return select(y < slip_length, slip_length / 3 + y * share * (1 - share / 3), y)


def sliding_distance(slip: Attribute, slip_length: Attribute, static: Attribute, kinetic: Attribute) -> Attribute:
    """W, whose derivative by the length y of the slip is mu(y) f1(y): times the normal force, friction's potential [m].

    mu is the static coefficient up to the slip length e, the kinetic one from 10 e on, and falls from one to the other
    with two continuous derivatives in between (the polynomial 6 q^5 - 15 q^4 + 10 q^3). So friction reaches all of the
    static coefficient before anything slides; in ipctk's version of it mu falls within e already, and the force never
    does. Where both coefficients are equal, W is the coefficient times `smoothed_distance`, to the last bit.
    """
    width = (KINETIC_FROM - 1) * slip_length
    q = maximum(slip.norm() / width - 1 / (KINETIC_FROM - 1), constant(0.0))
    lost = select(q < 1, q**4 * (2.5 - q * (3 - q)), q - 0.5)
    return static * smoothed_distance(slip, slip_length) - (static - kinetic) * (width * lost)


def slip_of(kind: Kind, way: Attribute, lagged: Attribute) -> Attribute:
    """The slip of a pair, 2x1 [m]: how far its second piece has come along the first, in the lagged tangent basis.

    way: how far each of its vertices has come since the beginning of the step, arity x 3 [m]. lagged: its corners when
    it was lagged. Linear in the way, so that Hessians of friction are projected as 2x2 matrices.
    """
    return kind.tangents(lagged).T * (way.T * kind.weights(lagged))


def normal_force(pairs: PairPrimitive, lagged: Attribute) -> Attribute:
    """-dE/dd [N] of the barrier of a pair by its distance d, at lagged corners; weight and mollifier count as they do
    there. As negative as its weight, should that be."""
    excess, activation = pairs.excess(lagged)
    slope = pairs.parts.barrier.slope(excess, activation, pairs.scale(pairs.of_law("stiffness")))
    distance = pairs.kind.squared_distance(lagged).sqrt()
    return pairs.mollified(-2 * distance * (pairs.weight * slope), lagged)


def checked_slip_length(slip_length: float | Attribute | None, mesh: Mesh) -> float | Attribute:
    """Raises SceneError unless this is a positive length, or a 1x1 attribute of the mesh or its scene."""
    if slip_length is None:
        raise SceneError(
            "the contact table has friction, but nothing says up to which slip things stick: give slip_length [m], the"
            " speed below which they count as at rest (1e-3 m/s, say) times the time step"
        )
    if not isinstance(slip_length, Attribute):
        return positive_number(slip_length, "slip_length", "m", SceneError)
    if slip_length.shape != (1, 1) or slip_length.owner not in mesh.lineage():
        raise SceneError(f"slip_length is a length [m], 1x1, of {mesh.label} or its scene, got {slip_length!r}")
    return slip_length


@dataclass(frozen=True)
class Lag:
    """What friction is lagged at: positions of all vertices at the beginning of the step and when it was lagged,
    [n, 3], and by kind the pairs that rub, with their laws."""

    previous: FloatArray
    positions: FloatArray
    pairs: Mapping[str, tuple[Pairs, Ids]]


class Friction:
    """Friction of all close pairs of a scene: for each kind a dynamic primitive, its name followed by `_friction`.

    Their pairs are those that were close when friction was lagged and rub by their law. The positions then are the
    constant `lagged_position` of the surface's points, those at the beginning of the step `previous_position`; normal
    forces, closest points and tangent planes are attributes of them.
    """

    def __init__(
        self,
        parts: ContactParts,
        kinds: Mapping[str, Kind],
        *,
        slip_length: float | Attribute,
        positions: FloatArray,
        projection: str,
    ) -> None:
        """Adds primitives and energies, without pairs.

        slip_length [m]: how far a pair slips within a step before friction has its full force, a number or an attribute
        of mesh or scene. positions: of all vertices now, [n, 3]. Raises NameTakenError.
        """
        mesh, points = parts.mesh, parts.points
        self._coefficients = parts.laws["friction"]
        if not isinstance(slip_length, Attribute):
            slip_length = mesh.add_constant("slip_length", 1, 1, value=slip_length)
        self.slip_length = slip_length
        self._lagged = points.add_constant("lagged_position", 3, 1, value=positions)
        self._previous = points.add_constant("previous_position", 3, 1, value=positions)
        self.primitives: dict[str, PairPrimitive] = {}
        self._lag = Lag(positions, positions, {})
        for name, kind in kinds.items():
            pairs = PairPrimitive(parts, f"{name}_friction", kind, names_points=True)
            x = pairs.corners("positions", parts.vertices["position"])
            lagged = pairs.corners("lagged_positions", self._lagged)
            way = x - pairs.corners("previous_positions", self._previous)
            slip = slip_of(kind, way.block(0, 0, kind.arity, 3), lagged)
            slid = sliding_distance(slip, self.slip_length, pairs.of_law("friction"), pairs.of_law("kinetic_friction"))
            force = pairs.primitive.add_attribute("normal_force", computed_attribute=normal_force(pairs, lagged))
            energy = pairs.primitive.add_attribute("potential", computed_attribute=force * slid)
            mesh.scene.add_energy(energy, projection=projection)
            self.primitives[name] = pairs

    @property
    def energies(self) -> list[Attribute]:
        """Friction of all kinds."""
        return [pairs.primitive["potential"] for pairs in self.primitives.values()]

    def resized(self, count: int) -> dict[Attribute | Connectivity, Any]:
        """What `Scene.resize` takes for so many vertices; `restart` follows."""
        return dict.fromkeys((self._lagged, self._previous), np.zeros((count, 3)))

    def restart(self, positions: FloatArray) -> None:
        """After the scene was resized, without pairs: lagged at these positions [n, 3], from which slips count."""
        self._lag = Lag(positions, positions, {})
        self._lagged.update_value(positions)
        self._previous.update_value(positions)

    def start_step(self, previous: FloatArray) -> None:
        """Where all vertices are at the beginning of a step, [n, 3]: slips count from there."""
        self.load(replace(self._lag, previous=previous))

    def take(self, positions: FloatArray, pairs: Mapping[str, Pairs], laws: Mapping[str, Ids]) -> None:
        """Lags friction: takes normal forces, closest points and tangent planes from these positions [n, 3], and the
        pairs that are close there, of which those rub whose law [n of the kind] has friction."""
        has_friction = self._coefficients.value > 0
        rubs = {name: has_friction[laws[name]] for name in pairs}
        chosen = {name: (all_of.chosen(rubs[name]), laws[name][rubs[name]]) for name, all_of in pairs.items()}
        self.load(replace(self._lag, positions=positions, pairs=chosen))

    def save(self) -> Lag:
        """What friction was lagged at, for `load`."""
        return self._lag

    def load(self, lag: Lag) -> None:
        """Lags friction as it was. Costs next to nothing where pairs and positions are the same."""
        old, self._lag = self._lag, lag
        if not np.array_equal(old.previous, lag.previous):
            self._previous.update_value(lag.previous)
        if not np.array_equal(old.positions, lag.positions):
            self._lagged.update_value(lag.positions)
        for name, (pairs, laws) in lag.pairs.items():
            if name not in old.pairs or not pairs.same_as(old.pairs[name][0]):
                self.primitives[name].update(pairs, laws)
