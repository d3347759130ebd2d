"""The kinds of close pairs: what their vertices are, how far apart they are, where they touch, how they may slide.

The corners of a pair's vertices are the rows of x, arity x 3 [m]; the first piece's vertices come first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from yasps import Attribute, concat_cols, concat_rows, constant, maximum, minimum, select
from yasps.contact.distances import (
    squared_line_line,
    squared_point_half_space,
    squared_point_line,
    squared_point_plane,
    squared_point_point,
)

PARALLEL = 1e-32
"""Squared sine below which two edges are parallel as far as rounding can tell."""


@dataclass(frozen=True)
class Kind:
    """One kind of close pair of two pieces: points, edges, triangles.

    arity: how many vertices it has. squared_distance(x): of the two pieces [m^2]. sides: which vertex stands for the
    body of the first piece and which for that of the second. edges: for mollified kinds the vertices that each of the
    two edges joins. counted: the areas of how many vertices, the first ones, count in its weight; of_edges: whether
    those of two edges do. is_plane: the second piece is a half-space; rows 1 and 2 of x are its normal and a point of
    it then.

    weights(x): closest-point weights g, arity x 1, without unit. sum_i g_i x_i = x^T g is the way from the closest
    point of the first piece to that of the second: weights of the first piece are negative and sum to -1, those of the
    second sum to 1. normal(x): a 3x1 vector orthogonal to the tangent plane of both pieces, of any length and sign.
    """

    arity: int
    squared_distance: Callable[[Attribute], Attribute]
    weights: Callable[[Attribute], Attribute]
    normal: Callable[[Attribute], Attribute]
    sides: tuple[int, int] = (0, 1)
    edges: tuple[tuple[int, int], tuple[int, int]] | None = None
    counted: int = 0
    of_edges: bool = False
    is_plane: bool = False

    def tangents(self, x: Attribute) -> Attribute:
        """Two orthonormal columns, 3x2, that span the tangent plane of both pieces."""
        return tangent_basis(self.normal(x))


def tangent_basis(normal: Attribute) -> Attribute:
    """Two orthonormal columns, 3x2, orthogonal to a 3x1 vector of any length but 0; right to rounding for all of them.

    Duff et al. 2017, *Building an orthonormal basis, revisited*: no branch but the sign of the last entry.
    """
    x, y, z = normal / normal.norm()
    sign = select(z < 0, constant(-1.0), constant(1.0))
    a = -1 / (sign + z)
    b = x * y * a
    return concat_cols(
        [concat_rows([1 + sign * x * x * a, sign * b, -sign * x]), concat_rows([b, sign + y * y * a, -y])]
    )


def _along(point: Attribute, start: Attribute, end: Attribute) -> Attribute:
    """Where on the line from start (0) to end (1) the point is projected to."""
    edge = end - start
    return (point - start).dot(edge) / edge.dot(edge)


def _within(share: Attribute) -> Attribute:
    """The share moved into [0, 1]."""
    return minimum(maximum(share, constant(0.0)), constant(1.0))


def _point_point_weights(x: Attribute) -> Attribute:
    return constant([-1.0, 1.0])


def _point_line_weights(x: Attribute) -> Attribute:
    t = _along(x.row(0), x.row(1), x.row(2))
    return concat_rows([constant(-1.0), 1 - t, t])


def _point_plane_weights(x: Attribute) -> Attribute:
    offset, first, second = x.row(0) - x.row(1), x.row(2) - x.row(1), x.row(3) - x.row(1)
    normal = first.cross(second)
    area = normal.dot(normal)
    u, v = offset.cross(second).dot(normal) / area, first.cross(offset).dot(normal) / area
    return concat_rows([constant(-1.0), 1 - u - v, u, v])


def _line_line_weights(x: Attribute) -> Attribute:
    offset, first, second = x.row(2) - x.row(0), x.row(1) - x.row(0), x.row(3) - x.row(2)
    normal = first.cross(second)
    area = normal.dot(normal)
    s, t = offset.cross(second).dot(normal) / area, offset.cross(first).dot(normal) / area
    return concat_rows([s - 1, -s, 1 - t, t])


def _near_parallel_weights(x: Attribute) -> Attribute:
    """As those of two lines, but inside both edges and finite however parallel they are.

    Where the lines are nearest is known to rounding over the sine of their angle only. Whatever is wrong with it,
    projecting the point to the other edge and back leaves the points nearest to each other, and their way orthogonal.
    """
    offset, first, second = x.row(2) - x.row(0), x.row(1) - x.row(0), x.row(3) - x.row(2)
    normal = first.cross(second)
    area = normal.dot(normal) + PARALLEL * first.dot(first) * second.dot(second)
    s = _within(offset.cross(second).dot(normal) / area)
    t = _within(_along(x.row(0) + s * first, x.row(2), x.row(3)))
    s = _within(_along(x.row(2) + t * second, x.row(0), x.row(1)))
    return concat_rows([s - 1, -s, 1 - t, t])


def _mollified_point_point_weights(x: Attribute) -> Attribute:
    return constant([-1.0, 1.0, 0.0, 0.0])


def _mollified_point_line_weights(x: Attribute) -> Attribute:
    t = _within(_along(x.row(0), x.row(1), x.row(2)))
    return concat_rows([constant(-1.0), 1 - t, t, constant(0.0)])


def _point_point_normal(x: Attribute) -> Attribute:
    return (x.row(1) - x.row(0)).T


def _point_line_normal(x: Attribute) -> Attribute:
    edge = x.row(2) - x.row(1)
    return edge.cross((x.row(1) - x.row(0)).cross(edge)).T  # orthogonal to the edge to rounding, however near they are


def _point_plane_normal(x: Attribute) -> Attribute:
    return (x.row(2) - x.row(1)).cross(x.row(3) - x.row(1)).T


def _line_line_normal(x: Attribute) -> Attribute:
    return (x.row(1) - x.row(0)).cross(x.row(3) - x.row(2)).T


def _half_space_weights(x: Attribute) -> Attribute:
    return constant([-1.0])


def _half_space_normal(x: Attribute) -> Attribute:
    return x.row(1).T


def _near_parallel_normal(x: Attribute) -> Attribute:
    """The way between the closest points: the normal of nearly parallel lines has no direction left."""
    _, s, _, t = _near_parallel_weights(x)
    first, second = x.row(1) - x.row(0), x.row(3) - x.row(2)
    return (x.row(2) - x.row(0) + s * first + t * second).T  # differences first: rounding is that of the pair's size


KINDS: dict[str, Kind] = {
    "point_point": Kind(2, squared_point_point, _point_point_weights, _point_point_normal, counted=2, of_edges=True),
    "point_edge": Kind(3, squared_point_line, _point_line_weights, _point_line_normal, counted=1, of_edges=True),
    "point_triangle": Kind(4, squared_point_plane, _point_plane_weights, _point_plane_normal, counted=1),
    "edge_edge": Kind(4, squared_line_line, _line_line_weights, _line_line_normal, (0, 2), of_edges=True),
    "mollified_edge_edge": Kind(
        4, squared_line_line, _near_parallel_weights, _near_parallel_normal, (0, 2), ((0, 1), (2, 3)), of_edges=True
    ),
    "mollified_point_edge": Kind(
        4,
        squared_point_line,
        _mollified_point_line_weights,
        _point_line_normal,
        (0, 1),
        ((0, 3), (1, 2)),
        of_edges=True,
    ),
    "mollified_point_point": Kind(
        4,
        squared_point_point,
        _mollified_point_point_weights,
        _point_point_normal,
        (0, 1),
        ((0, 2), (1, 3)),
        of_edges=True,
    ),
}

HALF_SPACE = Kind(
    1, squared_point_half_space, _half_space_weights, _half_space_normal, (0, 0), counted=1, is_plane=True
)
