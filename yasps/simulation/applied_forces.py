"""Forces that a user puts on bodies: given numbers, or fields that are asked before every step."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from yasps import Attribute, ShapeMismatchError, materials
from yasps.bodies import Body
from yasps.frontend.language.arrays import real_numbers
from yasps.meshes.tetrahedral_mesh import Float64Array

ForceField: TypeAlias = Callable[[Float64Array, Float64Array, float], ArrayLike]
"""Forces [N] on vertices, [n, 3] or [3], of their positions [m] and velocities [m/s], both [n, 3], and the time [s]."""


class AppliedForces:
    """The forces on bodies of one simulation; velocity_of: of a body's vertices [m/s], [n, 3]; time: now [s]."""

    def __init__(self, velocity_of: Callable[[Body], Float64Array], time: Callable[[], float]) -> None:
        self._velocity_of, self._time = velocity_of, time
        self._fields: list[tuple[Body, str, ForceField]] = []

    def add(self, body: Body, force: ArrayLike | ForceField, name: str) -> Attribute:
        """See `Simulation.add_force`; the body moves."""
        values = self._now(body, force, name)
        for part in (name, f"{name}_load"):
            body.vertices.check_name(part, "a force")
        holder = body.vertices.add_constant(name, 3, 1, value=values)
        load = materials.dead_load(body.position, holder)
        body.add_energy(body.vertices.add_attribute(f"{name}_load", computed_attribute=load))
        if callable(force):
            self._fields.append((body, name, force))
        return holder

    @property
    def has_fields(self) -> bool:
        """Whether any force is a field."""
        return bool(self._fields)

    def forget(self, body: Body) -> None:
        """Asks no fields of a body any more; what they said last acts no longer."""
        for of, name, _ in self._fields:
            if of is body:
                body.vertices[name].update_value(np.zeros(body.rest.shape))
        self._fields = [field for field in self._fields if field[0] is not body]

    def fields_on(self, body: Body) -> list[Attribute]:
        """What holds the forces that fields of a body say."""
        return [of.vertices[name] for of, name, _ in self._fields if of is body]

    def update(self) -> None:
        """Asks all fields. Raises DataError, ShapeMismatchError, and what fields raise; no force is changed then."""
        found = [(body.vertices[name], self._now(body, field, name)) for body, name, field in self._fields]
        for holder, values in found:
            holder.update_value(values)

    def _now(self, body: Body, force: ArrayLike | ForceField, name: str) -> Float64Array:
        """Forces on the vertices now, [n, 3]."""
        if callable(force):
            try:
                force = force(body.positions(), self._velocity_of(body), self._time())
            except Exception as error:
                error.add_note(f"the field of the forces {name!r} on {body.name} raised this; nothing has moved")
                raise
        values = real_numbers(force, f"the forces {name!r} on {body.name}")
        if values.shape not in ((3,), body.rest.shape):
            raise ShapeMismatchError(
                f"the forces {name!r} on {body.name} are [3] or {list(body.rest.shape)}, got {list(values.shape)}"
            )
        return np.array(np.broadcast_to(values, body.rest.shape))
