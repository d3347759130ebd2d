"""Errors name the attribute and the line of Python that made it; the line survives every pass and every dump."""

from __future__ import annotations

import inspect
import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from small_scenes import SCENES, emit
from xdsl.context import Context
from xdsl.dialects.builtin import FileLineColLoc, ModuleOp, StringAttr
from xdsl.parser import Parser
from xdsl.passes import ModulePass, PassPipeline
from xdsl.utils.exceptions import VerifyException

from yasps import Attribute, NotFiniteError, Scene, UnsupportedSceneError
from yasps.dialects.mat import matrix_type
from yasps.dialects.mat.calculus import ProjectPsdOp
from yasps.dialects.rel import AttributeOp, CurvatureOp, DerivativeOp, JacobianOp, StorageOp, name_of
from yasps.frontend.commands.yasps_opt import main
from yasps.frontend.language.attribute import combine
from yasps.passes import pipeline
from yasps.passes.errors import CompileError, place_of
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import PIPELINE, make_context, run_passes, run_pipeline

Located = AttributeOp | StorageOp | DerivativeOp | JacobianOp | CurvatureOp
SCENE = """
rel.scene @s {
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 3
  rel.storage @m.v.x on @m.v : 2x2 loc("user.py":3:0)
  rel.attribute @m.v.shape on @m.v : 1x1 {
    %x = rel.data @m.v.x : 2x2
    %p = mat.det %x : 1x1
    rel.yield %p
  } loc("user.py":7:0)
  rel.energy @m.v.shape projection "clamp"
  rel.target @m.v.x
}
"""


def parsed(text: str) -> ModuleOp:
    return Parser(make_context(), text).parse_module()


def line_here() -> int:
    """Number of the caller's line."""
    frame = inspect.currentframe()
    assert frame is not None
    assert frame.f_back is not None
    return frame.f_back.f_lineno


def without_rule(x: Attribute) -> Attribute:
    """An operation that has no derivative rule, which no method of an attribute makes."""
    return combine(ProjectPsdOp, [x], {"mode": StringAttr("clamp")})


def scene_of(energy: Callable[[Attribute], Attribute]) -> Scene:
    """One energy of a 2x2 matrix on three instances."""
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", 3)
    x = points.add_attribute("x", 2, 2, value=np.tile([2.0, 0.5, 0.5, 1.0], 3))
    scene.add_energy(points.add_attribute("e", computed_attribute=energy(x)))
    scene.add_minimize_target(x)
    return scene


# -- places ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
def test_every_pass_keeps_places(name: str) -> None:
    """Declarations of every stage know a line of the user's; derivatives that of the attribute they are of."""
    stages: list[str] = []

    def after(stage: str, module: ModuleOp) -> None:
        located = [op for op in module.walk() if isinstance(op, Located)]
        assert located
        made = {op.symbol: place_of(op) for op in located if isinstance(op, AttributeOp)}
        for op in located:
            place = place_of(op)
            assert place is not None, f"{stage}: {op.symbol}"
            assert re.search(r"small_scenes\.py:\d+$", place), f"{stage}: {op.symbol} at {place}"
            if isinstance(op, DerivativeOp | JacobianOp | CurvatureOp):
                assert place == made[name_of(op.attribute)], f"{stage}: {op.symbol}"
        stages.append(stage)

    run_pipeline(emit(SCENES[name]()).module, None, after)
    assert len(stages) == len(PIPELINE) + 1


def test_a_curvature_has_the_place_of_its_attribute() -> None:
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    arms, tips = mesh.add_primitive("a", 1), mesh.add_primitive("t", 2)
    through = tips.add_connectivity("arm", arms, [0, 0], 1)
    angle = arms.add_attribute("angle", 1, 1, value=[0.5])
    height, line = arms.add_attribute("height", computed_attribute=angle.sin()), line_here()
    read = tips.add_attribute("height", through=through, source=height)
    scene.add_energy(tips.add_attribute("e", computed_attribute=read * read))
    scene.add_minimize_target(angle)
    module = run_pipeline(emit(scene).module)
    places = [place_of(op) for op in module.walk() if isinstance(op, CurvatureOp)]
    assert places == [f"{__file__}:{line}"]


