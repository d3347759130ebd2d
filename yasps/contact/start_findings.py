"""What may be wrong with a start state, and how it is said."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps.contact.active_set import Floats

SHOWN = 8
"""So many findings of one sort are written out in a message."""


@dataclass(frozen=True)
class Overlap:
    """Two bodies, or one with itself, whose surfaces cross or one of which lies inside the other."""

    bodies: tuple[str, str]
    crossings: int
    """Edges that cross or touch triangles, or vertices in a half-space; 0 if the first body lies wholly inside the
    second."""
    depth: float
    """[m]: how far the deepest piece has to go."""
    where: str
    """The first edge and triangle that cross, by body and number; the deepest vertex; empty if nothing crosses."""
    in_half_space: bool = False
    """Whether the second is a half-space."""

    def __str__(self) -> str:
        first, second = self.bodies
        if not self.crossings:
            return f"{first!r} lies wholly inside {second!r}, {self.depth:.3g} m deep"
        if self.in_half_space:
            what = f"{self.crossings} vertices are in the half-space or touch it, the deepest: {self.where}"
            return f"{first!r} and {second!r} overlap, {self.depth:.3g} m deep: {what}"
        who = f"{first!r} crosses itself" if first == second else f"{first!r} and {second!r} overlap"
        return (
            f"{who}, {self.depth:.3g} m deep: {self.crossings} edges cross or touch triangles, the first: {self.where}"
        )


@dataclass(frozen=True)
class Touching:
    """Two bodies, or one with itself, nearer than positions are rounded, or than they are thick."""

    bodies: tuple[str, str]
    distance: float
    """[m]"""
    thickness: float
    """[m]: the sum of both radii there; pieces touch at this distance."""
    where: str

    def __str__(self) -> str:
        who = f"{self.bodies[0]!r} and {self.bodies[1]!r}"
        if self.thickness > 0:
            away = f"{self.distance:.3g} m apart where their radii are {self.thickness:.3g} m together"
            return f"{who} are too thick, {away}: {self.where}"
        return f"{who} touch, {self.distance:.1g} m apart: {self.where}"


@dataclass(frozen=True)
class Flipped:
    """Elements of a body that are turned inside out or have no size."""

    body: str
    kind: str
    """"tetrahedra" or "triangles"."""
    elements: NDArray[np.int64]
    sizes: Floats
    """[m^3] or [m^2], of these elements now."""

    def __str__(self) -> str:
        unit, what = ("m^3", "flipped or flat") if self.kind == "tetrahedra" else ("m^2", "without area")
        listed = ", ".join(
            f"{k} ({size:.3g} {unit})" for k, size in zip(self.elements[:SHOWN], self.sizes[:SHOWN], strict=True)
        )
        more = f" and {len(self.elements) - SHOWN} more" if len(self.elements) > SHOWN else ""
        return f"{len(self.elements)} {self.kind} of {self.body!r} are {what}: {listed}{more}"


@dataclass(frozen=True)
class StartState:
    """What is wrong with the present state of bodies; all lists are empty if nothing is."""

    overlaps: tuple[Overlap, ...]
    touching: tuple[Touching, ...]
    flipped: tuple[Flipped, ...]

    @property
    def is_apart(self) -> bool:
        """Is there a gap between all surfaces?"""
        return not (self.overlaps or self.touching)

    def __str__(self) -> str:
        lines: list[str] = []
        for findings in (self.overlaps, self.touching, self.flipped):
            lines += [str(finding) for finding in findings[:SHOWN]]
            if len(findings) > SHOWN:
                lines.append(f"... and {len(findings) - SHOWN} more of this sort")
        return "\n".join(lines) or "surfaces are apart, and no element is flipped"
