"""Energies of cloth in the plane of its triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, SceneError, ShapeMismatchError, as_attribute, concat_rows, select
from yasps.frontend.language.arrays import real_numbers, vertices_and_elements
from yasps.materials.scalar import Scalar


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


def triangle_deformation(positions: Attribute, rest_edges_inverse: Attribute) -> Attribute:
    """F (3x2) of a linear triangle: current edges times the inverse of the rest edges in the triangle's own plane.

    positions: 3x3, one vertex a row (a JOIN); rest_edges_inverse: 2x2, see `rest_triangles`.
    """
    if positions.shape != (3, 3):
        raise ShapeMismatchError(f"a triangle has 3x3 positions, got {positions.path} {positions.shape}")
    edges = concat_rows([positions.row(i) - positions.row(0) for i in (1, 2)])
    return edges.T * rest_edges_inverse


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
