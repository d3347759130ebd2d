"""Elastic energies of solids, of the deformation gradient."""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, SceneError, ShapeMismatchError, as_attribute, concat_rows, identity, polar, select
from yasps.frontend.language.arrays import positive_number, real_numbers, vertices_and_elements
from yasps.materials.scalar import Scalar


@overload
def lame_parameters(youngs_modulus: float, poisson_ratio: float) -> tuple[float, float]: ...
@overload
def lame_parameters(youngs_modulus: Scalar, poisson_ratio: Scalar) -> tuple[Scalar, Scalar]: ...
def lame_parameters(youngs_modulus: Scalar, poisson_ratio: Scalar) -> tuple[Scalar, Scalar]:
    """Lame's mu and lambda [Pa] of a linear elastic material; attributes of attributes, for each element its own.

    Raises SceneError for numbers unless youngs_modulus > 0 and -1 < poisson_ratio < 0.5.
    """
    if not isinstance(youngs_modulus, Attribute):
        youngs_modulus = positive_number(youngs_modulus, "Young's modulus", "Pa", SceneError)
    if not isinstance(poisson_ratio, Attribute):
        ratio = real_numbers(poisson_ratio, "Poisson's ratio", SceneError)
        if ratio.shape != () or not -1 < ratio < 0.5:
            raise SceneError(f"Poisson's ratio must lie between -1 and 0.5, got {poisson_ratio}")
    mu = youngs_modulus / (2 * (1 + poisson_ratio))
    lam = youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    return mu, lam


@overload
def stable_neo_hookean_parameters(youngs_modulus: float, poisson_ratio: float) -> tuple[float, float]: ...
@overload
def stable_neo_hookean_parameters(youngs_modulus: Scalar, poisson_ratio: Scalar) -> tuple[Scalar, Scalar]: ...
def stable_neo_hookean_parameters(youngs_modulus: Scalar, poisson_ratio: Scalar) -> tuple[Scalar, Scalar]:
    """mu = 4/3 mu_Lame and lambda = lambda_Lame + 5/6 mu_Lame [Pa], for which `stable_neo_hookean` has these moduli at
    rest.

    Numbers or attributes, as `lame_parameters`. Smith, de Goes and Kim 2018, section 3.4.
    """
    mu, lam = lame_parameters(youngs_modulus, poisson_ratio)
    return 4 / 3 * mu, lam + 5 / 6 * mu


