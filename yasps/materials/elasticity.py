"""Elastic energies of tetrahedra, of the deformation gradient."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, SceneError, ShapeMismatchError, as_attribute, concat_rows
from yasps.frontend.language.arrays import positive_number, real_numbers, vertices_and_elements
from yasps.materials.scalar import Scalar


def lame_parameters(youngs_modulus: float, poisson_ratio: float) -> tuple[float, float]:
    """Lame's mu and lambda [Pa] of a linear elastic material.

    Raises SceneError unless youngs_modulus > 0 and -1 < poisson_ratio < 0.5.
    """
    youngs_modulus = positive_number(youngs_modulus, "Young's modulus", "Pa", SceneError)
    ratio = real_numbers(poisson_ratio, "Poisson's ratio", SceneError)
    if ratio.shape != () or not -1 < ratio < 0.5:
        raise SceneError(f"Poisson's ratio must lie between -1 and 0.5, got {poisson_ratio}")
    mu = youngs_modulus / (2 * (1 + poisson_ratio))
    lam = youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    return mu, lam


def stable_neo_hookean_parameters(youngs_modulus: float, poisson_ratio: float) -> tuple[float, float]:
    """mu = 4/3 mu_Lame and lambda = lambda_Lame + 5/6 mu_Lame [Pa], for which `stable_neo_hookean` has these moduli at
    rest.

    Smith, de Goes and Kim 2018, section 3.4.
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
