"""Derivatives that are not finite are found wherever they stand, and the instance they belong to is named."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cuda_on_host import HostDevice

from yasps import Attribute, NotFiniteError, Scene
from yasps.backend.cpp.derivative import MOST_PACKS

COUNT = 300
"""More than two batches of packs that are projected together."""


def scene_of(
    rows: int, power: float, *, projection: str = "clamp", device: HostDevice | None = None
) -> tuple[Scene, Attribute]:
    """Powers of each entry of one target on COUNT instances. At 0, x^0.5 has an infinite gradient, x^1.5 a gradient of
    0 and an infinite Hessian."""
    # With one thread a kernel gets all instances at once.
    scene = Scene("steep", device=device) if device is not None else Scene("steep", threads=1)
    points = scene.add_mesh("m").add_primitive("v", COUNT)
    x = points.add_attribute("x", rows, 1, value=np.ones((COUNT, rows)))
    energy = x.dot(x)
    for k in range(rows):
        energy = energy + x[k] ** power
    scene.add_energy(points.add_attribute("steep", computed_attribute=energy), projection=projection)
    scene.add_minimize_target(x)
    return scene, x


def check_names(
    scene: Scene, x: Attribute, entry: int, instances: tuple[int, ...], *, in_gradient: bool = False
) -> None:
    for instance in instances:
        values = np.ones((COUNT, x.shape[0]))
        values[[instance, COUNT - 1], entry] = 0.0
        x.update_value(values)
        with pytest.raises(NotFiniteError, match=re.escape(f"m.v.steep are not finite on instance {instance};")):
            scene.minimize_energy()
        if in_gradient:
            with pytest.raises(NotFiniteError, match=f"on instance {instance};"):
                scene.gradient()  # no Hessian is looked at
    x.update_value(np.ones((COUNT, x.shape[0])))
    scene.minimize_energy()


def test_an_infinite_hessian_names_the_instance_in_every_batch() -> None:
    """The projection finds it and counts from the beginning of its batch."""
    assert COUNT > 2 * 8 * MOST_PACKS
    scene, x = scene_of(3, 1.5)
    for entry in range(3):
        check_names(scene, x, entry, (0, 7, 127, 128, 131, 255, 256, 271, 298))


@pytest.mark.parametrize("rows", [4, 5, 7])
def test_every_entry_of_a_gradient_is_looked_at(rows: int) -> None:
    """Four entries are looked at together, and then what is left."""
    scene, x = scene_of(rows, 0.5)
    for entry in range(rows):
        check_names(scene, x, entry, (3,), in_gradient=True)


def test_every_entry_of_a_hessian_that_is_not_projected_is_looked_at() -> None:
    scene, x = scene_of(3, 1.5, projection="none")
    for entry in range(3):
        check_names(scene, x, entry, (1, 298))


@pytest.mark.parametrize(("power", "projection"), [(0.5, "clamp"), (1.5, "clamp"), (1.5, "none")])
def test_on_a_device(power: float, projection: str) -> None:
    device = HostDevice()
    scene, x = scene_of(3, power, projection=projection, device=device)
    for entry in range(3):
        check_names(scene, x, entry, (0, 131, 298), in_gradient=power < 1)
