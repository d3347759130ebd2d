"""`yasps view`, `yasps picture` and `yasps export`: what the commands give on, say and refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from results_files import everything, record

from yasps import output
from yasps.frontend.commands.command_line import main
from yasps.output import View


@pytest.fixture
def file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    found = record(everything(), tmp_path, 5)
    capsys.readouterr()
    return found


def test_view_writes_a_page(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", str(file)]) == 0
    page = file.with_suffix(".html")
    assert capsys.readouterr().err == f"wrote {page}, {page.stat().st_size / 1e6:.1f} MB, for any browser\n"
    assert main(["view", str(file), "--output", str(file.with_name("b.html")), "--every", "2"]) == 0
    assert "it has 3 of 5 frames (see --megabytes and --every)" in capsys.readouterr().err
    assert file.with_name("b.html").is_file()
    assert main(["view", str(file), "--megabytes", "0.1"]) == 1
    assert "more than 0.1" in capsys.readouterr().err


def test_view_opens_a_window(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []
    monkeypatch.setattr(output, "show_window", lambda *given, **options: opened.append((*given, options)))
    assert main(["view", str(file), "--window", "--field", "velocity"]) == 0
    assert opened == [(file, {"field": "velocity"})]
    assert not file.with_suffix(".html").exists()


def test_picture_makes_what_its_ending_says(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: dict[str, Any] = {}

    def make(kind: str) -> Any:
        def write(_: Any, path: Path, **options: Any) -> Path:
            made.update(kind=kind, path=path, **options)
            path.write_bytes(b"x" * 20000)
            return path

        return write

    monkeypatch.setattr(output, "make_picture", make("picture"))
    monkeypatch.setattr(output, "make_animation", make("animation"))
    assert main(["picture", str(file), "--frame", "2", "--field", "velocity", "--no-forces"]) == 0
    png = file.with_suffix(".png")
    assert capsys.readouterr().err == f"wrote {png}, 0.02 MB\n"
    assert made == {
        "kind": "picture",
        "path": png,
        "frame": 2,
        "field": "velocity",
        "forces": False,
        "view": View(),
        "size": (960, 720),
    }
    webp = file.with_name("a.webp")
    more = [
        "--camera",
        "follow",
        "--direction",
        "1",
        "0",
        "0.5",
        "--speed",
        "0.5",
        "--fps",
        "15",
        "--size",
        "640",
        "480",
    ]
    assert main(["picture", str(file), str(webp), *more]) == 0
    assert (made["kind"], made["path"], made["frames_per_second"], made["size"]) == (
        "animation",
        webp,
        15.0,
        (640, 480),
    )
    assert made["view"] == View("follow", (1.0, 0.0, 0.5), None, 0.5)
    assert main(["picture", str(file), "--direction", "0", "0", "1"]) == 1
    assert "neither zero nor vertical" in capsys.readouterr().err


def test_export_says_what_it_wrote(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyvista")
    folder = file.parent
    assert main(["export", str(file), str(folder / "a.obj"), "--every", "4"]) == 0
    assert capsys.readouterr().err == f"wrote {folder / 'a_0000.obj'} to a_0004.obj\n"
    assert main(["export", str(file), str(folder / "a.ply"), "--frame", "1"]) == 0
    assert capsys.readouterr().err == f"wrote {folder / 'a_0001.ply'}\n"
    assert main(["export", str(file), str(folder / "a.doc")]) == 1
    assert capsys.readouterr().err.startswith("yasps: error: 'a.doc' ends in none of .usd")


def test_a_missing_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["view"], ["picture"], ["export", "a.obj"]):
        assert main([command[0], str(tmp_path / "no.vtkhdf"), *command[1:]]) == 1
        assert f"There is no file '{tmp_path / 'no.vtkhdf'}'" in capsys.readouterr().err
