"""The soft shadow of surfaces on a flat ground.

Not VTK's, whose shadow maps have hard, jagged edges: the surfaces are sampled, the samples dropped on the ground along
the light in a few layers of height, and a layer is blurred the more the higher it is.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import ndimage

Points = npt.NDArray[np.float64]

_SHADOW_TOWARDS_LIGHT: Final = (-0.30, -0.25, 1.0)
# (from this height up, width of the blur, darkness); lengths as parts of the scene's diagonal.
_SHADOW_LAYERS: Final = ((0.0, 0.008, 0.34), (0.05, 0.02, 0.24), (0.15, 0.04, 0.20), (0.4, 0.08, 0.16))
_SHADOW_CELLS: Final = 512


def soft_shadow(
    bodies: Sequence[tuple[Points, npt.NDArray[np.int64]]],
    ground_height: float,
    centre: Points,
    side: float,
    diagonal: float,
) -> Points:
    """How dark the ground is, in 0..1, on a square grid of cells [y, x] around `centre` with the given side.

    Args:
        bodies: (vertices [n, 3], triangles [m, 3]) each.
        ground_height: z of the ground; what lies below casts no shadow.
        centre: middle of the square, (x, y).
        side: of the square, in the unit of the vertices.
        diagonal: of the scene; widths of blur are parts of it.
    """
    cell = side / _SHADOW_CELLS
    samples = np.concatenate([np.empty((0, 3)), *(_surface_samples(v, t, 0.5 * cell) for v, t in bodies)])
    height = samples[:, 2] - ground_height
    slope = np.array(_SHADOW_TOWARDS_LIGHT[:2]) / _SHADOW_TOWARDS_LIGHT[2]
    place = samples[:, :2] - height[:, None] * slope - centre
    column = np.floor(place / cell + _SHADOW_CELLS / 2).astype(int)
    inside = ((column >= 0) & (column < _SHADOW_CELLS)).all(axis=1)
    tops = [layer[0] * diagonal for layer in _SHADOW_LAYERS[1:]] + [np.inf]
    bright = np.ones((_SHADOW_CELLS, _SHADOW_CELLS))
    for (bottom, width, darkness), top in zip(_SHADOW_LAYERS, tops, strict=True):
        chosen = column[inside & (height >= bottom * diagonal) & (height < top)]
        covered = np.zeros_like(bright)
        covered[chosen[:, 1], chosen[:, 0]] = 1.0
        bright *= 1.0 - darkness * ndimage.gaussian_filter(covered, width * diagonal / cell, mode="constant")
    return 1.0 - bright


def _surface_samples(vertices: Points, triangles: npt.NDArray[np.int64], spacing: float) -> Points:
    """Points on the triangles, about one per spacing^2 but at least one a triangle, [k, 3]; always the same."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # No more than the grid has cells: a huge triangle (a floor) would else cost any amount of memory.
    count = np.clip(np.ceil(area / spacing**2), 1, _SHADOW_CELLS**2 // 4).astype(int)
    owner = np.repeat(np.arange(len(triangles)), count)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    # The additive sequence of the plastic number covers the unit square evenly; folding it covers the triangle.
    s, t = (0.5 + number * 0.7548776662466927) % 1.0, (0.5 + number * 0.5698402909980532) % 1.0
    s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
    return np.asarray(a[owner] + s[:, None] * (b - a)[owner] + t[:, None] * (c - a)[owner])
