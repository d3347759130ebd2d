"""Scene programs: flags, what is refused, the check at the end, the numbers of a run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from yasps import SceneError
from yasps.bodies import AffineBody
from yasps.meshes import box
from yasps.output import read_series
from yasps.program import CheckFailedError, Options, SceneProgram
from yasps.simulation import Simulation

PROGRAM = SceneProgram("falling", "A box falls.", frames=3, time_step=0.02, size=2, size_means="boxes")
STATIC = SceneProgram("rest", "Something at rest.", frames=None)
GRAVITY = 9.8  # m/s^2


def build(options: Options) -> Simulation:
    """Boxes that fall, far from each other."""
    scene = PROGRAM.scene(options)
    shape = box((1.0, 1.0, 1.0), (1, 1, 1))
    bodies = [AffineBody(scene, f"box_{k}", shape.translated((3.0 * k, 0.0, 0.0))) for k in range(options.size)]
    return Simulation(scene, bodies, time_step=options.dt, contact=False, activation_distance=0.1)


def check(simulation: Simulation, options: Options) -> str:
    """All have fallen as backward Euler does."""
    fall = GRAVITY * options.dt**2 * options.frames * (options.frames + 1) / 2
    for body in simulation.moving:
        lower = float((body.rest - body.positions())[:, 2].mean())
        if abs(lower - fall) > 1e-9:
            raise CheckFailedError(f"{body.name} is {lower} m lower, not {fall} m")
    return f"all are {fall:.4f} m lower"


def test_the_defaults() -> None:
    options = PROGRAM.options()
    assert (options.frames, options.dt, options.size, options.seed) == (3, 0.02, 2, 0)
    assert (options.device, options.threads, options.mesh, options.headless) == ("cpu", None, None, False)
    assert options.output == Path("output/falling")


def test_a_size_that_is_a_length_is_a_float() -> None:
    assert SceneProgram("a", "", size=0.5, size_means="m").options(["--size", "2"]).size == 2.0
    assert isinstance(PROGRAM.options(["--size", "3"]).size, int)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--frames", "-1"], "--frames is a number of time steps, 0 or more, got -1"),
        (["--frames", "many"], "argument --frames: invalid int value: 'many'"),
        (["--dt", "0"], "--dt is the length of a time step in seconds, more than 0, got 0.0"),
        (["--dt", "nan"], "more than 0, got nan"),
        (["--device", "tpu"], 'device=\'tpu\': it must be "cpu", "cuda", or "cuda:N"'),
        (["--threads", "0"], "threads=0: it must be a positive integer"),
        (["--device", "cuda", "--threads", "2"], "threads=2: a GPU has its own"),
        (["--size", "0"], "--size is more than 0, got 0"),
        (["--size", "2.5"], "argument --size: invalid int value: '2.5'"),
        (["--seed", "-3"], "--seed is 0 or more, got -3"),
        (["--mesh", "bunny.msh"], "--mesh: falling makes its shapes itself and takes none from a file"),
        (["--output", __file__], f"--output is a folder, but {__file__} is a file"),
        (["--output", f"{__file__}/here"], f"--output is a folder, but {__file__} is a file"),
        (["--frame", "3"], "unrecognized arguments: --frame 3"),
    ],
)
def test_what_can_not_be_is_refused(flags: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as error:
        PROGRAM.options(flags)
    assert error.value.code == 2
    said = capsys.readouterr().err
    assert "yasps run falling: error: " in said
    assert message in said


@pytest.mark.parametrize("flags", [["--frames", "3"], ["--dt", "1"], ["--output", "here"], ["--headless"]])
def test_a_program_without_steps_refuses_their_flags(flags: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        STATIC.options(flags)
    assert f"{flags[0]}: rest has no time steps and writes no files" in capsys.readouterr().err


def test_a_mesh_that_is_not_there_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = SceneProgram("meshed", "", mesh_means="instead of the box")
    with pytest.raises(SystemExit):
        program.options(["--mesh", str(tmp_path / "none.msh")])
    assert f"--mesh: there is no file {tmp_path / 'none.msh'}" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        program.options(["--size", "3"])
    assert "--size: meshed has one size" in capsys.readouterr().err
    (tmp_path / "some.msh").touch()
    assert program.options(["--mesh", str(tmp_path / "some.msh")]).mesh == tmp_path / "some.msh"


def test_help_names_only_what_the_program_has(capsys: pytest.CaptureFixture[str]) -> None:
    for program, there, missing in ((PROGRAM, "--frames", "--mesh"), (STATIC, "--device", "--frames")):
        with pytest.raises(SystemExit) as error:
            program.options(["--help"])
        assert error.value.code == 0
        said = capsys.readouterr().out
        assert there in said
        assert missing not in said


def test_a_run_says_what_it_does_and_leaves_its_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert PROGRAM.run(["--headless", "--threads", "1", "--output", str(tmp_path / "new")], build, check) == 0
    said = capsys.readouterr()
    assert said.out.startswith("all are 0.0235 m lower\n3 frames: ")
    assert "falling on cpu, threads: 1; compiled code in " in said.err
    assert "2 bodies that move, 16 vertices, 12 tetra; 24 unknowns" in said.err
    numbers = json.loads((tmp_path / "new" / "falling.json").read_text(encoding="utf-8"))
    expected = {
        "frames": 3,
        "vertices": 16,
        "elements": {"tetra": 12},
        "contacts_most": 0,
        "time_step": 0.02,
        "size": 2,
    }
    assert expected.items() <= numbers.items()
    assert numbers["passed"] is True
    assert numbers["end"] == "all are 0.0235 m lower"
    assert numbers["newton_iterations"] >= 1
    assert numbers["cg_iterations"] >= numbers["newton_iterations"]
    assert numbers["seconds_a_frame"] > 0
    assert 20 < numbers["memory_mb"] < 20_000


def test_a_run_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--headless", "--output", str(tmp_path)]
    with pytest.raises(SceneError, match=r"there is no checkpoint to go on from: .*falling.checkpoint.npz does not"):
        PROGRAM.run([*flags, "--resume"], build, check)
    assert PROGRAM.run([*flags, "--frames", "3"], build, check) == 0
    assert PROGRAM.run([*flags, "--frames", "5", "--resume"], build, check) == 0  # the check knows all five frames
    said = capsys.readouterr()
    assert f"goes on after frame 3, from {tmp_path / 'falling.checkpoint.npz'}" in said.err
    numbers = json.loads((tmp_path / "falling.json").read_text(encoding="utf-8"))
    assert (numbers["first_frame"], numbers["frames"], numbers["command"]) == (3, 2, "yasps run falling --frames 5")
    assert len(read_series(tmp_path / "falling.vtkhdf")) == 6
    with pytest.raises(SceneError, match=r"is of frame 5, but --frames 4 ends before: give more --frames, or leave"):
        PROGRAM.run([*flags, "--frames", "4", "--resume"], build, check)
    (tmp_path / "falling.vtkhdf").unlink()  # it can be lost, and begins again
    assert PROGRAM.run([*flags, "--frames", "6", "--resume"], build, check) == 0
    assert len(read_series(tmp_path / "falling.vtkhdf")) == 2


def test_a_check_that_fails_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def fails(simulation: Simulation, options: Options) -> str:
        raise CheckFailedError("it is 3 m too high")

    assert PROGRAM.run(["--frames", "0", "--headless", "--output", str(tmp_path)], build, fails) == 1
    said = capsys.readouterr()
    assert said.err.endswith("falling: it is 3 m too high\n")
    assert said.out == ""
    numbers = json.loads((tmp_path / "falling.json").read_text(encoding="utf-8"))
    assert (numbers["passed"], numbers["end"], numbers["frames"]) == (False, "it is 3 m too high", 0)


def test_a_seed_jitters_the_start_a_little_and_reproducibly(tmp_path: Path) -> None:
    ends = {}
    for run, seed in enumerate((0, 1, 1, 2)):

        def note(simulation: Simulation, options: Options, run: int = run) -> str:
            ends[run] = np.concatenate([body.positions() for body in simulation.moving])
            return ""

        flags = ["--frames", "1", "--seed", str(seed), "--headless", "--output", str(tmp_path)]
        assert PROGRAM.run(flags, build, note) == 0
    np.testing.assert_array_equal(ends[1], ends[2])
    for one, other in ((0, 1), (0, 3), (1, 3)):
        assert 1e-5 < np.abs(ends[one] - ends[other]).max() < 2 * 0.01 * 0.1
