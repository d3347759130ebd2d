"""Imports point one way, as docs/architecture.md says."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COMPILER = ("dialects", "passes", "runtime", "backend", "frontend")
KIT = (
    "materials",
    "meshes",
    "output",
    "contact",
    "parameterisations",
    "bodies",
    "stepping",
    "simulation",
    "inverse",
    "program",
    "bridges",
)
MAY_IMPORT = {
    "dialects": set[str](),
    "runtime": set[str](),
    "passes": {"dialects"},
    "backend": {"dialects", "runtime"},
    "frontend": {"dialects", "runtime", "passes", "backend"},
    "examples": {"public API", *KIT},
}
ROOMS = {
    "dialects": ("scalar", "mat", "rel"),
    "passes": ("errors", "bodies", "analysis", "ir_text", "calculus", "transforms", "pipeline", "yasps_opt"),
    "runtime": ("build", "core", "device", "matrix", "assembly", "solvers", "projection", "collision"),
    "backend": ("codegen", "cpp", "cuda", "reference"),
    "frontend": ("errors", "language", "execution", "scene", "commands"),
}
"""Of each folder, its rooms: every one imports only those before it."""
KIT_ROOMS = {
    "materials": set[str](),
    "meshes": set[str](),
    "output": set[str](),
    "contact": {"meshes"},
    "parameterisations": {"meshes"},
    "bodies": {"materials", "meshes", "contact", "parameterisations"},
    "stepping": {"materials", "contact", "output"},
    "simulation": {"materials", "meshes", "output", "contact", "bodies", "stepping"},
    "inverse": {"output", "contact", "bodies", "stepping", "simulation"},
    "program": {"output", "stepping", "simulation"},
    "bridges": {"inverse"},
}
INSIDE = {
    "yasps.frontend.language.arrays",  # checks of arguments, with the messages that all of yasps has
    "yasps.frontend.language.in_scene",
    "yasps.frontend.language.scene_lock",
}
"""What the kit uses of the inside; contact has collision detection of the runtime besides, and program the place of
compiled code."""


def imported_modules(source: str, *, of_types: bool = True) -> Iterator[str]:
    """Modules of ours that a source imports, by their whole names; what is imported for types alone is left out
    unless `of_types`."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    if not of_types:
        for node in nodes.copy():
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                inside = {id(one) for child in node.body for one in ast.walk(child)}
                nodes = [one for one in nodes if id(one) not in inside]
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == "yasps")
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            assert node.module is not None
            if node.module == "yasps":
                # `from yasps import frontend` names a folder, `from yasps import Scene` something of the public API.
                folders = {*MAY_IMPORT, *KIT}
                yield from (f"yasps.{a.name}" if a.name in folders else "yasps" for a in node.names)
            elif node.module.startswith("yasps."):
                inner = ROOT.joinpath(*node.module.split(".")[1:])
                yield from (
                    f"{node.module}.{a.name}" if inner.is_dir() and (inner / f"{a.name}.py").exists() else node.module
                    for a in node.names
                )


def imported_folders(source: str) -> set[str]:
    """Folders of ours that a module imports; "public API" for names of `yasps` itself."""
    parts = [module.split(".") for module in imported_modules(source)]
    known = {*MAY_IMPORT, *KIT}
    return {part[1] if len(part) > 1 and part[1] in known else "public API" for part in parts}


def python_files(folder: str) -> list[Path]:
    """The files of a folder at the top or of a room of the kit."""
    place = ROOT / "yasps" / folder if folder in KIT else ROOT / folder
    return sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]


@pytest.mark.parametrize("folder", MAY_IMPORT)
def test_imports_point_one_way(folder: str) -> None:
    files = python_files(folder)
    assert len(files) > 1
    for file in files:
        used = imported_folders(file.read_text(encoding="utf-8")) - {folder}
        assert used <= MAY_IMPORT[folder], f"{file.relative_to(ROOT)} imports {sorted(used - MAY_IMPORT[folder])}"


@pytest.mark.parametrize("folder", ROOMS)
def test_rooms_import_those_before_them(folder: str) -> None:
    """What is imported for the sake of types may point both ways."""
    rooms = ROOMS[folder]
    assert {path.stem for path in (ROOT / folder).iterdir() if path.name[0] not in "._"} == set(rooms)
    for file in python_files(folder):
        room = file.relative_to(ROOT / folder).parts[0].removesuffix(".py")
        if room == "__init__":
            continue
        for module in imported_modules(file.read_text(encoding="utf-8"), of_types=False):
            parts = module.split(".")
            if parts[1:2] == [folder] and len(parts) > 2:
                assert rooms.index(parts[2]) <= rooms.index(room), f"{file.relative_to(ROOT)} imports {module}"