def test_dumps_tell_places_only_when_asked(tmp_path: Path) -> None:
    run_pipeline(parsed(SCENE), tmp_path / "plain")
    run_pipeline(parsed(SCENE), tmp_path / "located", locations=True)
    for plain in sorted((tmp_path / "plain").iterdir()):
        text = plain.read_text(encoding="utf-8")
        assert "loc(" not in text
        located = (tmp_path / "located" / plain.name).read_text(encoding="utf-8")
        assert 'rel.storage @m.v.x on @m.v : 2x2 loc("user.py":3:0)\n' in located
        assert '\n    } loc("user.py":7:0)\n' in located
        assert re.sub(r' loc\("user.py":\d:0\)', "", located) == text
        module = parsed(located)
        module.verify()
        assert text_of(module, locations=True) == located
        assert text_of(module) == text


def test_dump_ir_of_a_scene_takes_the_option(tmp_path: Path) -> None:
    scene = scene_of(lambda x: x.dot(x))
    scene.dump_ir(tmp_path / "a")
    scene.dump_ir(tmp_path / "b", locations=True)
    for stage in ("00-frontend.mlir", "11-outline-modules.mlir"):
        assert __file__ not in (tmp_path / "a" / stage).read_text(encoding="utf-8")
        assert __file__ in (tmp_path / "b" / stage).read_text(encoding="utf-8")


# -- operations without a rule -----------------------------------------------------------------------------------------


def test_an_operation_without_derivative_is_named_with_its_energy() -> None:
    scene = scene_of(lambda x: without_rule(x).dot(x))
    with pytest.raises(UnsupportedSceneError) as caught:
        scene.compile()
    (line,) = [k for k, text in enumerate(inspect.getsource(scene_of).splitlines()) if 'add_attribute("e"' in text]
    place = f"{__file__}:{inspect.getsourcelines(scene_of)[1] + line}"
    assert str(caught.value) == (
        f"pass differentiate: @m.v.e (made at {place}): mat.project_psd has no derivative rule; leave it out of what "
        "is minimised, or hold what it acts on constant by stop_gradient()"
    )
    assert isinstance(caught.value.__cause__, CompileError)


def test_the_advice_works() -> None:
    scene = scene_of(lambda x: without_rule(x).stop_gradient().dot(x))
    module = emit(scene).module
    run_passes(PassPipeline(PIPELINE[: 1 + [p.name for p in PIPELINE].index("differentiate")]), make_context(), module)
    assert any(isinstance(op, DerivativeOp) for op in module.walk())


def test_behind_a_join_the_inner_attribute_is_named_and_not_the_energy() -> None:
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    points, pairs = mesh.add_primitive("v", 2), mesh.add_primitive("p", 1)
    x = points.add_attribute("x", 2, 2)
    inner, line = points.add_attribute("inner", computed_attribute=without_rule(x)), line_here()
    ends = pairs.add_connectivity("ends", points, [0, 1], 2)
    read = pairs.add_attribute("read", through=ends, source=inner)
    scene.add_energy(pairs.add_attribute("e", computed_attribute=read.dot(read)))
    scene.add_minimize_target(x)
    with pytest.raises(
        UnsupportedSceneError, match=re.escape(f"@m.v.inner (made at {__file__}:{line}): mat.project_psd")
    ):
        scene.compile()


