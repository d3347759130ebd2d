"""Energies of thin sheets in their own plane, isotropic, of the 3x2 deformation gradient of a triangle."""

from __future__ import annotations

from yasps import Attribute, ShapeMismatchError, as_attribute, eigenvalues, select
from yasps.materials.elasticity import green_strain
from yasps.materials.scalar import Scalar


def st_venant_membrane(deformation: Attribute, mu: Scalar, lam: Scalar, area: Scalar, thickness: Scalar) -> Attribute:
    """St. Venant-Kirchhoff energy [J] of a triangle of rest area [m^2] with 3x2 deformation gradient F.

    A h (mu E:E + L/2 tr(E)^2) with Green's strain E = (F^T F - I)/2 (2x2) and, no stress across the sheet,
    L = 2 lambda mu / (lambda + 2 mu). mu, lam [Pa]: those of the solid, see `lame_parameters`; thickness h [m]. Small
    strains only, as `st_venant_kirchhoff`. Bower 2009, "Applied Mechanics of Solids", section 3.1 (plane stress).
    """
    mu, lam = as_attribute(mu), as_attribute(lam)
    strain = green_strain(_sheet(deformation))
    trace = strain.trace()
    density = mu * strain.dot(strain) + lam * mu / (lam + 2 * mu) * trace * trace
    return as_attribute(area) * as_attribute(thickness) * density


def neo_hookean_membrane(deformation: Attribute, mu: Scalar, area: Scalar, thickness: Scalar) -> Attribute:
    """Incompressible Neo-Hookean energy [J] of a triangle of rest area [m^2] with 3x2 deformation gradient F.

    A h mu/2 (tr C + 1/det C - 3) with C = F^T F (2x2): the sheet gets thinner by as much as its area grows. Infinite at
    a triangle of no area. mu [Pa]: shear modulus, a third of Young's modulus; thickness h [m] at rest. Treloar 1975,
    "The Physics of Rubber Elasticity", with three stretches of product 1.
    """
    f = _sheet(deformation)
    right = f.T * f
    density = 0.5 * as_attribute(mu) * (right.trace() + right.det() ** -1 - 3)
    return as_attribute(area) * as_attribute(thickness) * density


def strain_limiting(
    deformation: Attribute, limit: Scalar, stiffness: Scalar, area: Scalar, thickness: Scalar
) -> Attribute:
    """Penalty [J] on the stretching of a triangle of rest area [m^2] with 3x2 deformation gradient F beyond a limit.

    A h k/3 (sum over e of max(0, e - limit)^3), e being the eigenvalues of Green's strain (F^T F - I)/2: add it to the
    energy of a sheet that is soft below the limit. It has two continuous derivatives, and does not keep strains below
    the limit but draws them there; limit: a strain, without a unit (a fibre 1 % longer has 0.01005); stiffness k [Pa]:
    how much the sheet stiffens for each unit of strain beyond; thickness h [m]. Li et al. 2024 (STARK).
    """
    strains = eigenvalues(green_strain(_sheet(deformation)))
    excess = [strains[k] - as_attribute(limit) for k in range(2)]
    cubes = [select(over > 0, over**3, 0) for over in excess]
    return as_attribute(stiffness) / 3 * as_attribute(area) * as_attribute(thickness) * (cubes[0] + cubes[1])


def _sheet(deformation: Attribute) -> Attribute:
    if deformation.shape != (3, 2):
        raise ShapeMismatchError(
            f"a membrane has a 3x2 deformation gradient, got {deformation.path} {deformation.shape}; "
            "`triangle_deformation` makes one of a triangle"
        )
    return deformation
