"""Bodies, contact and time steps together."""

from yasps.simulation.applied_forces import ForceField
from yasps.simulation.simulation import Recorder, Simulation

__all__ = ["ForceField", "Recorder", "Simulation"]
