"""`yasps-opt --interpret` and `--random`: what a dump amounts to in numbers."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_scenes import mixed_union, shared_targets, soft_tets

from yasps import Scene
from yasps.frontend.commands.yasps_opt import main

NUMBER = r"[-+.\de]+|nan|inf"
LINE = re.compile(rf"(?P<name>.*?): value (?P<v>{NUMBER})(?:, gradient (?P<g>{NUMBER}), Hessian (?P<h>{NUMBER}))?$")
Numbers = dict[str, dict[str, float]]


def said(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> Numbers:
    """Numbers by energy and kind."""
    assert main(arguments) == 0
    found = {}
    for line in capsys.readouterr().out.splitlines():
        match = LINE.match(line)
        assert match is not None, line
        found[match["name"]] = {kind: float(match[kind]) for kind in "vgh" if match[kind] is not None}
    return found


def close(a: dict[str, float], b: dict[str, float]) -> bool:
    return a.keys() == b.keys() and all(np.isclose(a[k], b[k], rtol=1e-10, atol=1e-12) for k in a)


@pytest.fixture(scope="module")
def dumps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Dumps of three scenes, the last unprojected."""
    folder = tmp_path_factory.mktemp("dumps")
    mixed_union().dump_ir(folder / "mixed")
    shared_targets("none").dump_ir(folder / "shared")
    return folder


