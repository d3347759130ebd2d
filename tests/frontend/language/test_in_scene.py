"""What belongs to a scene: it can't be copied, and its name may be any that its users need."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yasps import Scene, SceneError
from yasps.contact import BarrierContact, CollisionGeometry
from yasps.frontend.commands import yasps_opt
from yasps.stepping import MovingPart, TimeStepper

COPIES: list[Callable[[Any], object]] = [copy.copy, copy.deepcopy, pickle.dumps]


def parent_scene(name: str) -> Scene:
    """Links of a chain, each hanging on its parent by a spring of rest length 0; the scene, and what is in it, have
    names that are also those of parts of yasps."""
    scene = Scene(name)
    mesh = scene.add_mesh("m")
    links = mesh.add_primitive("links", 3)
    x = links.add_attribute("x", 3, 1, value=np.arange(9.0))
    parent = links.add_connectivity("parent", links, [0, 0, 1], 1)
    ends = links.add_attribute("ends", through=parent, source=x)
    offset = x - ends.reshape(3, 1)
    scene.add_energy(links.add_attribute("pull", computed_attribute=0.5 * offset.dot(offset) + x.dot(x)))
    scene.add_minimize_target(x)
    return scene


@pytest.fixture(scope="module")
def solved() -> Scene:
    """A scene that has been compiled."""
    scene = parent_scene("chain")
    scene.minimize_energy()
    return scene


def test_a_connectivity_may_be_called_parent(solved: Scene) -> None:
    links = solved.m.links
    assert links.parent is links.connectivities["parent"]
    assert links.path == "m.links"
    np.testing.assert_array_equal(links["ends"].compute().array.reshape(3, 3), [[0, 1, 2], [0, 1, 2], [3, 4, 5]])


@pytest.mark.parametrize("name", ["parent", "kind"])
def test_names_that_only_yasps_itself_used_are_free(name: str) -> None:
    scene = Scene("s")
    mesh = scene.add_mesh(name)
    primitive = mesh.add_primitive(name, 2)
    connectivity = primitive.add_connectivity(name, primitive, [0, 1], 1)
    assert (getattr(scene, name), getattr(mesh, name), getattr(primitive, name)) == (mesh, primitive, connectivity)
    assert connectivity.path == f"{name}.{name}.{name}"
    assert primitive.lineage() == [primitive, mesh, scene]


def test_a_mesh_may_be_called_as_the_scene_is(
    solved: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = parent_scene("m")
    assert scene.m.path == "m"
    assert scene.minimize_energy()[0].tolist() == solved.minimize_energy()[0].tolist()
    scene.dump_ir(tmp_path)
    for dump in sorted(tmp_path.glob("*.mlir")):
        assert yasps_opt.main([str(dump), "--interpret", str(tmp_path / "data.npz")]) == 0
        assert f"value {scene.total_energy():.12g}" in capsys.readouterr().out


def test_an_attribute_may_be_called_as_the_scene_is() -> None:
    scene = Scene("dt")
    dt = scene.add_attribute("dt", 1, 1, value=2.0)
    scene.add_energy(scene.add_attribute("energy", computed_attribute=(dt - 5.0) * (dt - 5.0)))
    scene.add_minimize_target(dt)
    np.testing.assert_allclose(scene.minimize_energy()[0], [-3.0])


@pytest.mark.parametrize("make_copy", COPIES)
@pytest.mark.parametrize(
    ("part", "said"),
    [
        (lambda s: s, "<scene chain"),
        (lambda s: s.m, "<mesh m"),
        (lambda s: s.m.links, "<primitive m.links"),
        (lambda s: s.m.links.parent, "<connectivity m.links.parent"),
        (lambda s: s.m.links["x"], "<stored attribute m.links.x"),
        (lambda s: s.m.links["x"] * 2.0, "<computed attribute"),
        (lambda s: s.compile(), "CpuScene"),
        (lambda s: [s.m.links["x"], 3], "<stored attribute m.links.x"),
    ],
)
def test_parts_of_a_scene_are_not_copied(
    solved: Scene, part: Callable[[Scene], Any], said: str, make_copy: Callable[[Any], object]
) -> None:
    thing = part(solved)
    if isinstance(thing, list) and make_copy is copy.copy:
        return  # a new list of the same
    with pytest.raises(SceneError) as caught:
        make_copy(thing)
    assert said in str(caught.value)
    assert "update_value" in str(caught.value)


def test_a_scene_that_was_never_compiled_is_not_copied_either() -> None:
    """Its copy would share the meshes, which say that they are of the first."""
    for make_copy in COPIES:
        with pytest.raises(SceneError):
            make_copy(Scene("s"))


@pytest.mark.parametrize("make_copy", COPIES)
def test_what_owns_memory_of_the_runtime_is_not_copied(make_copy: Callable[[Any], object]) -> None:
    corners, faces = np.vstack([np.zeros(3), np.eye(3)]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    vertices = mesh.add_primitive("v", 4)
    x = vertices.add_attribute("position", 3, 1, value=corners)
    part = MovingPart(x, vertices.add_constant("p", 3, 1), vertices.add_constant("mass", 1, 1))
    for thing in (
        BarrierContact(mesh, vertices, faces, activation_distance=0.01, barrier="paper", stiffness=1.0),
        TimeStepper(scene, [part], 0.01),
    ):
        with pytest.raises(SceneError, match=type(thing).__name__):
            make_copy(thing)
    geometry = CollisionGeometry(corners, faces, 0.1, runtime=scene.runtime)
    for owner in (geometry, scene.runtime, geometry._surface):
        with pytest.raises(TypeError, match=f"{type(owner).__name__} can't be copied or pickled"):
            make_copy(owner)


@pytest.mark.parametrize("make_copy", COPIES)
def test_results_are_ones_own(solved: Scene, make_copy: Callable[[Any], object]) -> None:
    for result in (solved.solve(), solved.hessian(), solved.compile_report, solved.m.links["ends"].compute()):
        make_copy(result)
