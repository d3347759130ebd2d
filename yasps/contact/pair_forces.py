"""Forces of close pairs in closed form: minus the derivative of their barrier by each of their vertices.

Of the shortest way r = sum of g_i x_i between two pieces, g the closest-point weights, the squared length D has the
derivative dD/dx_i = 2 g_i r: that of the weights drops out, since r is orthogonal to the ways in which they change r
(the envelope theorem). Where radii vary along a piece, their sum xi = sum of |g_i| radius_i needs that of the weights:
with A_k = dr/dp_k and B_ik = dg_i/dp_k for the parameters p of the closest points, and A^T r = 0,

    dp = -(A^T A)^-1 (B_i r + g_i A) dx_i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yasps.contact.active_set import Floats
from yasps.contact.friction import KINETIC_FROM
from yasps.contact.kinds import PARALLEL
from yasps.contact.rows import row_crosses, row_dots

_LINES = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
_SLOPES: dict[str, Floats] = {
    "point_point": np.zeros((2, 0)),
    "point_edge": np.array([[0.0], [-1.0], [1.0]]),
    "point_triangle": np.array([[0.0, 0.0], [-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]),
    "edge_edge": _LINES,
    "mollified_edge_edge": _LINES,
    "mollified_point_edge": np.array([[0.0], [-1.0], [1.0], [0.0]]),
    "mollified_point_point": np.zeros((4, 0)),
    "half_space": np.zeros((1, 0)),
}
"""B of each kind, [arity, parameters]."""
FIRST_PIECE: dict[str, tuple[bool, ...]] = {
    "point_point": (True, False),
    "point_edge": (True, False, False),
    "point_triangle": (True, False, False, False),
    "edge_edge": (True, True, False, False),
    "mollified_edge_edge": (True, True, False, False),
    "mollified_point_edge": (True, False, False, True),
    "mollified_point_point": (True, False, True, False),
    "half_space": (True,),
}
"""Which vertices of a kind are of its first piece."""


@dataclass(frozen=True)
class ClosestPoints:
    """Where pairs of one kind are closest, for n pairs."""

    weights: Floats
    """g, [n, arity]: negative and -1 in sum for the first piece, 1 in sum for the second."""
    way: Floats
    """r [m], [n, 3], from the first piece to the second."""
    along: Floats
    """A^T [m], [n, parameters, 3]: how the way changes with the parameters."""
    of_parameters: Floats
    """B, [arity, parameters]."""

    def slopes(self) -> Floats:
        """dp/dx_i, [n, parameters, arity, 3]: how the closest points move along their pieces."""
        moved = self.of_parameters.T[None, :, :, None] * self.way[:, None, None] + (
            self.weights[:, None, :, None] * self.along[:, :, None]
        )
        return np.asarray(-np.einsum("npq,nqad->npad", _inverse_gram(self.along), moved))

    def offset(self, kind: str, radii: Floats) -> Floats:
        """The sum of |g_i| radius_i [m], [n]; radii [n, arity] [m].

        Weights of nearly parallel edges are moved into the edges, as `Kind.weights` does.
        """
        shares = self.weights * _signs(kind)
        return np.asarray(((shares.clip(0, 1) if kind.startswith("mollified") else shares) * radii).sum(axis=1))

    def offset_slopes(self, kind: str, radii: Floats) -> Floats:
        """Derivatives of `offset` by the vertices, [n, arity, 3]. Weights that were moved into an edge don't change."""
        sign = _signs(kind)
        by_parameter = np.einsum("na,ap->np", sign * radii, self.of_parameters)
        if kind.startswith("mollified"):
            shares = self.weights * sign
            outside = (shares < 0) | (shares > 1)
            by_parameter *= 1.0 - np.einsum("na,ap->np", outside, self.of_parameters != 0).clip(0, 1)
        slopes = np.einsum("np,npad->nad", by_parameter, self.slopes())
        # Their sum is 0: what rounding leaves of it, for nearly parallel edges, is taken away.
        return np.asarray(slopes - slopes.mean(axis=1, keepdims=True), np.float64)


def closest_points(kind: str, x: Floats) -> ClosestPoints:
    """Of corners x [n, arity, 3] [m]; those of a half-space are a vertex, the unit normal and a point of the plane."""
    if kind == "half_space":
        height = np.einsum("nd,nd->n", x[:, 0] - x[:, 2], x[:, 1])
        way = -height[:, None] * x[:, 1]
        return ClosestPoints(-np.ones((len(x), 1)), way, np.zeros((len(x), 0, 3)), _SLOPES[kind])
    if kind.endswith("edge_edge"):
        first, second, offset = x[:, 1] - x[:, 0], x[:, 3] - x[:, 2], x[:, 2] - x[:, 0]
        normal, area = _normal(first, second)
        s = row_dots(row_crosses(offset, second), normal) / area
        t = row_dots(row_crosses(offset, first), normal) / area
        weights = np.stack([s - 1, -s, 1 - t, t], axis=1)
        way, along = _part_along(offset, normal, area), np.stack([-first, second], axis=1)
    elif kind == "point_triangle":
        first, second, offset = x[:, 2] - x[:, 1], x[:, 3] - x[:, 1], x[:, 0] - x[:, 1]
        normal, area = _normal(first, second)
        u, v = row_dots(row_crosses(offset, second), normal) / area, row_dots(row_crosses(first, offset), normal) / area
        weights = np.stack([-np.ones(len(x)), 1 - u - v, u, v], axis=1)
        way, along = _part_along(-offset, normal, area), np.stack([first, second], axis=1)
    elif kind.endswith("point_edge"):
        edge, offset = x[:, 2] - x[:, 1], x[:, 1] - x[:, 0]
        area = row_dots(edge, edge)
        t = -row_dots(offset, edge) / area
        weights = np.stack([-np.ones(len(x)), 1 - t, t, *([np.zeros(len(x))] if kind[0] == "m" else [])], axis=1)
        way = (
            row_crosses(edge, row_crosses(offset, edge)) / area[:, None]
        )  # all of it orthogonal, however long the edge is
        along = edge[:, None]
    else:
        weights = np.tile([-1.0, 1.0, 0.0, 0.0][: x.shape[1]], (len(x), 1))
        way, along = x[:, 1] - x[:, 0], np.zeros((len(x), 0, 3))
    return ClosestPoints(weights, way, along, _SLOPES[kind])