def rest_shape(vertices: ArrayLike, tets: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """For tets at rest: inverse of the matrix whose columns are the edges from vertex 0, [m, 3, 3] in 1/m, and volume
    [m].

    Raises ShapeMismatchError for wrong shapes, DataError for wrong numbers and indices, SceneError for a tet of no or
    negative volume.
    """
    x, t = vertices_and_elements(vertices, tets, 4, ("vertices", "tets"))
    edges = (x[t[:, 1:]] - x[t[:, :1]]).swapaxes(1, 2)
    volumes = np.linalg.det(edges) / 6
    inverted = np.flatnonzero(~(volumes > 0))
    if inverted.size:
        raise SceneError(
            f"tet {inverted[0]} has volume {volumes[inverted[0]]:.3g} at rest ({inverted.size} tets are flat or "
            "inverted); "
            "a tet's vertices 1, 2, 3 must turn counter-clockwise seen from vertex 0's far side"
        )
    return np.linalg.inv(edges), volumes


def deformation_gradient(positions: Attribute, rest_edges_inverse: Attribute) -> Attribute:
    """F (3x3) of a linear tet: current edges times the inverse of the rest edges.

    positions: 4x3, one vertex a row (a JOIN); rest_edges_inverse: 3x3, see `rest_shape`.
    """
    if positions.shape != (4, 3):
        raise ShapeMismatchError(f"a tet has 4x3 positions, got {positions.path} {positions.shape}")
    edges = concat_rows([positions.row(i) - positions.row(0) for i in (1, 2, 3)])
    return edges.T * rest_edges_inverse


def gauss_deformation(positions: Attribute, gradients: Attribute) -> Attribute:
    """F at a Gauss point of any element, 3x3 (3x2 on surfaces): sum of x_a (x) grad N_a.

    positions: n x 3, one node a row (a JOIN); gradients: n x 3 (n x 2), of the shape functions at rest in 1/m, see
    `ElementMesh.points` of `yasps.meshes`. Linear in the positions, so Hessians are projected as 9x9 (6x6).
    """
    if positions.shape != (gradients.shape[0], 3):
        raise ShapeMismatchError(
            f"an element of {gradients.shape[0]} nodes has {gradients.shape[0]}x3 positions, got {positions.path} "
            f"{positions.shape}"
        )
    return positions.T * gradients


def stable_neo_hookean(deformation: Attribute, mu: Scalar, lam: Scalar, volume: Scalar) -> Attribute:
    """Stable Neo-Hookean energy [J] of an element of rest volume [m^3] with 3x3 deformation gradient F.

    V (mu/2 (I_C - 3) - mu/2 log(I_C + 1) + lambda/2 (J - 1 - 3 mu / (4 lambda))^2) with I_C = tr(F^T F), J = det F.
    Smith, de Goes and Kim 2018; paper, eq. 10. mu, lam [Pa]: see `stable_neo_hookean_parameters`.
    """
    mu, lam = as_attribute(mu), as_attribute(lam)
    stretch = deformation.dot(deformation)
    dilation = deformation.det() - (1 + 0.75 * mu / lam)
    density = 0.5 * mu * (stretch - 3 - (stretch + 1).log()) + 0.5 * lam * dilation * dilation
    return as_attribute(volume) * density


def linear_elasticity(deformation: Attribute, mu: Scalar, lam: Scalar, volume: Scalar) -> Attribute:
    """Linear elastic energy [J] of an element of rest volume [m^3] with 3x3 deformation gradient F.

    V (mu eps:eps + lambda/2 tr(eps)^2) with eps = (F + F^T)/2 - I. Quadratic: for small rotations and strains only, a
    turned body swells. mu, lam [Pa]: see `lame_parameters`. Bower 2009, "Applied Mechanics of Solids", section 3.2.
    """
    f = _solid(deformation)
    strain = 0.5 * (f + f.T) - identity(3)
    return as_attribute(volume) * _quadratic(strain, mu, lam)


def st_venant_kirchhoff(deformation: Attribute, mu: Scalar, lam: Scalar, volume: Scalar) -> Attribute:
    """St. Venant-Kirchhoff energy [J] of an element of rest volume [m^3] with 3x3 deformation gradient F.

    V (mu E:E + lambda/2 tr(E)^2) with Green's strain E = (F^T F - I)/2. For large rotations and small strains: a bar
    shortened to less than 1/sqrt(3) of its length gives way, and a flat or inverted element has finite energy.
    mu, lam [Pa]: see `lame_parameters`. Bonet and Wood 2008, "Nonlinear Continuum Mechanics for Finite Element
    Analysis", chapter 6.
    """
    return as_attribute(volume) * _quadratic(green_strain(_solid(deformation)), mu, lam)


def fixed_corotated(deformation: Attribute, mu: Scalar, lam: Scalar, volume: Scalar) -> Attribute:
    """Fixed corotated energy [J] of an element of rest volume [m^3] with 3x3 deformation gradient F.

    V (mu |F - R|^2 + lambda/2 (J - 1)^2) with the rotation R nearest to F, J = det F. Finite for flat and inverted
    elements too; without derivatives where the two smallest singular values are opposite (see `polar`). mu, lam [Pa]:
    see `lame_parameters`. Stomakhin et al. 2012, "Energetically consistent invertible elasticity".
    """
    f = _solid(deformation)
    stretch, dilation = f - polar(f), f.det() - 1
    density = as_attribute(mu) * stretch.dot(stretch) + 0.5 * as_attribute(lam) * dilation * dilation
    return as_attribute(volume) * density


def neo_hookean(deformation: Attribute, mu: Scalar, lam: Scalar, volume: Scalar) -> Attribute:
    """Compressible Neo-Hookean energy [J] of an element of rest volume [m^3] with 3x3 deformation gradient F.

    V (mu/2 (I_C - 3) - mu log J + lambda/2 (log J)^2) with I_C = tr(F^T F), J = det F; infinite at J = 0 and not a
    number below, so that no line search lets an element through. mu, lam [Pa]: see `lame_parameters`. Bonet and Wood
    2008, chapter 6.
    """
    mu, f = as_attribute(mu), _solid(deformation)
    log_volume = f.det().log()
    density = 0.5 * mu * (f.dot(f) - 3) - mu * log_volume + 0.5 * as_attribute(lam) * log_volume * log_volume
    return as_attribute(volume) * density


def mooney_rivlin(deformation: Attribute, c1: Scalar, c2: Scalar, bulk: Scalar, volume: Scalar) -> Attribute:
    """Mooney-Rivlin energy [J] of an element of rest volume [m^3] with 3x3 deformation gradient F.

    V (c1 (J^(-2/3) I_1 - 3) + c2 (J^(-4/3) I_2 - 3) + K/2 (J - 1)^2) with I_1 = tr C, I_2 = (I_1^2 - tr C^2)/2,
    C = F^T F, J = det F; not a number for J < 0. c1, c2, bulk K [Pa]: at rest the shear modulus is 2 (c1 + c2), and K
    is the bulk modulus lambda + 2/3 mu. Mooney 1940 and Rivlin 1948; as a compressible material Bonet and Wood 2008,
    chapter 6.
    """
    f = _solid(deformation)
    right, volume_ratio = f.T * f, f.det()
    first = right.trace()
    second = 0.5 * (first * first - right.dot(right))
    scale = volume_ratio ** (-2 / 3)
    dilation = volume_ratio - 1
    shape = as_attribute(c1) * (scale * first - 3) + as_attribute(c2) * (scale * scale * second - 3)
    return as_attribute(volume) * (shape + 0.5 * as_attribute(bulk) * dilation * dilation)


def holzapfel_fibres(
    deformation: Attribute,
    direction: Attribute | Sequence[float],
    stiffness: Scalar,
    stiffening: Scalar,
    volume: Scalar,
) -> Attribute:
    """Energy [J] of one family of fibres in an element of rest volume [m^3] with 3x3 deformation gradient F.

    V k1/(2 k2) (exp(k2 (I_4 - 1)^2) - 1) where the fibres are longer than at rest, else 0, I_4 = |F a|^2. Add it to an
    energy of the ground substance, once for each family. direction a: 3x1 or numbers, of length 1, at rest; stiffness
    k1 [Pa]: Young's modulus along slightly stretched fibres is 4 k1; stiffening k2: no unit. Holzapfel, Gasser and
    Ogden 2000, with I_4 of F itself (Nolan et al. 2014).
    """
    f, k1, k2 = _solid(deformation), as_attribute(stiffness), as_attribute(stiffening)
    fibre = f * as_attribute(direction).reshape(3, 1)
    stretch = fibre.dot(fibre) - 1
    stored = 0.5 * k1 / k2 * (k2 * stretch * stretch).expm1()
    return as_attribute(volume) * select(stretch > 0, stored, 0)


def green_strain(deformation: Attribute) -> Attribute:
    """Green's strain E = (F^T F - I)/2 of a deformation gradient F with n columns, n x n."""
    return 0.5 * (deformation.T * deformation - identity(deformation.shape[1]))


def _quadratic(strain: Attribute, mu: Scalar, lam: Scalar) -> Attribute:
    """mu e:e + lambda/2 tr(e)^2 [J/m^3]."""
    trace = strain.trace()
    return as_attribute(mu) * strain.dot(strain) + 0.5 * as_attribute(lam) * trace * trace


def _solid(deformation: Attribute) -> Attribute:
    if deformation.shape != (3, 3):
        raise ShapeMismatchError(
            f"a solid has a 3x3 deformation gradient, got {deformation.path} {deformation.shape}; "
            "`deformation_gradient` makes one of a tetrahedron"
        )
    return deformation
