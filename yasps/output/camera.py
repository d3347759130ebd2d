"""Where the camera stands so that it sees what it should, and not much more."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from yasps.frontend.language.arrays import real_numbers
from yasps.output.picture_errors import PictureError

Points = npt.NDArray[np.float64]

VIEW_ANGLE: Final = 30.0
"""Over the height of the picture [degrees]."""
MARGIN: Final = 1.12
"""Free space around the scene."""
_TANGENT: Final = float(np.tan(np.radians(VIEW_ANGLE / 2))) / MARGIN
"""Of half the view, upwards, without the margin."""


def camera_position(points: Points, view_direction: tuple[float, float, float], aspect: float) -> tuple[Points, Points]:
    """The eye and the point it looks at, as near as all points allow.

    A point with coordinates (x, y, z) along (right, up, towards the eye) is in the picture of an eye at (s, u, d) if
    |x - s| <= (d - z) tan(a_x) and |y - u| <= (d - z) tan(a_y), with a the half angles of view. For the extreme points
    on both sides, s that is best for both is half the difference of max(x + z t) and max(-x + z t), and d t half their
    sum.

    Args:
        points: [k, 3].
        view_direction: from the scene towards the eye, not vertical.
        aspect: width / height of the picture.

    Raises:
        PictureError: the direction is zero or vertical.
    """
    towards, right, up = _axes(view_direction)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    depth = (points - centre) @ towards
    distance, focus = 1e-6, centre
    for axis, tangent in ((right, _TANGENT * aspect), (up, _TANGENT)):
        across = (points - centre) @ axis
        one, other = (across + tangent * depth).max(), (tangent * depth - across).max()
        distance = max(distance, float(one + other) / (2 * tangent))
        focus = focus + 0.5 * (one - other) * axis
    return focus + distance * towards, focus


def distance_to_see(points: Points, focus: Points, view_direction: tuple[float, float, float], aspect: float) -> float:
    """How far from a point that the camera looks at it must be to see all points; see `camera_position`."""
    towards, right, up = _axes(view_direction)
    off = points - focus
    return max(
        float((off @ towards + abs(off @ axis) / tangent).max())
        for axis, tangent in ((right, _TANGENT * aspect), (up, _TANGENT))
    )


def _axes(view_direction: tuple[float, float, float]) -> tuple[Points, Points, Points]:
    """Unit vectors towards the eye, to the right and up in the picture. Raises PictureError."""
    towards = real_numbers(view_direction, "view_direction", PictureError).copy()
    if towards.shape != (3,):
        raise PictureError(f"view_direction is {view_direction}; it must be three numbers.")
    right = np.cross([0.0, 0.0, 1.0], towards)
    if not np.linalg.norm(right) > 1e-6 * np.linalg.norm(towards):
        raise PictureError(f"view_direction is {view_direction}; it must not be zero or vertical (z is up).")
    towards /= np.linalg.norm(towards)
    right /= np.linalg.norm(right)
    return towards, right, np.cross(towards, right)


def box_corners(bounds: Points) -> Points:
    """The corners of a box, [8, 3], of its lowest and highest, [2, 3]."""
    return np.array([[x, y, z] for x in bounds[:, 0] for y in bounds[:, 1] for z in bounds[:, 2]])
