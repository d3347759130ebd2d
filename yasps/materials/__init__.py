"""Energies of deformable and stiff bodies, in joules, as expressions to read and copy.

Every function takes attributes (or numbers) and returns a 1x1 attribute: the energy on one instance. The incremental
potential of a backward Euler step of size dt is sum(inertia) + sum(everything else), all in joules: `inertia` is
divided by dt^2, so nothing else is multiplied by it. Its minimiser is the next position.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps.frontend.errors import SceneError, ShapeMismatchError
from yasps.frontend.language.arrays import real_numbers, vertices_and_elements
from yasps.frontend.language.attribute import Attribute, as_attribute, concat_rows, identity
from yasps.frontend.language.functions import select

Scalar = Attribute | float


def lame_parameters(youngs_modulus: float, poisson_ratio: float) -> tuple[float, float]:
    """Lame's mu and lambda [Pa] of a linear elastic material.

    Raises SceneError unless youngs_modulus > 0 and -1 < poisson_ratio < 0.5.
    """
    if not youngs_modulus > 0:
        raise SceneError(f"Young's modulus must be positive, got {youngs_modulus} Pa")
    if not -1 < poisson_ratio < 0.5:
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


def rest_triangles(
    vertices: ArrayLike, triangles: ArrayLike, warp: ArrayLike = (1.0, 0.0, 0.0)
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """For triangles at rest: inverse of the 2x2 matrix whose columns are the edges from vertex 0, [m, 2, 2] in 1/m, and
    area [m^2].

    Plane coordinates are along `warp`, projected into each triangle's plane, and across it.
    Raises ShapeMismatchError for wrong shapes, DataError for wrong numbers and indices, SceneError for a triangle of no
    area or one that warp is normal to.
    """
    x, t = vertices_and_elements(vertices, triangles, 3, ("vertices", "triangles"))
    edges = x[t[:, 1:]] - x[t[:, :1]]
    normals = np.cross(edges[:, 0], edges[:, 1])
    double = np.linalg.norm(normals, axis=1, keepdims=True)
    flat = np.flatnonzero(~(double > 0))
    if flat.size:
        raise SceneError(f"triangle {flat[0]} has no area at rest ({flat.size} triangles have none)")
    direction = real_numbers(warp, "warp")
    if direction.shape != (3,):
        raise ShapeMismatchError(f"warp is a direction, three numbers, got shape {direction.shape}")
    normals = normals / double
    along = direction - (normals @ direction)[:, None] * normals
    length = np.linalg.norm(along, axis=1, keepdims=True)
    upright = np.flatnonzero(~(length > 1e-6 * np.linalg.norm(direction)))
    if upright.size:
        raise SceneError(
            f"warp {tuple(direction.tolist())} is normal to triangle {upright[0]}: choose another direction"
        )
    axes = np.stack([along / length, np.cross(normals, along / length)], axis=1)
    return np.linalg.inv(axes @ edges.swapaxes(1, 2)), 0.5 * double[:, 0]


def deformation_gradient(positions: Attribute, rest_edges_inverse: Attribute) -> Attribute:
    """F (3x3) of a linear tet: current edges times the inverse of the rest edges.

    positions: 4x3, one vertex a row (a JOIN); rest_edges_inverse: 3x3, see `rest_shape`.
    """
    if positions.shape != (4, 3):
        raise ShapeMismatchError(f"a tet has 4x3 positions, got {positions.path} {positions.shape}")
    edges = concat_rows([positions.row(i) - positions.row(0) for i in (1, 2, 3)])
    return edges.T * rest_edges_inverse


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


def baraff_witkin(
    deformation: Attribute, stretch: Scalar, shear: Scalar, area: Scalar, *, compression: Scalar = 1.0
) -> Attribute:
    """Cloth energy [J] of a triangle of rest area [m^2] with 3x2 deformation gradient F = [u v].

    A (k_stretch ((|u| - 1)^2 + (|v| - 1)^2) + k_shear (u . v)^2): u and v are the images of warp and weft.
    Baraff and Witkin 1998, section 4.2, as an energy of F: Kim 2020, "A finite element formulation of Baraff-Witkin
    cloth". stretch, shear [J/m^2]: Pa times thickness. compression: k_stretch is multiplied by it in a direction that
    is shortened, as cloth gives way there (0.01 in the paper's scene 9.1).
    """
    if deformation.shape != (3, 2):
        raise ShapeMismatchError(
            f"cloth has a 3x2 deformation gradient, got {deformation.path} {deformation.shape}; `triangle_deformation` "
            "makes one"
        )
    u, v = deformation.col(0), deformation.col(1)
    resisting = as_attribute(stretch) * (_strain_energy(u, compression) + _strain_energy(v, compression))
    tilt = u.dot(v)
    return as_attribute(area) * (resisting + as_attribute(shear) * tilt * tilt)


def _strain_energy(fibre: Attribute, compression: Scalar) -> Attribute:
    """(|w| - 1)^2, less where the fibre is shortened."""
    strain = fibre.norm() - 1
    if isinstance(compression, float | int) and compression == 1:
        return strain * strain
    return select(strain < 0, as_attribute(compression), as_attribute(1.0)) * strain * strain


def triangle_deformation(positions: Attribute, rest_edges_inverse: Attribute) -> Attribute:
    """F (3x2) of a linear triangle: current edges times the inverse of the rest edges in the triangle's own plane.

    positions: 3x3, one vertex a row (a JOIN); rest_edges_inverse: 2x2, see `rest_triangles`.
    """
    if positions.shape != (3, 3):
        raise ShapeMismatchError(f"a triangle has 3x3 positions, got {positions.path} {positions.shape}")
    edges = concat_rows([positions.row(i) - positions.row(0) for i in (1, 2)])
    return edges.T * rest_edges_inverse


def hinge_bending(positions: Attribute, stiffness: Scalar) -> Attribute:
    """Bending energy [J] of two triangles that share an edge: k |N_1 - N_2|^2 = 4 k sin^2(theta / 2), flat at rest.

    positions: 4x3 (a JOIN), the shared edge is rows 0 and 1, row 2 lies on its left and row 3 on its right, so that
    (0, 1, 2) and (1, 0, 3) turn the same way. N: unit normals; theta: the angle between them. stiffness [J]: bending
    stiffness times 3 l^2 / (area of both), l the edge's rest length (Grinspun et al. 2003, "Discrete shells", eq. 3).
    The square keeps it smooth where the hinge is flat, where the paper's l |N_1 - N_2| (9.5) has no derivative.
    """
    first, second = _hinge_normals(positions)
    difference = first / first.norm() - second / second.norm()
    return as_attribute(stiffness) * difference.dot(difference)


def _hinge_normals(positions: Attribute) -> tuple[Attribute, Attribute]:
    if positions.shape != (4, 3):
        raise ShapeMismatchError(f"a hinge has 4x3 positions, got {positions.path} {positions.shape}")
    edge, left, right = (positions.row(i) - positions.row(0) for i in (1, 2, 3))
    return edge.cross(left), right.cross(edge)


def affine_orthogonality(affine_matrix: Attribute, stiffness: Scalar) -> Attribute:
    """Stiffness energy [J] of an affine body: s/2 ||A^T A - I||^2, zero for rotations (paper, 10.1; Lan et al. 2022).

    stiffness [J]: of the order of Young's modulus times volume.
    """
    strain = affine_matrix.T * affine_matrix - identity(3)
    return 0.5 * as_attribute(stiffness) * strain.dot(strain)


def inertia(position: Attribute, predicted: Attribute, mass: Scalar, time_step: Scalar) -> Attribute:
    """Inertia term [J] of backward Euler: m / (2 dt^2) |x - (x_n + dt v_n)|^2.

    predicted: x_n + dt v_n, a constant; mass [kg]; time_step [s].
    """
    offset = position - predicted
    step = as_attribute(time_step)
    return 0.5 * as_attribute(mass) / (step * step) * offset.dot(offset)


def gravity(
    position: Attribute, mass: Scalar, acceleration: Sequence[float] | Attribute = (0.0, 0.0, -9.8)
) -> Attribute:
    """Potential [J] of a uniform field: -m a . x. acceleration [m/s^2], numbers or a 3x1 attribute."""
    field = acceleration if isinstance(acceleration, Attribute) else real_numbers(acceleration, "the acceleration")
    return as_attribute(mass) * position.reshape(3, 1).dot(-field)


def dead_load(position: Attribute, force: Attribute) -> Attribute:
    """Potential [J] of a force [N] on a vertex that keeps its direction: -f . x. Both 3x1."""
    return -position.reshape(3, 1).dot(force)


def anchor(position: Attribute, place: Attribute, stiffness: Scalar) -> Attribute:
    """Energy [J] of a spring of rest length 0 that holds a vertex at a place: k/2 |x - a|^2. stiffness k [N/m]."""
    offset = position.reshape(3, 1) - place.reshape(3, 1)
    return 0.5 * as_attribute(stiffness) * offset.dot(offset)
