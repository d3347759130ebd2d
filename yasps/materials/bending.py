"""Bending energies of hinges: two triangles that share an edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yasps import Attribute, SceneError, ShapeMismatchError, as_attribute, atan2
from yasps.frontend.language.arrays import vertices_and_elements
from yasps.materials.scalar import Scalar


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


def hinge_angle(positions: Attribute) -> Attribute:
    """Angle [1] by which two triangles that share an edge are folded: 0 where flat, within (-pi, pi].

    positions: 4x3, as `hinge_bending` has them. It is positive where rows 2 and 3 are folded towards the side that the
    normal of (0, 1, 2) points to.
    """
    first, second = _hinge_normals(positions)
    edge = positions.row(1) - positions.row(0)
    return atan2(second.cross(first).dot(edge) / edge.norm(), first.dot(second))


def discrete_shell_bending(positions: Attribute, rest_angle: Scalar, stiffness: Scalar) -> Attribute:
    """Bending energy [J] of two triangles that share an edge: k (theta - theta_0)^2, theta of `hinge_angle`.

    positions: 4x3, as `hinge_bending` has them; rest_angle theta_0: see `hinge_angles`; stiffness k [J]: the bending
    rigidity E h^3 / (12 (1 - nu^2)) times l^2 / (2 area of both), l the edge's rest length, which is
    `meshes.hinge_stiffness` of a sixth of the rigidity. With it equilateral triangles bend about any axis as the plate
    does; others are stiffer, right triangles up to three times where their longest edges curve. Grinspun et al. 2003,
    "Discrete shells", eq. 3.
    """
    change = hinge_angle(positions) - as_attribute(rest_angle)
    return as_attribute(stiffness) * change * change


def quadratic_bending(positions: Attribute, weights: Attribute, stiffness: Scalar) -> Attribute:
    """Bending energy [J] of two triangles that share an edge, flat at rest, of sheets that hardly stretch:
    k/2 |w_0 x_0 + w_1 x_1 + w_2 x_2 + w_3 x_3|^2.

    Half of the rigidity times the squared curvature, summed over the sheet; its Hessian is constant and positive
    semi-definite. positions: 4x3, as `hinge_bending` has them; weights: 4x1 [1/m], see `quadratic_bending_weights`;
    stiffness k [J]: the bending rigidity E h^3 / (12 (1 - nu^2)), on meshes as `discrete_shell_bending` says. Bergou et
    al. 2006, "A quadratic bending model for inextensible surfaces".
    """
    if positions.shape != (4, 3):
        raise ShapeMismatchError(f"a hinge has 4x3 positions, got {positions.path} {positions.shape}")
    normal = weights.reshape(1, 4) * positions
    return 0.5 * as_attribute(stiffness) * normal.dot(normal)


def hinge_angles(vertices: ArrayLike, hinges: ArrayLike) -> NDArray[np.float64]:
    """`hinge_angle` of hinges [m, 4] of vertices [n, 3]: rest angles of a shell that is curved at rest, [m].

    Raises ShapeMismatchError for wrong shapes, DataError for wrong numbers and indices.
    """
    x, h = vertices_and_elements(vertices, hinges, 4, ("vertices", "hinges"))
    edge, left, right = (x[h[:, k]] - x[h[:, 0]] for k in (1, 2, 3))
    first, second = np.cross(edge, left), np.cross(right, edge)
    sine = np.einsum("ij,ij->i", np.cross(second, first), edge) / np.linalg.norm(edge, axis=1)
    return np.asarray(np.arctan2(sine, np.einsum("ij,ij->i", first, second)), np.float64)


def quadratic_bending_weights(vertices: ArrayLike, hinges: ArrayLike) -> NDArray[np.float64]:
    """Weights of `quadratic_bending` for hinges [m, 4] that lie flat, of vertices [n, 3]: [m, 4] in 1/m.

    They are sums of cotangents of the angles at the edge (Bergou et al. 2006, section 3) over the root of the area of
    both, and of a flat hinge sum to zero, as do the weighted positions. The paper's have another factor sqrt(3), with
    which sheets are three times too stiff where vertices lie on the bent surface. Raises ShapeMismatchError for wrong
    shapes, DataError for wrong numbers and indices, SceneError for a triangle of no area.
    """
    x, h = vertices_and_elements(vertices, hinges, 4, ("vertices", "hinges"))
    edge = x[h[:, 1]] - x[h[:, 0]]
    sides = [x[h[:, k]] - x[h[:, 0]] for k in (2, 3)]
    doubles = [np.linalg.norm(np.cross(edge, side), axis=1) for side in sides]  # twice the areas
    flat = np.flatnonzero(~(np.minimum(*doubles) > 0))
    if flat.size:
        raise SceneError(f"hinge {flat[0]} has a triangle of no area ({flat.size} hinges have one)")
    both = list(zip(sides, doubles, strict=True))
    at_start = sum(np.einsum("ij,ij->i", edge, side) / double for side, double in both)  # cotangents
    at_end = sum(np.einsum("ij,ij->i", edge, edge - side) / double for side, double in both)
    squared = np.einsum("ij,ij->i", edge, edge)
    opposite = [-squared / double for double in doubles]
    size = np.sqrt(2 / (doubles[0] + doubles[1]))
    return np.asarray(size[:, None] * np.stack([at_end, at_start, *opposite], axis=1), np.float64)


def _hinge_normals(positions: Attribute) -> tuple[Attribute, Attribute]:
    if positions.shape != (4, 3):
        raise ShapeMismatchError(f"a hinge has 4x3 positions, got {positions.path} {positions.shape}")
    edge, left, right = (positions.row(i) - positions.row(0) for i in (1, 2, 3))
    return edge.cross(left), right.cross(edge)
