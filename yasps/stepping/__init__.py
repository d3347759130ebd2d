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
from yasps.stepping.step_report import StepReport, step_report

__all__ = [
    "BackwardEuler",
    "Motion",
    "MovingPart",
    "NewtonReport",
    "NewtonSettings",
    "StepReport",
    "minimize",
    "positions_of",
    "step_report",
]
