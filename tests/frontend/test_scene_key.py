"""A scene that was compiled before comes from the cache: code and results are those of the passes."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import SCENES

from yasps import Scene
from yasps.backend.cpp_object import CppEmitter
from yasps.backend.scene_code import SceneCode
from yasps.frontend import scene_source
from yasps.frontend.emit import SceneEmitter
from yasps.frontend.scene_key import text_without_sizes
from yasps.passes.pipeline import run_pipeline


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
    return text_without_sizes(SceneEmitter(scene.name).emit(scene._energies, scene._targets, []))


def test_sizes_do_not_matter_and_everything_else_does() -> None:
    assert key(chain(4)) == key(chain(9))
    assert key(chain(4)) != key(chain(4, stiffness=2.5))
    assert key(chain(4)) != key(chain(4, exponent=3))


def test_the_module_keeps_its_sizes() -> None:
    module = SceneEmitter("chain").emit(chain(4)._energies, [], [])
    text_without_sizes(module)
    assert "size 4" in str(module)


def test_an_equal_scene_runs_no_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    gradient = chain(5).gradient()

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a pass ran")

    monkeypatch.setattr(scene_source, "run_pipeline", refuse)
    again = chain(5)
    np.testing.assert_array_equal(again.gradient()[0], gradient[0])
    chain(12).gradient()
    with pytest.raises(AssertionError, match="a pass ran"):
        chain(5, stiffness=np.random.default_rng().uniform()).gradient()  # no cache has seen this number
    monkeypatch.undo()
    assert "rel.object" in str(again.compile().module)


@pytest.mark.parametrize("name", sorted(SCENES))
def test_text_and_back(name: str) -> None:
    scene = SCENES[name]()
    module = run_pipeline(SceneEmitter("s").emit(scene._energies, scene._targets, []))
    code = SceneCode.of(module, lambda view: CppEmitter(view, True))
    assert SceneCode.from_text(code.to_text()) == code
