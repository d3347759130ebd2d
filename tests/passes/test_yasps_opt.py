"""`yasps-opt`, and stock `xdsl-opt`, which finds our dialects and passes by their entry point."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from xdsl.universe import Universe

from yasps.passes.pipeline import PIPELINE
from yasps.passes.yasps_opt import UNIVERSE, main

SCENE = Path(__file__).parent / "filecheck" / "differentiate-linear-cut.mlir"


@pytest.mark.slow
@pytest.mark.parametrize("command", ["yasps-opt", "xdsl-opt"])
def test_commands_run_our_passes(command: str) -> None:
    program = shutil.which(command, path=str(Path(sys.executable).parent)) or shutil.which(command)
    assert program is not None, f"{command} is not installed"
    result = subprocess.run(
        [program, "-p", "differentiate,project-psd", str(SCENE)], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert "rel.derivative @m.p.e.derivative" in result.stdout
    assert result.stdout.count("mat.project_psd") == 1


def test_the_universe_holds_our_passes_and_no_other() -> None:
    """Upstream's canonicalize and cse are xDSL's own: to name them again would be an error there."""
    assert set(UNIVERSE.all_passes) == {p.name for p in PIPELINE} - {"canonicalize", "cse"}
    assert set(UNIVERSE.all_dialects) == {"rel", "mat"}
    for name, load in UNIVERSE.all_passes.items():
        assert load().name == name


def test_all_universes_fit_together() -> None:
    """`get_multiverse` raises where two packages define one name."""
    everything = Universe.get_multiverse()
    assert set(UNIVERSE.all_passes) <= set(everything.all_passes)
    assert everything.all_dialects["mat"]().name == "mat"


def test_the_whole_pipeline_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    main(["-p", ",".join(p.name for p in PIPELINE), str(SCENE)])
    assert "rel.object @m.p.e.derivative.object" in capsys.readouterr().out


def test_what_breaks_a_law_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "broken.mlir"
    text = SCENE.read_text(encoding="utf-8").replace("rel.target @m.v.x", "rel.target @m.v.y")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(Exception, match=r"a target names a stored variable as target @m\.v\.y, which does not exist"):
        main(["-p", "differentiate", str(path)])
