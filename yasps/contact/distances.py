"""Squared distances [m^2] of points, lines and planes, whose corners are the rows of x."""

from __future__ import annotations

from yasps import Attribute


def squared_point_point(x: Attribute) -> Attribute:
    """Squared distance of points 0 and 1."""
    offset = x.row(1) - x.row(0)
    return offset.dot(offset)


def squared_point_line(x: Attribute) -> Attribute:
    """Squared distance of point 0 and the line through 1 and 2."""
    edge = x.row(2) - x.row(1)
    area = (x.row(1) - x.row(0)).cross(edge)  # of both ways to the ends, a tiny edge would be lost in their rounding
    return area.dot(area) / edge.dot(edge)


def squared_point_plane(x: Attribute) -> Attribute:
    """Squared distance of point 0 and the plane through 1, 2 and 3."""
    offset, first, second = x.row(0) - x.row(1), x.row(2) - x.row(1), x.row(3) - x.row(1)
    normal = first.cross(second)
    height = offset.dot(normal)
    return height * height / normal.dot(normal)


def squared_line_line(x: Attribute) -> Attribute:
    """Squared distance of the line through 0 and 1 and the line through 2 and 3."""
    offset, first, second = x.row(2) - x.row(0), x.row(1) - x.row(0), x.row(3) - x.row(2)
    normal = first.cross(second)
    height = offset.dot(normal)
    return height * height / normal.dot(normal)


def squared_point_half_space(x: Attribute) -> Attribute:
    """Squared distance of point 0 and the plane through point 2 with the unit normal in row 1."""
    height = (x.row(0) - x.row(2)).dot(x.row(1))
    return height * height
