"""Finite elements by the names and node orders of meshio: shape functions, Gauss points, masses, faces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from yasps.meshes.tetrahedral_mesh import Float64Array

HEX_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], np.float64
)
"""Local coordinates of a hexahedron's corners."""
TET_SIDES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
"""Ends of the sides of a tetrahedron, in the order of the nodes in their middles, 4 to 9."""
TRIANGLE_SIDES = ((0, 1), (1, 2), (2, 0))


def trilinear_shape(local: Float64Array) -> Float64Array:
    """Shape functions of a hexahedron's corners at local coordinates [q, 3] from -1 to 1; [q, 8]."""
    return np.asarray(np.prod(1 + local[:, None, :] * HEX_CORNERS, axis=2) / 8)


def trilinear_slopes(local: Float64Array) -> Float64Array:
    """Derivatives of these by the local coordinates, [q, 8, 3]."""
    factors = 1 + local[:, None, :] * HEX_CORNERS
    others = np.stack([factors[..., (k + 1) % 3] * factors[..., (k + 2) % 3] for k in range(3)], axis=2)
    return np.asarray(HEX_CORNERS * others / 8)


def _simplex_slopes(local: Float64Array, sides: tuple[tuple[int, int], ...]) -> Float64Array:
    """Derivatives of the shape functions of a triangle or tetrahedron, with nodes in the middles of these sides, by the
    local coordinates [q, d], which are the barycentric ones of all corners but the first; [q, nodes, d]."""
    dimension = local.shape[1]
    corners = np.column_stack([1 - local.sum(axis=1), local])
    by_local = np.vstack([-np.ones(dimension), np.eye(dimension)])  # of the barycentric coordinates
    if not sides:
        return np.broadcast_to(by_local, (len(local), *by_local.shape)).copy()
    # N = b (2 b - 1) of a corner and 4 b c of the middle of a side.
    ends = [(4 * corners[:, k] - 1)[:, None] * by_local[k] for k in range(dimension + 1)]
    middles = [4 * (corners[:, [i]] * by_local[j] + corners[:, [j]] * by_local[i]) for i, j in sides]
    return np.stack([*ends, *middles], axis=1)


def _split(corners: tuple[int, int, int], middles: tuple[int, int, int]) -> tuple[tuple[int, ...], ...]:
    """The four triangles of a quadratic one."""
    (a, b, c), (ab, bc, ca) = corners, middles
    return (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)


@dataclass(frozen=True)
class ElementKind:
    """One kind of finite element."""

    name: str
    """Of meshio."""
    dimension: int
    """2 for surfaces."""
    slopes: Callable[[Float64Array], Float64Array]
    """Derivatives of the shape functions by local coordinates, [q, d] -> [q, nodes, d]."""
    points: Float64Array
    """Local coordinates of the Gauss points, [q, d]."""
    weights: Float64Array
    """Of the Gauss points, [q]."""
    masses: Float64Array
    """Shares of an element's mass that its nodes get, [nodes]: all positive, adding up to 1."""
    faces: tuple[tuple[int, ...], ...]
    """Corners of each face, counter-clockwise seen from outside; of a surface, its own."""
    split: tuple[tuple[tuple[int, ...], ...], ...]
    """The triangles into which each face is cut; for quadrilaterals none, they are cut by their node numbers."""

    @property
    def nodes(self) -> int:
        """How many an element has."""
        return len(self.masses)


_TRIANGLE_POINTS = np.array([[1, 1], [4, 1], [1, 4]]) / 6
_A, _B = (5 - np.sqrt(5)) / 20, (5 + 3 * np.sqrt(5)) / 20
_TET_POINTS = np.array([[_A, _A, _A], [_B, _A, _A], [_A, _B, _A], [_A, _A, _B]])
_TET_FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
_MIDDLE = {frozenset(side): 4 + k for k, side in enumerate(TET_SIDES)}

KINDS = {
    kind.name: kind
    for kind in (
        ElementKind(
            "tetra", 3, lambda x: _simplex_slopes(x, ()), np.full((1, 3), 0.25), np.full(1, 1 / 6), np.full(4, 0.25),
            _TET_FACES, tuple((face,) for face in _TET_FACES),
        ),
        ElementKind(
            "tetra10", 3, lambda x: _simplex_slopes(x, TET_SIDES), _TET_POINTS, np.full(4, 1 / 24),
            # Row sums of the consistent mass matrix are negative at corners; these are its diagonal, scaled (HRZ).
            np.array([1 / 36] * 4 + [4 / 27] * 6), _TET_FACES,
            tuple(
                _split(face, tuple(_MIDDLE[frozenset((face[k], face[(k + 1) % 3]))] for k in range(3)))  # type: ignore[arg-type]
                for face in _TET_FACES
            ),
        ),
        ElementKind(
            "hexahedron", 3, trilinear_slopes, HEX_CORNERS / np.sqrt(3), np.ones(8), np.full(8, 0.125),
            ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)), (),
        ),
        ElementKind(
            "triangle", 2, lambda x: _simplex_slopes(x, ()), np.full((1, 2), 1 / 3), np.full(1, 0.5), np.full(3, 1 / 3),
            ((0, 1, 2),), (((0, 1, 2),),),
        ),
        ElementKind(
            "triangle6", 2, lambda x: _simplex_slopes(x, TRIANGLE_SIDES), _TRIANGLE_POINTS, np.full(3, 1 / 6),
            # The diagonal of the consistent matrix, scaled (HRZ); row sums are 0 at corners.
            np.array([1 / 19] * 3 + [16 / 57] * 3), ((0, 1, 2),), (_split((0, 1, 2), (3, 4, 5)),),
        ),
    )
}  # fmt: skip
"""By name. Gauss points integrate what is quadratic in the local coordinates, as the energies of small strains of
quadratic elements with straight sides are, exactly."""