@pytest.mark.parametrize("room", KIT)
def test_the_kit_uses_the_public_language(room: str) -> None:
    assert set(KIT) == set(KIT_ROOMS)
    for file in python_files(room):
        for module in imported_modules(file.read_text(encoding="utf-8")):
            where = module.split(".")[1:2]
            allowed = not where or where[0] in {room, *KIT_ROOMS[room]} or module in INSIDE
            allowed = allowed or (room == "contact" and where[0] == "runtime")
            allowed = allowed or (room == "program" and module == "yasps.runtime.build.toolchain")
            assert allowed, f"{file.relative_to(ROOT)} imports {module}"


def test_users_import_no_inside() -> None:
    """Neither do examples, nor what the documents show: all of that is written as users write."""
    documents = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    sources = {str(file): file.read_text(encoding="utf-8") for file in python_files("examples")}
    for file in documents:
        blocks = re.findall(r"^```python\n(.*?)^```", file.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        sources |= {f"{file.name}, block {k}": block for k, block in enumerate(blocks)}
    assert len(sources) > 10
    for name, source in sources.items():
        words = re.findall(r"\byasps\.(\w+)", source)
        assert not set(words) & set(COMPILER), name


def test_relative_and_nested_imports_are_seen() -> None:
    source = "def f():\n    from yasps.frontend.scene import Scene\n    import yasps.runtime.solvers.pcg, numpy\n"
    assert imported_folders(source) == {"frontend", "runtime"}
    assert imported_folders("from yasps import Scene, backend") == {"public API", "backend"}
    source = "if TYPE_CHECKING:\n    import yasps.passes\nfrom yasps.frontend import errors\n"
    assert set(imported_modules(source)) == {"yasps.passes", "yasps.frontend.errors"}
    assert set(imported_modules(source, of_types=False)) == {"yasps.frontend.errors"}


def test_the_document_says_the_same() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)/` \| `yasps\.\w+` \| .* \| ([^|]*) \|$", text, re.MULTILINE)
    documented = {folder: set(re.findall(r"\w+", words)) for folder, words in rows}
    expected = {folder: set(allowed) for folder, allowed in MAY_IMPORT.items()}
    expected |= {"dialects": {"nothing", "of", "ours"}, "runtime": {"nothing", "of", "ours"}}
    expected |= {"frontend": {"all", "of", "the", "above"}, "examples": {"the", "public", "API", "and", "kit"}}
    assert documented == expected
    for folder, rooms in ROOMS.items():
        assert f"- `{folder}/`: " + " < ".join(f"`{room}`" for room in rooms) in text
    for room, below in KIT_ROOMS.items():
        names = ", ".join(f"`{name}`" for name in KIT if name in below) or "none of the kit"
        assert re.search(rf"^\| `yasps/{room}(/|\.py)` \| .* \| {re.escape(names)} \|$", text, re.MULTILINE), room


def test_an_installed_package_has_all_that_is_compiled_when_it_runs() -> None:
    """Whatever lies beside the Python files is named in pyproject.toml."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    patterns: dict[str, list[str]] = settings["tool"]["setuptools"]["package-data"]
    for folder in (*COMPILER, "examples"):
        packaged = {path for pattern in patterns.get(f"yasps.{folder}", []) for path in (ROOT / folder).glob(pattern)}
        beside = {
            path
            for path in (ROOT / folder).rglob("*")
            if path.is_file() and path.suffix not in {".py", ".pyc"} and "__pycache__" not in path.parts
        }
        assert beside == packaged


def test_no_command_goes_through_a_shell() -> None:
    calls = [
        (file.name, ast.unparse(node.func), {word.arg for word in node.keywords})
        for folder in (*COMPILER, *KIT, "examples")
        for file in python_files(folder)
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
    ]
    by_shell = {"os.system", "os.popen", "subprocess.getoutput", "subprocess.getstatusoutput"}
    assert not [call for call in calls if call[1] in by_shell or "shell" in call[2]]
    assert len([call for call in calls if call[1].startswith("subprocess.")]) >= 6
