"""Minimisation and time stepping."""

from yasps.stepping.anchors import Anchors, Pins
from yasps.stepping.driven import Driven, DrivenSurface, DrivenVertices, Prescribed
from yasps.stepping.forces import forces_by_term
from yasps.stepping.integrators import BACKWARD_EULER, BDF2, Carried, Integrator, checked_integrator
from yasps.stepping.motion import Motion, positions_of
from yasps.stepping.newton import minimize
from yasps.stepping.quasi_static import LoadStep, quasi_static
from yasps.stepping.rescue import step_or_halves
from yasps.stepping.settings import NewtonReport, NewtonSettings
from yasps.stepping.step_report import StepReport, energies_by_kind, step_report
from yasps.stepping.time_stepper import LAGGING, MovingPart, TimeStepper

__all__ = [
    "BACKWARD_EULER",
    "BDF2",
    "LAGGING",
    "Anchors",
    "Carried",
    "Driven",
    "DrivenSurface",
    "DrivenVertices",
    "Integrator",
    "LoadStep",
    "Motion",
    "MovingPart",
    "NewtonReport",
    "NewtonSettings",
    "Pins",
    "Prescribed",
    "StepReport",
    "TimeStepper",
    "checked_integrator",
    "energies_by_kind",
    "forces_by_term",
    "minimize",
    "positions_of",
    "quasi_static",
    "step_or_halves",
    "step_report",
]
