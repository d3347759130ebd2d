"""Names of values in dumps: the user's through all passes, derived ones by what an operation is."""

from __future__ import annotations

import re

import pytest
from small_scenes import emit, soft_tets
from xdsl.dialects.builtin import ModuleOp
from xdsl.parser import Parser

from yasps.frontend.execution.scene_key import text_of_key
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import make_context, run_pipeline

BODY = """rel.scene @s {{
  rel.mesh @m in @s
  rel.primitive @m.v in @m size 2
  rel.storage @m.v.F on @m.v : 3x3
  rel.attribute @m.v.e on @m.v : 1x1 {{
    %0 = rel.data @m.v.F : 3x3
    %1 = {operation}
    rel.yield %1
  }}
}}"""


def parsed(text: str) -> ModuleOp:
    return Parser(make_context(), text).parse_module()


@pytest.mark.parametrize(
    ("operation", "name"),
    [
        ("mat.det %0 : 1x1", "%det_F"),
        ("mat.trace %0 : 1x1", "%tr_F"),
        ("mat.transpose %0 : 3x3", "%t_F"),
        ("mat.block %0[1, 0] : 1x3", "%F_row1"),
        ("mat.block %0[0, 2] : 3x1", "%F_col2"),
        ("mat.block %0[1, 2] : 1x1", "%F_r1c2"),
        ("mat.block %0[0, 0] : 2x2", "%0"),
        ("mat.reshape %0 : 9x1", "%F_flat"),
        ("mat.add %0, %0 : 3x3", "%0"),
        ("mat.constant 3.0 : 1x1", "%c3"),
        ("mat.constant -2.0 : 1x1", "%cm2"),
        ("mat.constant 0.5 : 1x1", "%half"),
        ("mat.constant 0.25 : 1x1", "%0"),
        ("mat.constant 1e30 : 1x1", "%0"),
        ("mat.constant 0.0 : 3x3", "%zero"),
        ("mat.identity : 3x3", "%identity"),
    ],
)
def test_a_value_is_called_by_what_it_is(operation: str, name: str) -> None:
    text = text_of(parsed(BODY.format(operation=operation.replace("1e30", "1.0e30"))))
    assert f"    {name} = mat." in text
    assert "%F = rel.data" in text
    assert text_of(parsed(text)) == text


def test_names_of_names_stay_short() -> None:
    chain = "mat.neg %0 : 3x3\n" + "".join(f"    %{k + 1} = mat.neg %{k} : 3x3\n" for k in range(1, 12))
    names = re.findall(r"%(\S+) = mat.neg", text_of(parsed(BODY.format(operation=chain))))
    assert names[:2] == ["minus_F", "minus_minus_F"]
    assert max(map(len, names)) <= 32
    assert names[-1].isdigit()


def test_the_users_names_are_there_after_every_pass() -> None:
    def after(name: str, module: ModuleOp) -> None:
        assert re.search(r"%positions = rel\.(join|ref) ", text_of(module)), name

    run_pipeline(emit(soft_tets()).module, None, after)


def test_a_derivative_opens_with_a_line_about_it() -> None:
    lines: dict[str, str] = {}

    def after(name: str, module: ModuleOp) -> None:
        found = re.findall(r"^ *// (.*)\n *rel\.derivative ", text_of(module), re.MULTILINE)
        lines[name] = found[0] if found else ""

    run_pipeline(emit(soft_tets()).module, None, after)
    assert lines["fold-norms"] == ""
    start = "energy @m.t.elastic of positions 4x3; "
    assert re.fullmatch(start + r"cut cut 3x3; projection clamp; operations: on matrices \d+", lines["differentiate"])
    assert re.fullmatch(
        start + r"projection clamp 9x9 of 12x12; operations: derive_uniforms \d+, derive \d+, pull_back \d+",
        lines["outline-modules"],
    )


def test_a_key_knows_no_names() -> None:
    module, other = emit(soft_tets()).module, emit(soft_tets()).module
    for op in other.walk():
        for result in op.results:
            result.name_hint = "renamed"
    assert text_of(module) != text_of(other)
    assert text_of_key(module) == text_of_key(other)
    assert "positions =" not in text_of_key(module)
