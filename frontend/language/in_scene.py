"""What belongs to a scene stays there."""

from __future__ import annotations

from typing import Never

from yasps.frontend.errors import SceneError
from yasps.runtime.core.uncopied import Uncopied


class InScene(Uncopied):
    """A scene or a part of one: it refers to all of the scene, and so to what is compiled for it."""

    def __reduce_ex__(self, protocol: object) -> Never:
        raise SceneError(
            f"{self!r} can't be copied or pickled: a scene holds memory and machine code of this process. Make another "
            "scene by calling what made this one (in another process, too), and carry the numbers over: "
            "attribute.value gives them, attribute.update_value(numbers) sets them"
        )
