"""Affine motion."""

from __future__ import annotations

from yasps import Attribute


def affine_position(matrix: Attribute, translation: Attribute, rest: Attribute) -> Attribute:
    """A r + t [m], 3x1. matrix A: 3x3, or 1x9 as JOIN gives it; translation t [m]: 3x1 or 1x3; rest r [m]: 3x1, from
    the point that t is the place of.

    Linear in A and t: Hessians of what reads it are projected inside each energy, and straight ways stay straight.
    """
    return matrix.reshape(3, 3) * rest.reshape(3, 1) + translation.reshape(3, 1)
