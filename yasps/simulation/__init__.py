"""Bodies, contact and time steps together."""

from yasps.simulation.applied_forces import ForceField
from yasps.simulation.checkpoints import Checkpoints
from yasps.simulation.frames import Recorder
from yasps.simulation.remeshing import RemeshReport
from yasps.simulation.simulation import Simulation
from yasps.simulation.state_files import DamagedStateError

__all__ = ["Checkpoints", "DamagedStateError", "ForceField", "Recorder", "RemeshReport", "Simulation"]
