"""Writes what type checkers see of methods that are made when yasps runs: `python tools/write_stubs.py`.

frontend/language/paper_names.pyi has the paper's spelling, made from the source: every public method and property of
several words, in camelCase, with its keywords in camelCase, its types and its docstring. entrywise.pyi beside it has
the functions of the table in dialects/scalar/functions.py. A test compares both with what this would write.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from yasps.dialects.scalar.functions import FUNCTIONS
from yasps.frontend.language.spelling import camel_case

FRONTEND = Path(__file__).resolve().parents[1] / "frontend"
STUB = FRONTEND / "language" / "paper_names.pyi"
MODULES = (
    "language.attribute",
    "language.connectivity",
    "language.entity",
    "language.primitive",
    "language.mesh",
    "scene",
)
FUNCTIONS_STUB = FRONTEND / "language" / "entrywise.pyi"
FUNCTIONS_HEADER = '''"""Functions of every entry, for type checkers. Written by tools/write_stubs.py."""

import abc

from yasps.dialects.mat.elementwise import TabledFunction
from yasps.frontend.language.attribute import Attribute

class EntrywiseFunctions(abc.ABC):
    @abc.abstractmethod
    def _apply(self, operation: type[TabledFunction]) -> Attribute: ...
'''
SUFFIX = "Names"
HEADER = '''# ruff: noqa: N802
"""The paper's spelling for type checkers. Written by tools/write_stubs.py from the classes themselves."""

'''


def stub() -> str:
    """The text of the file."""
    imports: dict[str, str] = {}
    classes: list[ast.ClassDef] = []
    for module in MODULES:
        tree = ast.parse((FRONTEND / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
        imports |= _imported_names(tree, f"yasps.frontend.{module}")
        classes += [node for node in tree.body if isinstance(node, ast.ClassDef) and _names_class(node) is not None]
    inherited = {node.name: _base(node) for node in classes}
    members = {node.name: {member.name: _renamed(member) for member in _of_several_words(node)} for node in classes}
    written = []
    for node in classes:
        own = members[node.name]
        above = inherited[node.name]
        while above is not None:
            own = {name: member for name, member in own.items() if name not in members[above]}
            above = inherited[above]
        written.append(
            ast.ClassDef(f"{node.name}{SUFFIX}", [], [], [*own.values()] or [ast.Expr(ast.Constant(...))], [])
        )
    used = {name.id for node in written for name in ast.walk(node) if isinstance(name, ast.Name)}
    lines = [imports[name] for name in sorted(used) if name in imports]
    module_text = ast.unparse(ast.fix_missing_locations(ast.Module([*written], [])))
    text = HEADER + "\n".join([*lines, "", module_text, ""])
    for command in (["check", "--select", "I", "--fix-only"], ["format"]):
        ruff = [sys.executable, "-m", "ruff", *command, "--quiet", "--stdin-filename", str(STUB), "-"]
        text = subprocess.run(ruff, input=text, capture_output=True, text=True, check=True, cwd=FRONTEND.parent).stdout
    return text


def _names_class(node: ast.ClassDef) -> ast.expr | None:
    """The base class that stands for its names in the paper's spelling."""
    wanted = f"{node.name}{SUFFIX}"
    return next((base for base in node.bases if isinstance(base, ast.Name) and base.id == wanted), None)


def _base(node: ast.ClassDef) -> str | None:
    """The class of ours that it derives from and that has such names, too."""
    bases = [base.id for base in node.bases if isinstance(base, ast.Name)]
    return next((base for base in bases if base in ("Entity", "PrimitiveBase")), None)


def _imported_names(tree: ast.Module, module: str) -> dict[str, str]:
    """For each name that annotations of the module may use, the line that imports it."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                found[alias.asname or alias.name] = f"from {node.module} import {ast.unparse(alias)}"
        elif isinstance(node, ast.Import):
            for alias in node.names:
                found[alias.asname or alias.name] = f"import {ast.unparse(alias)}"
    for node in tree.body:
        names = [node.name] if isinstance(node, ast.ClassDef) else []
        if isinstance(node, ast.Assign):
            names = [target.id for target in node.targets if isinstance(target, ast.Name)]
        found |= {name: f"from {module} import {name}" for name in names}
    return found


def _of_several_words(node: ast.ClassDef) -> list[ast.FunctionDef]:
    functions = [member for member in node.body if isinstance(member, ast.FunctionDef)]
    return [f for f in functions if "_" in f.name and not f.name.startswith("_")]


def _renamed(function: ast.FunctionDef) -> ast.FunctionDef:
    """The declaration alone, in camelCase."""
    for argument in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs):
        argument.arg = camel_case(argument.arg)
    docstring = ast.get_docstring(function, clean=False)
    body: list[ast.stmt] = [ast.Expr(ast.Constant(docstring if docstring is not None else ...))]
    decorators = [d for d in function.decorator_list if isinstance(d, ast.Name) and d.id == "property"]
    name = camel_case(function.name)
    return ast.FunctionDef(name, function.args, body, decorators, function.returns)


def functions_stub() -> str:
    """The text of frontend/language/entrywise.pyi: a method for each function of the table."""
    methods = [f'    def {f.name}(self) -> Attribute:\n        """{f.about} of every entry."""\n' for f in FUNCTIONS]
    return FUNCTIONS_HEADER + "\n".join(methods)


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")
    FUNCTIONS_STUB.write_text(functions_stub(), encoding="utf-8")
