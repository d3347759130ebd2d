"""Forces in newtons of gradients of all kinds of targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from yasps import Attribute, FloatArray, Scene, SceneError
from yasps.frontend.language.arrays import positive_number

Arms = Mapping[Attribute, float]
"""Of targets that are no positions: how far at most a vertex moves for a unit of the target [m]. The gradient with
respect to an angle is a torque; over the distance of the farthest vertex it is the force there."""


def checked_arms(arms: Arms | None, scene: Scene) -> dict[Attribute, float]:
    """Raises SceneError for what is no target or no length."""
    checked = {}
    for target, arm in (arms or {}).items():
        if target not in scene.minimize_targets:
            raise SceneError(f"arms: {getattr(target, 'path', target)!r} is no minimisation target of {scene.label}")
        checked[target] = positive_number(arm, f"the arm of {target.path}", "m", SceneError)
    return checked


@dataclass(frozen=True)
class ForceMeasure:
    """Turns gradients into forces on instances of targets: the Euclidean norm of an instance's gradient, over the
    target's arm if it has one."""

    targets: Sequence[Attribute]
    arms: Arms

    def largest(self, gradient: FloatArray) -> float:
        """Largest force on any instance [N], of a gradient with respect to all targets, end to end."""
        most, start = 0.0, 0
        for target in self.targets:
            assert target.owner is not None
            rows, cols = target.shape
            end = start + target.owner.num_instances * rows * cols
            parts = gradient[start:end].reshape(-1, rows * cols)
            norm = float(np.sqrt(np.einsum("ij,ij->i", parts, parts).max(initial=0.0)))
            most, start = max(most, norm / self.arms.get(target, 1.0)), end
        return most

    def place_of_largest(self, gradient: FloatArray) -> str:
        """Target and instance of the largest force, for messages."""
        start, found = 0, (-1.0, "")
        for target in self.targets:
            assert target.owner is not None
            size = target.shape[0] * target.shape[1]
            end = start + target.owner.num_instances * size
            norms = np.linalg.norm(gradient[start:end].reshape(-1, size), axis=1) / self.arms.get(target, 1.0)
            if norms.size:
                found = max(found, (float(norms.max()), f"{target.path}, instance {int(norms.argmax())}"))
            start = end
        return found[1]


def forces_by_term(scene: Scene) -> dict[str, dict[str, FloatArray]]:
    """Path of an energy -> path of a target -> minus the energy's gradient there, [instances, 3] in N for a 3x1 target
    in metres, else [instances, rows, columns]."""
    compiled = scene.compile()
    return {
        path: {
            target.path: -part.reshape(-1, *(target.shape if target.shape[1] > 1 else target.shape[:1]))
            for target, part in zip(compiled.targets, compiled.split(gradient), strict=True)
        }
        for path, gradient in compiled.gradients().items()
    }
