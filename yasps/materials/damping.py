"""Energies that take motion away where a material is strained."""

from __future__ import annotations

from yasps import Attribute, ShapeMismatchError, as_attribute
from yasps.materials.elasticity import green_strain
from yasps.materials.scalar import Scalar


def strain_rate_damping(
    deformation: Attribute, previous_strain: Attribute, viscosity: Scalar, volume: Scalar, effective_step: Scalar
) -> Attribute:
    """Dissipation potential [J] of one step in an element of rest volume [m^3].

    V c / (2 h) |E(F) - E_0|^2 with Green's strain E: its gradient is the force of the viscous stress c E'. Rigid
    motions lose nothing. deformation F: 3x3, or 3x2 of a sheet, whose volume is area times thickness; viscosity c
    [Pa s]; previous_strain E_0, 3x3 (2x2), a constant, and effective_step h [s], so that (E - E_0) / h is the rate of
    strain. Of backward Euler E_0 is the strain where the step began and h the time step; `Simulation.carry` and
    `Simulation.effective_step` are those of any integrator. Kane et al. 2000, "Variational integrators and the Newmark
    algorithm" (dissipation of one step as an incremental potential).
    """
    strain = green_strain(deformation)
    if previous_strain.shape != strain.shape:
        raise ShapeMismatchError(
            f"the strain of {deformation.path} is {strain.shape}, but {previous_strain.path} is {previous_strain.shape}"
        )
    change = strain - previous_strain
    factor = 0.5 * as_attribute(viscosity) * as_attribute(volume) / as_attribute(effective_step)
    return factor * change.dot(change)
