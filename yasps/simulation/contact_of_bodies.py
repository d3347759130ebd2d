"""The union of all vertices of bodies, and contact on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps import Attribute, Scene
from yasps.bodies import Body, HalfSpace
from yasps.contact import BarrierContact, ContactTable


@dataclass(frozen=True)
class ContactOptions:
    """What a simulation was told of contact; see `Simulation`."""

    table: ContactTable
    barrier: str
    stiffness: float | None
    eps_v: float
    """[m/s]"""


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
    time_step: Attribute,
) -> BarrierContact:
    """Adds a mesh of this name with the union of all vertices and contact on it.

    activation_distance [m]; time_step: 1x1, of the scene [s]. Raises what `BarrierContact` raises.
    """
    stiffness = options.stiffness
    if stiffness is None and options.barrier == "paper":
        stiffness = 10.0 / activation_distance**3
    everything = scene.add_mesh(name)
    surfaces = [body for body in bodies if not isinstance(body, HalfSpace)]
    union = everything.add_primitive_union("vertices", [body.vertices for body in surfaces])
    union.add_attribute("position")
    union.add_attribute("rest_position")
    starts = union.offsets()
    groups = [-1 if body.meets_itself else number for number, body in enumerate(surfaces)]
    return BarrierContact(
        everything,
        union,
        np.concatenate([body.triangles + start for body, start in zip(surfaces, starts, strict=False)]),
        edges=np.concatenate([body.edges + start for body, start in zip(surfaces, starts, strict=False)]),
        points=np.concatenate([body.points + start for body, start in zip(surfaces, starts, strict=False)]),
        radii=np.concatenate([body.radii() for body in surfaces]),
        activation_distance=activation_distance,
        barrier=options.barrier,
        stiffness=stiffness,
        table=options.table,
        moduli={body.name: body.contact_modulus for body in bodies},
        planes=[body.plane for body in bodies if isinstance(body, HalfSpace)],
        fixed=stands_still(surfaces),
        group=np.repeat(groups, [len(body.rest) for body in surfaces]),
        objects={body.name: len(body.rest) for body in surfaces},
        slip_length=time_step * options.eps_v,
    )
