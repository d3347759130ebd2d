"""Derivatives through whole runs of a simulation, and what fits parameters to an objective with them."""

from yasps.inverse.fitting import LOG, Fit, Iteration, Transform, fit, scaled
from yasps.inverse.gradients import Gradient
from yasps.inverse.objectives import Energy, FrameView, FromOutside, Objective, Squares
from yasps.inverse.parameters import Constant, InitialValue, InitialVelocity, MotionOf, Parameter, PerStep, Tied
from yasps.inverse.trajectory import PRECISE, Trajectory

__all__ = [
    "LOG",
    "PRECISE",
    "Constant",
    "Energy",
    "Fit",
    "FrameView",
    "FromOutside",
    "Gradient",
    "InitialValue",
    "InitialVelocity",
    "Iteration",
    "MotionOf",
    "Objective",
    "Parameter",
    "PerStep",
    "Squares",
    "Tied",
    "Trajectory",
    "Transform",
    "fit",
    "scaled",
]
