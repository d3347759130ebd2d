"""The documents name nothing that is not there: what they show in running text is type-checked, and files exist."""

from __future__ import annotations

import ast
import builtins
import re
from pathlib import Path

import pytest
from type_checking import ROOT, problems

import yasps
from yasps import materials
from yasps.dialects.mat import OPERATIONS
from yasps.dialects.rel import Rel

DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

PREAMBLE = """
from typing import Any
import numpy as np
import yasps
import yasps.runtime.build.toolchain
import yasps.runtime.device.gpu
from yasps import {public}
import yasps.inverse
from yasps.inverse import Trajectory
import yasps.bridges.jax, yasps.bridges.scipy, yasps.bridges.torch
import yasps.backend, yasps.dialects, yasps.examples, yasps.frontend, yasps.passes
from yasps import Solution
from yasps.backend.reference.interpreter import Interpreter
from yasps.contact import CollisionGeometry
from yasps.frontend.execution.compiled_scene import CompiledScene
from yasps.contact import BarrierContact
from yasps.bodies import Joints
from yasps.materials import *
from yasps.stepping import BACKWARD_EULER, LoadStep, MovingPart, NewtonReport, NewtonSettings, TimeStepper, minimize
from yasps.stepping import quasi_static
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.solvers.pcg import SolveReport
from yasps.simulation import Simulation
from yasps.stepping import DrivenVertices
any_: Any
"""

# What the names in the documents stand for; whatever else they name is anything.
STANDS_FOR = {
    "scene": "Scene",
    "mesh": "Mesh",
    "primitive": "Primitive",
    "owner": "Primitive",
    "pairs": "Primitive",
    "union": "PrimitiveUnion",
    "connectivity": "Connectivity",
    **dict.fromkeys(("attribute", "position", "a", "b", "x"), "Attribute"),
    "solution": "Solution",
    "report": "SolveReport",
    "compiled_scene": "CompiledScene",
    "contact": "BarrierContact",
    "geometry": "CollisionGeometry",
    "stepper": "TimeStepper",
    "simulation": "Simulation",
    "joints": "Joints",
    "inverse": "Any",
    "trajectory": "Trajectory",
    "bodies": "Any",
    "set_load": "Any",
    "share": "Any",
    "pins": "DrivenVertices",
    "module": "Any",
    "data": "Any",
}
# Methods that the documents show without their object.
OBJECT_OF = {
    "scene": "yasps",
    **dict.fromkeys(("addMesh", "total_energy", "hessian", "dump_ir"), "scene"),
    "addPrimitive": "mesh",
    "assemble": "compiled_scene",
    "compute": "attribute",
    "step": "stepper",
    **dict.fromkeys(("set_velocity", "velocity_of", "add_force", "pin", "add", "remove"), "simulation"),
    **dict.fromkeys(("candidates", "covers", "active_set", "step_bound", "check_intersection_free"), "geometry"),
}
NO_PYTHON = re.compile(r"X_\w+\(|jit\(")  # generated functions; another library's
ENDINGS = r"py|pyi|h|cu|cuh|md|cpp"


def running_text(document: Path) -> str:
    text = document.read_text(encoding="utf-8")
    return re.sub(r"^ *```.*?^ *```$", "", text, flags=re.MULTILINE | re.DOTALL)


def shown(text: str) -> list[str]:
    """The pieces of code in running text."""
    return [code.replace(r"\|", "|") for code in re.findall(r"`([^`\n]+)`", text)]


def is_file(code: str) -> bool:
    return re.fullmatch(rf"[\w/]+\.({ENDINGS})", code) is not None


def as_python(code: str) -> str | None:
    """The code with `...` filled in, if it calls or takes something of ours."""
    if is_file(code):
        return None
    code = code.replace("*, ", "")  # of signatures
    method = code.partition("(")[0]
    if method in OBJECT_OF and method != code:
        code = f"{OBJECT_OF[method]}.{code}"
    for dots, anything in {
        "(...)": "(*any_, **any_)",
        "(..., ": "(*any_, ",
        ", ...)": ", **any_)",
        "...": "*any_",
    }.items():
        code = re.sub(r"(?<==)( ?)\.\.\.", r"\1any_", code).replace(dots, anything)
    try:
        tree = ast.parse(code)
    except SyntaxError:
        return None
    roots = {
        node.value.id for node in ast.walk(tree) if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    }
    called = any(isinstance(node, ast.Call) for node in ast.walk(tree))
    return code if (called or roots & {*STANDS_FOR, "yasps"}) and not NO_PYTHON.match(code) else None


def script(codes: list[str]) -> str:
    """A user's script with these pieces, each in a function of its own, in order from line 1 of the result's end."""
    known = {*re.findall(r"\w+", PREAMBLE), *yasps.__all__, *dir(builtins), *materials.__all__}
    names = {node.id for code in codes for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)}
    declared = [f"{name}: {kind}" for name, kind in STANDS_FOR.items()]
    declared += [f"{name}: Any" for name in sorted(names - known - set(STANDS_FOR))]
    public = ", ".join(name for name in yasps.__all__ if name != "scene")  # in the documents it is one
    return "\n".join([PREAMBLE.format(public=public), *declared, *codes, ""])


def test_pieces_of_code_are_found() -> None:
    found = [code for document in DOCUMENTS for code in map(as_python, shown(running_text(document))) if code]
    assert len(found) > 100
    assert "scene.mixed_hessian(targets, parameters)" in found
    minimize = "minimize(scene, positions, time_step, contact=None, settings=NewtonSettings(), times=None"
    assert f"{minimize}, arms=None, fixed=None)" in found


@pytest.mark.slow
def test_what_the_documents_show_is_there(tmp_path: Path) -> None:
    """And what is not there is found: the first of the wrong ones is what docs/gpu.md once said."""
    wrong = ["attribute.value = ...", "scene.addMehs(...)", "scene.solve(maxIteration=3)", "report.whence"]
    codes = [as_python(code) for code in wrong]
    found = {code: None for document in DOCUMENTS for code in map(as_python, shown(running_text(document))) if code}
    shown_script = script([*found])
    said, *of_wrong = problems([shown_script, *(script([code]) for code in codes if code is not None)], tmp_path)
    lines = shown_script.splitlines()
    assert [f"{lines[int(line.split(':')[1]) - 1]}: {line}" for line in said] == []
    assert [code for code, errors in zip(wrong, of_wrong, strict=True) if not errors] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_files_and_operations_that_are_named_exist(document: Path) -> None:
    files = {
        path.name: path
        for path in ROOT.rglob("*")
        if path.suffix[1:] in ENDINGS.split("|") and ".git" not in path.parts
    }
    operations = {operation.name for operation in (*OPERATIONS, *Rel.operations)}
    for code in shown(running_text(document)):
        if is_file(code):
            assert (ROOT / code).exists() or ("/" not in code and code in files) or code.startswith("generated/"), code
        named = re.match(r"(mat|rel)\.\w+$", code)
        assert named is None or code in operations, code
