"""Bodies, contact and time steps together."""

from yasps.simulation.applied_forces import ForceField
from yasps.simulation.frames import Recorder
from yasps.simulation.simulation import Simulation

__all__ = ["ForceField", "Recorder", "Simulation"]
