"""Linear systems that a coarse space helps with: two square nets, which pairs of contact couple in the second part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from device_systems import Structure
from numpy.typing import NDArray

from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix

SIDE, BODIES = 9, 2
VERTICES = SIDE * SIDE * BODIES
STATIC = 2
"""Energies of the first part."""


def net_structure(side: int = SIDE) -> Structure:
    """Springs between vertices of 3 scalars, one block of 12 scalars that holds a corner, and two contacts."""
    vertices = BODIES * side * side
    ids = np.arange(vertices, dtype=np.int32).reshape(BODIES, side, side)
    edges = np.concatenate(
        [
            np.stack([ids[:, :-1], ids[:, 1:]], -1).reshape(-1, 2),
            np.stack([ids[:, :, :-1], ids[:, :, 1:]], -1).reshape(-1, 2),
        ]
    )
    held = np.array([[1, 3 * vertices + 1]], np.int32)
    pairs = np.array([[0, side * side], [5, side * side + 7]], np.int32)
    return Structure((vertices, 1), (3, 12), [3 * edges + 1, held, 3 * pairs + 1])


def fill_nets(parts: Sequence[BlockMatrix], stiffness: float = 100.0) -> None:
    """The values of static part and contacts of this structure: positive definite."""
    rng = np.random.default_rng(0)
    for part, scale in zip(parts, (stiffness, 50.0), strict=True):
        for group in part.groups:
            apart = group.rows != group.cols
            group.values[apart] = -scale * np.eye(group.r, group.c)
            if group.r == group.c:
                group.values[~apart] = 0.0
    dense = dense_of(parts)
    for group in parts[0].groups:
        for block in np.flatnonzero((group.rows == group.cols) & (group.r == group.c)):
            at = slice(int(group.rows[block]), int(group.rows[block]) + group.r)
            random = rng.standard_normal((group.r, group.r))
            group.values[block] = np.diag(np.abs(dense[at]).sum(1) + 0.01) + 0.001 * random @ random.T


def nets(runtime: Runtime, *, stiffness: float = 100.0) -> list[BlockMatrix]:
    """Both parts, on the CPU."""
    structure = net_structure()
    parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
    for part, kappas in zip(parts, (structure.kappas[:STATIC], structure.kappas[STATIC:]), strict=True):
        part.build(structure.boundaries, structure.block_sizes, kappas)
    fill_nets(parts, stiffness)
    return parts


def dense_of(parts: Sequence[BlockMatrix]) -> NDArray[np.float64]:
    """Their sum."""
    return np.asarray(sum(part.to_scipy().toarray() for part in parts))
