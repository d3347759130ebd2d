"""What bodies lie on in pictures: a ground with a soft shadow and a faint grid, and the planes of half-spaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from yasps.output.recorded_bodies import RecordedPlane
from yasps.output.soft_shadow import soft_shadow

Points = npt.NDArray[np.float64]

_SHADOW_RGB: Final = (52, 58, 78)
_LINE_RGB: Final = (120, 130, 150)
_LINE_ALPHA: Final = 0.35
_REACH: Final = 2.2
"""How far the grid goes, in diagonals of the scene; it fades on the way."""


def shadow_texture(
    bodies: Sequence[tuple[Points, npt.NDArray[np.int64]]],
    ground_height: float,
    centre: Points,
    side: float,
    diagonal: float,
) -> Any:
    """The shadow of `soft_shadow` as a texture, dark where it is and transparent elsewhere."""
    import pyvista

    shadow = soft_shadow(bodies, ground_height, centre, side, diagonal)
    image = np.empty((*shadow.shape, 4), dtype=np.uint8)
    image[..., :3] = _SHADOW_RGB
    image[..., 3] = np.round(255 * shadow)
    to_texture: Any = pyvista.numpy_to_texture
    texture = to_texture(np.ascontiguousarray(image[::-1]))
    texture.interpolate = True
    return texture


def round_spacing(length: float) -> float:
    """1, 2 or 5 times a power of ten: the largest that is not above a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= length))


class GroundLines:
    """A grid of lines on the ground, fixed to the world, drawn around a place and fading away from it."""

    def __init__(self, height: float, diagonal: float) -> None:
        """height: z of the ground; diagonal: of the scene, of which it takes its spacing."""
        import pyvista

        self.spacing = round_spacing(diagonal / 5)
        self._reach = _REACH * diagonal
        self._height = height - 5e-4 * diagonal
        count = int(self._reach // self.spacing)
        across = self.spacing * np.arange(-count, count + 1)
        along = np.linspace(-self._reach, self._reach, 60)
        one = np.stack(np.meshgrid(across, along, indexing="ij"), axis=-1).reshape(-1, 2)
        self._flat = np.concatenate([one, one[:, ::-1]])
        lines = np.arange(len(self._flat)).reshape(-1, len(along))
        flat = np.insert(lines, 0, len(along), axis=1).ravel()
        self.mesh: Any = pyvista.PolyData(np.zeros((len(self._flat), 3)), lines=flat)
        self.mesh.point_data["rgba"] = np.zeros((len(self._flat), 4), np.uint8)
        self.move(np.zeros(3))

    def move(self, focus: Points) -> None:
        """Draws the part around a place; the lines stay where they are in the world."""
        snapped = self.spacing * np.round(focus[:2] / self.spacing)
        place = self._flat + snapped
        away = np.linalg.norm(place - focus[:2], axis=1) / self._reach
        alpha = _LINE_ALPHA * np.clip(1.0 - away, 0.0, 1.0)
        self.mesh.points[:] = np.column_stack([place, np.full(len(place), self._height)])
        self.mesh.point_data["rgba"][:] = np.column_stack(
            [np.tile(np.array(_LINE_RGB), (len(place), 1)), np.round(255 * alpha)]
        )
        self.mesh.Modified()


def plane_square(plane: RecordedPlane, middle: Points, diagonal: float, ground_height: float | None) -> Any:
    """The part of a half-space's plane near the scene, above the ground, with thickness of none; None if nothing of it
    is above the ground.

    Its square is no larger than the one that stands for it, and than 1.6 diagonals of the scene.
    """
    import pyvista

    normal, point = np.array(plane.normal), np.array(plane.point)
    side = min(plane.size, 1.6 * diagonal)
    foot = middle - ((middle - point) @ normal) * normal
    square: Any = pyvista.Plane(center=foot, direction=normal, i_size=side, j_size=side)
    if ground_height is None:
        return square
    above = square.triangulate().clip(normal="z", origin=(0.0, 0.0, ground_height), invert=False)
    return above if above.n_points else None
