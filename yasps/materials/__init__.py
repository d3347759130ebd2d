"""Energies of deformable and stiff bodies, in joules, as expressions to read and copy.

Every function takes attributes (or numbers) and returns a 1x1 attribute: the energy on one instance. The incremental
potential of a backward Euler step of size dt is sum(inertia) + sum(everything else), all in joules: `inertia` is
divided by dt^2, so nothing else is multiplied by it. Its minimiser is the next position.
"""

from yasps.materials.affine import affine_orthogonality
from yasps.materials.bending import (
    discrete_shell_bending,
    hinge_angle,
    hinge_angles,
    hinge_bending,
    quadratic_bending,
    quadratic_bending_weights,
)
from yasps.materials.cloth import baraff_witkin, rest_triangles, triangle_deformation
from yasps.materials.damping import strain_rate_damping
from yasps.materials.elasticity import (
    deformation_gradient,
    fixed_corotated,
    gauss_deformation,
    green_strain,
    holzapfel_fibres,
    lame_parameters,
    linear_elasticity,
    mooney_rivlin,
    neo_hookean,
    rest_shape,
    st_venant_kirchhoff,
    stable_neo_hookean,
    stable_neo_hookean_parameters,
)
from yasps.materials.forces import anchor, dead_load, gravity, inertia
from yasps.materials.joints import (
    aligned,
    angle_limits,
    frame_of,
    held_together,
    joint_angle,
    motor,
    on_the_axis,
)
from yasps.materials.membranes import neo_hookean_membrane, st_venant_membrane, strain_limiting
from yasps.materials.pressure import enclosed_volume, inner_pressure
from yasps.materials.rods import (
    curvature_binormal,
    material_curvature,
    reference_twists,
    rod_bending,
    rod_directors,
    rod_material_bending,
    rod_stretching,
    rod_tangents,
    rod_twist,
    rod_twisting,
    transported_directors,
)
from yasps.materials.scalar import Scalar
from yasps.materials.springs import spring

__all__ = [
    "Scalar",
    "affine_orthogonality",
    "aligned",
    "anchor",
    "angle_limits",
    "baraff_witkin",
    "curvature_binormal",
    "dead_load",
    "deformation_gradient",
    "discrete_shell_bending",
    "enclosed_volume",
    "fixed_corotated",
    "frame_of",
    "gauss_deformation",
    "gravity",
    "green_strain",
    "held_together",
    "hinge_angle",
    "hinge_angles",
    "hinge_bending",
    "holzapfel_fibres",
    "inertia",
    "inner_pressure",
    "joint_angle",
    "lame_parameters",
    "linear_elasticity",
    "material_curvature",
    "mooney_rivlin",
    "motor",
    "neo_hookean",
    "neo_hookean_membrane",
    "on_the_axis",
    "quadratic_bending",
    "quadratic_bending_weights",
    "reference_twists",
    "rest_shape",
    "rest_triangles",
    "rod_bending",
    "rod_directors",
    "rod_material_bending",
    "rod_stretching",
    "rod_tangents",
    "rod_twist",
    "rod_twisting",
    "spring",
    "st_venant_kirchhoff",
    "st_venant_membrane",
    "stable_neo_hookean",
    "stable_neo_hookean_parameters",
    "strain_limiting",
    "strain_rate_damping",
    "transported_directors",
    "triangle_deformation",
]
