"""tools/gpu_check: what it shows of parts that pass, fail, hang or are missing, and that it never passes by silence."""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
import time
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from cuda_on_host import HostDevice

from benchmarks.__main__ import _parser
from yasps import NoDeviceError
from yasps.runtime.build.cuda.nvcc import CudaNotFoundError
from yasps.runtime.device.driver import find_device

BENCHMARK_OPTIONS = _parser()
SCRIPT = Path(__file__).parents[2] / "tools" / "gpu_check"


@pytest.fixture(scope="module")
def tool() -> Iterator[ModuleType]:
    """The script as a module."""
    spec = importlib.util.spec_from_loader("gpu_check", SourceFileLoader("gpu_check", str(SCRIPT)))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["gpu_check"] = module  # where dataclasses look for their types
    spec.loader.exec_module(module)
    yield module
    del sys.modules["gpu_check"]


def python(text: str) -> list[str]:
    """A command."""
    return [sys.executable, "-c", text]


def simple(tool: ModuleType) -> Any:
    """Reads a status alone."""

    def read(status: int | None, said: str) -> list[Any]:
        result = tool.OUT_OF_TIME if status is None else tool.PASSED if status == 0 else tool.FAILED
        return [tool.Line("it", result, said.strip())]

    return read


def run(tool: ModuleType, parts: list[Any], tmp_path: Path, seconds: float = 60.0) -> tuple[int, dict[str, Any]]:
    """Exit status and JSON."""
    minutes = (seconds + tool.SECONDS_TO_END) / 60.0
    options = argparse.Namespace(json=tmp_path / "found.json", log=tmp_path / "all.log", minutes=minutes)
    status = tool.check(parts, options, {}, time.monotonic())
    return status, json.loads(options.json.read_text())


HANGS = "import time; print('so far', flush=True); time.sleep(100)"


def test_all_that_ran_is_shown_when_parts_fail_or_hang(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tool, "LEAST_SECONDS", 0.5)
    read = simple(tool)
    parts = [
        tool.Part("first", python("print('fine')"), 30, read, lambda: [{"value": 1}]),
        tool.Part("hangs", python(HANGS), 1, read),
        tool.Part("fails", python("raise SystemExit('broken')"), 30, read),
        tool.Part("last", python("print('still fine')"), 30, read),
    ]
    status, found = run(tool, parts, tmp_path)
    assert status == 1
    assert not found["passed"]
    results = [part["lines"][0] for part in found["parts"]]
    assert [line["result"] for line in results] == ["passed", "OUT OF TIME", "FAILED", "passed"]
    assert [line["detail"] for line in results] == ["fine", "so far", "broken", "still fine"]
    assert found["parts"][0]["rows"] == [{"value": 1}]
    shown = capsys.readouterr().out
    assert shown.count("OUT OF TIME") == 1
    assert shown.count("detail") == 1, "it is one table"
    assert "2 of 4 parts passed" in shown
    log = (tmp_path / "all.log").read_text()
    assert log.count("====") == 4


