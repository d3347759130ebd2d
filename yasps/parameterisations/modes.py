"""Reduced modes: a small dense basis of displacements."""

from __future__ import annotations

from yasps import Attribute


def modal_position(rest: Attribute, modes: Attribute, amplitudes: Attribute) -> Attribute:
    """r + sum of q_k phi_k [m], 3x1. rest r [m]: 3x1; modes: 3 x m, column k the displacement of this vertex in mode k;
    amplitudes q: m x 1, or 1 x m as JOIN gives it.

    Linear in q. Modes with a turn in them grow with its angle: for large turns put the modes inside a rigid motion.
    """
    return rest.reshape(3, 1) + modes * amplitudes.reshape(modes.shape[1], 1)
