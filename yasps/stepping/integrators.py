"""Formulas for velocities: what a time step minimises, by the name of the method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from yasps import Attribute, FloatArray, SceneError

ROUNDING = 64 * np.finfo(np.float64).eps
"""Relative difference of positions that are the same but for rounding."""


Transfer: TypeAlias = Callable[[FloatArray], FloatArray]
"""From numbers of the vertices of a mesh, [n, 3], to those of another mesh of the same thing, [m, 3]."""


@dataclass(frozen=True)
class Integrator:
    """A backward differentiation formula: v = (x - X) / h at the end of a step.

    X is the weighted sum of the positions at the beginning of this step and of those before it, V the same of the
    velocities, and h the effective step, a share of the time step. So a step minimises m / (2 h^2) |x - (X + h V)|^2
    and all other energies: it is one of backward Euler that starts from X with the velocities V and lasts h.
    """

    name: str
    weights: tuple[float, ...]
    """Of the present, of one step ago, ..."""
    share: float
    """h in time steps."""


BACKWARD_EULER = Integrator("backward Euler", (1.0,), 1.0)
"""Order 1; damps fast motion strongly."""
BDF2 = Integrator("BDF2", (4 / 3, -1 / 3), 2 / 3)
"""Order 2; damps much less. It remembers one step; where there is none to remember, it is backward Euler."""


def checked_integrator(given: object) -> Integrator:
    """Raises SceneError unless it is one."""
    if not isinstance(given, Integrator):
        raise SceneError(f"integrator is BACKWARD_EULER or BDF2 of yasps.stepping, got {given!r}")
    return given


@dataclass(frozen=True)
class Moment:
    """Where a stepper's parts are, and how fast: positions [m] and velocities [m/s] of each, [n, 3]; `surface`: from
    where slips of contact count [m], [n, 3]; `carried`: values of what is carried along, flat."""

    positions: list[FloatArray]
    velocities: list[FloatArray]
    surface: FloatArray | None
    carried: list[FloatArray]

    def resized(self, part: int, transfer: Transfer, of_surface: Transfer | None) -> Moment:
        """The same moment with another mesh of one part."""
        positions, velocities = list(self.positions), list(self.velocities)
        positions[part], velocities[part] = transfer(positions[part]), transfer(velocities[part])
        surface = self.surface if self.surface is None or of_surface is None else of_surface(self.surface)
        return replace(self, positions=positions, velocities=velocities, surface=surface)

    def continues(self, other: Moment) -> bool:
        """Whether nobody has changed anything since the other moment, but for rounding."""
        pairs = list(zip(self.positions, other.positions, strict=True))
        pairs += zip(self.velocities, other.velocities, strict=True)
        if self.surface is not None and other.surface is not None:
            pairs.append((self.surface, other.surface))
        return all(np.abs(one - two).max(initial=0.0) <= ROUNDING * np.abs(one).max(initial=0.0) for one, two in pairs)


def weighted(weights: Sequence[float], moments: Sequence[Moment]) -> Moment:
    """The sum of moments, each with its weight."""

    def add(arrays: Sequence[FloatArray]) -> FloatArray:
        total = weights[0] * arrays[0]
        for weight, array in zip(weights[1:], arrays[1:], strict=True):
            total = total + weight * array
        return total

    surfaces = [moment.surface for moment in moments if moment.surface is not None]
    return Moment(
        [add(arrays) for arrays in zip(*(moment.positions for moment in moments), strict=True)],
        [add(arrays) for arrays in zip(*(moment.velocities for moment in moments), strict=True)],
        add(surfaces) if len(surfaces) == len(moments) else None,
        [add(arrays) for arrays in zip(*(moment.carried for moment in moments), strict=True)],
    )


@dataclass(frozen=True)
class Carried:
    """Something whose rate energies read: `constant` is set at the beginning of each step so that (attribute -
    constant) / effective step is the rate at its end. For backward Euler that is the attribute there."""

    constant: Attribute
    attribute: Attribute


@dataclass(frozen=True)
class Past:
    """The step before: its beginning, its end, and how long it took [s]."""

    start: Moment
    end: Moment
    time_step: float

    def start_numbers(self) -> dict[str, FloatArray]:
        """All but the end, by name."""
        numbers = {f"position/{k}": x.copy() for k, x in enumerate(self.start.positions)}
        numbers |= {f"velocity/{k}": v.copy() for k, v in enumerate(self.start.velocities)}
        numbers |= {f"carried/{k}": value.copy() for k, value in enumerate(self.start.carried)}
        if self.start.surface is not None:
            numbers["surface"] = self.start.surface.copy()
        return numbers | {"time_step": np.array(self.time_step)}

    @classmethod
    def of_numbers(cls, numbers: Mapping[str, FloatArray], end: Moment) -> Past | None:
        """From `start_numbers`; None if there are none, or they are not of such parts."""
        count, carried = range(len(end.positions)), range(len(end.carried))
        shapes = {f"position/{k}": end.positions[k].shape for k in count}
        shapes |= {f"velocity/{k}": end.velocities[k].shape for k in count}
        shapes |= {f"carried/{k}": end.carried[k].shape for k in carried}
        shapes |= {"time_step": ()} | ({} if end.surface is None else {"surface": end.surface.shape})
        if {name: x.shape for name, x in numbers.items()} != shapes:
            return None
        positions, velocities = ([numbers[f"{name}/{k}"] for k in count] for name in ("position", "velocity"))
        start = Moment(positions, velocities, numbers.get("surface"), [numbers[f"carried/{k}"] for k in carried])
        return cls(start, end, float(numbers["time_step"]))
