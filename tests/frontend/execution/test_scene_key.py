"""A scene that was compiled before comes from the cache: code and results are those of the passes."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from small_scenes import SCENES

import yasps
from yasps import Scene
from yasps.backend.codegen.scene_code import SceneCode
from yasps.backend.cpp.object import CppEmitter
from yasps.frontend.execution import scene_source
from yasps.frontend.execution.emit import SceneEmitter
from yasps.frontend.execution.scene_key import ENDINGS, SOURCES, digest_of_sources, text_of_key
from yasps.frontend.execution.scene_source import CompileRequest, SceneSource
from yasps.passes.pipeline import LIFTING, run_pipeline


def chain(count: int, *, stiffness: float = 2.0, exponent: int = 2) -> Scene:
    """Springs in a row."""
    scene = Scene("chain")
    mesh = scene.add_mesh("m")
    points = mesh.add_primitive("points", count)
    x = points.add_attribute("x", 3, 1, value=np.arange(3.0 * count).reshape(-1, 3))
    springs = mesh.add_primitive("springs", count - 1)
    ends = springs.add_connectivity("ends", points, [[k, k + 1] for k in range(count - 1)], 2)
    p = springs.add_attribute("p", through=ends, source=x)
    length = (p.row(0) - p.row(1)).norm()
    scene.add_energy(springs.add_attribute("E", computed_attribute=stiffness * (length - 1.0) ** exponent))
    scene.add_minimize_target(x)
    return scene


def key(scene: Scene) -> str:
    module = SceneEmitter(scene.name).emit(scene._energies, scene._targets, [])
    return text_of_key(run_pipeline(module, passes=LIFTING))


def test_sizes_and_numbers_do_not_matter_and_everything_else_does() -> None:
    assert key(chain(4)) == key(chain(9))
    assert key(chain(4, stiffness=2.5)) == key(chain(4, stiffness=7.5))
    assert key(chain(4)) != key(chain(4, exponent=3))
    assert key(chain(4, stiffness=2.0)) != key(chain(4, stiffness=2.5))  # 2 is structure


def test_the_module_keeps_its_sizes_and_numbers() -> None:
    module = SceneEmitter("chain").emit(chain(4, stiffness=2.5)._energies, [], [])
    run_pipeline(module, passes=LIFTING)
    text = str(module)
    assert "size" not in text_of_key(module)
    assert "2.5" not in text_of_key(module)
    assert str(module) == text
    assert "size 4" in text
    assert "numbers 2.5" in text


def test_an_equal_scene_runs_no_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng()
    known, new = random.uniform(3, 4, 2)  # no cache has seen these numbers
    gradient = chain(5, stiffness=known).gradient()
    ran: list[object] = []

    def noted(*arguments: object, **options: object) -> object:
        ran.append(options["passes"])
        return run_pipeline(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(scene_source, "run_pipeline", noted)
    again = chain(5, stiffness=known)
    np.testing.assert_array_equal(again.gradient()[0], gradient[0])
    chain(12, stiffness=known).gradient()
    assert ran == []
    np.testing.assert_allclose(chain(5, stiffness=new).gradient()[0], new / known * gradient[0], rtol=1e-12)
    assert ran == [LIFTING]
    assert "rel.object" in str(again.compile().module)


# -- what the key is made of -------------------------------------------------------------------------------------------

PACKAGE = Path(yasps.__file__).parent


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the package that may be changed."""
    for folder in SOURCES:
        shutil.copytree(PACKAGE / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_the_same_files_elsewhere_have_the_same_digest(package: Path) -> None:
    assert digest_of_sources(package, "1") == digest_of_sources(PACKAGE, "1")
    assert digest_of_sources(package, "1") != digest_of_sources(package, "2")


def test_changing_any_source_file_changes_the_digest(package: Path) -> None:
    """Device code too: a changed .cuh once left old kernels in use."""
    files = [path for path in package.rglob("*") if path.is_file() and path.suffix != ".pyi"]  # of type checkers
    assert {path.suffix for path in files} == set(ENDINGS)  # a new kind of source must be read as well
    whole = digest_of_sources(package, "")
    chosen = {(path.suffix, path.parent): path for path in files}  # of each folder one of each kind
    assert len(chosen) > len(ENDINGS)
    for path in chosen.values():
        text = path.read_text(encoding="utf-8")
        path.write_text(text + " ", encoding="utf-8")
        assert digest_of_sources(package, "") != whole, path
        path.write_text(text, encoding="utf-8")
    assert digest_of_sources(package, "") == whole
    files[0].rename(files[0].with_name("renamed.py"))
    assert digest_of_sources(package, "") != whole


def test_each_entry_of_the_key_makes_new_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YASPS_CACHE", str(tmp_path))
    tmp_path.chmod(0o700)
    generated: list[int] = []
    emitted = SceneCode.of

    def noted(*arguments: object) -> SceneCode:
        generated.append(1)
        return emitted(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(SceneCode, "of", noted)

    def generate(**options: bool) -> int:
        """How often code is generated for a scene."""
        scene = chain(4, stiffness=3.7, exponent=4)
        request = CompileRequest("chain", scene._energies, scene._targets)
        del generated[:]
        has_vector_math = options.get("has_vector_math", True)
        SceneSource(request, lambda view: CppEmitter(view, has_vector_math), [str(has_vector_math)])
        return len(generated)

    generate()
    assert generate() == 0
    assert generate(has_vector_math=False) == 1
    monkeypatch.setattr(scene_source, "compiler_digest", lambda: "another compiler")
    assert generate() == 1
    assert generate() == 0


@pytest.mark.parametrize("name", sorted(SCENES))
def test_text_and_back(name: str) -> None:
    scene = SCENES[name]()
    module = run_pipeline(SceneEmitter("s").emit(scene._energies, scene._targets, []))
    code = SceneCode.of(module, lambda view: CppEmitter(view, True))
    assert SceneCode.from_text(code.to_text()) == code
