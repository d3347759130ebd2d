"""Minimisation and time stepping."""

from yasps.stepping.anchors import Anchors, Pins
from yasps.stepping.driven import Driven, DrivenSurface, DrivenVertices, Prescribed
from yasps.stepping.motion import Motion, positions_of
from yasps.stepping.newton import minimize
from yasps.stepping.rescue import step_or_halves
from yasps.stepping.settings import NewtonReport, NewtonSettings
from yasps.stepping.step_report import StepReport, step_report
from yasps.stepping.time_stepper import MovingPart, TimeStepper

__all__ = [
    "Anchors",
    "Driven",
    "DrivenSurface",
    "DrivenVertices",
    "Motion",
    "MovingPart",
    "NewtonReport",
    "NewtonSettings",
    "Pins",
    "Prescribed",
    "StepReport",
    "TimeStepper",
    "minimize",
    "positions_of",
    "step_or_halves",
    "step_report",
]
