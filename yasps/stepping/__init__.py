"""Minimisation and time stepping."""

from yasps.stepping.anchors import Anchors, Pins
from yasps.stepping.backward_euler import BackwardEuler, MovingPart
from yasps.stepping.driven import Driven, DrivenSurface, DrivenVertices, Prescribed
from yasps.stepping.forces import forces_by_term
from yasps.stepping.motion import Motion, positions_of
from yasps.stepping.newton import minimize
from yasps.stepping.rescue import step_or_halves
from yasps.stepping.settings import NewtonReport, NewtonSettings
from yasps.stepping.step_report import StepReport, energies_by_kind, step_report

__all__ = [
    "Anchors",
    "BackwardEuler",
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
    "energies_by_kind",
    "forces_by_term",
    "minimize",
    "positions_of",
    "step_or_halves",
    "step_report",
]