def lagged_points(kind: str, x: Floats) -> tuple[Floats, Floats]:
    """Closest-point weights [n, arity] and ways [n, 3] [m] of corners x, as friction takes them: of nearly parallel
    edges inside both, however parallel they are (see `Kind.weights`, whose steps these are)."""
    if kind == "mollified_edge_edge":
        first, second, offset = x[:, 1] - x[:, 0], x[:, 3] - x[:, 2], x[:, 2] - x[:, 0]
        long_first, long_second = row_dots(first, first), row_dots(second, second)
        normal, area = _normal(first, second)
        s = (row_dots(row_crosses(offset, second), normal) / (area + PARALLEL * long_first * long_second)).clip(0, 1)
        t = (row_dots(s[:, None] * first - offset, second) / long_second).clip(0, 1)
        s = (row_dots(offset + t[:, None] * second, first) / long_first).clip(0, 1)
        weights = np.stack([s - 1, -s, 1 - t, t], axis=1)
        return weights, offset - s[:, None] * first + t[:, None] * second
    points = closest_points(kind, x)
    weights = points.weights
    if kind == "mollified_point_edge":
        t = weights[:, 2].clip(0, 1)
        weights = np.stack([weights[:, 0], 1 - t, t, weights[:, 3]], axis=1)
    return weights, points.way


def friction_slopes(slip: Floats, length: float, static: Floats, kinetic: Floats) -> tuple[Floats, Floats]:
    """W of `sliding_distance` [m] and W'/y of slips of length y [m], [n]; length: e, the slip length [m]."""
    share = slip / length
    sticks = share < 1
    width = (KINETIC_FROM - 1) * length
    q = np.maximum(slip / width - 1 / (KINETIC_FROM - 1), 0.0)
    inner = np.minimum(q, 1.0)
    lost = np.where(q < 1, inner**4 * (2.5 - inner * (3 - inner)), q - 0.5)
    faded = inner**3 * (10 - inner * (15 - 6 * inner))
    smooth = np.where(sticks, length / 3 + slip * share * (1 - share / 3), slip)
    safe = np.where(sticks, 1.0, slip)
    by_length = static * np.where(sticks, (2 - share) / length, 1 / safe) - (static - kinetic) * faded / safe
    return static * smooth - (static - kinetic) * width * lost, by_length


def mollifiers(edges: tuple[tuple[int, int], tuple[int, int]], x: Floats, threshold: Floats) -> tuple[Floats, Floats]:
    """(c/e) (2 - c/e), c = |u x v|^2, of corners x [n, 4, 3] and thresholds e [n] [m^4]; its derivative, [n, 4, 3]."""
    (a, b), (c, d) = edges
    u, v = x[:, b] - x[:, a], x[:, d] - x[:, c]
    normal = row_crosses(u, v)
    ratio = row_dots(normal, normal) / threshold
    by_square = (4 * (1 - ratio) / threshold)[:, None]
    of_u, of_v = by_square * row_crosses(v, normal), by_square * row_crosses(normal, u)
    slopes = np.zeros((len(x), 4, 3))
    slopes[:, a], slopes[:, b], slopes[:, c], slopes[:, d] = -of_u, of_u, -of_v, of_v
    return ratio * (2 - ratio), slopes


def barrier_slopes(barrier: str, excess: Floats, activation: Floats, scale: Floats) -> tuple[Floats, Floats, Floats]:
    """Energy of a barrier [J] ("log" or "paper", see `BARRIERS`), and its derivatives by excess and activation."""
    ratio = excess / activation
    gap, log = 1 - ratio, np.log(ratio)
    if barrier == "log":
        by_ratio = scale * gap * (2 * log - gap / ratio)
        return -scale * gap * gap * log, by_ratio / activation, -by_ratio * ratio / activation
    away = excess - activation
    common = 2 * scale * away * log
    return scale * (away * log) ** 2, common * (log + away / excess), -common * (log + away / activation)


def _signs(kind: str) -> Floats:
    """What makes the weights of both pieces positive, [arity]."""
    return np.where(FIRST_PIECE[kind], -1.0, 1.0)


def _normal(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    normal = row_crosses(first, second)
    return normal, row_dots(normal, normal)


def _part_along(offset: Floats, normal: Floats, area: Floats) -> Floats:
    return np.asarray((row_dots(offset, normal) / area)[:, None] * normal)


def _inverse_gram(along: Floats) -> Floats:
    """(A^T A)^-1 of one or two columns A [n, columns, 3], [n, columns, columns]."""
    gram = np.einsum("npd,nqd->npq", along, along)
    if along.shape[1] < 2:
        return np.asarray(1.0 / gram)
    _, area = _normal(along[:, 0], along[:, 1])
    adjugate = np.stack([gram[:, 1, 1], -gram[:, 0, 1], -gram[:, 0, 1], gram[:, 0, 0]], axis=1).reshape(-1, 2, 2)
    return np.asarray(adjugate / area[:, None, None])