def test_rows_are_there_as_soon_as_a_part_has_ended(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[tuple[str, bool]] = []

    def look(status: int | None, said: str) -> list[Any]:
        found = tmp_path / "found.json"
        seen.append((capsys.readouterr().out, found.is_file() and "row of the first" in found.read_text()))
        return [tool.Line("second", tool.PASSED)]

    parts = [
        tool.Part("one", python("pass"), 1, lambda status, said: [tool.Line("row of the first", tool.PASSED)]),
        tool.Part("two", python("pass"), 1, look),
    ]
    run(tool, parts, tmp_path)
    ((shown, written),) = seen
    assert "row of the first" in shown
    assert written


def test_time_is_never_exceeded_and_shared(tool: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every part hangs, and each gets its share."""
    monkeypatch.setattr(tool, "LEAST_SECONDS", 0.2)

    def stopped(status: int | None, said: str) -> list[Any]:
        return [tool.Line("it", tool.PASSED)]  # or nothing would run after the first

    parts = [tool.Part(name, python(HANGS), share, stopped) for name, share in (("a", 3), ("b", 1), ("c", 2))]
    start = time.monotonic()
    run(tool, parts, tmp_path, seconds=3.0)
    assert 2.9 < time.monotonic() - start < 3.0 + tool.SECONDS_TO_END
    assert [part.seconds for part in parts] == pytest.approx([1.5, 0.5, 1.0], abs=0.3)


def test_what_a_part_leaves_goes_to_the_others(tool: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[float] = []

    def note(part: Any, seconds: float, environment: dict[str, str]) -> str:
        given.append(seconds)
        part.lines = [tool.Line("it", tool.PASSED)]
        return ""

    monkeypatch.setattr(tool, "run_part", note)
    parts = [tool.Part(str(k), ["x"], share, simple(tool)) for k, share in enumerate((1, 1, 2))]
    tool.run_parts(parts, time.monotonic() + 60.0, {}, lambda part, said: None)
    assert given == pytest.approx([15.0, 20.0, 60.0], abs=0.1)


def test_all_passed(tool: ModuleType, tmp_path: Path) -> None:
    parts = [tool.Part(name, python("pass"), 30, simple(tool)) for name in ("one", "two")]
    status, found = run(tool, parts, tmp_path)
    assert (status, found["passed"]) == (0, True)


def test_nothing_runs_after_a_failed_environment(tool: ModuleType, tmp_path: Path) -> None:
    parts = [
        tool.Part("environment", python("print('no GPU'); raise SystemExit(1)"), 30, tool.read_environment),
        tool.Part("tests", python("print('ran')"), 30, simple(tool)),
    ]
    status, found = run(tool, parts, tmp_path)
    assert status == 1
    assert found["parts"][0]["lines"] == [{"check": "GPU and compilers for it", "result": "FAILED", "detail": "no GPU"}]
    assert found["parts"][1]["lines"][0]["result"] == "NOT RUN"


def test_what_there_was_no_time_for(tool: ModuleType, tmp_path: Path) -> None:
    parts = [
        tool.Part("first", python(HANGS), 3, lambda status, said: [tool.Line("", "passed")]),
        tool.Part("second", python("pass"), 1, simple(tool)),
    ]
    status, found = run(tool, parts, tmp_path, seconds=4.0)
    assert status == 1
    (line,) = found["parts"][1]["lines"]
    assert line["result"] == "NOT RUN"
    assert "no time was left" in line["detail"]


def test_minutes_are_positive(tool: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("0", "-1", "nan", "six"):
        with pytest.raises(SystemExit):
            tool.main([f"--minutes={text}"])
        assert "is no positive number of minutes" in capsys.readouterr().err


def test_interrupting_keeps_what_was_found(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(status: int | None, said: str) -> list[Any]:
        raise KeyboardInterrupt

    parts = [
        tool.Part("first", python("print('found')"), 30, simple(tool)),
        tool.Part("second", python("pass"), 30, interrupted),
    ]
    status, found = run(tool, parts, tmp_path)
    assert status == 1
    assert found["parts"][0]["passed"]
    assert "it was interrupted before" in capsys.readouterr().out


def test_a_missing_sanitizer_has_not_passed(tool: ModuleType, tmp_path: Path) -> None:
    parts = [tool.Part("first", python("pass"), 30, simple(tool)), tool.Part("memcheck", [], 30, simple(tool))]
    status, found = run(tool, parts, tmp_path)
    assert status == 1
    (line,) = found["parts"][1]["lines"]
    assert line["result"] == "NOT RUN"
    assert "nvidia-cuda-sanitizer-api" in line["detail"]


TESTS = """\
tests/gpu/test_agreement.py::test_a_scene_agrees[cuda-rings, sum-atomic] PASSED [ 10%]
tests/gpu/test_agreement.py::test_a_scene_agrees[cuda-levers-atomic] FAILED [ 20%]
tests/gpu/test_agreement.py::test_out_of_memory[cuda] PASSED              [ 30%]
tests/gpu/test_agreement.py::test_two_scenes_on_a_device[cuda] SKIPPED (there is no GPU) [ 40%]

=================================== FAILURES ===================================
_________________ test_a_scene_agrees[cuda-levers-atomic] _________________
>       assert difference <= AGREEMENT
E       AssertionError: the gradient differs
"""


def test_tests_are_read_one_by_one(tool: ModuleType) -> None:
    lines = {line.check: (line.result, line.detail) for line in tool.read_tests(1, TESTS)}
    assert lines["test_a_scene_agrees"] == ("FAILED", "1 of 2 cases")
    assert lines["test_out_of_memory"] == ("passed", "1 of 1 cases")
    assert lines["test_a_scene_agrees[cuda-levers-atomic]"] == ("FAILED", "AssertionError: the gradient differs")
    assert lines["test_two_scenes_on_a_device[cuda]"][0] == "NOT RUN"
    assert "there is no GPU" in lines["test_two_scenes_on_a_device[cuda]"][1]


def test_tests_that_were_stopped_or_never_began(tool: ModuleType) -> None:
    begun = TESTS.splitlines()[0] + "\ntests/gpu/test_agreement.py::test_time_steps_agree[cuda] "
    stopped = tool.read_tests(None, begun)
    assert [line.result for line in stopped] == ["passed", "OUT OF TIME"]
    assert "test_time_steps_agree" in stopped[1].detail
    for status in (0, 5):
        assert [line.result for line in tool.read_tests(status, "no tests ran")] == ["FAILED"]
    crashed = tool.read_tests(-11, TESTS.splitlines()[0] + "\nSegmentation fault")
    assert [line.result for line in crashed] == ["passed", "FAILED"]


@pytest.mark.parametrize(
    ("name", "summary"),
    [
        ("memcheck", "ERROR SUMMARY: 0 errors"),
        ("racecheck", "RACECHECK SUMMARY: 0 hazards displayed"),
        ("synccheck", "ERROR SUMMARY: 0 errors"),
    ],
)
def test_the_sanitizer_must_have_counted_and_the_scene_run(tool: ModuleType, name: str, summary: str) -> None:
    read = tool.reader_of(name)
    clean = f"========= COMPUTE-SANITIZER\nsmall scene: done\n========= {summary} (0 errors, 0 warnings)\n"
    assert read(0, clean)[0].result == "passed"
    for status, said in (
        (0, clean.replace("small scene: done", "")),
        (0, clean.replace(" 0 ", " 3 ")),
        (0, "small scene: done\n"),
        (tool.SANITIZER_EXIT, clean),
    ):
        assert read(status, said)[0].result == "FAILED"
    assert read(None, clean)[0].result == "OUT OF TIME"


def test_figures_of_a_benchmark_stand_side_by_side(tool: ModuleType, tmp_path: Path) -> None:
    rows = [
        {"case": "derived", "implementation": "yasps", "threads": 16, "value": 12.5, "unit": "ns/element"},
        {"case": "derived", "implementation": "yasps", "threads": 0, "value": 0.75, "unit": "ns/element"},
        {"case": "stage: energy", "implementation": "yasps", "threads": 0, "value": 1.0, "unit": "ms/frame"},
    ]
    path = tmp_path / "rows.json"
    assert tool.reader_of_rows(path)(0, "no figures")[0].result == "FAILED"
    path.write_text(json.dumps(rows))
    (line,) = tool.reader_of_rows(path)(0, "")
    assert (line.check, line.detail) == ("derived [ns/element]", "yasps (CPU x 16) 12.5; yasps (GPU) 0.75")
    assert tool.reader_of_rows(path)(1, "a reason\n")[0].detail == "a reason"


def test_the_small_scene_runs(tool: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    device = HostDevice()
    tool.run_small_scene(device)
    assert capsys.readouterr().out == "small scene: done\n"
    assert any("derive" in name for name in device.launches)
    assert "yasps_pcg_step" in device.launches


def test_parts_are_commands_that_exist(tool: ModuleType, tmp_path: Path) -> None:
    parts = tool.parts_in(tmp_path)
    assert [part.name for part in parts] == [
        "environment",
        "GPU tests",
        *(f"benchmark {name}" for name in ("elements", "contacts", "spmv", "solver", "assembly", "scene")),
        "sanitizer memcheck",
        "sanitizer racecheck",
        "sanitizer synccheck",
    ]
    for part in parts:
        if part.name.startswith("benchmark"):
            options = BENCHMARK_OPTIONS.parse_args(part.command[3:])
            assert (options.name, options.device) == (part.name.split()[1], "cuda")


def test_only_what_kernels_do_wrong_counts_for_memcheck(tool: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tool, "find_sanitizer", lambda: "/opt/compute-sanitizer")
    commands = {name: tool.sanitizer_command(name, ["python", "gpu_check", "--child"]) for name in tool.SANITIZERS}
    assert commands["memcheck"][:5] == ["/opt/compute-sanitizer", "--tool", "memcheck", "--report-api-errors", "no"]
    for name, command in commands.items():
        assert command[1:3] == ["--tool", name]
        assert command[-4:] == ["python", "gpu_check", "--child", "small-scene"]
        assert ("--report-api-errors" in command) == (name == "memcheck"), "the others do not know it"


def test_without_a_gpu_the_command_says_so_and_fails(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        find_device()
    except (NoDeviceError, CudaNotFoundError) as error:
        sentence = " ".join(str(error).split())
    else:
        pytest.skip("there is a GPU")
    path = tmp_path / "found.json"
    assert tool.main(["--json", str(path)]) == 1
    found = json.loads(path.read_text())
    assert found["parts"][0]["lines"][-1]["detail"] == sentence
    assert {part["passed"] for part in found["parts"]} == {False}
    assert "0 of 11 parts passed" in capsys.readouterr().out