# -- laws --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "rel.data @m.v.x : 2x2\n",
            "rel.data @m.v.y : 2x2\n",
            "@m.v.shape (made at user.py:7) names an attribute @m.v.y, which does not exist",
        ),
        (
            "2x2 loc",
            "3x3 loc",
            "@m.v.shape (made at user.py:7) uses @m.v.x as 2x2, but it is 3x3",
        ),
        (
            "size 3",
            "size 3\n  rel.primitive @m.w in @m size 3\n"
            "  rel.storage @m.w.y on @m.w : 2x2\n  rel.attribute @m.v.z on @m.v : 2x2 {\n"
            '    %y = rel.data @m.w.y : 2x2\n    rel.yield %y\n  } loc("user.py":5:0)',
            "@m.v.z (made at user.py:5) lives on @m.v and reads @m.w.y of @m.w: attributes of different lineages meet "
            "only through a JOIN or a UNION",
        ),
        (
            "mat.det %x : 1x1",
            "mat.neg %x : 1x1",
            "@m.v.shape (made at user.py:7): mat.neg gives 2x2 here, but its type says 1x1",
        ),
        (
            '"clamp"',
            '"crush"',
            "@m.v.shape (made at user.py:7): projection must be one of clamp, abs, none, got 'crush'",
        ),
        (
            "rel.target @m.v.x",
            "rel.target @m.v.shape",
            "@m.v.shape (made at user.py:7): a target needs a stored variable as target, but @m.v.shape is "
            "rel.attribute",
        ),
        (
            "rel.target @m.v.x",
            "rel.target @m.v.other",
            "a target names a stored variable as target @m.v.other, which does not exist",
        ),
    ],
)
def test_a_broken_law_of_hand_written_ir_is_one_line(
    old: str, new: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert old in SCENE
    path = tmp_path / "broken.mlir"
    path.write_text(SCENE.replace(old, new), encoding="utf-8")
    assert main(["-p", "differentiate", str(path)]) == 1
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err == f"yasps-opt: {message}\n"


def test_without_places_the_attribute_is_still_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "broken.mlir"
    broken = re.sub(r" loc\(.*\)", "", SCENE).replace("rel.data @m.v.x", "rel.data @m.v.y")
    path.write_text(broken, encoding="utf-8")
    assert main([str(path)]) == 1
    assert capsys.readouterr().err == "yasps-opt: @m.v.shape names an attribute @m.v.y, which does not exist\n"


def test_yasps_opt_names_pass_attribute_and_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "no-rule.mlir"
    rule = 'mat.project_psd %x mode "abs" : 2x2'
    text = SCENE.replace("mat.det %x :", f"{rule}\n    %d = mat.det %p :").replace("yield %p", "yield %d")
    path.write_text(text, encoding="utf-8")
    assert main(["-p", "canonicalize,differentiate", str(path)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("yasps-opt: pass differentiate: @m.v.shape (made at user.py:7): mat.project_psd has no ")
    assert error.count("\n") == 1


# -- bugs of passes ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Breaks(ModulePass):
    """Gives attributes another type than their bodies have."""

    name = "breaks"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for attribute in op.walk():
            if isinstance(attribute, AttributeOp):
                attribute.type = matrix_type((7, 7))


def test_a_pass_that_breaks_a_law_is_blamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its dump is there to read, and the whole module is neither in the message nor in the traceback."""
    monkeypatch.setattr(pipeline, "PIPELINE", (PIPELINE[0], Breaks()))
    with pytest.raises(CompileError) as caught:
        run_pipeline(parsed(SCENE), tmp_path)
    assert str(caught.value) == (
        "pass breaks broke a rule, which is a bug of yasps: @m.v.shape (made at user.py:7) uses @m.v.shape as "
        "1x1, but it is 7x7"
    )
    assert isinstance(caught.value.__cause__, VerifyException)
    assert "rel.scene" not in "".join(traceback.format_exception(caught.value))
    assert "on @m.v : 7x7" in (tmp_path / "02-breaks.mlir").read_text(encoding="utf-8")


def test_the_scene_of_a_broken_frontend_is_refused_without_blaming_a_pass() -> None:
    with pytest.raises(CompileError, match=r"^@m\.v\.shape \(made at user\.py:7\) uses @m\.v\.x as"):
        run_pipeline(parsed(SCENE.replace("2x2 loc", "3x3 loc")))


# -- at run time -------------------------------------------------------------------------------------------------------


def test_derivatives_that_are_not_finite_name_the_line() -> None:
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", 3)
    x = points.add_attribute("x", 1, 1, value=[1.0, 2.0, -1.0])
    energy, line = points.add_attribute("e", computed_attribute=x.log() * x), line_here()
    scene.add_energy(energy)
    scene.add_minimize_target(x)
    with pytest.raises(NotFiniteError) as caught:
        scene.gradient()
    message = str(caught.value)
    assert message.startswith("energy m.v.e is not finite (nan) on instance 2")
    assert message.endswith(f"It was made at {__file__}:{line}")


def test_places_are_those_of_files_and_lines() -> None:
    module = parsed(SCENE)
    (attribute,) = [op for op in module.walk() if isinstance(op, AttributeOp)]
    assert isinstance(attribute.location, FileLineColLoc)
    assert place_of(attribute) == "user.py:7"
    assert place_of(module) is None
