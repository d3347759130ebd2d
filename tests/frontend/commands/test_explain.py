"""`yasps explain`: what it says of each energy, when it stops, and what it does not find."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from yasps.frontend.commands.command_line import main

SCRIPT = """
import sys
import numpy as np
from yasps import Scene

scene = Scene("probe")
points = scene.add_mesh("m").add_primitive("v", 2)
F = points.add_attribute("F", 3, 3, value=np.tile(np.eye(3), (2, 1, 1)))
{energy}
scene.add_minimize_target(F)
{after}
"""


def explained(folder: Path, energy: str, capsys: pytest.CaptureFixture[str], after: str = "scene.gradient()") -> str:
    """What the command prints about a scene with this energy of a 3x3 attribute F."""
    path = folder / "probe.py"
    path.write_text(SCRIPT.format(energy=energy, after=after), encoding="utf-8")
    assert main(["explain", str(path)]) == 0
    return capsys.readouterr().out


def term(formula: str) -> str:
    return f'scene.add_energy(points.add_attribute("e", computed_attribute={formula}))'


def test_an_isotropic_energy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = explained(tmp_path, term("F.norm() * F.det()"), capsys)
    assert out.startswith("scene probe, 1 energies\n\nenergy m.v.e, made at ")
    assert f"{tmp_path / 'probe.py'}:9\n" in out
    facts = dict(re.findall(r"^  (\w+) +(.*)$", out, re.MULTILINE))
    assert list(facts) == ["inputs", "cut", "projection", "isotropy", "blocks", "operations", "local"]
    assert facts["inputs"] == facts["cut"] == "F 3x3"
    assert facts["projection"].startswith("clamp: 9x9 of 9x9: no narrower linear cut")
    assert facts["isotropy"] == "proven in a 3x3 matrix"
    assert facts["blocks"] == "at most 1, between 1 places of unknowns, for an instance"
    assert re.fullmatch(r"derive \d+, on numbers", facts["operations"])
    # F, the energy, its gradient, the packed Hessian and F once more for the projection, and the projected Hessian
    assert facts["local"] == f"{8 * (9 + 1 + 9 + 45 + 9 + 45)} bytes for an instance"


def test_the_operation_that_stops_a_proof(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = explained(tmp_path, term("F.det() * F[0, 1]"), capsys)
    assert "  isotropy    not proven: stopped by %F_r0c1 = mat.block %F[0, 1] : 1x1\n" in out


def test_other_energies(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "nowhere: the energy is affine" in explained(tmp_path, term("F[0, 0]"), capsys)
    narrow = explained(tmp_path, term("F[0, 0] * F[0, 0]"), capsys)
    assert "isotropy    not looked for: the cut is no matrix of 3x3 or 3x2" in narrow
    constant = (
        'k = points.add_constant("k", 1, 1, value=np.ones((2, 1)))\n'
        + term("k * k")
        + "\n"
        + term("F.det()").replace('"e"', '"g"')
    )
    assert "none that lead to a target: it has no derivatives" in explained(tmp_path, constant, capsys)


def test_the_script_ends_where_its_scene_is_compiled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    after = 'print("before")\nscene.gradient()\nprint("after")'
    out = explained(tmp_path, term("F.det()"), capsys, after)
    assert "before" in out
    assert "after" not in out


def test_a_script_without_energies_is_said_to_have_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "empty.py"
    path.write_text("print('done')", encoding="utf-8")
    assert main(["explain", str(path)]) == 1
    captured = capsys.readouterr()
    assert captured.out == "done\n"
    assert captured.err.startswith(f"yasps: error: '{path}' ended without a scene with an energy to explain: ")
    assert main(["explain", "no_such_example"]) == 1
    assert "There is no example 'no_such_example'" in capsys.readouterr().err


def test_a_scene_that_cannot_be_compiled_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "probe.py"
    formula = term("combine(ProjectPsdOp, [F], {'mode': StringAttr('clamp')}).det()")
    imports = (
        "from xdsl.dialects.builtin import StringAttr\nfrom yasps.dialects.mat.calculus import ProjectPsdOp\n"
        "from yasps.frontend.language.attribute import combine\n"
    )
    path.write_text(imports + SCRIPT.format(energy=formula, after="scene.gradient()"), encoding="utf-8")
    assert main(["explain", str(path)]) == 1
    assert "pass differentiate: @m.v.e (made at " in capsys.readouterr().err