@pytest.mark.parametrize("name", ["mixed", "shared"])
def test_every_pass_keeps_the_numbers(name: str, dumps: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = str(dumps / name / "data.npz")
    stages = sorted((dumps / name).glob("*.mlir"))
    assert len(stages) == 12
    told: dict[str, Numbers] = {}  # by the text: a pass that changed nothing has left the numbers too
    for path in stages:
        text = path.read_text(encoding="utf-8")
        if text not in told:
            told[text] = said([str(path), "--interpret", data], capsys)
    numbers = {path.stem[3:]: told[path.read_text(encoding="utf-8")] for path in stages}
    first, derived, projected = numbers["frontend"], numbers["differentiate"], numbers["project-psd"]
    assert len(first) > 2
    is_derived = is_projected = False
    for stage, found in numbers.items():
        is_derived |= stage == "differentiate"
        is_projected |= stage == "project-psd"
        assert found.keys() == first.keys(), stage
        for energy, values in found.items():
            assert np.isclose(values["v"], first[energy]["v"], rtol=1e-10), (stage, energy)
            if not is_derived:
                assert values.keys() == {"v"}, (stage, energy)
                continue
            wanted = dict(derived[energy])
            if name == "mixed" and is_projected:
                wanted["h"] = projected[energy]["h"]
            assert close(values, wanted), (stage, energy)


def test_passes_run_before_the_interpreter(dumps: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = ["--interpret", str(dumps / "shared" / "data.npz")]
    before = said([str(dumps / "shared" / "03-cse.mlir"), "-p", "differentiate", *data], capsys)
    after = said([str(dumps / "shared" / "11-outline-modules.mlir"), *data], capsys)
    assert before.keys() == after.keys()
    assert all(close(before[energy], after[energy]) for energy in before)


def test_the_numbers_are_the_compiled_scenes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Machine code and the command agree, on numbers as they are when the dump is made."""
    scene = soft_tets()
    x = scene.m.v["x"]
    x.update_value(1.1 * x.value)
    scene.dump_ir(tmp_path)
    arguments = [str(tmp_path / "11-outline-modules.mlir"), "--interpret", str(tmp_path / "data.npz")]
    (numbers,) = said(arguments, capsys).values()
    compiled = scene.compile()
    gradient = compiled.assemble()
    hessian = (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()
    wanted = {"v": scene.total_energy(), "g": np.linalg.norm(gradient), "h": np.linalg.norm(hessian)}
    assert close(numbers, {kind: float(value) for kind, value in wanted.items()})


def test_random_numbers_compare_dumps_without_data(dumps: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def numbers(stage: str, *options: str) -> Numbers:
        return said([str(dumps / "shared" / stage), *options], capsys)

    a, b = numbers("06-differentiate.mlir", "--random", "4"), numbers("11-outline-modules.mlir", "--random", "4")
    assert all(close(a[energy], b[energy]) for energy in a)
    other = numbers("11-outline-modules.mlir", "--random", "4", "--seed", "1")
    assert not any(close(other[energy], b[energy]) for energy in b)


def test_a_wrong_rewriting_is_seen(dumps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Otherwise comparing would be worth nothing."""
    path = dumps / "shared" / "11-outline-modules.mlir"
    broken = tmp_path / "broken.mlir"
    broken.write_text(path.read_text(encoding="utf-8").replace("arith.subf", "arith.addf"), encoding="utf-8")
    right, wrong = (said([str(p), "--random", "3"], capsys) for p in (path, broken))
    assert not np.isclose(right["energy @m.s.stretch"]["v"], wrong["energy @m.s.stretch"]["v"])
    assert right["energy @m.anchor"]["v"] == wrong["energy @m.anchor"]["v"]


def test_outputs_are_told_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("YASPS_DUMP_IR", str(tmp_path))
    scene = Scene("s")
    x = scene.add_mesh("m").add_primitive("v", 2).add_attribute("x", 1, 1, value=[3.0, 4.0])
    (2.0 * x).compute()
    (stage,) = tmp_path.glob("s/*/*-lower-to-scalar.mlir")
    assert main([str(stage), "--random", "2"]) == 0
    assert re.fullmatch(r"output @m\.v\.unnamed\.1: norm \d+\.\d+\n", capsys.readouterr().out)


def test_nothing_to_compute_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "empty.mlir"
    path.write_text("rel.scene @s { rel.mesh @m in @s }", encoding="utf-8")
    assert main([str(path), "--random", "2"]) == 0
    assert capsys.readouterr().out == "nothing to compute: no energy, no output\n"


def test_without_the_options_it_prints_the_module(dumps: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = dumps / "shared" / "03-cse.mlir"
    assert main([str(path)]) == 0
    assert capsys.readouterr().out.rstrip() == path.read_text(encoding="utf-8").rstrip()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{shared}/03-cse.mlir", "--interpret", "{mixed}/data.npz"], "the numbers have no size @m.s"),
        (["{shared}/03-cse.mlir", "--interpret", "{shared}/none.npz"], "No such file"),
        (["{shared}/none.mlir"], "No such file"),
        (["{shared}/03-cse.mlir", "-p", "no-such-pass"], "Unrecognized passes: ['no-such-pass']"),
        (["{shared}/data.json"], "Unrecognized file extension 'json'"),
    ],
)
def test_errors_are_short_and_the_status_says_so(
    arguments: list[str], message: str, dumps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (dumps / "shared" / "data.json").write_text("{}", encoding="utf-8")
    filled = [word.format(shared=dumps / "shared", mixed=dumps / "mixed") for word in arguments]
    assert main(filled) == 1
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("yasps-opt: ")
    assert message in output.err
    assert output.err.count("\n") == 1


@pytest.mark.parametrize("count", ["0", "-1", "many"])
def test_a_number_of_instances_is_a_number(count: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([f"--random={count}"])
    assert f"{count!r} is not a number of instances" in capsys.readouterr().err


def test_the_installed_command(dumps: Path) -> None:
    program = shutil.which("yasps-opt", path=str(Path(sys.executable).parent)) or shutil.which("yasps-opt")
    assert program is not None
    stage, data = dumps / "shared" / "03-cse.mlir", dumps / "shared" / "data.npz"
    command = [program, str(stage), "--interpret", str(data)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout.startswith("energy @m.s.stretch: value ")
    failed = subprocess.run([program, str(data)], capture_output=True, text=True, check=False)
    assert failed.returncode == 1
    assert "Traceback" not in failed.stderr
