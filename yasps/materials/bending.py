"""Bending energies of hinges: two triangles that share an edge."""

from __future__ import annotations

from yasps import Attribute, ShapeMismatchError, as_attribute
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


def _hinge_normals(positions: Attribute) -> tuple[Attribute, Attribute]:
    if positions.shape != (4, 3):
        raise ShapeMismatchError(f"a hinge has 4x3 positions, got {positions.path} {positions.shape}")
    edge, left, right = (positions.row(i) - positions.row(0) for i in (1, 2, 3))
    return edge.cross(left), right.cross(edge)
