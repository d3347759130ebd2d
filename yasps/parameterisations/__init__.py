"""Positions of vertices as functions of other unknowns: plain functions from attributes to a 3x1 `position`.

An energy that reads `position`, contact, friction and joints among them, needs no word about where it comes from: its
derivatives go through JOINs and UNIONs to the unknowns behind. Functions of NumPy arrays beside them find weights and
connectivities.
"""

from yasps.parameterisations.affine import affine_position
from yasps.parameterisations.cage import barycentric_coordinates, barycentric_weights, caged_position, trilinear_weights
from yasps.parameterisations.chains import ancestors, turned
from yasps.parameterisations.modes import modal_position
from yasps.parameterisations.rigid import cross_matrix, recentred_rotation, rotation_matrix
from yasps.parameterisations.skinning import Influences, blended, influences

__all__ = [
    "Influences",
    "affine_position",
    "ancestors",
    "barycentric_coordinates",
    "barycentric_weights",
    "blended",
    "caged_position",
    "cross_matrix",
    "influences",
    "modal_position",
    "recentred_rotation",
    "rotation_matrix",
    "trilinear_weights",
    "turned",
]
