"""The union of all vertices of bodies, and contact on it."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, Scene, SceneError
from yasps.bodies import Body, HalfSpace
from yasps.contact import BarrierContact, ContactTable
from yasps.contact.barrier import BARRIERS
from yasps.frontend.language.arrays import positive_number
from yasps.stepping import LAGGING, Integrator, NewtonSettings, checked_integrator

LOGGER = logging.getLogger("yasps")

FRICTION_BALANCE = 1e-3
"""Relative force tolerance with friction. What sticks is so stiff that where something is about to slide, Newton
directions are shorter than any speed tells."""


@dataclass(frozen=True)
class ContactOptions:
    """What a simulation was told of contact and time steps; see `Simulation`."""

    table: ContactTable
    barrier: str
    stiffness: float | None
    eps_v: float
    """[m/s], the speed below which things stick."""
    lagging: str
    integrator: Integrator

    def __post_init__(self) -> None:
        """Raises SceneError for what can't be."""
        if not isinstance(self.table, ContactTable):
            raise SceneError(f"contacts are a ContactTable (yasps.contact), got {self.table!r}")
        for name, given, known in (("barrier", self.barrier, BARRIERS), ("lagging", self.lagging, LAGGING)):
            if given not in tuple(known):
                raise SceneError(f"{name} is one of {', '.join(map(repr, known))}, got {given!r}")
        if self.stiffness is not None:
            positive_number(self.stiffness, "contact_stiffness", BARRIERS[self.barrier].unit, SceneError)
        positive_number(self.eps_v, "eps_v", "m/s", SceneError)
        checked_integrator(self.integrator)

    def check_names(self, names: Iterable[str]) -> None:
        """Raises SceneError if the table names other bodies than these."""
        unknown = sorted(self.table.names - set(names))
        if unknown:
            raise SceneError(f"the contact table names {unknown[0]!r}, but there are only {sorted(names)}")

    def newton_settings(self, reach_speed: float, *, has_friction: bool) -> NewtonSettings:
        """With which Newton's method stops well inside the activation distance, or contact forces would be left
        half-balanced; with friction, well below the speed at which things stick, and not before forces balance.

        reach_speed: activation distances a step [m/s].
        """
        tolerance = min(2e-3, 0.1 * reach_speed)
        if not has_friction:
            return NewtonSettings(tolerance, max_iterations=500)
        tolerance = min(tolerance, 0.1 * self.eps_v)
        return NewtonSettings(tolerance, max_iterations=500, relative_force_tolerance=FRICTION_BALANCE)

    def warn_of(self, settings: NewtonSettings) -> None:
        """Warns of a tolerance with which friction is not seen."""
        if (settings.velocity_tolerance or 0.0) > 0.1 * self.eps_v:
            LOGGER.warning(
                "friction: the velocity tolerance, %.3g m/s, is more than a tenth of eps_v, %.3g m/s, the speed"
                " below which things stick: whether they do is left to chance",
                settings.velocity_tolerance,
                self.eps_v,
            )


def stands_still(bodies: Sequence[Body]) -> NDArray[np.bool_]:
    """Whether nothing ever moves a vertex, of all vertices, [n]."""
    return np.repeat([body.stands_still for body in bodies], [len(body.rest) for body in bodies])


def add_contact(
    scene: Scene,
    name: str,
    bodies: Sequence[Body],
    options: ContactOptions,
    *,
    activation_distance: float,
    effective_step: Attribute,
) -> BarrierContact:
    """Adds a mesh of this name with the union of all vertices and contact on it.

    activation_distance [m]; effective_step: 1x1, of the scene [s]. Raises what `BarrierContact` raises.
    """
    stiffness = options.stiffness
    if stiffness is None and options.barrier == "paper":
        stiffness = 10.0 / activation_distance**3
    everything = scene.add_mesh(name)
    surfaces = [body for body in bodies if not isinstance(body, HalfSpace)]
    union = everything.add_primitive_union("vertices", [body.vertices for body in surfaces])
    union.add_attribute("position")
    union.add_attribute("rest_position")
    return BarrierContact(
        everything,
        union,
        **surface_of(surfaces),
        activation_distance=activation_distance,
        barrier=options.barrier,
        stiffness=stiffness,
        table=options.table.of(body.name for body in bodies),
        moduli={body.name: body.contact_modulus for body in bodies},
        planes=[body.plane for body in bodies if isinstance(body, HalfSpace)],
        slip_length=effective_step * options.eps_v,
        room=max(body.room for body in surfaces),
    )


def surface_of(bodies: Sequence[Body]) -> dict[str, Any]:
    """The surface of bodies that have one, as contact takes it."""
    counts = [len(body.rest) for body in bodies]
    placed = list(zip(bodies, np.cumsum([0, *counts]), strict=False))
    groups = [-1 if body.meets_itself else number for number, body in enumerate(bodies)]
    return {
        "triangles": np.concatenate([body.triangles + start for body, start in placed]),
        "edges": np.concatenate([body.edges + start for body, start in placed]),
        "points": np.concatenate([body.points + start for body, start in placed]),
        "radii": np.concatenate([body.radii() for body in bodies]),
        "fixed": stands_still(bodies),
        "group": np.repeat(groups, counts),
        "objects": {body.name: count for body, count in zip(bodies, counts, strict=True)},
    }
