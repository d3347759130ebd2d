"""What type checkers see: both spellings, what a scene's parts are, and that a misspelt method is none."""

from __future__ import annotations

import ast
import importlib.util
import re
from types import ModuleType

import pytest
from type_checking import ROOT, problems

from yasps import Attribute, Connectivity, Mesh, Primitive, PrimitiveBase, PrimitiveUnion, Scene
from yasps.frontend.language import paper_names
from yasps.frontend.language.entity import Entity
from yasps.frontend.language.spelling import camel_case, snake_case

STUB = ROOT / "frontend" / "language" / "paper_names.pyi"
CLASSES = (Entity, Scene, Mesh, PrimitiveBase, Primitive, PrimitiveUnion, Attribute, Connectivity)


def load_writer() -> ModuleType:
    spec = importlib.util.spec_from_file_location("write_stubs", ROOT / "tools" / "write_stubs.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_stubs_are_up_to_date() -> None:
    advice = "run `python tools/write_stubs.py` and look at `git diff`"
    writer = load_writer()
    assert STUB.read_text(encoding="utf-8") == writer.stub(), advice
    assert writer.FUNCTIONS_STUB.read_text(encoding="utf-8") == writer.functions_stub(), advice


@pytest.mark.parametrize("cls", CLASSES)
def test_type_checkers_see_the_names_that_there_are(cls: type) -> None:
    """The class derives from its names, and with those of its bases they are all camelCase that it has."""
    assert f"{cls.__name__}Names" in [base.__name__ for base in cls.__bases__]
    declared = {
        node.name: {member.name for member in node.body if isinstance(member, ast.FunctionDef)}
        for node in ast.parse(STUB.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    }
    assert set(declared) == {name for name in vars(paper_names) if name.endswith("Names")}
    seen = set().union(*(declared.get(base.__name__, set()) for base in cls.__mro__))
    public = {name for name in dir(cls) if not name.startswith("_")}
    assert seen == {camel_case(name) for name in public if "_" in name}
    assert {snake_case(name) for name in seen} <= public


TABLE_4 = """
import numpy as np
from typing import assert_type
from yasps import Attribute, Connectivity, Mesh, Primitive, PrimitiveUnion, Scene, addScene, concatRows, scene
from yasps import Solution

s: Scene = scene("s")
assert_type(addScene("t"), Scene)
mesh = s.addMesh("wall")
assert_type(mesh, Mesh)
hook = mesh.addPrimitive("hook", numInstances=1, isDynamic=False)
assert_type(hook, Primitive)
bead = mesh.addPrimitive("bead", 3)
x = hook.addAttribute("position", rows=3, cols=1, value=[0.0, 0.0, 0.0])
hook.addConstant("mass", rows=1, cols=1)
named = bead.addAttribute("named", computedAttribute=2.0 * bead.addAttribute("position", 3, 1))
assert_type(named, Attribute)
both = mesh.addPrimitiveUnion("both", members=[hook, bead])
assert_type(both, PrimitiveUnion)
ends = bead.addConnectivity("ends", both, np.zeros((3, 2), int), 2)
assert_type(ends, Connectivity)
s.addEnergy(named.dot(named), dynamicInstances=False)
s.addMinimizeTarget(targets=[x])
x.updateValue(values=[1.0, 2.0, 3.0])
s.minimizeEnergy(tolerance=1e-8, maxIterations=10)
assert_type(s.solve(1e-8, maxIterations=10), Solution)
s.compile(needTargets=False)
assert_type(s.totalEnergy(), float)
assert_type(bead.numInstances, int)
assert_type(s.minimizeTargets, tuple[Attribute, ...])
concatRows([x.stopGradient().T])
s.dumpIr("folder", locations=True)
"""

PYTHONS = TABLE_4
for word in set(re.findall(r"\b[a-z]+[A-Z]\w*", TABLE_4)):
    PYTHONS = re.sub(rf"\b{word}\b", snake_case(word), PYTHONS)

READING = """
from typing import assert_type
import yasps
from yasps import Attribute, Connectivity, Mesh, Primitive, PrimitiveUnion

scene = yasps.Scene("s")
scene.add_mesh("vertices").add_primitive("points", 2, is_dynamic=True)
assert_type(scene.vertices, Mesh)
point: Primitive = scene.vertices.points
union: PrimitiveUnion = scene.vertices.all
scene.vertices.points.update(x=[1.0])
print(scene.vertices.all.offsets(), scene.vertices.points.num_instances, scene.vertices.points.numInstances)
assert_type(scene.vertices.points.edges, Connectivity)
assert_type(scene.vertices.points["x"], Attribute)
scene.vertices.points.edges.update_value([0])
"""

WRONG = """
import yasps
scene = yasps.Scene("s")
scene.add_mehs("m")
scene.addMehs("m")
scene.add_mesh()
scene.addMesh(3)
mesh = scene.add_mesh("m")
mesh.addPrimitive("hook", numInstance=1)
mesh.addPrimitive("hook", num_instances=1)
mesh.add_primitive("hook", numInstances=1)
mesh.addPrimitive("hook", numInstances="1")
mesh.add_primitve("hook", 1)
points = mesh.add_primitive("hook", 1)
points.add_atribute("x", 3, 1)
points.addAttribute("x", rows=3, columns=1)
x = points.addAttribute("x", rows=3, cols=1)
x.updateValues([1.0])
x.norm2()
scene.solve(1e-3, maxIteration=5)
scene.solve(1e-3, max_iterations=5, maxIterations=5)
scene.compile(need_target=False)
scene.vertices = mesh
points.add_connectivity("c", points, [0], 1).update_values([0])
mesh.points.add_atribute("x", 3, 1)
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """The errors of each of these scripts."""
    scripts = [TABLE_4, PYTHONS, READING, WRONG]
    return dict(zip(scripts, problems(scripts, tmp_path_factory.mktemp("scripts")), strict=True))


@pytest.mark.slow
def test_both_spellings_are_typed(said: dict[str, list[str]]) -> None:
    assert "num_instances=1" in PYTHONS
    assert said[TABLE_4] == []
    assert said[PYTHONS] == []


@pytest.mark.slow
def test_parts_are_read_by_their_names(said: dict[str, list[str]]) -> None:
    assert said[READING] == []


@pytest.mark.slow
def test_what_there_is_not_is_an_error(said: dict[str, list[str]]) -> None:
    found = {int(line.split(":")[1]) for line in said[WRONG]}
    harmless = {"", "import yasps", 'scene = yasps.Scene("s")', 'mesh = scene.add_mesh("m")'}
    harmless |= {'points = mesh.add_primitive("hook", 1)', 'x = points.addAttribute("x", rows=3, cols=1)'}
    lines = enumerate(WRONG.splitlines(), start=1)
    assert found == {number for number, line in lines if line not in harmless}, "\n".join(said[WRONG])
