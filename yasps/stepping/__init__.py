"""Minimisation and time stepping."""

from yasps.stepping.newton import (
    BackwardEuler,
    Motion,
    MovingPart,
    NewtonReport,
    NewtonSettings,
    minimize,
    positions_of,
)

__all__ = [
    "BackwardEuler",
    "Motion",
    "MovingPart",
    "NewtonReport",
    "NewtonSettings",
    "minimize",
    "positions_of",
]
