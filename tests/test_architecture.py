"""Imports point one way, as docs/architecture.md says."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "dialects": set[str](),
    "runtime": set[str](),
    "passes": {"dialects"},
    "backend": {"dialects", "runtime"},
    "frontend": {"dialects", "runtime", "passes", "backend"},
    "examples": {"frontend", "public API"},
}


def imported_folders(source: str) -> set[str]:
    """Folders of ours that a module imports; "public API" for names of `yasps` itself."""
    modules = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            assert node.module is not None
            # `from yasps import frontend` names a folder, `from yasps import Scene` something of the public API.
            modules |= {f"yasps.{a.name}" for a in node.names} if node.module == "yasps" else {node.module}
    parts = [module.split(".") for module in modules if module == "yasps" or module.startswith("yasps.")]
    return {part[1] if len(part) > 1 and part[1] in MAY_IMPORT else "public API" for part in parts}


@pytest.mark.parametrize("folder", MAY_IMPORT)
def test_imports_point_one_way(folder: str) -> None:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert len(files) > 1
    for file in files:
        used = imported_folders(file.read_text(encoding="utf-8")) - {folder}
        assert used <= MAY_IMPORT[folder], f"{file.relative_to(ROOT)} imports {sorted(used - MAY_IMPORT[folder])}"


def test_relative_and_nested_imports_are_seen() -> None:
    source = "def f():\n    from yasps.frontend.scene import Scene\n    import yasps.runtime.solvers.pcg, numpy\n"
    assert imported_folders(source) == {"frontend", "runtime"}
    assert imported_folders("from yasps import Scene, backend") == {"public API", "backend"}


def test_the_document_says_the_same() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)/` \| `yasps\.\w+` \| .* \| ([^|]*) \|$", text, re.MULTILINE)
    documented = {folder: set(re.findall(r"\w+", words)) for folder, words in rows}
    expected = {folder: set(allowed) for folder, allowed in MAY_IMPORT.items()}
    expected |= {"dialects": {"nothing", "of", "ours"}, "runtime": {"nothing", "of", "ours"}}
    expected |= {"frontend": {"all", "of", "the", "above"}, "examples": {"the", "public", "API", "and", "frontend"}}
    assert documented == expected


def test_an_installed_package_has_all_that_is_compiled_when_it_runs() -> None:
    """Whatever lies beside the Python files is named in pyproject.toml."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    patterns: dict[str, list[str]] = settings["tool"]["setuptools"]["package-data"]
    for folder in MAY_IMPORT:
        packaged = {path for pattern in patterns.get(f"yasps.{folder}", []) for path in (ROOT / folder).glob(pattern)}
        beside = {
            path
            for path in (ROOT / folder).rglob("*")
            if path.is_file() and path.suffix not in {".py", ".pyc"} and "__pycache__" not in path.parts
        }
        assert beside == packaged


def test_no_command_goes_through_a_shell() -> None:
    folders = ("dialects", "passes", "runtime", "backend", "frontend", "examples", "yasps")
    calls = [
        (file.name, ast.unparse(node.func), {word.arg for word in node.keywords})
        for folder in folders
        for file in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
    ]
    by_shell = {"os.system", "os.popen", "subprocess.getoutput", "subprocess.getstatusoutput"}
    assert not [call for call in calls if call[1] in by_shell or "shell" in call[2]]
    assert len([call for call in calls if call[1].startswith("subprocess.")]) >= 6
