"""Surfaces with their vertices and triangles in another order, so that of two edges or points either may come first."""

from __future__ import annotations

import numpy as np
from collision_scenes import Mesh

NAMES = (
    "nearly parallel",
    "shaken",
    "edges crossing at 0.001",
    "edges crossing at 0.015",
    "box corner to corner",
    "box edge across edge",
)
"""Scenes that have all kinds of close pairs together."""


def renumbered(mesh: Mesh, seed: int) -> Mesh:
    """The same surface with its vertices in another order, and its triangles too, each from another corner on."""
    rng = np.random.default_rng(seed)
    points, faces = mesh
    new_id = rng.permutation(len(points))
    moved = np.empty_like(points)
    moved[new_id] = points
    turned = np.array([np.roll(face, rng.integers(3)) for face in new_id[faces]], np.int32)
    return moved, rng.permutation(turned)
