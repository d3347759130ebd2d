"""The IR that the frontend gives to the compiler."""

from __future__ import annotations

import pytest
from xdsl.dialects.builtin import FileLineColLoc, ModuleOp
from xdsl.parser import Parser

from yasps import Attribute, Scene
from yasps.dialects.rel import AttributeOp, Container, StorageOp
from yasps.frontend.execution.emit import EnergyTerm, SceneEmitter
from yasps.passes.pipeline import make_context


@pytest.fixture
def scene() -> Scene:
    """Vertices moved by a body, tets over them, a union with other vertices, and parts nobody reads."""
    s = Scene("s")
    a, b = s.add_mesh("a"), s.add_mesh("b")
    vertices, body, tets = a.add_primitive("vertices", 4), a.add_primitive("body", 1), a.add_primitive("tets", 1)
    shift = body.add_attribute("shift", 3, 1)
    rest = vertices.add_constant("rest", 3, 1)
    to_body = vertices.add_connectivity("to_body", body, [0] * 4, 1)
    moved = rest + vertices.add_attribute("shift", through=to_body, source=shift).resize(3, 1)
    vertices.add_attribute("x", computed_attribute=moved)
    b.add_primitive("vertices", 2).add_attribute("x", 3, 1)
    union = b.add_primitive_union("all", [vertices, b.vertices])
    union.add_attribute("x")
    tet2v = tets.add_connectivity("tet2v", union, [0, 1, 2, 5], 4)
    x = tets.add_attribute("x", through=tet2v, source=union["x"])
    tets.add_attribute("energy", computed_attribute=s.add_attribute("scale", 1, 1, value=1.0) * x.dot(x))
    a.add_primitive("unused", 9).add_attribute("unused", 1, 1)
    return s


def emitted(scene: Scene, targets: list[Attribute]) -> tuple[SceneEmitter, ModuleOp]:
    """The emitter and its module, for the scene's energy."""
    emitter = SceneEmitter(scene.name)
    return emitter, emitter.emit([EnergyTerm(scene.a.tets["energy"], "clamp", False)], targets, [])


def test_module_verifies_and_parses_back(scene: Scene) -> None:
    _, module = emitted(scene, [scene.a.body["shift"], scene.b.vertices["x"]])
    module.verify()
    parsed = Parser(make_context(), str(module)).parse_module()
    parsed.verify()
    assert str(parsed) == str(module)


def test_only_what_is_read_is_emitted(scene: Scene) -> None:
    emitter, module = emitted(scene, [scene.a.body["shift"]])
    assert "unused" not in str(module)
    assert set(emitter.stored) == {"a.body.shift", "a.vertices.rest", "b.vertices.x", "scale"}
    assert set(emitter.connected) == {"a.vertices.to_body", "a.tets.tet2v"}
    assert set(emitter.owners) == {"a.tets", "b.all", "a.vertices", "b.vertices", "a.body"}


def test_the_same_scene_gives_the_same_text(scene: Scene) -> None:
    targets = [scene.a.body["shift"]]
    assert str(emitted(scene, targets)[1]) == str(emitted(scene, targets)[1])


def test_definitions_know_the_users_line(scene: Scene) -> None:
    _, module = emitted(scene, [])
    container = module.body.block.first_op
    assert isinstance(container, Container)
    definitions = [op for op in container.body.block.ops if isinstance(op, StorageOp | AttributeOp)]
    assert definitions
    for op in definitions:
        assert isinstance(op.location, FileLineColLoc)
        assert op.location.filename.data.endswith("test_emit.py")
        assert op.location.line.data > 0


def test_shared_parts_of_an_expression_are_emitted_once() -> None:
    s = Scene("s")
    x = s.add_attribute("x", 1, 1, value=1.0)
    doubled = x
    for _ in range(40):  # 2^40 terms if written out
        doubled = doubled + doubled
    emitter = SceneEmitter("s")
    assert str(emitter.emit([], [], [doubled])).count("mat.add") == 40
    assert doubled.compute().value == [2.0**40]


def test_long_chains_do_not_exhaust_the_stack() -> None:
    s = Scene("s")
    x = s.add_attribute("x", 1, 1, value=1.0)
    chain = x
    for _ in range(3000):
        chain = chain + x
    text = str(SceneEmitter("s").emit([], [], [chain]))
    assert text.count("mat.add") == 3000


def test_expressions_get_symbols_that_no_user_can_take(scene: Scene) -> None:
    vertices = scene.a.vertices
    first, second = vertices["rest"] * 2.0, vertices["rest"] * 3.0
    vertices.add_attribute("unnamed", 1, 1)
    emitter = SceneEmitter("s")
    emitter.emit([], [], [first, second])
    assert [emitter.symbol_of(a) for a in (first, second)] == ["a.vertices.unnamed.1", "a.vertices.unnamed.2"]
