"""Energies that take motion away where a material is strained."""

from __future__ import annotations

from yasps import Attribute, ShapeMismatchError, as_attribute
from yasps.materials.elasticity import green_strain
from yasps.materials.scalar import Scalar


def strain_rate_damping(
    deformation: Attribute, previous: Attribute, viscosity: Scalar, volume: Scalar, time_step: Scalar
) -> Attribute:
    """Dissipation potential [J] of one step of backward Euler in an element of rest volume [m^3].

    V c / (2 dt) |E(F) - E(F_n)|^2 with Green's strain E: its gradient is the force of the viscous stress c E'. Rigid
    motions lose nothing. deformation F: 3x3, or 3x2 of a sheet, whose volume is area times thickness; previous F_n: the
    same at the start of the step, a constant; viscosity c [Pa s]; time_step dt [s]. Kane et al.
    2000, "Variational integrators and the Newmark algorithm" (dissipation of one step as an incremental potential).
    """
    if previous.shape != deformation.shape:
        raise ShapeMismatchError(
            f"the deformation gradients of a step are of one shape, got {deformation.path} {deformation.shape} and "
            f"{previous.path} {previous.shape}"
        )
    change = green_strain(deformation) - green_strain(previous)
    factor = 0.5 * as_attribute(viscosity) * as_attribute(volume) / as_attribute(time_step)
    return factor * change.dot(change)
