"""Every example at a small size: it runs without an intersection and passes its check; also from jittered starts."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from yasps.frontend.commands.command_line import find_examples
from yasps.output import read_series

SCENES: dict[str, list[str]] = {
    "bunnies_in_container": ["--size", "2", "--affine", "1", "--frames", "8"],
    "caged_bunny": ["--size", "8", "--frames", "13", "--dt", "0.04"],
    "card_house": ["--size", "1", "--frames", "3"],
    "chain": ["--size", "5", "--frames", "45"],
    "cloth_on_sphere": ["--size", "10", "--frames", "100"],
    "cloths_on_bunny": ["--size", "8", "--frames", "14", "--dt", "0.04"],
    "dominoes": ["--size", "3", "--frames", "90"],
    "erleben": ["--frames", "10"],
    "fit_material": ["--size", "4", "--frames", "10"],
    "gripper": ["--size", "100", "--frames", "100"],
    "lever": ["--size", "4", "--frames", "20"],
    "many_bunnies_on_cloth": ["--size", "8", "--frames", "13", "--dt", "0.04", "--bunnies", "2"],
    "masonry_arch": ["--size", "3", "--frames", "12", "--friction", "0"],
    "mat_twist": ["--size", "400", "--frames", "45", "--speed", "50"],
    "mixed_material_bunny": ["--size", "1500", "--frames", "12"],
    "noodles": ["--size", "1", "--frames", "90"],
    "refined_cloth": ["--size", "5", "--frames", "20", "--finest", "0.03"],
    "repulsive_curve": ["--size", "100", "--frames", "5"],
    "rods_twist": ["--size", "1", "--frames", "70"],
    "shape_of_rest": ["--size", "3", "--frames", "30"],
    "slide_to_stop": ["--frames", "20", "--dt", "0.02"],
    "throw": ["--size", "15", "--frames", "15", "--dt", "0.04"],
    "turntable": ["--size", "2", "--frames", "25"],
    "two_bunnies": ["--size", "1500", "--frames", "2", "--friction", "0"],
}
"""Name -> flags of a run of a few seconds that passes its check."""

SLOW: dict[str, list[str]] = {"gripper_control": []}
"""The same of runs that take longer."""

BY_HAND: dict[str, list[str]] = {
    "caged_bunny_by_hand": [*SCENES["caged_bunny"], "--element", "hex8"],
    "cloths_on_bunny_by_hand": [*SCENES["cloths_on_bunny"]],
    "many_bunnies_on_cloth_by_hand": [*SCENES["many_bunnies_on_cloth"]],
}
"""The same of examples that step without a `Simulation`."""

WITHOUT_STEPS: dict[str, list[str]] = {"hanging_chain": [], "laplacian_smoothing": ["--size", "1500"]}
"""The same of examples without a simulation."""


def run(name: str, flags: list[str]) -> int:
    """Its exit code."""
    code: int = importlib.import_module(f"yasps.examples.{name}").main(flags)
    return code


def test_every_example_is_here() -> None:
    assert {*SCENES, *SLOW, *BY_HAND, *WITHOUT_STEPS} == set(find_examples())


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_runs_and_passes_its_check(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(name, [*SCENES[name], "--headless", "--output", str(tmp_path)]) == 0
    numbers = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    assert numbers["passed"]
    assert numbers["frames"] == int(SCENES[name][SCENES[name].index("--frames") + 1])
    assert numbers["newton_iterations"] >= 1
    assert numbers["end"] in capsys.readouterr().out
    assert (tmp_path / f"{name}.vtkhdf").is_file()


@pytest.mark.nightly
@pytest.mark.parametrize("name", SLOW)
def test_a_slow_scene_passes_its_check(name: str, tmp_path: Path) -> None:
    assert run(name, [*SLOW[name], "--headless", "--output", str(tmp_path)]) == 0


@pytest.mark.parametrize("name", BY_HAND)
def test_an_example_by_hand_passes_its_check(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(name, [*BY_HAND[name], "--headless", "--seed", "1", "--output", str(tmp_path)]) == 0
    assert "bodies above the cloth: " in capsys.readouterr().out
    assert (tmp_path / f"{name}.vtkhdf").is_file()


@pytest.mark.parametrize("name", WITHOUT_STEPS)
def test_an_example_without_steps_passes_its_check(name: str) -> None:
    assert run(name, WITHOUT_STEPS[name]) == 0
    assert run(name, [*WITHOUT_STEPS[name], "--seed", "1"]) == 0


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(1, 11))
@pytest.mark.parametrize("name", SCENES)
def test_jittered_scenes_pass_it_too(name: str, seed: int, tmp_path: Path) -> None:
    """`Simulation.run` looks for intersections after every frame."""
    assert run(name, [*SCENES[name], "--headless", "--seed", str(seed), "--output", str(tmp_path)]) == 0


# What slide_to_stop fits follows from all its frames: with half of them it is another simulation.
@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name in SCENES if name != "slide_to_stop"])
def test_a_scene_goes_on_from_its_checkpoint_to_the_last_bit(name: str, tmp_path: Path) -> None:
    """With another number of threads, and its check passes."""
    frames = int(SCENES[name][SCENES[name].index("--frames") + 1])
    cut, whole = ([*SCENES[name], "--headless", "--output", str(tmp_path / folder)] for folder in ("cut", "whole"))
    run(name, [*cut, "--frames", str(frames // 2), "--threads", "1"])
    assert run(name, [*cut, "--resume", "--threads", "2"]) == 0
    assert run(name, [*whole, "--threads", "2"]) == 0
    with (
        np.load(tmp_path / "cut" / f"{name}.checkpoint.npz") as one,
        np.load(tmp_path / "whole" / f"{name}.checkpoint.npz") as other,
    ):
        assert one.files == other.files
        for array in one.files:
            np.testing.assert_array_equal(one[array], other[array], err_msg=array)
    files = sorted(file.name for file in (tmp_path / "whole").glob("*.vtkhdf"))  # one for each mesh
    shown = 0
    for file in files:
        one_series, other_series = (read_series(tmp_path / folder / file) for folder in ("cut", "whole"))
        np.testing.assert_array_equal(one_series.times, other_series.times)
        for frame in range(len(other_series)):
            np.testing.assert_array_equal(one_series.positions(frame), other_series.positions(frame))
        shown += len(other_series)
    assert shown == frames + 1
