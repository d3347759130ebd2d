"""The scenes of the paper's sections 9.1 to 9.3: with the kit and by hand they are the same, and their checks fail."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from yasps import SceneError
from yasps.examples import cloths_on_bunny_by_hand as by_hand
from yasps.examples.bunnies_and_cloth import bunny_shape, check_end, cloth_corners, lies_above
from yasps.examples.cloths_on_bunny import PROGRAM
from yasps.meshes import TriangleMesh, box, cloth_grid, rabbit, write_mesh
from yasps.program import CheckFailedError
from yasps.simulation import Simulation

TIGHT = 1e-7  # m/s

# -- with the kit and by hand ------------------------------------------------------------------------------


def both(name: str, flags: list[str]) -> tuple[Simulation, by_hand.World]:
    """A scene with the paper's barrier, with the kit and by hand."""
    with_kit, without = (importlib.import_module(f"yasps.examples.{name}{which}") for which in ("", "_by_hand"))
    simulation: Simulation = with_kit.build(with_kit.PROGRAM.options([*flags, "--barrier", "paper"]))
    settings = simulation.stepper.settings
    simulation.stepper.settings = replace(settings, velocity_tolerance=TIGHT, linear_tolerance=1e-14)
    world: by_hand.World = without.build(without.PROGRAM.options(flags))
    world.tolerance, world.linear_tolerance = TIGHT, 1e-14
    return simulation, world


@pytest.mark.parametrize(
    ("name", "flags"),
    [
        pytest.param("cloths_on_bunny", ["--cloths", "1"], marks=pytest.mark.nightly),
        pytest.param("many_bunnies_on_cloth", ["--bunnies", "2"], marks=pytest.mark.slow),
        pytest.param("caged_bunny", ["--bunnies", "2", "--element", "tet4"], marks=pytest.mark.nightly),
        pytest.param("caged_bunny", ["--bunnies", "2", "--element", "hex8"], marks=pytest.mark.nightly),
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


# -- what must hold at the end -----------------------------------------------------------------------------


@dataclass
class Thing:
    """A body with numbers alone."""

    name: str
    rest: NDArray[np.float64]
    cells: dict[str, NDArray[np.int32]]
    now: NDArray[np.float64]

    def positions(self) -> NDArray[np.float64]:
        return self.now


CLOTH = cloth_grid((1.0, 1.0), (6, 6))
BLOCK = box((0.2, 0.2, 0.2), (1, 1, 1)).translated((0.05, 0.02, 0.5))


def two_things() -> tuple[Thing, Thing]:
    """A block that has fallen by 0.2 m to a cloth that sags by 0.1 m, but at its corners."""
    cloth = Thing("cloth_0", CLOTH.vertices, {"triangle": CLOTH.triangles}, CLOTH.vertices.copy())
    block = Thing("block", BLOCK.vertices, {"tetra": BLOCK.tets}, BLOCK.vertices.copy())
    sagging = np.ones(len(CLOTH.vertices), bool)
    sagging[cloth_corners(6)] = False
    cloth.now[sagging, 2] -= 0.1
    block.now[:, 2] -= 0.2
    return block, cloth


def checked(block: Thing, cloth: Thing, motion: float = 0.0) -> str:
    return check_end([block, cloth], {"block": np.full(8, 0.125), "cloth_0": np.zeros(49)}, motion)


def test_the_check_says_how_far_things_are() -> None:
    said = checked(*two_things(), motion=1.9)
    assert said.startswith("bodies above the cloth: 1; it hangs 0.10 m deep from its corners; 1.9 J of 1.96 J")
    assert said.endswith("the flattest tetrahedron has 1.00 of its volume")


def test_what_must_not_be_fails_the_check() -> None:
    with pytest.raises(CheckFailedError, match=r"the motion has 1\.97 J, but only 1\.96 J came from falling"):
        checked(*two_things(), motion=1.97)
    block, cloth = two_things()
    cloth.now[cloth_corners(6)[1], 0] += 1e-15
    with pytest.raises(CheckFailedError, match="the corners of cloth_0 have moved"):
        checked(block, cloth)
    block, cloth = two_things()
    block.now[:, 0] *= -1
    with pytest.raises(CheckFailedError, match="tetrahedron 0 of block is inside out"):
        checked(block, cloth)
    block, cloth = two_things()
    block.now[:, 2] -= 0.7
    with pytest.raises(CheckFailedError, match="block is no longer above cloth_0"):
        checked(block, cloth)


def test_above_a_folded_sheet() -> None:
    """One that goes 1 m along x, back over itself, and on: three layers over each other in the middle."""
    x, z = np.array([0.0, 2.0, 1.0, 3.0]), np.array([0.0, 0.0, 1.0, 1.0])
    vertices = np.stack([np.repeat(x, 2), np.tile([0.0, 1.0], 4), np.repeat(z, 2)], axis=1)
    cells = np.array(
        [[2 * k, 2 * k + 2, 2 * k + 1] for k in range(3)] + [[2 * k + 1, 2 * k + 2, 2 * k + 3] for k in range(3)]
    )
    sheet = TriangleMesh(vertices, cells.astype(np.int32))
    for place, expected in (
        ((0.5, 0.3, 0.1), True),
        ((0.5, 0.3, -0.1), False),
        ((1.5, 0.3, 1.1), True),
        ((1.4, 0.3, 0.8), False),  # between the second layer and the third: on the sheet's lower side
        ((1.4, 0.3, 0.2), True),  # between the first layer and the second: on its upper side
        ((1.5, 0.3, -0.1), False),
        ((3.5, 0.3, 2.0), False),  # beside it
    ):
        assert lies_above(np.array(place), *sheet) is expected, place


def test_bunnies_are_a_metre_across_and_stand_on_their_feet(tmp_path: Path) -> None:
    own = bunny_shape(8, None)
    assert len(own.vertices) == pytest.approx(1500, rel=0.05)
    assert np.linalg.norm(np.ptp(own.vertices, axis=0)) == pytest.approx(1.0, rel=1e-12)
    y_up = rabbit(1500).rotated((1.0, 0.0, 0.0), -0.5 * np.pi)
    write_mesh(tmp_path / "rabbit.vtu", y_up)
    read = bunny_shape(8, tmp_path / "rabbit.vtu")
    np.testing.assert_allclose(np.ptp(read.vertices, axis=0), np.ptp(own.vertices, axis=0), rtol=1e-12)
    assert own.vertices[:, 2].argmax() == read.vertices[:, 2].argmax()


def test_a_number_of_bodies_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        PROGRAM.options(["--cloths", "-1"])
    assert "--cloths: it is a number of bodies, 0 or more, got '-1'" in capsys.readouterr().err


def test_programs_by_hand_have_no_checkpoints_to_go_on_from(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="cloths_on_bunny_by_hand is made by hand and writes no checkpoints"):
        by_hand.main(["--resume", "--output", str(tmp_path / "nothing")])
    assert not (tmp_path / "nothing").exists()
