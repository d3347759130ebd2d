"""A scene's energies as differentiable functions of arrays, for SciPy, JAX and PyTorch.

`EnergyFunction` needs NumPy and SciPy alone; `yasps.bridges.scipy`, `yasps.bridges.jax` and `yasps.bridges.torch` hand
it to these libraries, and each is imported by its own module only.
"""

from yasps.bridges.energy_function import EnergyFunction

__all__ = ["EnergyFunction"]
