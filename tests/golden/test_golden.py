"""What the compiler makes of three small scenes, kept as text: every change of it is seen in review.

`pytest --update-golden` writes the files anew. The generated C++ is kept without its preludes, which are files of their
own, and with hashes replaced by what they stand for; of the CUDA C++ one kernel of derivatives, over a UNION.
"""

from __future__ import annotations

import difflib
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from xdsl.parser import Parser

from yasps import Scene, concat_rows
from yasps.backend.codegen.object_text import ObjectEmitter
from yasps.backend.codegen.preludes import without_preludes
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cpp.object import CppEmitter
from yasps.backend.cuda.object import CudaEmitter
from yasps.frontend.execution.emit import SceneEmitter
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import PIPELINE, make_context, run_pipeline

FOLDER = Path(__file__).parent
CUDA = ("both.pp.barrier.derivative",)
"""What is kept as CUDA C++ too."""
SHOWN = 60
"""Lines of a difference; the whole is one `git diff` away."""


def soft_tets() -> Scene:
    """One tetrahedron with a volume energy and gravity: JOIN, a linear cut of 9 of 12 entries, constants."""
    scene = Scene("soft_tets")
    mesh = scene.add_mesh("m")
    vertices, tets = mesh.add_primitive("v", 4), mesh.add_primitive("t", 1)
    corners = tets.add_connectivity("corners", vertices, [0, 1, 2, 3], 4)
    vertices.add_constant("mass", 1, 1, value=[1.0] * 4)
    position = vertices.add_attribute("x", 3, 1, value=[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    x = tets.add_attribute("x", through=corners, source=position)
    edges = concat_rows([x.row(i) - x.row(0) for i in (1, 2, 3)])
    excess = edges.det() - 0.5
    scene.add_energy(tets.add_attribute("swell", computed_attribute=3.0 * excess * excess))
    scene.add_energy(vertices.add_attribute("gravity", computed_attribute=9.8 * vertices["mass"] * position[1]))
    scene.add_minimize_target(position)
    return scene


def mixed_union() -> Scene:
    """The union of a free point, the points of an affine body and a fixed one, and a barrier between pairs of it."""
    scene = Scene("mixed_union")
    soft, stiff, still, both = (scene.add_mesh(name) for name in ("soft", "stiff", "still", "both"))
    free = soft.add_primitive("v", 1)
    free.add_attribute("x", 3, 1, value=[0.0, 0.0, 1.0])
    body, points = stiff.add_primitive("body", 1), stiff.add_primitive("v", 2)
    matrix = body.add_attribute("A", 3, 3, value=np.eye(3))
    shift = body.add_attribute("t", 3, 1, value=[0.0, 0.0, 0.1])
    rest = points.add_constant("rest", 3, 1, value=[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    owner = points.add_connectivity("owner", body, [0, 0], 1)
    a = points.add_attribute("A", through=owner, source=matrix).resize(3, 3)
    t = points.add_attribute("t", through=owner, source=shift).resize(3, 1)
    points.add_attribute("x", computed_attribute=a * rest + t)
    fixed = still.add_primitive("v", 1)
    fixed.add_constant("x", 3, 1, value=[0.0, 1.0, 0.0])
    union = both.add_primitive_union("v", [free, points, fixed])
    contacts = both.add_primitive("pp", 0, is_dynamic=True)
    ends = contacts.add_connectivity("ends", union, [], 2)
    pair = contacts.add_attribute("pair", through=ends, source=union.add_attribute("x"))
    between = pair.row(1) - pair.row(0)
    squared = between.dot(between)
    log, gap = (squared / 2.5).log(), squared - 2.5
    scene.add_energy(contacts.add_attribute("barrier", computed_attribute=gap * gap * log * log))
    ends.update_value([[0, 1], [2, 3], [1, 2]])
    scene.add_minimize_target([free["x"], matrix, shift])
    return scene


def lever() -> Scene:
    """Springs between tips of arms that turn by an angle: a nonlinear parameterisation, so curvature functions."""
    scene = Scene("lever")
    mesh = scene.add_mesh("m")
    arms, tips, springs = mesh.add_primitive("arms", 2), mesh.add_primitive("tips", 2), mesh.add_primitive("springs", 1)
    angle = arms.add_attribute("angle", 1, 1, value=[0.1, 0.4])
    length = tips.add_constant("length", 1, 1, value=[1.0, 1.5])
    arm = tips.add_connectivity("arm", arms, [0, 1], 1)
    a = tips.add_attribute("angle", through=arm, source=angle)
    tips.add_attribute("x", computed_attribute=concat_rows([length * a.cos(), length * a.sin()]))
    ends = springs.add_connectivity("ends", tips, [0, 1], 2)
    pair = springs.add_attribute("pair", through=ends, source=tips["x"])
    between = pair.row(1) - pair.row(0)
    scene.add_energy(springs.add_attribute("stretch", computed_attribute=0.5 * between.dot(between)))
    scene.add_minimize_target(angle)
    return scene


SCENES: dict[str, Callable[[], Scene]] = {f.__name__: f for f in (soft_tets, mixed_union, lever)}


def made_of(scene: Scene) -> dict[str, str]:
    """Text of every stage and every generated file, by the names `dump_ir` gives them."""
    module = SceneEmitter(scene.name).emit(scene._energies, scene._targets, [])
    texts: dict[str, str] = {}

    def after(name: str, current: object) -> None:
        texts[f"{len(texts):02d}-{name}.mlir"] = text_of(module)

    run_pipeline(module, None, after)
    texts |= generated(CppEmitter(SceneView(module), has_vector_math=True), "cpp")  # as on any Linux with glibc
    for name, text in generated(CudaEmitter(SceneView(module)), "cu").items():
        if name in {f"generated/{kept}.cu" for kept in CUDA}:
            texts[name] = text
    return texts


def generated(emitter: ObjectEmitter, ending: str) -> dict[str, str]:
    """The files of one language, by the names `dump_ir` gives them."""
    emitter.emit_all()
    codes = [code for code in emitter.codes.values() if code.entries]
    owners: dict[str, str] = {}
    for code in codes:  # equal objects share a hash: the first names it
        owners.setdefault(code.symbol, code.name)

    def named(text: str) -> str:
        return re.sub(r"yasps_[0-9a-f]{20}", lambda match: f"yasps<{owners[match[0]]}>", text)

    return {f"generated/{code.name}.{ending}": named(without_preludes(code.text)) for code in codes}


def difference(old: dict[str, str], new: dict[str, str]) -> str:
    """A unified diff, cut off; empty where nothing differs."""
    lines: list[str] = []
    for name in sorted(old.keys() | new.keys()):
        before, now = (texts.get(name, "").splitlines() for texts in (old, new))
        lines += difflib.unified_diff(before, now, f"golden/{name}", f"now/{name}", lineterm="")
    if len(lines) > SHOWN:
        lines[SHOWN:] = [f"... and {len(lines) - SHOWN} lines more"]
    return "\n".join(lines)


def read(folder: Path) -> dict[str, str]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8") for path in files}


def write(folder: Path, texts: dict[str, str]) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


@pytest.mark.parametrize("name", SCENES)
def test_what_is_made_of_a_scene(name: str, request: pytest.FixtureRequest) -> None:
    new = made_of(SCENES[name]())
    if request.config.getoption("--update-golden"):
        write(FOLDER / name, new)
    changes = difference(read(FOLDER / name), new)
    assert not changes, f"\n{changes}\n\nIf that is meant: pytest --update-golden tests/golden, and look at git diff."


@pytest.mark.parametrize("name", SCENES)
def test_kept_stages_parse_back(name: str) -> None:
    stages = sorted((FOLDER / name).glob("*.mlir"))
    assert len(stages) == len(PIPELINE) + 1
    for path in stages:
        text = path.read_text(encoding="utf-8")
        module = Parser(make_context(), text).parse_module()
        module.verify()
        assert text_of(module) == text, path.name


def test_differences_are_readable_and_short() -> None:
    old = {"a": "one\ntwo\n", "gone": "x\n"}
    assert difference(old, old) == ""
    assert difference(old, {"a": "one\n2\n", "gone": "x\n"}).splitlines()[-3:] == [" one", "-two", "+2"]
    assert "--- golden/gone" in difference(old, {"a": "one\ntwo\n"})
    long = difference({"a": "x\n" * 500}, {"a": "y\n" * 500}).splitlines()
    assert len(long) == SHOWN + 1
    assert long[-1].endswith("lines more")


def test_updating_leaves_nothing_old(tmp_path: Path) -> None:
    write(tmp_path / "s", {"a": "1\n", "generated/b": "2\n"})
    write(tmp_path / "s", {"a": "3\n"})
    assert read(tmp_path / "s") == {"a": "3\n"}
