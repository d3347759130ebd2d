"""The energy that keeps an affine body stiff."""

from __future__ import annotations

from yasps import Attribute, as_attribute, identity
from yasps.materials.scalar import Scalar


def affine_orthogonality(affine_matrix: Attribute, stiffness: Scalar) -> Attribute:
    """Stiffness energy [J] of an affine body: s/2 ||A^T A - I||^2, zero for rotations (paper, 10.1; Lan et al. 2022).

    stiffness [J]: of the order of Young's modulus times volume.
    """
    strain = affine_matrix.T * affine_matrix - identity(3)
    return 0.5 * as_attribute(stiffness) * strain.dot(strain)
