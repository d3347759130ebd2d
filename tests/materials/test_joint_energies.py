"""Energies of joints of two frames by hand, also where nothing pulls and after whole turns.

Their derivatives are those of rows of `parts.py`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from yasps import Attribute, Primitive, Scene, concat_rows, materials

Frame = NDArray[np.float64]
FIRST = np.vstack([[0.1, 0.2, 0.3], Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()])
TURN = 2.2  # rad about the axis
STIFFNESS = np.array([2.0, 0.0, 3.0])


def turned(angle: float) -> Frame:
    """A frame that is turned against the first about its axis, and moved."""
    axis, e2, e3 = FIRST[1:]
    c, s = np.cos(angle), np.sin(angle)
    frame = np.stack([axis, c * e2 + s * e3, c * e3 - s * e2])
    return np.vstack([FIRST[0] + [0.4, -0.1, 0.2], frame])


def off_axis() -> float:
    way = turned(TURN)[0] - FIRST[0]
    return float((way @ FIRST[2]) ** 2 + (way @ FIRST[3]) ** 2)


WAY = float(np.linalg.norm([0.4, -0.1, 0.2]))
ENERGIES: dict[str, tuple[Callable[[Attribute, Attribute], Attribute], float]] = {
    "held together": (lambda e, f: materials.held_together(e, f, 7.0), 3.5 * WAY**2),
    "aligned": (
        lambda e, f: materials.aligned(e, f, concat_rows([e[0, 0] * 0 + s for s in STIFFNESS.tolist()])),
        1.5 * float(((turned(TURN) - FIRST)[3] ** 2).sum()),
    ),
    "on the axis": (lambda e, f: materials.on_the_axis(e, f, 5.0), 2.5 * off_axis()),
    "motor": (lambda e, f: materials.motor(materials.joint_angle(e, f, 0.0), 2.0, 3.0, 1.0), 1.5 * (TURN - 2.0) ** 2),
    "motor at its limit": (
        lambda e, f: materials.motor(materials.joint_angle(e, f, 0.0), 1.0, 3.0, 1.0),
        (TURN - 1.0) - 1.0 / 6.0,
    ),
    "motor after a whole turn": (
        lambda e, f: materials.motor(materials.joint_angle(e, f, 7.0), 8.0, 3.0, 9.0),
        1.5 * (TURN + 2 * np.pi - 8.0) ** 2,
    ),
    "no motor": (lambda e, f: materials.motor(materials.joint_angle(e, f, 0.0), 1.0, 0.0, 1.0), 0.0),
    "above its limits": (
        lambda e, f: materials.angle_limits(materials.joint_angle(e, f, 0.0), -1.0, 2.0, 4.0),
        4 / 3 * (TURN - 2.0) ** 3,
    ),
    "below its limits": (
        lambda e, f: materials.angle_limits(materials.joint_angle(e, f, 0.0), 2.5, 3.0, 4.0),
        4 / 3 * (2.5 - TURN) ** 3,
    ),
    "within its limits": (lambda e, f: materials.angle_limits(materials.joint_angle(e, f, 0.0), 0.0, 3.0, 4.0), 0.0),
}


def frames(second: Frame) -> tuple[Scene, Primitive, list[Attribute]]:
    """Two frames, and all energies of them."""
    scene = Scene("frames", threads=1)
    pairs = scene.add_mesh("m").add_primitive("pairs", 1)
    e = pairs.add_attribute("e", 4, 3, value=FIRST)
    f = pairs.add_attribute("f", 4, 3, value=second)
    return scene, pairs, [energy(e, f) for energy, _ in ENERGIES.values()]


def test_values() -> None:
    _, pairs, energies = frames(turned(TURN))
    found = pairs.add_attribute("all", computed_attribute=concat_rows(energies)).compute().value
    for (name, (_, expected)), value in zip(ENERGIES.items(), found.tolist(), strict=True):
        assert value == pytest.approx(expected, rel=1e-12, abs=1e-12), name
