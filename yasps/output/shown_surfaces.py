"""What one sees of a frame as triangles: surfaces, rods as tubes, loose vertices as balls, half-spaces as squares."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yasps.output.picture_errors import PicturesUnavailable
from yasps.output.recorded_bodies import RecordedBody, RecordedPlane
from yasps.output.series import Series
from yasps.output.tubes import Tubes

Floats = NDArray[np.float64]
Ids = NDArray[np.int64]

THIN = 2e-3
"""Radius of rods that have none, in diagonals of the box of what moves."""


@dataclass(frozen=True, eq=False)
class ShownSurface:
    """Triangles of one body: vertices [n, 3] in metres, triangles [m, 3]."""

    body: RecordedBody
    vertices: Floats
    triangles: Ids


def plane_corners(plane: RecordedPlane) -> Floats:
    """The square that stands for a half-space, around its point, [4, 3], anticlockwise seen from outside."""
    normal = np.array(plane.normal)
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    other = np.cross(normal, across)
    half = 0.5 * plane.size
    sides = [(-half, -half), (half, -half), (half, half), (-half, half)]
    return np.array([np.array(plane.point) + i * across + j * other for i, j in sides])


def thin_radius(series: Series) -> float:
    """What rods without a radius are drawn with [m]."""
    box = series.box([0])
    return THIN * (float(np.linalg.norm(box[1] - box[0])) or 1.0)


def shown_surfaces(series: Series, frame: int) -> Iterator[ShownSurface]:
    """What one sees of a frame, body by body. Raises OutputFileError, and PicturesUnavailable for rods without pyvista,
    which makes tubes of them."""
    x = series.positions(frame)
    for body in series.bodies:
        here = x[body.vertices]
        vertices, triangles = [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
        if body.plane is not None:
            vertices, triangles = [plane_corners(body.plane)], [np.array([[0, 1, 2], [0, 2, 3]])]
        if len(body.triangles):
            used = np.unique(body.triangles)
            vertices.append(here[used])
            triangles.append(np.searchsorted(used, body.triangles))
        if len(body.edges) or len(body.points):
            if importlib.util.find_spec("pyvista") is None:
                raise PicturesUnavailable(
                    f"'{body.name}' has rods, which pyvista makes tubes of; it is not installed. To get it: "
                    "pip install 'yasps[examples]'"
                )
            skin, faces, _ = Tubes(body.edges, body.points, body.radii, thin_radius(series)).surface(here)
            triangles.append(faces + sum(len(part) for part in vertices))
            vertices.append(skin)
        if sum(len(part) for part in triangles):
            yield ShownSurface(body, np.concatenate(vertices), np.concatenate(triangles))
