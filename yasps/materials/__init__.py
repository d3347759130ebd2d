"""Energies of deformable and stiff bodies, in joules, as expressions to read and copy.

Every function takes attributes (or numbers) and returns a 1x1 attribute: the energy on one instance. The incremental
potential of a backward Euler step of size dt is sum(inertia) + sum(everything else), all in joules: `inertia` is
divided by dt^2, so nothing else is multiplied by it. Its minimiser is the next position.
"""

from yasps.materials.affine import affine_orthogonality
from yasps.materials.bending import hinge_bending
from yasps.materials.cloth import baraff_witkin, rest_triangles, triangle_deformation
from yasps.materials.elasticity import (
    deformation_gradient,
    gauss_deformation,
    lame_parameters,
    rest_shape,
    stable_neo_hookean,
    stable_neo_hookean_parameters,
)
from yasps.materials.forces import anchor, dead_load, gravity, inertia
from yasps.materials.joints import (
    aligned,
    angle_limits,
    elastic_link,
    frame_of,
    held_together,
    hinge_angle,
    motor,
    on_the_axis,
)
from yasps.materials.scalar import Scalar

__all__ = [
    "Scalar",
    "affine_orthogonality",
    "aligned",
    "anchor",
    "angle_limits",
    "baraff_witkin",
    "dead_load",
    "deformation_gradient",
    "elastic_link",
    "frame_of",
    "gauss_deformation",
    "gravity",
    "held_together",
    "hinge_angle",
    "hinge_bending",
    "inertia",
    "lame_parameters",
    "motor",
    "on_the_axis",
    "rest_shape",
    "rest_triangles",
    "stable_neo_hookean",
    "stable_neo_hookean_parameters",
    "triangle_deformation",
]
