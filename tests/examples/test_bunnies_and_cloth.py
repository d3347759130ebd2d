"""The scenes of the paper's sections 9.1 to 9.3: with the kit and by hand they are the same, and their checks fail."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps.examples.bunnies_and_cloth import check_end, lies_above
from yasps.examples.cloths_on_bunny_by_hand import World
from yasps.meshes import box, cloth_grid, write_mesh
from yasps.program import CheckFailedError
from yasps.simulation import Simulation

TIGHT = 1e-7  # m/s

# -- with the kit and by hand ------------------------------------------------------------------------------


def both(name: str, flags: list[str]) -> tuple[Simulation, World]:
    """A scene with the paper's barrier, with the kit and by hand."""
    with_kit, by_hand = (importlib.import_module(f"yasps.examples.{name}{which}") for which in ("", "_by_hand"))
    simulation: Simulation = with_kit.build(with_kit.PROGRAM.options([*flags, "--barrier", "paper"]))
    settings = simulation.stepper.settings
    simulation.stepper.settings = replace(settings, velocity_tolerance=TIGHT, linear_tolerance=1e-14)
    world: World = by_hand.build(by_hand.PROGRAM.options(flags))
    world.tolerance, world.linear_tolerance = TIGHT, 1e-14
    return simulation, world


@pytest.mark.parametrize(
    ("name", "flags"),
    [
        pytest.param("cloths_on_bunny", ["--cloths", "1"], marks=pytest.mark.nightly),
        pytest.param("many_bunnies_on_cloth", ["--bunnies", "2"], marks=pytest.mark.nightly),
        pytest.param("caged_bunny", ["--bunnies", "2", "--element", "tet4"], marks=pytest.mark.nightly),
        pytest.param("caged_bunny", ["--bunnies", "2", "--element", "hex8"], marks=pytest.mark.slow),
    ],
)
def test_with_the_kit_and_by_hand_they_move_alike(name: str, flags: list[str], tmp_path: Path) -> None:
    """They know nothing of each other's energies, contact, parameterisations and Newton's method."""
    write_mesh(tmp_path / "block.vtu", box((0.5, 0.6, 0.4), (2, 2, 2)))
    flags = [*flags, "--size", "6", "--dt", "0.03", "--threads", "1", "--mesh", str(tmp_path / "block.vtu")]
    simulation, world = both(name, flags)
    assert simulation.contact is not None
    touched = 0
    for step in range(1, 25):
        touched += simulation.step().contacts > 0
        world.step()
        for body, other in zip(simulation.bodies, world.bodies, strict=True):
            assert body.name == other.name
            np.testing.assert_allclose(other.positions(), body.positions(), atol=1e-6, err_msg=f"{body.name}, {step}")
    assert touched >= 4
