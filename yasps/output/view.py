"""How pictures look at a motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from yasps.frontend.language.arrays import positive_number, real_numbers
from yasps.output.vtkhdf_layout import OutputFileError

CAMERAS: Final = ("whole", "follow")


@dataclass(frozen=True)
class View:
    """Where the camera stands; z is up.

    Attributes:
        camera: "whole" stands still and sees the whole motion; "follow" goes along with what moves.
        direction: from the scene towards the camera, not vertical.
        bounds: lowest and highest corner of what a camera that stands still sees [m], ((x, y, z), (x, y, z)), instead
            of the whole motion.
        speed: of the animation: 1 is that of the world, 0.1 ten times slower.
    """

    camera: str = "whole"
    direction: tuple[float, float, float] = (0.35, -1.0, 0.32)
    bounds: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    speed: float = 1.0

    def changed(self, **changes: Any) -> View:
        """The same with what is not None changed. Raises OutputFileError for what is no view."""
        new = replace(self, **{name: value for name, value in changes.items() if value is not None})
        return checked_view(new.camera, new.direction, new.bounds, new.speed)

    def told(self) -> dict[str, Any]:
        """For JSON."""
        return {"camera": self.camera, "direction": self.direction, "bounds": self.bounds, "speed": self.speed}


def checked_view(camera: str, direction: ArrayLike, bounds: ArrayLike | None, speed: float) -> View:
    """A view of what a user gave. Raises OutputFileError for what is none."""
    if camera not in CAMERAS:
        raise OutputFileError(f"camera is one of {', '.join(map(repr, CAMERAS))}, got {camera!r}.")
    towards = real_numbers(direction, "view_direction", OutputFileError)
    if towards.shape != (3,) or not np.linalg.norm(towards[:2]) > 1e-6 * abs(towards[2]):
        raise OutputFileError(
            f"view_direction is three numbers, from the scene towards the camera, and neither zero nor vertical (z is "
            f"up), got {direction!r}."
        )
    corners = None
    if bounds is not None:
        box = real_numbers(bounds, "bounds", OutputFileError)
        if box.shape != (2, 3) or not (box[0] <= box[1]).all():
            raise OutputFileError(f"bounds are the lowest and the highest corner of a box, [2, 3], got {bounds!r}.")
        corners = (tuple(box[0].tolist()), tuple(box[1].tolist()))
    x, y, z = towards.tolist()
    return View(camera, (x, y, z), corners, positive_number(speed, "speed", "times that of the world", OutputFileError))


def view_of(told: Mapping[str, Any]) -> View:
    """The view that a file has."""
    return checked_view(told["camera"], told["direction"], told["bounds"], told["speed"])
