"""Minimisation and time stepping."""

from yasps.stepping.backward_euler import BackwardEuler, MovingPart
from yasps.stepping.motion import Motion, positions_of
from yasps.stepping.newton import minimize
from yasps.stepping.settings import NewtonReport, NewtonSettings
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
